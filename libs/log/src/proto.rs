//! The messages of a log, generated from `proto/hapfic.proto`.
#![allow(missing_docs, clippy::all, clippy::pedantic, clippy::nursery)]

include!(concat!(env!("OUT_DIR"), "/hapfic.rs"));

/// The descriptor set (`google.protobuf.FileDescriptorSet`) of all messages above: the schema that logs carry.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/hapfic.bin"));
