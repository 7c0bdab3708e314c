//! One file for each thing the program can do.

pub mod check;
pub mod nuisance;
pub mod order;
pub mod process;
pub mod recover;
pub mod report;
pub mod run;
pub mod scenarios;
pub mod status;
pub mod stop;
pub mod timeline;
