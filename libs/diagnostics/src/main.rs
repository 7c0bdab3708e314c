//! `hapfic-chain`: the chains over what the kernel offers as a program of their own; the pattern of any other peer.

use std::process::ExitCode;

fn main() -> ExitCode {
    hapfic_diagnostics::main(&hapfic_diagnostics::own())
}
