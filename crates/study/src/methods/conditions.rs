//! Conditions that make methods fail. One condition is varied at a time, from harmless to intolerable.

use super::specimen::{
    CONVERTER, DEPTH_MM, FORCES_N, HALF_MM, KnownReadings, NoiseReference, StudySpecimen, Touch, anywhere,
};
use palpate_core::mechanics::Medium;
use palpate_core::quantity::{Place, RandomStream};
use palpate_sim::scene::{Converter, Elastomer, SkinSpec, TaxelFault, TaxelFaultKind};
use rand::RngExt;
use rand_distr::StandardNormal;
use std::f64::consts::TAU;

/// One condition that is varied.
#[derive(Clone, Copy, Debug)]
pub struct Harm {
    /// Name of the condition in rows.
    pub name: &'static str,
    /// Label for people, with the unit.
    pub label: &'static str,
    /// Distribution of the values along an axis.
    pub spread: ValueAxis,
    /// Values from harmless to harmful.
    pub values: &'static [f64],
    kind: HarmKind,
}

/// Distribution of values along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ValueAxis {
    /// Evenly.
    Linear,
    /// By their logarithm.
    Log,
    /// By index: value i isn't a quantity but this word.
    Words(&'static [&'static str]),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum HarmKind {
    Force,
    Outside,
    Units,
    Spacing,
    Noise,
    Bits,
    Dead,
    Stuck,
    Drift,
    Aging,
    Outliers,
    Baseline,
    Second,
    Physics,
}

/// All conditions, in the order of the figures.
pub const CONDITIONS: [Harm; 14] = [
    harm(HarmKind::Force, "low force", "force, N", ValueAxis::Log, &[1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005]),
    harm(HarmKind::Outside, "beyond grid", "beyond the grid, mm", ValueAxis::Linear, &[0.0, 0.25, 0.5, 1.0, 1.5, 2.0]),
    harm(HarmKind::Units, "few units", "units along a side, on 9 mm", ValueAxis::Linear, &[5.0, 4.0, 3.0, 2.0]),
    harm(
        HarmKind::Spacing,
        "spacing",
        "pitch / depth, 3 x 3 units",
        ValueAxis::Linear,
        &[0.9, 1.2, 0.6, 1.6, 0.4, 2.0, 0.2, 2.5],
    ),
    harm(HarmKind::Noise, "noise", "noise, times that of Table 1", ValueAxis::Log, &[1.0, 2.0, 5.0, 10.0, 20.0, 50.0]),
    harm(
        HarmKind::Bits,
        "few bits",
        "converter, bits over ±10 N",
        ValueAxis::Linear,
        &[16.0, 14.0, 12.0, 10.0, 8.0, 7.0],
    ),
    harm(
        HarmKind::Dead,
        "dead unit",
        "unit that dies after calibration",
        ValueAxis::Words(&["none", "corner", "edge", "centre"]),
        &[0.0, 1.0, 2.0, 3.0],
    ),
    harm(HarmKind::Stuck, "stuck unit", "centre unit stuck at, N", ValueAxis::Linear, &[0.0, 0.25, 0.5, 1.0, 2.0]),
    harm(
        HarmKind::Drift,
        "gain drift",
        "gain drift of the centre unit, %",
        ValueAxis::Linear,
        &[0.0, 2.0, -2.0, 5.0, -5.0, 10.0, -10.0, 20.0, -20.0, 40.0, -40.0, 60.0, -60.0],
    ),
    harm(
        HarmKind::Aging,
        "slow drift",
        "spread of gains at the test's end, %",
        ValueAxis::Linear,
        &[0.0, 2.0, 5.0, 10.0, 20.0, 40.0],
    ),
    harm(
        HarmKind::Outliers,
        "outliers",
        "readings with a spike, %",
        ValueAxis::Linear,
        &[0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0],
    ),
    harm(
        HarmKind::Baseline,
        "offset",
        "offset of all units, N",
        ValueAxis::Linear,
        &[0.0, 0.005, 0.01, 0.02, 0.05, 0.1],
    ),
    harm(
        HarmKind::Second,
        "two contacts",
        "distance of two contacts, mm",
        ValueAxis::Linear,
        &[0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0],
    ),
    harm(
        HarmKind::Physics,
        "physics",
        "physical terms",
        ValueAxis::Words(&["none", "punch", "disc", "units", "layer", "all"]),
        &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
    ),
];

/// Meanings of the words on the axes of the figures.
pub(super) const MEANINGS: [&str; 4] = [
    "Forces are 0.1 to 1 N unless stated otherwise, and one condition is changed at a time. offset, stuck: 1 N is what a unit reads of 1 N straight above. dead, stuck, drift, offset: after calibration. noise: of the test \
     alone. units and spacing: all units as noisy as Table 1 on average.",
    "slow drift: each unit's gain goes evenly to its own end while the test lasts; the ends are normal, their sd is the value. \
     outliers: one unit of such a reading is off by 0.2 N or more either way, over s by a share of 0.2 N / s, and by 10 N at most.",
    "two contacts: 0.5 N each; error to the nearer one, wrong where farther than 1 mm from both.",
    "physics, in calibration and test: flat punch of 0.5 mm radius; units read discs of 1 mm radius; units' gains ±20 %, places ±0.1 mm, \
     depths ±5 %; layer bonded to a rigid base, Poisson's ratio 0.49; all of these.",
];

/// Least and largest size of a spike, N: the reading of a unit for this force directly above it.
const SPIKE_N: (f64, f64) = (0.2, 10.0);
/// Force of each of two contacts, N. The second contact presses as hard as the first.
const EACH_N: f64 = 0.5;

const fn harm(
    kind: HarmKind,
    name: &'static str,
    label: &'static str,
    spread: ValueAxis,
    values: &'static [f64],
) -> Harm {
    Harm { name, label, spread, values, kind }
}

/// One value of one condition.
#[derive(Clone, Debug)]
pub struct ConditionValue {
    /// Specimen that is calibrated.
    pub calibrated: StudySpecimen,
    /// State of the specimen when it is tested.
    pub tested: StudySpecimen,
    /// Whether the calibration's map is also the test's map, so that a bound exists.
    pub map_is_known: bool,
}

impl Harm {
    /// Returns a value in words, if it isn't a quantity.
    pub fn words(&self, value: f64) -> Option<&'static str> {
        match self.spread {
            ValueAxis::Words(words) => words.get(value as usize).copied(),
            ValueAxis::Linear | ValueAxis::Log => None,
        }
    }

    /// Returns the specimens that are calibrated and tested at a value.
    pub fn case(&self, noise: NoiseReference, value: f64) -> ConditionValue {
        let papers = StudySpecimen::papers(noise);
        let same = |specimen: StudySpecimen| ConditionValue {
            tested: specimen.clone(),
            calibrated: specimen,
            map_is_known: true,
        };
        let after = |tested: StudySpecimen| ConditionValue {
            map_is_known: tested == papers,
            calibrated: papers.clone(),
            tested,
        };
        let fault = |unit: usize, kind| after(papers.with(|skin| skin.faults = vec![TaxelFault { unit, kind }]));
        match self.kind {
            HarmKind::Force | HarmKind::Outside | HarmKind::Second => same(papers),
            HarmKind::Units => {
                let side = value as usize;
                same(StudySpecimen::square(noise, side, 9.0 / (side - 1) as f64))
            }
            HarmKind::Spacing => same(StudySpecimen::square(noise, 3, value * DEPTH_MM)),
            HarmKind::Noise => {
                let louder = papers.with(|skin| {
                    if let Some(noise) = &mut skin.noise {
                        noise.repeatability_percent.iter_mut().for_each(|percent| *percent *= value);
                        noise.floor *= value;
                    }
                });
                ConditionValue { map_is_known: true, ..after(louder) }
            }
            HarmKind::Bits => {
                same(papers.with(|skin| skin.converter = Some(Converter { bits: value as u32, ..CONVERTER })))
            }
            HarmKind::Dead => match value as usize {
                0 => same(papers),
                // corner, edge, centre of the paper's nine
                which => fault([1, 2, 5][(which - 1).min(2)], TaxelFaultKind::Dead),
            },
            HarmKind::Stuck => fault(5, TaxelFaultKind::Stuck(value)),
            HarmKind::Drift if value == 0.0 => same(papers),
            HarmKind::Drift => fault(5, TaxelFaultKind::Drifted(value)),
            HarmKind::Baseline => after(papers.with(|skin| skin.taxels.baseline = value)),
            HarmKind::Aging | HarmKind::Outliers => ConditionValue { map_is_known: value == 0.0, ..same(papers) },
            HarmKind::Physics => same(papers.with(|skin| add_terms(skin, value as usize))),
        }
    }

    /// Returns the touches at a value. Places and forces are the same at each value, except for the varied quantity.
    pub fn touches(&self, value: f64, count: usize, rng: &mut RandomStream) -> Vec<Touch> {
        match self.kind {
            HarmKind::Force => anywhere(count, (value, value), rng),
            HarmKind::Outside => anywhere(count, FORCES_N, rng).into_iter().map(|touch| beyond(touch, value)).collect(),
            HarmKind::Second => (0..count).map(|_| pair(value, rng)).collect(),
            _ => anywhere(count, FORCES_N, rng),
        }
    }

    /// Changes the readings, if the condition varies them. The readings follow one another in time.
    pub(crate) fn spoil(&self, value: f64, readings: &mut KnownReadings, rng: &mut RandomStream) {
        match self.kind {
            HarmKind::Aging => age(readings, value / 100.0, rng),
            HarmKind::Outliers => add_spikes(readings, value / 100.0, rng),
            _ => {}
        }
    }
}

/// Changes each unit's gain linearly from 1 to its own random end value. The standard deviation of the end values is given.
fn age(readings: &mut KnownReadings, sd: f64, rng: &mut RandomStream) {
    let ends: Vec<f64> = (0..readings.units).map(|_| sd * rng.sample::<f64, _>(StandardNormal)).collect();
    let last = readings.truths.len().saturating_sub(1).max(1) as f64;
    for (nth, outputs) in readings.outputs.chunks_exact_mut(readings.units).enumerate() {
        outputs.iter_mut().zip(&ends).for_each(|(output, end)| *output *= 1.0 + end * nth as f64 / last);
    }
}

/// Adds a spike to one unit in a fraction `share` of the readings. A fraction of 1/s of the spikes is larger than s times the
/// least size, which is a heavy tail.
fn add_spikes(readings: &mut KnownReadings, share: f64, rng: &mut RandomStream) {
    let units = readings.units;
    for outputs in readings.outputs.chunks_exact_mut(units) {
        // drawn for every reading, so that a larger share spoils the same readings and more
        let is_spoilt = rng.random_range(0.0..1.0) < share;
        let (unit, is_up) = (rng.random_range(0..units), rng.random_range(0.0..1.0) < 0.5);
        let size = SPIKE_N.0 / rng.random_range(SPIKE_N.0 / SPIKE_N.1..=1.0);
        if is_spoilt {
            outputs[unit] += if is_up { size } else { -size };
        }
    }
}

/// Moves a contact straight outward to the edge of the grid and `beyond_mm` beyond it.
fn beyond(touch: Touch, beyond_mm: f64) -> Touch {
    let Place { x_mm, y_mm } = touch.place;
    let far_mm = x_mm.abs().max(y_mm.abs()).max(f64::MIN_POSITIVE);
    let times = (HALF_MM + beyond_mm) / far_mm;
    Touch { place: Place::new(times * x_mm, times * y_mm), ..touch }
}

/// Returns two contacts that are `apart_mm` apart, both on the grid.
fn pair(apart_mm: f64, rng: &mut RandomStream) -> Touch {
    let mut coordinate = || rng.random_range(-HALF_MM..=HALF_MM);
    loop {
        let (x_mm, y_mm) = (coordinate(), coordinate());
        let (sin, cos) = (coordinate() / (2.0 * HALF_MM) * TAU).sin_cos();
        let second = Place::new(x_mm + apart_mm * cos, y_mm + apart_mm * sin);
        if second.x_mm.abs() <= HALF_MM && second.y_mm.abs() <= HALF_MM {
            return Touch { place: Place::new(x_mm, y_mm), force_n: EACH_N, second: Some(second) };
        }
    }
}

/// Switches on one of the physical terms, or all terms.
fn add_terms(skin: &mut SkinSpec, which: usize) {
    const ALL: usize = 5;
    let has = |term: usize| which == term || which == ALL;
    if has(1) {
        skin.indenter_radius_mm = 0.5;
    }
    if has(2) {
        skin.taxels.radius_mm = 1.0;
    }
    if has(3) {
        skin.taxels.gain_spread_percent = 20.0;
        skin.taxels.place_spread_mm = 0.1;
        skin.taxels.depth_spread_percent = 5.0;
    }
    if has(4) {
        skin.elastomer = Some(Elastomer { depth_mm: DEPTH_MM, medium: Medium::BondedLayer { poisson_ratio: 0.49 } });
    }
}

#[cfg(test)]
mod tests {
    use super::super::specimen::KnownContact;
    use super::*;
    use palpate_core::quantity::stream;

    #[test]
    fn contacts_of_a_condition_are_at_their_places() {
        let rng = || stream(1, 0, "test");
        let of = |kind| CONDITIONS.iter().find(|harm| harm.kind == kind).unwrap();
        for touch in of(HarmKind::Outside).touches(1.5, 100, &mut rng()) {
            assert!((touch.place.x_mm.abs().max(touch.place.y_mm.abs()) - 7.5).abs() < 1e-9, "{touch:?}");
        }
        for touch in of(HarmKind::Second).touches(8.0, 100, &mut rng()) {
            assert!((touch.place.distance_mm(touch.second.unwrap()) - 8.0).abs() < 1e-9, "{touch:?}");
        }
        assert!(of(HarmKind::Force).touches(0.05, 10, &mut rng()).iter().all(|touch| touch.force_n == 0.05));
        assert!(of(HarmKind::Bits).touches(8.0, 50, &mut rng()).iter().all(|touch| touch.force_n <= FORCES_N.1));
    }

    #[test]
    fn drift_and_spikes_have_their_declared_size() {
        let of = |kind| CONDITIONS.iter().find(|harm| harm.kind == kind).unwrap();
        let touches = anywhere(4000, FORCES_N, &mut stream(1, 0, "test"));
        let truths = touches.iter().map(|touch| KnownContact { place: touch.place, force_n: None, second: None });
        let readings = KnownReadings { units: 9, truths: truths.collect(), outputs: vec![1.0; 9 * touches.len()] };
        let spoilt = |kind, value| {
            let mut readings = readings.clone();
            of(kind).spoil(value, &mut readings, &mut stream(1, 0, "test"));
            readings.outputs
        };
        for kind in [HarmKind::Aging, HarmKind::Outliers, HarmKind::Noise] {
            assert_eq!(spoilt(kind, 0.0), readings.outputs, "{kind:?}");
        }
        let aged = spoilt(HarmKind::Aging, 10.0);
        assert_eq!(aged[..9], [1.0; 9], "at first nothing has drifted");
        let last = &aged[9 * 3999..];
        let sd = (last.iter().map(|output| (output - 1.0).powi(2)).sum::<f64>() / 9.0).sqrt();
        assert!((0.05..0.2).contains(&sd) && last.iter().any(|output| *output < 1.0), "{last:?}");
        let spiked = |percent| -> Vec<f64> {
            let off = spoilt(HarmKind::Outliers, percent).into_iter().map(|output| output - 1.0);
            off.filter(|off| *off != 0.0).collect()
        };
        let spikes = spiked(10.0);
        assert!((300..500).contains(&spikes.len()) && spiked(50.0).len() > 4 * spikes.len());
        let is_spike = |off: &f64| (SPIKE_N.0 - 1e-9..=SPIKE_N.1 + 1e-9).contains(&off.abs());
        assert!(spikes.iter().all(is_spike) && spikes.iter().any(|off| *off < 0.0));
        let large = spikes.iter().filter(|off| off.abs() > 2.0).count() as f64 / spikes.len() as f64;
        assert!((0.05..0.15).contains(&large), "{large} are ten times the least");
    }

    #[test]
    fn first_value_of_a_condition_is_harmless_and_shares_its_calibration() {
        for harm in CONDITIONS.iter().filter(|harm| harm.kind != HarmKind::Stuck) {
            let case = harm.case(NoiseReference::T, harm.values[0]);
            assert_eq!(case.calibrated, case.tested, "{}", harm.name);
            assert!(case.map_is_known, "{}", harm.name);
        }
        let calibrations = |noise| {
            let mut all: Vec<StudySpecimen> = Vec::new();
            for harm in CONDITIONS {
                for value in harm.values {
                    let calibrated = harm.case(noise, *value).calibrated;
                    if !all.contains(&calibrated) {
                        all.push(calibrated);
                    }
                }
            }
            all.len()
        };
        assert_eq!(calibrations(NoiseReference::Q), 22, "the paper's, and those that can't share it");
    }
}
