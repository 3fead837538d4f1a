//! Mutated real inputs that keep most of their grammar.
#![allow(dead_code, reason = "each test file is a program of its own and uses its part of this")]

use palpate_core::quantity::RandomStream;
use rand::RngExt;

/// Longest message, bytes.
pub const INPUT_MOST: usize = 512;

/// Parts of grammars, for wrong places.
const TOKENS: &[&str] = &[
    "-",
    "+",
    ".",
    ",",
    ";",
    "|",
    ":",
    "<",
    ">",
    "{",
    "}",
    "[",
    "]",
    "\"",
    "(",
    ")",
    "*",
    "?",
    "\r",
    "\n",
    "0",
    "9",
    "1e999",
    "nan",
    "inf",
    "-0",
    "99999999999999999999",
    "EndOfAPI",
    "MPos:",
    "$",
    "id",
    "\\u0000",
    "\u{fffd}",
    "\0",
    " ",
];

/// A message after some mutations that keep most of its grammar, sometimes random bytes.
pub fn mutated(seeds: &[&[u8]], rng: &mut RandomStream, into: &mut Vec<u8>) {
    into.clear();
    if rng.random_bool(0.02) {
        let length = rng.random_range(0..INPUT_MOST);
        into.extend((0..length).map(|_| rng.random::<u8>()));
        return;
    }
    into.extend_from_slice(seeds[rng.random_range(0..seeds.len())]);
    for _ in 0..rng.random_range(0..5) {
        let (length, other) = (into.len(), seeds[rng.random_range(0..seeds.len())]);
        let at = rng.random_range(0..=length);
        match rng.random_range(0..8) {
            0 if length > 0 => into[at % length] ^= 1 << rng.random_range(0..8),
            1 if length > 0 => into[at % length] = b'0' + rng.random_range(0..10u8),
            2 => into.truncate(at),
            3 => {
                let token = TOKENS[rng.random_range(0..TOKENS.len())].as_bytes();
                into.splice(at..at, token.iter().copied());
            }
            4 => {
                let from = rng.random_range(0..=other.len());
                into.extend_from_slice(&other[from..]);
            }
            5 => {
                let to = rng.random_range(at..=length);
                into.drain(at..to);
            }
            6 => {
                let part: Vec<u8> = into[at..].to_vec();
                into.extend(part);
            }
            _ if length > 0 => into[at % length] = rng.random(),
            _ => {}
        }
        into.truncate(INPUT_MOST);
    }
}

/// Text that a person or another program may write at a wrong place in a file.
const WORDS: &[&str] = &[
    "[",
    "]",
    "{",
    "}",
    "[[",
    "]]",
    "=",
    ",",
    ".",
    "..",
    "../x",
    "\"",
    "'",
    "\"\"\"",
    "#",
    "\\",
    "\n",
    "\r\n",
    "\r",
    "\t",
    " ",
    "\0",
    "\u{feff}",
    "\u{fffd}",
    "\u{202e}",
    "\u{1b}[2J",
    "ä",
    "null",
    "true",
    "false",
    "nan",
    "inf",
    "-inf",
    "\"x\"",
    "name",
    "step",
    "[[step]]\n",
    "[scene]\n",
    "x = 1\n",
    "x_mm",
    "out_1",
    "out_2",
    "force_n",
    "flags",
    "press",
    "\"press\":0",
    "\"rows\":[]",
    "{}",
    "[]",
    "\"\"",
    "1979-05-27T07:32:00Z",
    "0x10",
    "1_000",
    "+1",
];

/// Numbers at the edges of what can be written, read or requested.
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "-0.0",
    "1",
    "-1",
    "0.5",
    "1e308",
    "-1e308",
    "1e309",
    "1e-320",
    "1e-9",
    "1e-3",
    "nan",
    "inf",
    "-inf",
    "NaN",
    "1e",
    "99999",
    "100000",
    "100001",
    "1000000000",
    "99999999999",
    "9223372036854775807",
    "9223372036854775808",
    "18446744073709551615",
    "18446744073709551616",
    "-9223372036854775808",
    "0.1",
    "3",
    "1000",
    "4096",
    "65535",
    "65536",
];

/// Longest text, bytes, and longest repetition in it.
pub const TEXT_MOST: usize = 256 << 10;
const REPEATS_MOST: usize = 20_000;

/// A text after some mutations of lines, numbers and brackets.
pub fn rewritten(seeds: &[Vec<u8>], rng: &mut RandomStream, into: &mut Vec<u8>) {
    into.clear();
    into.extend_from_slice(&seeds[rng.random_range(0..seeds.len())]);
    let most = if rng.random_bool(0.02) { 30 } else { 4 };
    for _ in 0..rng.random_range(0..=most) {
        let other = &seeds[rng.random_range(0..seeds.len())];
        let length = into.len();
        let at = rng.random_range(0..=length);
        match rng.random_range(0..100) {
            0..30 => renumber(rng, at, into),
            30..45 => insert(into, at, WORDS[rng.random_range(0..WORDS.len())].as_bytes()),
            45..55 => {
                let line = line_at(into, at);
                into.drain(line);
            }
            55..63 => {
                let line = into[line_at(into, at)].to_vec();
                let to = line_at(into, rng.random_range(0..=length)).start;
                insert(into, to, &line);
            }
            63..71 => {
                let line = other[line_at(other, rng.random_range(0..=other.len()))].to_vec();
                let to = line_at(into, at).start;
                insert(into, to, &line);
            }
            71..79 => {
                let word = WORDS[rng.random_range(0..WORDS.len())].as_bytes();
                let to = word_end(into, at);
                into.splice(at..to, word.iter().copied());
            }
            79..82 => {
                let stretch = [
                    "[", "{", "{a=", "[[", "\"a\":{", "0,", "[0,0],", "a.", "9", "\"", "(", "\n", "a = 1\n", "[[a]]\n",
                ];
                let stretch = stretch[rng.random_range(0..stretch.len())];
                let times = 1 << rng.random_range(0..=REPEATS_MOST.ilog2());
                insert(into, at, stretch.repeat(times).as_bytes());
            }
            82..84 => {
                let stretch = into[at..rng.random_range(at..=length).min(at + 64)].to_vec();
                insert(into, at, &stretch.repeat(rng.random_range(1..2000)));
            }
            84..87 => into.truncate(at),
            87..90 if length > 0 => into[at % length] = rng.random(),
            90..93 if length > 0 => into[at % length] ^= 1 << rng.random_range(0..8),
            93..96 => {
                let to = rng.random_range(at..=length);
                into.drain(at..to);
            }
            96 => insert(into, 0, "\u{feff}".as_bytes()),
            97 => {
                *into =
                    into.iter().flat_map(|&byte| if byte == b'\n' { vec![b'\r', b'\n'] } else { vec![byte] }).collect()
            }
            _ => {}
        }
        into.truncate(TEXT_MOST);
    }
}

/// Replaces the next number.
fn renumber(rng: &mut RandomStream, at: usize, into: &mut Vec<u8>) {
    let is_digit = |byte: &u8| byte.is_ascii_digit();
    let Some(from) = into[at..].iter().position(is_digit).map(|way| at + way) else { return };
    let number = |byte: &u8| byte.is_ascii_digit() || b".eE+-_".contains(byte);
    let to = into[from..].iter().position(|byte| !number(byte)).map_or(into.len(), |way| from + way);
    let number = NUMBERS[rng.random_range(0..NUMBERS.len())].as_bytes();
    into.splice(from..to, number.iter().copied());
}

fn insert(into: &mut Vec<u8>, at: usize, what: &[u8]) {
    into.splice(at..at, what.iter().copied());
}

/// The line around a byte, with its end.
fn line_at(text: &[u8], at: usize) -> std::ops::Range<usize> {
    let start = text[..at].iter().rposition(|&byte| byte == b'\n').map_or(0, |newline| newline + 1);
    let end = text[at..].iter().position(|&byte| byte == b'\n').map_or(text.len(), |way| at + way + 1);
    start..end
}

/// Where the word that begins at a byte ends.
fn word_end(text: &[u8], at: usize) -> usize {
    text[at..]
        .iter()
        .position(|byte| !(byte.is_ascii_alphanumeric() || *byte == b'_'))
        .map_or(text.len(), |way| at + way)
}
