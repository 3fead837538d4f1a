//! What a board sends, by four profiles: lines of text and frames of bytes. The first byte chooses the profile.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_drivers::lines::{Finder, LineProfile};

const PROFILES: [&str; 4] = [
    "name = \"a\"\n[text]\nbefore = \"F,\"\ncolumns = 4\n",
    "name = \"a\"\n[text]\nseparator = \"\\t\"\ncolumns = 3\n",
    "name = \"a\"\n[frame]\nnumbers = [\"3 f32\"]\ntail = \"0D 0A\"\n",
    "name = \"a\"\n[frame]\nhead = \"AA\"\nnumbers = [\"u16\", \"skip\", \"2 i8\"]\nchecksum = \"crc16-modbus\"\n",
];

fuzz_target!(|bytes: &[u8]| {
    let Some((choice, bytes)) = bytes.split_first() else { return };
    let profile = PROFILES[usize::from(*choice) % PROFILES.len()];
    let profile = LineProfile::parse("a", profile).expect("a sound profile");
    let mut finder = Finder::new(profile.framing, false);
    let mut found = 0;
    for piece in bytes.chunks(7) {
        finder.take(piece);
        while finder.find().is_some() {
            found += 1;
        }
    }
    assert!(found <= bytes.len(), "{found} lines of {} bytes", bytes.len());
});
