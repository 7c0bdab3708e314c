//! Sampler: reads decisions from the bytes of an input.
//!
//! Thus messages, which are not text, are mutated as bytes too, and an input file always gives the same messages.

/// Reader of decisions; zeros after the last byte.
pub(super) struct Sampler<'a> {
    bytes: &'a [u8],
}

impl<'a> Sampler<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    pub(super) fn byte(&mut self) -> u8 {
        match self.bytes.split_first() {
            Some((&byte, rest)) => {
                self.bytes = rest;
                byte
            }
            None => 0,
        }
    }

    /// Returns a number below `count`, which is 1 to 256.
    pub(super) fn below(&mut self, count: usize) -> usize {
        usize::from(self.byte()) % count
    }

    fn word(&mut self) -> u64 {
        (0..8).fold(0_u64, |word, _| (word << 8) | u64::from(self.byte()))
    }

    /// Returns a replacement for a number.
    pub(super) fn number(&mut self, old: f64) -> f64 {
        const SPECIAL: [f64; 12] = [
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            0.0,
            -0.0,
            5e-324,
            f64::MIN_POSITIVE,
            f64::MAX,
            f64::MIN,
            1.0,
            1e100,
            -1e-100,
        ];
        match self.byte() % 8 {
            0 => SPECIAL[self.below(SPECIAL.len())],
            1 => f64::from_bits(self.word()),
            2 => -old,
            // Scaled by 1e-32 to 1e31.
            3 => old * 10_f64.powi(i32::from(self.byte() % 64) - 32),
            // From 1e-300 to 1e300.
            4 => 10_f64.powi(i32::from(self.byte()) * 600 / 255 - 300),
            5 => f64::from(i16::from_be_bytes([self.byte(), self.byte()])) / 4096.0,
            6 => old + f64::from(i16::from_be_bytes([self.byte(), self.byte()])) * 1e-6,
            _ => old.next_up(),
        }
    }

    /// Returns a replacement for a code, a count or a flag.
    pub(super) fn code(&mut self, old: u32) -> u32 {
        match self.byte() % 8 {
            0 => u32::MAX,
            1 => self.word() as u32,
            2 => old.wrapping_add(1),
            3 => old ^ 1,
            _ => u32::from(self.byte() % 12),
        }
    }

    /// Returns a replacement for a time, a version or a number of ticks.
    pub(super) fn count(&mut self, old: u64) -> u64 {
        match self.byte() % 8 {
            0 => u64::MAX,
            1 => 0,
            2 => self.word(),
            3 => old.wrapping_add(1),
            4 => old.wrapping_sub(1),
            5 => 1_u64 << (self.byte() % 64),
            _ => old.wrapping_add(self.byte().into()),
        }
    }

    /// Returns a replacement for a tick.
    pub(super) fn tick(&mut self, old: i64) -> i64 {
        match self.byte() % 8 {
            0 => i64::MAX,
            1 => i64::MIN,
            _ => self.count(old as u64) as i64,
        }
    }
}
