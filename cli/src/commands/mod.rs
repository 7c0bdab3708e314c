//! The commands of the program, one file each.

pub mod bench;
pub mod calibrate;
pub mod check;
pub mod control;
pub mod cross_check;
pub mod doctor;
pub mod process;
pub mod recover;
pub mod report;
pub mod run;
pub mod scenarios;
pub mod schema;
pub mod simulate;
pub mod status;
pub mod stop;
pub mod stressor;
pub mod timeline;
