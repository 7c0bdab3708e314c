//! Compiles the schemas of the log into Rust types and the descriptor set that every log carries.

use prost::Message;
use std::error::Error;
use std::path::PathBuf;
use std::{env, fs};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=proto/hapfic.proto");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mut descriptors = protox::compile(["proto/hapfic.proto"], ["proto"])?;
    prost_build::Config::new()
        // Comparisons of sets serialize them, so that they include every new parameter.
        .type_attribute(".hapfic.Operator", "#[derive(serde::Serialize)]")
        .compile_fds(descriptors.clone())?;
    // Only rustdoc uses the comments. Without them the schema in a log has a quarter of the size.
    for file in &mut descriptors.file {
        file.source_code_info = None;
    }
    fs::write(out.join("hapfic.bin"), descriptors.encode_to_vec())?;
    Ok(())
}
