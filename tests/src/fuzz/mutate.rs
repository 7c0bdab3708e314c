//! Mutation of inputs: by bits and bytes, and for text also by words and lines.

use super::target::FuzzTarget;
use fastrand::Rng;
use std::ops::Range;

/// Largest number of edits of one input.
const MAX_EDITS: usize = 6;
/// Largest number of repetitions of a piece: deep nesting, long lists.
const MAX_REPEATS: usize = 3000;
/// Largest length of most pieces [bytes].
const PIECE: usize = 32;

/// Boundary numbers, as text.
const NUMBERS: &[&str] = &[
    "0",
    "-0.0",
    "1",
    "-1",
    "3",
    "8",
    "9",
    "1.5",
    "1e-300",
    "5e-324",
    "1e-9",
    "1e6",
    "1e16",
    "1e154",
    "1.7976931348623157e308",
    "-1.7976931348623157e308",
    "1e309",
    "nan",
    "inf",
    "-inf",
    "255",
    "256",
    "65536",
    "2147483647",
    "2147483648",
    "4294967296",
    "9007199254740993",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "18446744073709551616",
    "99999999999999999999999999999999999999999999999",
    "0x7f",
    "1_000",
    "1979-05-27T07:32:00Z",
    "true",
];

/// Boundary numbers, as bytes of a record.
const WORDS: &[u64] = &[
    0,
    1,
    2,
    7,
    8,
    9,
    16,
    0x7f,
    0x80,
    0xff,
    0x100,
    0x7fff,
    0xffff,
    0x10_0000,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_fff0,
    0xffff_ffff,
    0x1_0000_0000,
    i64::MAX as u64,
    1 << 63,
    u64::MAX - 8,
    u64::MAX,
    f64::NAN.to_bits(),
    f64::INFINITY.to_bits(),
    f64::MAX.to_bits(),
];

/// Brackets, quotes and separators.
const PUNCTUATION: &[&str] = &[
    "[", "]", "[[", "]]", "{", "}", "\"", "'", "\"\"\"", "\n", "=", ".", ",", ":", "<", "/>", "</", ">", "<!--", "\0", " ",
    "\\u0000", "\u{feff}", "é", "a.", "{a=", "[1,", "<a>", "{\"a\":",
];

/// Makes an input from the existing ones.
pub(super) fn mutated(rng: &mut Rng, target: &FuzzTarget, inputs: &[Vec<u8>]) -> Vec<u8> {
    let mut input = chosen(rng, inputs).to_vec();
    for _ in 0..rng.usize(1..=MAX_EDITS) {
        if target.text && rng.u8(0..4) > 0 {
            edit_text(rng, target.dictionary, inputs, &mut input);
        } else {
            edit_bytes(rng, target.dictionary, inputs, &mut input);
        }
        input.truncate(target.max_bytes);
    }
    input
}

fn chosen<'a>(rng: &mut Rng, inputs: &'a [Vec<u8>]) -> &'a [u8] {
    rng.choice(inputs).map_or(&[], Vec::as_slice)
}

fn edit_bytes(rng: &mut Rng, dictionary: &[&str], inputs: &[Vec<u8>], input: &mut Vec<u8>) {
    let at = rng.usize(0..=input.len());
    match rng.u8(0..11) {
        0 => {
            if let Some(byte) = input.get_mut(at) {
                *byte ^= 1 << rng.u8(0..8);
            }
        }
        1 => {
            if let Some(byte) = input.get_mut(at) {
                *byte = rng.u8(..);
            }
        }
        2 => {
            let mut new = vec![0_u8; rng.usize(1..=8)];
            rng.fill(&mut new);
            replace(input, at..at, &new);
        }
        3 => {
            let end = end_from(rng, at, input.len());
            replace(input, at..end, &[]);
        }
        4 => {
            let piece = input[at..end_from(rng, at, input.len())].to_vec();
            let to = rng.usize(0..=input.len());
            replace(input, to..to, &piece);
        }
        5 => {
            let other = chosen(rng, inputs);
            let from = rng.usize(0..=other.len());
            input.truncate(at);
            input.extend_from_slice(&other[from..]);
        }
        6 => input.truncate(at),
        7 | 8 => {
            let word = rng.choice(WORDS).copied().unwrap_or_default().to_le_bytes();
            let width = 1 << rng.usize(0..4);
            if let Some(bytes) = input.get_mut(at..at + width) {
                bytes.copy_from_slice(&word[..width]);
            }
        }
        9 => {
            let word = rng.choice(dictionary).copied().unwrap_or_default();
            replace(input, at..at, word.as_bytes());
        }
        _ => {
            let piece = input[at..(at + rng.usize(1..=4)).min(input.len())].to_vec();
            let new = piece.repeat(rng.usize(1..=MAX_REPEATS));
            replace(input, at..at, &new);
        }
    }
}

fn edit_text(rng: &mut Rng, dictionary: &[&str], inputs: &[Vec<u8>], input: &mut Vec<u8>) {
    match rng.u8(0..10) {
        0..=2 => {
            let numbers = spans(input, |b| b.is_ascii_digit() || matches!(b, b'.' | b'-' | b'+' | b'e'));
            let numbers: Vec<_> = numbers.into_iter().filter(|span| input[span.clone()].iter().any(u8::is_ascii_digit)).collect();
            if let (Some(span), Some(new)) = (rng.choice(numbers), rng.choice(NUMBERS)) {
                replace(input, span, new.as_bytes());
            }
        }
        3 | 4 => {
            let words = spans(input, |b| b.is_ascii_alphanumeric() || matches!(b, b'_' | b'-'));
            if let (Some(mut span), Some(new)) = (rng.choice(words), rng.choice(dictionary)) {
                if rng.bool() {
                    span.end = span.start;
                }
                replace(input, span, new.as_bytes());
            }
        }
        5 => {
            if let Some(line) = rng.choice(lines(input)) {
                replace(input, line, &[]);
            }
        }
        6 => {
            if let (Some(line), Some(to)) = (rng.choice(lines(input)), rng.choice(lines(input))) {
                let copy = input[line].to_vec();
                replace(input, to.start..to.start, &copy);
            }
        }
        7 => {
            if let (Some(line), Some(to)) = (rng.choice(lines(input)), rng.choice(lines(input))) {
                let moved = input[line.clone()].to_vec();
                replace(input, to.start..to.start, &moved);
                let shift = if to.start <= line.start { moved.len() } else { 0 };
                replace(input, line.start + shift..line.end + shift, &[]);
            }
        }
        8 => {
            let other = chosen(rng, inputs);
            if let Some(line) = rng.choice(lines(other)) {
                let at = rng.choice(lines(input)).map_or(0, |line| line.start);
                replace(input, at..at, &other[line]);
            }
        }
        _ => {
            let at = rng.usize(0..=input.len());
            let repeats = if rng.u8(0..8) == 0 { rng.usize(1..=MAX_REPEATS) } else { 1 };
            let new = rng.choice(PUNCTUATION).copied().unwrap_or_default().repeat(repeats);
            replace(input, at..at, new.as_bytes());
        }
    }
}

fn replace(input: &mut Vec<u8>, span: Range<usize>, new: &[u8]) {
    drop(input.splice(span, new.iter().copied()));
}

/// End of a piece that begins at `at`: most pieces are short.
fn end_from(rng: &mut Rng, at: usize, length: usize) -> usize {
    let most = if rng.u8(0..8) == 0 { length - at } else { PIECE };
    (at + rng.usize(0..=most)).min(length)
}

/// Longest runs of bytes that match.
fn spans(input: &[u8], matches: impl Fn(u8) -> bool) -> Vec<Range<usize>> {
    let mut spans = Vec::new();
    let mut start = None;
    for (at, &byte) in input.iter().enumerate() {
        match (matches(byte), start) {
            (true, None) => start = Some(at),
            (false, Some(from)) => {
                spans.push(from..at);
                start = None;
            }
            _ => {}
        }
    }
    spans.extend(start.map(|from| from..input.len()));
    spans
}

/// Lines, with their line ends.
fn lines(input: &[u8]) -> Vec<Range<usize>> {
    let mut at = 0;
    input
        .split_inclusive(|&byte| byte == b'\n')
        .map(|line| {
            at += line.len();
            at - line.len()..at
        })
        .collect()
}
