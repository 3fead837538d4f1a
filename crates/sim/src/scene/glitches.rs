//! Corrupt samples of a load cell: counts that no force caused.

use palpate_core::quantity::RandomStream;
use rand::RngExt;

/// Counts of a converter on either side of zero: 24 bits, as the HX711 and most converters of bridges have.
const COUNTS: i64 = 1 << 23;

/// Numbers of low bits that [`GlitchKind::LowOnes`] sets. Fewer change a reading by under 0.2 N at 400,000 counts for one newton, which
/// is what a usual HX711 has. With more only the sign is left.
const LOW_BITS: std::ops::RangeInclusive<u32> = 16..=23;

/// Corrupt samples of a load cell. A sample is a conversion that is read: conversions that no reader asks for don't count, and a
/// corrupt conversion stays corrupt for every reading of it. With three axes only the press axis has corrupt samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CorruptSamples {
    /// What the samples are instead.
    pub kind: GlitchKind,
    /// Share of the samples that are corrupt, 1.
    pub share: f64,
    /// Number of successive samples that each event makes corrupt, with the same bits.
    pub in_a_row: u32,
    /// Force of 2^23 counts, N. The kinds are counts, and the scene knows forces: its count is the reading without a zero subtracted,
    /// in steps of this force by 2^23. A device that sends counts of its own uses those.
    pub range_n: f64,
    /// Start of the events, s since the rig was opened.
    pub from_s: f64,
    /// Time in which events begin, s; infinite: they don't end.
    pub for_s: f64,
}

impl CorruptSamples {
    /// Range of a usual cell on an HX711, N: 400,000 counts for one newton.
    pub const USUAL_RANGE_N: f64 = 20.0;

    /// Returns single corrupt samples at any time.
    pub fn of(kind: GlitchKind, share: f64) -> Self {
        CorruptSamples { kind, share, in_a_row: 1, range_n: Self::USUAL_RANGE_N, from_s: 0.0, for_s: f64::INFINITY }
    }

    /// Probability that an event begins at a sample that is in none, so that the share of all samples is as stated.
    fn begins(&self) -> f64 {
        self.share / (f64::from(self.in_a_row) * (1.0 - self.share) + self.share)
    }
}

/// Kinds of corrupt samples, as users of the HX711 report them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GlitchKind {
    /// The count -1: all 24 bits are 1, because the data line is read while the chip converts.
    MinusOne,
    /// The count 2^24 - 1: the same bits, read by a program that doesn't extend the sign. It is beyond the range of the chip.
    AllOnes,
    /// The largest count, 2^23 - 1.
    FullScale,
    /// The sign bit of the two's complement is the other one, so the count is off by 2^23.
    SignTurned,
    /// The lowest 16 to 23 bits are 1, because a conversion begins while the bits are read. A small positive count becomes 2^n - 1.
    LowOnes,
}

impl GlitchKind {
    /// All kinds, with their names in a rig file.
    pub const ALL: [(&str, GlitchKind); 5] = [
        ("minus-one", GlitchKind::MinusOne),
        ("all-ones", GlitchKind::AllOnes),
        ("full-scale", GlitchKind::FullScale),
        ("sign-turned", GlitchKind::SignTurned),
        ("low-ones", GlitchKind::LowOnes),
    ];
}

/// What happened to one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Glitch {
    kind: GlitchKind,
    low_bits: u32,
    range_n: f64,
}

impl Glitch {
    /// Returns the corrupt count of a sample with this sound count.
    pub(super) fn count(self, sound: f64) -> f64 {
        let count = sound.round() as i64;
        let corrupt = match self.kind {
            GlitchKind::MinusOne => -1,
            GlitchKind::AllOnes => 2 * COUNTS - 1,
            GlitchKind::FullScale => COUNTS - 1,
            GlitchKind::SignTurned if count < 0 => count + COUNTS,
            GlitchKind::SignTurned => count - COUNTS,
            GlitchKind::LowOnes => count | ((1 << self.low_bits) - 1),
        };
        corrupt as f64
    }

    /// Returns the corrupt reading of a cell that is known by its forces, N.
    pub(super) fn reading_n(self, sound_n: f64) -> f64 {
        let count_n = self.range_n / COUNTS as f64;
        self.count(sound_n / count_n) * count_n
    }
}

/// State of the corrupt samples. They have their own random stream, so the other readings stay what they are without them.
#[derive(Clone)]
pub(super) struct GlitchState {
    spec: CorruptSamples,
    rng: RandomStream,
    /// Event under way, and the number of its samples that are left.
    event: Option<(Glitch, u32)>,
}

impl GlitchState {
    pub(super) fn new(spec: CorruptSamples) -> Self {
        GlitchState { spec, rng: stream(0, 0), event: None }
    }

    /// Begins another press.
    pub(super) fn begin(&mut self, seed: u64, press: u64) {
        (self.rng, self.event) = (stream(seed, press), None);
    }

    /// Takes the next sample, which was converted at a time, and returns what happens to it.
    pub(super) fn strike(&mut self, at_s: f64) -> Option<Glitch> {
        let CorruptSamples { kind, in_a_row, range_n, from_s, for_s, .. } = self.spec;
        let (glitch, left) = match self.event.take() {
            Some(event) => event,
            None => {
                let is_time = at_s >= from_s && at_s - from_s < for_s;
                if !is_time || !self.rng.random_bool(self.spec.begins()) {
                    return None;
                }
                (Glitch { kind, low_bits: self.rng.random_range(LOW_BITS), range_n }, in_a_row)
            }
        };
        self.event = (left > 1).then(|| (glitch, left - 1));
        Some(glitch)
    }
}

fn stream(seed: u64, press: u64) -> RandomStream {
    palpate_core::quantity::stream(seed, press, "load cell glitches")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glitch(kind: GlitchKind) -> Glitch {
        Glitch { kind, low_bits: 20, range_n: 16.0 }
    }

    #[test]
    fn kinds_are_the_counts_that_users_report() {
        for (kind, sound, expected) in [
            (GlitchKind::MinusOne, 484_000.0, -1.0),
            (GlitchKind::AllOnes, 484_000.0, 16_777_215.0),
            (GlitchKind::FullScale, 484_000.0, 8_388_607.0),
            (GlitchKind::SignTurned, 484_000.0, -7_904_608.0),
            (GlitchKind::SignTurned, -8_388_608.0, 0.0),
            (GlitchKind::LowOnes, 484_000.0, 1_048_575.0),
            (GlitchKind::LowOnes, 1_048_576.0, 2_097_151.0),
            (GlitchKind::LowOnes, -5.0, -1.0),
        ] {
            assert_eq!(glitch(kind).count(sound), expected, "{kind:?} of {sound}");
        }
    }

    #[test]
    fn forces_are_counts_of_the_range() {
        let count_n = 16.0 / COUNTS as f64;
        assert_eq!(glitch(GlitchKind::MinusOne).reading_n(1.0), -count_n);
        assert_eq!(glitch(GlitchKind::FullScale).reading_n(1.0), 16.0 - count_n);
        assert_eq!(glitch(GlitchKind::AllOnes).reading_n(1.0), 32.0 - count_n);
        assert_eq!(glitch(GlitchKind::SignTurned).reading_n(1.0), -15.0);
        assert_eq!(glitch(GlitchKind::LowOnes).reading_n(1.0), 2.0 - count_n);
    }

    /// Corrupt samples of successive ones, 1 ms apart.
    fn struck(spec: CorruptSamples, samples: u32) -> Vec<bool> {
        let mut state = GlitchState::new(spec);
        state.begin(1, 1);
        (0..samples).map(|nth| state.strike(f64::from(nth) / 1000.0).is_some()).collect()
    }

    #[test]
    fn share_is_that_of_the_samples_for_any_length_of_the_events() {
        for (share, in_a_row) in [(0.0, 1), (0.004, 1), (0.1, 1), (0.1, 3), (0.5, 7), (1.0, 2)] {
            let found = struck(CorruptSamples { in_a_row, ..CorruptSamples::of(GlitchKind::MinusOne, share) }, 200_000);
            let found = found.iter().filter(|is_corrupt| **is_corrupt).count() as f64 / 200_000.0;
            // four standard deviations of a binomial share, times the length of the events
            let most = 4.0 * f64::from(in_a_row) * (share * (1.0 - share) / 200_000.0).sqrt();
            assert!((found - share).abs() <= most, "{share}, {in_a_row} in a row: {found}");
        }
    }

    #[test]
    fn events_have_their_length_and_begin_in_their_time() {
        let spec =
            CorruptSamples { in_a_row: 3, from_s: 1.0, for_s: 0.5, ..CorruptSamples::of(GlitchKind::MinusOne, 0.01) };
        let found = struck(spec, 3000);
        let first = found.iter().position(|is_corrupt| *is_corrupt).expect("one event");
        let last = found.iter().rposition(|is_corrupt| *is_corrupt).expect("one event");
        assert!(first >= 1000 && last < 1503, "{first} {last}");
        assert!(found.chunk_by(|a, b| a == b).filter(|run| run[0]).all(|run| run.len().is_multiple_of(3)));
    }
}
