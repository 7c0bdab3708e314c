//! One file for each thing the program can do.

pub mod check;
pub mod process;
pub mod run;
pub mod scenarios;
