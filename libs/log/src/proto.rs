//! Messages of a log, generated from `proto/hapfic.proto`.
#![allow(missing_docs, clippy::all, clippy::pedantic, clippy::nursery)]

include!(concat!(env!("OUT_DIR"), "/hapfic.rs"));

/// Descriptor set (`google.protobuf.FileDescriptorSet`) of all messages above: the schema in every log.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/hapfic.bin"));
