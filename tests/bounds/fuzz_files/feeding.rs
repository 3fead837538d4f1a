//! Feeds readers with mutated inputs, and measures the cost of each input.

use super::FILE;
use crate::HEAP;
use cpu_time::ThreadTime;
use palpate_core::quantity::{RandomStream, stream};
use palpate_testing::campaign;
use palpate_testing::mutation::rewritten;
use rand::RngExt;
use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::time::Instant as Wall;

/// Largest memory of the process, bytes: all targets at the same time, each with a plan of 100,000 presses.
const EVER_HELD_MOST: usize = 192 << 20;

/// The quick tier tries one in so many inputs of the full one.
const QUICK_PART: usize = 10;

/// Number of inputs between two lines of progress.
const PROGRESS: usize = 100_000;

/// Feeds a reader, and prints the number of inputs, the speed and the slowest input.
pub(super) fn fuzz(name: &str, inputs: usize, seeds: &[Vec<u8>], read: impl FnMut(&[u8])) {
    fuzz_with(name, inputs, seeds, rewritten, read);
}

/// The same with a reader of a file.
pub(super) fn fuzz_file(
    name: &str,
    inputs: usize,
    seeds: &[Vec<u8>],
    mutate: fn(&[Vec<u8>], &mut RandomStream, &mut Vec<u8>),
    mut read: impl FnMut(&Path, &[u8]),
) {
    let home = tempfile::tempdir().expect("a folder");
    let path = home.path().join(FILE);
    fuzz_with(name, inputs, seeds, mutate, |input| {
        let _ = fs::remove_file(&path); // writing a new file is faster than truncating one
        fs::write(&path, input).expect("a file");
        read(&path, input);
    });
}

fn fuzz_with(
    name: &str,
    inputs: usize,
    seeds: &[Vec<u8>],
    mutate: fn(&[Vec<u8>], &mut RandomStream, &mut Vec<u8>),
    mut read: impl FnMut(&[u8]),
) {
    let inputs = campaign::size(inputs.div_ceil(QUICK_PART), inputs);
    let (mut rng, mut input, mut longest_s) = (stream(1, 0, name), Vec::new(), 0.0f64);
    let began = Wall::now();
    for n in 0..inputs {
        if n > 0 && n.is_multiple_of(PROGRESS) {
            println!("{name}: {n} inputs so far, the longest {longest_s:.3} s, {} bytes", HEAP.max_allocated());
        }
        mutate(seeds, &mut rng, &mut input);
        let started = ThreadTime::now();
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| read(&input)));
        let took_s = started.elapsed().as_secs_f64();
        longest_s = longest_s.max(took_s);
        let wrong = match done {
            Err(_) => "it panicked".to_owned(),
            Ok(()) if HEAP.max_allocated() > EVER_HELD_MOST => format!("it held {} bytes", HEAP.max_allocated()),
            Ok(()) => continue,
        };
        panic!("{name}: input {n}: {wrong}:\n{}", excerpt(&input));
    }
    let (took_s, held) = (began.elapsed().as_secs_f64(), HEAP.max_allocated());
    let rate = inputs as f64 / took_s;
    println!(
        "{name}: {inputs} inputs in {took_s:.1} s, {rate:.0} a second, the longest {longest_s:.3} s, {held} bytes"
    );
}

/// The part of an input that is printed.
fn excerpt(input: &[u8]) -> String {
    let text = String::from_utf8_lossy(input);
    let shown: String = text.chars().take(4000).collect();
    if shown.len() < text.len() { format!("{shown}... ({} bytes)", input.len()) } else { shown }
}

/// A mutated journal with corrected check sums and numbers in most lines: a reader ignores the others early.
pub(super) fn resealed(seeds: &[Vec<u8>], rng: &mut RandomStream, into: &mut Vec<u8>) {
    rewritten(seeds, rng, into);
    if rng.random_bool(0.2) {
        return;
    }
    let renumbers = rng.random_bool(0.7);
    let mut sealed = Vec::with_capacity(into.len());
    let mut sequence = 0u64;
    for line in into.split_inclusive(|&byte| byte == b'\n') {
        let text = String::from_utf8_lossy(line);
        let mut parts = text.trim_end_matches('\n').splitn(3, ' ');
        let (Some(number), Some(_), Some(json)) = (parts.next(), parts.next(), parts.next()) else {
            sealed.extend_from_slice(line);
            continue;
        };
        let number = if renumbers { sequence } else { number.parse().unwrap_or(sequence) };
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&number.to_le_bytes());
        hasher.update(json.as_bytes());
        let mut line = String::new();
        let _ = writeln!(line, "{number} {:08x} {json}", hasher.finalize());
        sealed.extend_from_slice(line.as_bytes());
        sequence += 1;
    }
    *into = sealed;
}
