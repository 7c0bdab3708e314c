//! A disk that runs full.

use crate::samples::{attachments, header, log, names, write_tick};
use hapfic_log::{LogError, Writer, WriterOptions};
use std::io::{self, Write};
use std::path::Path;

/// Takes so many bytes and no more.
struct Disk {
    room: usize,
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.room == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let taken = bytes.len().min(self.room);
        self.room -= taken;
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

const TICKS: i64 = 6;
const OPTIONS: WriterOptions = WriterOptions { start_unix_ns: 0, chunk_bytes: 4096 };

fn write_all(room: usize) -> Result<(), LogError> {
    let mut writer = Writer::new(Disk { room }, Path::new("/data/run.mcap"), &names(), &header(), &attachments(), &OPTIONS)?;
    for tick in 0..TICKS {
        if let Err(error) = write_tick(&mut writer, tick) {
            assert!(writer.flush().is_err(), "a flush after {error} claims that all is written");
            assert!(writer.sync().is_err(), "so does a sync");
            assert!(write_tick(&mut writer, tick).is_err(), "a message after {error} is taken");
            drop(writer);
            return Err(error);
        }
    }
    writer.finish().map(|_| ())
}

#[test]
fn is_reported_wherever_it_happens_and_never_panics() {
    let size = log(TICKS, &OPTIONS).len();
    write_all(size).expect("the disk is large enough");
    for room in (0..size).step_by(211).chain([size - 1]) {
        let error = write_all(room).expect_err("the disk is too small");
        assert!(matches!(error, LogError::Write { .. }), "{error:?}");
        assert!(error.to_string().starts_with("/data/run.mcap: cannot write the log"), "{error}");
    }
}
