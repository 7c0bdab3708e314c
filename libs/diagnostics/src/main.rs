//! `hapfic-chain`: the chains over the kernel's transports as a separate program; the pattern of any other peer.

use std::process::ExitCode;

fn main() -> ExitCode {
    hapfic_diagnostics::main(&hapfic_diagnostics::kernel_kinds())
}
