//! Output that counts its bytes.

use std::io::{self, Write};

/// Output that counts the written bytes.
pub(super) struct CountingWriter<W> {
    pub(super) inner: W,
    pub(super) bytes: u64,
}

impl<W: Write> Write for CountingWriter<W> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(buffer)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
