//! Compiles the schemas of the log: Rust types, and the descriptor set that every log carries.

use prost::Message;
use std::error::Error;
use std::path::PathBuf;
use std::{env, fs};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=proto/hapfic.proto");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mut descriptors = protox::compile(["proto/hapfic.proto"], ["proto"])?;
    prost_build::Config::new()
        // So that a parameter that is added comes along wherever sets are compared.
        .type_attribute(".hapfic.Operator", "#[derive(serde::Serialize)]")
        .compile_fds(descriptors.clone())?;
    // The comments are of use to rustdoc alone; without them a log carries a quarter of the bytes.
    for file in &mut descriptors.file {
        file.source_code_info = None;
    }
    fs::write(out.join("hapfic.bin"), descriptors.encode_to_vec())?;
    Ok(())
}
