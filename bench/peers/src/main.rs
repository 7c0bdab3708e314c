//! `hapfic-peers`: chains of three hops over what users would otherwise pick. `hapfic bench latency --peers hapfic-peers` measures
//! them beside the stack's own chain.
//!
//! Each is set up as its manual tells who wants short latencies, waits without spinning, and does nothing else. Whatever threads it
//! starts have the priority and the core that it was given.

mod iceoryx;
mod place;
mod zenoh_chain;
mod zeromq_chain;
#[cfg(feature = "libzmq")]
mod zmq_chain;

use hapfic_diagnostics::Kind;
use std::process::ExitCode;

fn main() -> ExitCode {
    let kinds: &[&dyn Kind] = &[
        &iceoryx::IceoryxEvent,
        &zenoh_chain::Zenoh { shared_memory: true },
        &zenoh_chain::Zenoh { shared_memory: false },
        &zeromq_chain::ZeroMq,
        #[cfg(feature = "libzmq")]
        &zmq_chain::LibZmq,
    ];
    let code = hapfic_diagnostics::main(kinds);
    // The relays, which could not do it themselves, have ended by now.
    place::clean_up();
    if std::env::args().any(|word| word == zenoh_chain::WITH_MEMORY) {
        zenoh::shm::cleanup_orphaned_shm_segments();
    }
    code
}
