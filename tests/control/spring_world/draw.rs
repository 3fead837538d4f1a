//! A run of the campaign, which follows from its seed.

use palpate_core::quantity::{RandomStream, stream};
use rand::RngExt;

/// Fraction of runs with two faults, and of runs on a specimen stiffer than declared.
const PAIRS: f64 = 0.25;
const STIFFER: f64 = 0.08;

/// Step through the list of faults, a prime number, so that few runs contain some of each class.
const STRIDE: usize = 37;

/// Bounds of the true stiffness of those, as a fraction of the declared one; one in eight has the last value.
const STIFFER_SHARES: (f64, f64) = (1.0, 2.0);
const HARD_SHARE: f64 = 20.0;

/// Places at which a fault begins: of the first press, of early and of late ones.
const PLACES: [(u32, u32); 3] = [(1, 4), (5, 10), (11, 12)];

/// Values of triggers: true forces, N, and heights of the tip over the surface, mm.
const FORCES_N: (f64, f64) = (0.05, 1.4);
const HEIGHTS_MM: (f64, f64) = (-0.4, 0.6);

#[derive(Debug)]
pub(super) struct RandomDraw {
    pub(super) seed: u64,
    pub(super) fault: String,
    /// True stiffness as a fraction of the declared one, if the seed doesn't choose it.
    pub(super) stiffness: Option<f64>,
}

impl RandomDraw {
    /// The run of a seed: every value of every kind comes in turn, alone or with another one.
    pub(super) fn new(seed: u64, kinds: &[DrawKind]) -> RandomDraw {
        let mut rng = stream(seed, 0, "spring-world");
        let mut fault = when(&kinds[(seed as usize * STRIDE) % kinds.len()], &mut rng);
        if rng.random_bool(PAIRS) {
            let other = rng.random_range(0..kinds.len());
            fault += &format!("+{}", when(&kinds[other], &mut rng));
        }
        let stiffness = rng.random_bool(STIFFER).then(|| match rng.random_range(0..8) {
            0 => HARD_SHARE,
            _ => (rng.random_range(STIFFER_SHARES.0..STIFFER_SHARES.1) * 100.0_f64).round() / 100.0,
        });
        RandomDraw { seed, fault, stiffness }
    }
}

/// A kind of fault, and its parameter with a value if it has one.
#[derive(Debug)]
pub(super) struct DrawKind {
    name: String,
    parameter: Option<String>,
}

impl DrawKind {
    /// The kinds in a line of `spring_world kinds`: one for each value.
    pub(super) fn of_line(line: &str) -> Vec<DrawKind> {
        let cells: Vec<&str> = line.split('\t').collect();
        let kind = |parameter| DrawKind { name: cells[0].to_owned(), parameter };
        let tried: Vec<DrawKind> =
            cells[2].split(' ').map(|value| kind(Some(format!("{}={value}", cells[1])))).collect();
        if cells[2].is_empty() { vec![kind(None)] } else { tried }
    }
}

fn when(DrawKind { name, parameter }: &DrawKind, rng: &mut RandomStream) -> String {
    let (low, high) = PLACES[rng.random_range(0..PLACES.len())];
    let mut text = format!("{name}:at-press={}", rng.random_range(low..=high));
    match rng.random_range(0..3) {
        0 => text += &format!(",at-force={:.2}", rng.random_range(FORCES_N.0..FORCES_N.1)),
        1 => text += &format!(",at-height={:.2}", rng.random_range(HEIGHTS_MM.0..HEIGHTS_MM.1)),
        _ => {}
    }
    parameter.iter().for_each(|parameter| text += &format!(",{parameter}"));
    text
}
