//! A file carried inside a log.

/// A file carried inside a log, such as the scenario it was recorded with.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attachment {
    /// File name, `scenario.toml`.
    pub name: String,
    /// Media type, `application/toml`.
    pub media_type: String,
    /// Content, at most [`Attachment::LARGEST`] bytes.
    pub bytes: Vec<u8>,
}

impl Attachment {
    /// Most bytes of content; more could not be told from a damaged length when the log is read.
    pub const LARGEST: usize = 32 << 20;
}
