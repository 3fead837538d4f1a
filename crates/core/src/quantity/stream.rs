//! Random streams, the same on every machine.

use rand::SeedableRng;

/// The generator behind every random stream: portable, so a seed means the same on every machine.
pub type RandomStream = rand_pcg::Pcg64Mcg;

/// Returns the random stream of one device in one press of one seed.
///
/// Streams of other presses, devices or seeds are unrelated. A press that is measured again draws the same values. Properties of
/// the specimen or the plan use press 0.
pub fn stream(seed: u64, press: u64, device: &str) -> RandomStream {
    let mut state = mix(seed);
    state = mix(state ^ press);
    for byte in device.bytes() {
        state = mix(state ^ u64::from(byte));
    }
    RandomStream::seed_from_u64(state)
}

/// Finaliser of SplitMix64 (Steele, Lea and Flood 2014): every input bit affects every output bit.
fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    #[test]
    fn a_stream_depends_on_each_of_its_three_names() {
        let first = |seed, press, device| stream(seed, press, device).random::<u64>();
        let base = first(1, 2, "taxels");
        assert_eq!(base, first(1, 2, "taxels"));
        assert_ne!(base, first(2, 2, "taxels"));
        assert_ne!(base, first(1, 3, "taxels"));
        assert_ne!(base, first(1, 2, "load cell"));
    }
}
