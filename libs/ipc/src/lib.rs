//! Communication between the processes of the stack: topics and ports over iceoryx2, and real-time set-up.
//!
//! A process opens a [`Bus`] on the run's domain, takes [`Input`]s and [`Output`]s of the [`topic`]s it needs, and
//! loops: wait, read, check, step, publish, account.
//!
//! ```no_run
//! use hapfic_ipc::{Bus, Domain, Wait, topic};
//! # fn main() -> Result<(), hapfic_ipc::IpcError> {
//! let domain = Domain::new("hf1_", "/dev/shm/hf1")?;
//! let bus = Bus::open(&domain, "listener")?;
//! let mut state = bus.input(&topic::STATE, Wait::Yes)?;
//! hapfic_ipc::wait(&[&state], core::time::Duration::from_millis(100))?;
//! while let Some(sample) = state.next()? {
//!     let _ = sample.tick;
//! }
//! # Ok(())
//! # }
//! ```
//!
//! Besides this crate only `diagnostics` (which measures the machine) has `unsafe` code.
#![allow(unsafe_code)]

pub mod allocations;
mod arrival_predictor;
mod bus;
mod change_page;
pub mod clock;
mod context;
pub mod deadline_timer;
pub mod doorbell;
mod error;
mod gate_page;
mod heartbeat;
pub mod inject;
mod memory;
mod message_ring;
mod ownership;
mod plant_memory;
mod ports;
mod predecessor;
pub mod realtime;
mod recorder_page;
mod run;
pub mod run_status;
pub mod service;
mod shared_page;
mod supervisor_page;
pub mod topic;
mod wire;

pub use arrival_predictor::ArrivalPredictor;
pub use bus::{Bus, Domain, Wait};
pub use change_page::{CHANGES, ChangePage, Decision};
pub use context::{Context, Gaps, ProcessStart, TickTimes};
pub use deadline_timer::DeadlineTimer;
pub use doorbell::{Doorbell, Listener, Wakes, poll, wait};
pub use error::IpcError;
pub use gate_page::{GateLock, GatePage, Locked};
pub use heartbeat::{Heartbeat, HeartbeatPage};
pub use message_ring::KeptMessages;
pub use ownership::{Orphanhood, Ownership, tie_to_parent};
pub use plant_memory::PlantMemory;
pub use ports::{Input, Output, failed_connections};
pub use recorder_page::{LogPosition, RecorderPage};
pub use run::RunFile;
pub use run_status::SharedStatus;
pub use supervisor_page::{ProcessRecord, SupervisorPage, SupervisorRecord};
