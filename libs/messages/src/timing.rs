//! Timing and heartbeat of a process, the recorder's credit, and injected faults.

use crate::message::Message;
use crate::wire_struct::wire_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

wire_struct! {
    /// Times of a process in a tick, by the monotonic clock; also its heartbeat.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct Timing {
        /// Code of [`Process`](crate::Process).
        pub process: u32,
        /// Code of [`Phase`](crate::Phase).
        pub phase: u32,
        /// Tick of the report; -1 before the first.
        pub tick: i64,
        /// Publication time of the input that started the tick; for the plant the due time of its timer [ns].
        pub due_ns: u64,
        /// Wake-up time [ns].
        pub wake_ns: u64,
        /// Publication time of the output [ns]; zero if there is none.
        pub publish_ns: u64,
        /// Time from the state to its command, published (gate) or received (plant) [ns]; zero if the command was late.
        pub latency_ns: u64,
        /// Heap allocations of the thread between receiving and sending, in this tick.
        pub allocations: u32,
        /// Messages rejected since the start.
        pub rejected: u32,
        /// Page faults of the thread since it started to run, minor and major.
        pub page_faults: u32,
        /// Real-time privileges in use, bits: 1 `SCHED_FIFO`, 2 memory locked, 4 pinned to its core.
        pub realtime: u32,
        /// Number of this start of the process: 0 for the first.
        pub generation: u32,
        /// Failed connections since the start.
        pub failed_connections: u32,
    }
}

impl Message for Timing {
    const NAME: &str = "hapfic.Timing";
}

wire_struct! {
    /// Order to a process to inject a fault into its messages.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
    pub struct Injection {
        /// Counts up from 1, so that a process takes each injection once.
        pub number: u64,
        /// First tick of the fault; the next tick if that has passed.
        pub tick: i64,
        /// Duration of the fault [ticks].
        pub ticks: u32,
        /// Code of the [`Process`](crate::Process) that injects it.
        pub process: u32,
        /// Code of [`MessageFault`](crate::MessageFault).
        pub message_fault: u32,
        /// Delay of a slow process [us].
        pub by_us: u32,
    }
}

impl Message for Injection {
    const NAME: &str = "hapfic.Injection";
}

wire_struct! {
    /// Credit of the recorder to the plant: in lockstep the plant may run ahead of it by a bounded number of ticks.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct Credit {
        /// Last tick the plant may publish.
        pub tick: i64,
    }
}

impl Message for Credit {
    const NAME: &str = "hapfic.Credit";
}
