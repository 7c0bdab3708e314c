//! Full disk.

use crate::samples::{attachments, header, log, names, write_tick};
use hapfic_log::{LogError, Writer, WriterOptions};
use std::io::{self, Write};
use std::path::Path;

/// Output with a limited capacity [bytes].
struct Disk {
    free: usize,
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.free == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let written = bytes.len().min(self.free);
        self.free -= written;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

const TICKS: i64 = 6;
const OPTIONS: WriterOptions =
    WriterOptions { start_unix_ns: 0, chunk_bytes: 4096, in_parts: false, part_bytes: None, keep_bytes: None };

fn write_all(free: usize) -> Result<(), LogError> {
    let mut writer = Writer::new(Disk { free }, Path::new("/data/run.mcap"), &names(), &header(), &attachments(), &OPTIONS)?;
    for tick in 0..TICKS {
        if let Err(error) = write_tick(&mut writer, tick) {
            assert!(writer.flush().is_err(), "a flush after {error} succeeds");
            assert!(writer.sync().is_err(), "a sync after {error} succeeds");
            assert!(write_tick(&mut writer, tick).is_err(), "a message after {error} is accepted");
            drop(writer);
            return Err(error);
        }
    }
    writer.finish().map(|_| ())
}

#[test]
fn writer_full_disk_is_reported_at_any_byte() {
    let size = log(TICKS, &OPTIONS).len();
    write_all(size).expect("the disk is large enough");
    for free in (0..size).step_by(211).chain([size - 1]) {
        let error = write_all(free).expect_err("the disk is too small");
        assert!(matches!(error, LogError::Write { .. }), "{error:?}");
        assert!(error.to_string().starts_with("/data/run.mcap: cannot write the log"), "{error}");
    }
}
