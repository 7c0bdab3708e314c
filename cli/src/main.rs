//! The program `hapfic`; all of it is in the library.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: hapfic_ipc::allocations::Counting = hapfic_ipc::allocations::Counting;

fn main() -> ExitCode {
    hapfic_cli::main()
}
