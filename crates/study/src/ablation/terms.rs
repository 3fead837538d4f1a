//! Terms that are tried, and the scene in which they are tried.

use crate::bench::papers_rig;
use crate::methods::specimen::CONVERTER;
use palpate_core::mechanics::Medium;
use palpate_document::Problems;
use palpate_report::paper;
use palpate_run::rig::RigSpec;
use palpate_sim::scene::{Elastomer, LoadCellScene, NoiseOf, RelaxationBranch, SceneSpec, Servo, TaxelNoise, Taxels};

/// Model of a try: a scene, and the effects of the measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct TermModel {
    /// Specimen, stage and load cell.
    pub scene: SceneSpec,
    /// Additional error of each unit that grows with its reading, drawn once for each contact: three standard deviations, % of
    /// the reading.
    pub noise_of_reading_percent: Option<Vec<f64>>,
    /// Largest difference between reached and requested force in either direction, N; uniformly distributed.
    pub force_tolerance_n: f64,
    /// Drift of each unit's zero after an hour: one standard deviation, % of full scale. The drift is Brownian: after a quarter
    /// of the time it is half as large.
    pub drift_percent: f64,
}

impl TermModel {
    /// Returns the base: the supplied scene of the paper's rig, on that rig. The rig's card converts to 16 bits over 10 V in
    /// either direction at the wire; here the skin does this conversion.
    ///
    /// # Errors
    /// Never in practice: a test checks that the supplied text is valid.
    pub fn base() -> Result<(TermModel, RigSpec), Problems> {
        let rig = papers_rig()?;
        let mut scene = rig.scene.clone();
        scene.skin.converter = Some(CONVERTER);
        Ok((TermModel { scene, noise_of_reading_percent: None, force_tolerance_n: 0.0, drift_percent: 0.0 }, rig))
    }

    fn taxels(&mut self) -> &mut Taxels {
        &mut self.scene.skin.taxels
    }
}

/// Things that a term can be tried on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Touches {
    /// A calibration and its test, read from a skin.
    Methods,
    /// Staircases above each unit, read from a skin.
    Table1,
    /// Presses in the force loop.
    Press,
}

impl Touches {
    /// All things, the one that takes longest first.
    pub const ALL: [Touches; 3] = [Touches::Methods, Touches::Table1, Touches::Press];
}

/// A term that a scene may model or omit.
#[derive(Clone, Copy, Debug)]
pub struct SceneTerm {
    /// Name in tables and figures.
    pub name: &'static str,
    /// Size of the term, and what it can't affect by construction.
    pub text: &'static str,
    /// Whether the base contains the term.
    pub in_base: bool,
    on: &'static [Touches],
    set: fn(&mut TermModel, bool),
}

impl SceneTerm {
    /// Whether the term can change anything in `on`.
    pub fn touches(&self, on: Touches) -> bool {
        self.on.contains(&on)
    }

    /// Returns a model with the term or without it.
    #[must_use]
    pub fn set(&self, model: &TermModel, on: bool) -> TermModel {
        let mut changed = model.clone();
        (self.set)(&mut changed, on);
        changed
    }

    /// Returns the base with the term switched: off if it is on in the base, on if it is off.
    pub(super) fn other_than(&self, base: &TermModel) -> TermModel {
        self.set(base, !self.in_base)
    }
}

const METHODS: &[Touches] = &[Touches::Methods];
const TABLE_1: &[Touches] = &[Touches::Table1];
const READINGS: &[Touches] = &[Touches::Methods, Touches::Table1];
const PRESS: &[Touches] = &[Touches::Press];

/// All terms. The array's terms don't affect the press, because the loop never reads the array.
pub const TERMS: [SceneTerm; 16] = [
    term(
        "taxel noise",
        "Table 1's, three standard deviations of full scale, one draw a contact",
        true,
        READINGS,
        |model, on| {
            let repeatability_percent = paper::repeatability_percent().to_vec();
            let of = NoiseOf::FullScale;
            model.scene.skin.noise = on.then_some(TaxelNoise { repeatability_percent, of, floor: 0.0 });
        },
    ),
    term("noise of reading", "the same percentages of the reading, besides", false, READINGS, |model, on| {
        model.noise_of_reading_percent = on.then(|| paper::repeatability_percent().to_vec())
    }),
    term("hysteresis", "Table 1's; calibration and test only ever load", true, TABLE_1, |model, on| {
        model.scene.skin.hysteresis_percent = on.then(|| paper::hysteresis_percent().to_vec())
    }),
    term("punch", "flat, 1 mm across; a unit right below reads 1 of 1 N with any", false, METHODS, |model, on| {
        model.scene.skin.indenter_radius_mm = if on { 0.5 } else { 0.0 }
    }),
    term(
        "taxel disc",
        "units read the mean over 1 mm around; right below as the punch",
        false,
        METHODS,
        |model, on| model.taxels().radius_mm = if on { 1.0 } else { 0.0 },
    ),
    term(
        "bonded layer",
        "on a rigid base, Poisson's ratio 0.49; right below as the punch",
        false,
        METHODS,
        |model, on| {
            let medium = if on { Medium::BondedLayer { poisson_ratio: 0.49 } } else { Medium::HalfSpace };
            let elastomer = &mut model.scene.skin.elastomer;
            *elastomer = elastomer.map(|elastomer| Elastomer { medium, ..elastomer });
        },
    ),
    term("gains", "+-20 % from unit to unit", false, READINGS, |model, on| {
        model.taxels().gain_spread_percent = if on { 20.0 } else { 0.0 }
    }),
    term("places", "units +-0.1 mm off along x and y", false, READINGS, |model, on| {
        model.taxels().place_spread_mm = if on { 0.1 } else { 0.0 }
    }),
    term("depths", "+-5 % from unit to unit", false, READINGS, |model, on| {
        model.taxels().depth_spread_percent = if on { 5.0 } else { 0.0 }
    }),
    term(
        "converter",
        "16 bits over 10 V either way, the array's; the load cell's is at the wire",
        true,
        READINGS,
        |model, on| model.scene.skin.converter = on.then_some(CONVERTER),
    ),
    term(
        "drift of zeros",
        "Brownian, 1 % of full scale in an hour; calibration and test take 13 minutes",
        false,
        READINGS,
        |model, on| model.drift_percent = if on { 1.0 } else { 0.0 },
    ),
    term(
        "force tolerance",
        "the force reached is anywhere within +-0.05 N; of a press it is the question",
        false,
        READINGS,
        |model, on| model.force_tolerance_n = if on { 0.05 } else { 0.0 },
    ),
    term(
        "stage grain",
        "places and depths in 1 um; a unit's centre is a multiple of it",
        false,
        &[Touches::Methods, Touches::Press],
        |model, on| {
            model.scene.stage = on.then_some(Servo { quantum_mm: 0.001, ..Servo::default() });
        },
    ),
    term(
        "load-cell noise",
        "3 mN a conversion; methods go by the force that was asked for",
        true,
        &[Touches::Table1, Touches::Press],
        |model, on| {
            model.scene.load_cell = on.then_some(LoadCellScene { noise_n: 0.003, ..LoadCellScene::default() });
        },
    ),
    term(
        "surface tilt",
        "at most 0.2 mm in the loading area; readings follow the force, not the depth",
        false,
        PRESS,
        |model, on| model.scene.surface_tilt_mm = if on { 0.2 } else { 0.0 },
    ),
    term(
        "relaxation",
        "5 % in 0.3 s and 5 % in 5 s; readings follow the force, not the depth",
        true,
        PRESS,
        |model, on| {
            let branch = |(share, time_s)| RelaxationBranch { share, time_s };
            model.scene.relaxation = if on { [(0.05, 0.3), (0.05, 5.0)].map(branch).to_vec() } else { Vec::new() };
        },
    ),
];

const fn term(
    name: &'static str,
    text: &'static str,
    in_base: bool,
    on: &'static [Touches],
    set: fn(&mut TermModel, bool),
) -> SceneTerm {
    SceneTerm { name, text, in_base, on, set }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base_terms_have_an_effect() {
        let (base, _) = TermModel::base().unwrap();
        for term in TERMS {
            assert_eq!(term.set(&base, term.in_base), base, "{}", term.name);
            assert_ne!(term.other_than(&base), base, "{}", term.name);
        }
    }

    #[test]
    fn names_fit_their_column_and_differ() {
        for (index, term) in TERMS.iter().enumerate() {
            assert!(term.name.len() <= 16 && term.text.len() <= 78, "{}", term.name);
            assert!(TERMS[..index].iter().all(|other| other.name != term.name), "{}", term.name);
        }
    }
}
