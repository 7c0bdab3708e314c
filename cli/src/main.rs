//! The program `hapfic`; the library holds all of it.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: hapfic_ipc::allocations::CountingAllocator = hapfic_ipc::allocations::CountingAllocator;

fn main() -> ExitCode {
    hapfic_cli::main()
}
