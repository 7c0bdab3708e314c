//! `hapfic-peers`: chains of three hops over other transports.
//!
//! `hapfic bench latency --peers hapfic-peers` measures them beside the stack's own chain. Each transport has the
//! settings that its manual recommends for short latencies, waits without spinning, and does no other work. Its threads
//! inherit priority and core.

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
    // The relays cannot remove their files; all of them have ended here.
    place::clean_up();
    if std::env::args().any(|word| word == zenoh_chain::WITH_MEMORY) {
        zenoh::shm::cleanup_orphaned_shm_segments();
    }
    code
}
