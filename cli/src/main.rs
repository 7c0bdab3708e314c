//! The program `hapfic`; the library holds all of it.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: hapfic_ipc::allocations::Counting = hapfic_ipc::allocations::Counting;

fn main() -> ExitCode {
    hapfic_cli::main()
}
