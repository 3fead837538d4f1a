//! Random seeds of a simulated batch.
//!
//! A serial number is one specimen, so its seed depends on the batch's seed and the serial number. Each run of the specimen has
//! other noise and other random places, so a run's seed also depends on the number of the run.

use sha2::{Digest, Sha256};

/// Number of bits of a seed. A larger whole number isn't exact in programs that read JSON numbers as doubles.
const BITS: u32 = 53;

/// Returns the seed of a serial number's specimen: the first 53 bits of SHA-256 of `specimen`, the batch's seed and the serial
/// number, separated by a zero byte each; the seed in decimal.
pub fn specimen_seed(batch: u64, serial: &str) -> u64 {
    hashed(&["specimen", &batch.to_string(), serial])
}

/// Returns the seed of a serial number's run `number`, counted from 1, in the same way: of `run`, the batch's seed, the serial
/// number and the number of the run.
pub fn run_seed(batch: u64, serial: &str, number: u64) -> u64 {
    hashed(&["run", &batch.to_string(), serial, &number.to_string()])
}

fn hashed(parts: &[&str]) -> u64 {
    let digest = Sha256::digest(parts.join("\0"));
    let first = digest.iter().take(8).fold(0, |seed: u64, byte| seed << 8 | u64::from(*byte));
    first >> (u64::BITS - BITS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_stay_the_same_in_every_version() {
        assert_eq!(specimen_seed(1, "A-01"), 8_889_793_072_037_086);
        assert_eq!(run_seed(1, "A-01", 2), 346_993_500_927_462);
    }

    #[test]
    fn other_serials_runs_and_batches_have_other_seeds() {
        let all = [specimen_seed(1, "a"), specimen_seed(2, "a"), specimen_seed(1, "b"), run_seed(1, "a", 1)];
        let all = all.into_iter().chain([run_seed(1, "a", 2), run_seed(1, "a", 12), run_seed(1, "a1", 2)]);
        let unique: std::collections::BTreeSet<u64> = all.collect();
        assert_eq!(unique.len(), 7);
        assert!(unique.iter().all(|seed| *seed < 1 << BITS));
    }
}
