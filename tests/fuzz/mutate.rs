//! Mutations of files: of their bytes, and of the numbers and words of text.

use rand::rngs::ChaCha8Rng;
use rand::{Rng, RngExt};

/// Numbers at the edge of what readers expect.
const NUMBERS: [&str; 16] = [
    "0",
    "-1",
    "1",
    "nan",
    "inf",
    "-inf",
    "1e39",
    "-1e38",
    "1e-45",
    "4294967296",
    "-9223372036854775808",
    "1e400",
    "0.5",
    "3e38",
    "99999999999999999999",
    "1e9",
];

/// The same in binary.
const INTEGERS: [u32; 10] =
    [0, 1, 0xff, 0xffff, 0x1_0000, 0x10_0000, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x7f80_0000];

/// A mutant of one of the seeds. `words` are those of the format.
pub fn mutant(seeds: &[Vec<u8>], words: &[&str], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = one_of(seeds, rng).clone();
    for _ in 0..rng.random_range(1..=5) {
        mutate(&mut bytes, seeds, words, rng);
    }
    bytes
}

fn one_of<'a, T>(list: &'a [T], rng: &mut ChaCha8Rng) -> &'a T {
    &list[rng.random_range(0..list.len())]
}

fn mutate(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], words: &[&str], rng: &mut ChaCha8Rng) {
    let at = rng.random_range(0..=bytes.len());
    let end = (at + rng.random_range(1..=16)).min(bytes.len());
    match rng.random_range(0..9) {
        0 => bytes.truncate(at),
        1 => drop(bytes.drain(at..end)),
        2 => drop(bytes.splice(at..at, bytes[at..end].to_vec())),
        3 if at < end => bytes[at] ^= 1 << rng.random_range(0..8),
        4 if at < end => rng.fill_bytes(&mut bytes[at..end]),
        5 => {
            let integer = one_of(&INTEGERS, rng).to_le_bytes();
            let end = (at + 4).min(bytes.len());
            bytes[at..end].copy_from_slice(&integer[..end - at]);
        }
        6 => {
            let other = one_of(seeds, rng);
            let from = rng.random_range(0..=other.len());
            let to = (from + rng.random_range(1..=64)).min(other.len());
            drop(bytes.splice(at..at, other[from..to].iter().copied()));
        }
        7 if !words.is_empty() => drop(bytes.splice(at..at, one_of(words, rng).bytes())),
        _ => replace_number(bytes, at, rng),
    }
}

/// Puts another number in the place of the next one after `at`.
fn replace_number(bytes: &mut Vec<u8>, at: usize, rng: &mut ChaCha8Rng) {
    let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|offset| at + offset) else { return };
    let is_number = |byte: &u8| byte.is_ascii_digit() || b".eE+-".contains(byte);
    let length = bytes[start..].iter().position(|byte| !is_number(byte)).unwrap_or(bytes.len() - start);
    drop(bytes.splice(start..start + length, one_of(&NUMBERS, rng).bytes()));
}
