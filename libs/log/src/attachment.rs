//! Attachments: files inside a log.

/// File inside a log, such as the scenario of the run.
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
    /// Most bytes of content. The reader treats a longer attachment as a damaged length.
    pub const LARGEST: usize = 32 << 20;
}
