//! A file carried inside a log.

/// A file carried inside a log, such as the scenario it was recorded with.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attachment {
    /// File name, `scenario.toml`.
    pub name: String,
    /// Media type, `application/toml`.
    pub media_type: String,
    /// Content, at most 64 MiB.
    pub bytes: Vec<u8>,
}
