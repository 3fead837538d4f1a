//! The terms that are tried, and the scene that they are tried in.

use crate::document::Problems;
use crate::mechanics::Medium;
use crate::paper;
use crate::rig::RigSpec;
use crate::scene::{Elastomer, LoadCell, NoiseOf, RelaxationBranch, SceneSpec, Servo, TaxelNoise, Taxels};
use crate::study::bench::papers_rig;
use crate::study::methods::specimen::CONVERTER;

/// What a try models: a scene, and what the measurement adds to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// The specimen, the stage and the load cell.
    pub scene: SceneSpec,
    /// Another error of each unit that grows with its reading, one draw a contact: three standard deviations, % of the reading.
    pub noise_of_reading_percent: Option<Vec<f64>>,
    /// How far the force that is reached may be from the one asked for, either way, N; uniform.
    pub force_tolerance_n: f64,
    /// How far each unit's zero has wandered after an hour: one standard deviation, % of full scale. Brownian: after a quarter
    /// of the time half as far.
    pub drift_percent: f64,
}

impl Model {
    /// The base: the scene of the paper's rig as it is shipped, on that rig. Its card converts to 16 bits over 10 V either way
    /// at the wire; here the skin does.
    ///
    /// # Errors
    /// None: a test holds the shipped text to be sound.
    pub fn base() -> Result<(Model, RigSpec), Problems> {
        let rig = papers_rig()?;
        let mut scene = rig.scene.clone();
        scene.skin.converter = Some(CONVERTER);
        Ok((Model { scene, noise_of_reading_percent: None, force_tolerance_n: 0.0, drift_percent: 0.0 }, rig))
    }

    fn taxels(&mut self) -> &mut Taxels {
        &mut self.scene.skin.taxels
    }
}

/// What a term can be tried on.
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
    /// All, the one that takes longest first.
    pub const ALL: [Touches; 3] = [Touches::Methods, Touches::Table1, Touches::Press];
}

/// Something that a scene may model or leave out.
#[derive(Clone, Copy, Debug)]
pub struct Term {
    /// As it stands in tables and figures.
    pub name: &'static str,
    /// How much of it, and what it can't touch by construction.
    pub told: &'static str,
    /// Whether the base has it.
    pub in_base: bool,
    on: &'static [Touches],
    set: fn(&mut Model, bool),
}

impl Term {
    /// Whether the term can change anything there.
    pub fn touches(&self, on: Touches) -> bool {
        self.on.contains(&on)
    }

    /// A model with the term, or without it.
    #[must_use]
    pub fn set(&self, model: &Model, on: bool) -> Model {
        let mut changed = model.clone();
        (self.set)(&mut changed, on);
        changed
    }

    /// The base with the term off if it is on there, and on if it is off.
    pub(super) fn other_than(&self, base: &Model) -> Model {
        self.set(base, !self.in_base)
    }
}

const METHODS: &[Touches] = &[Touches::Methods];
const TABLE_1: &[Touches] = &[Touches::Table1];
const READINGS: &[Touches] = &[Touches::Methods, Touches::Table1];
const PRESS: &[Touches] = &[Touches::Press];

/// All of them. None of the array's touches the press, since the loop never looks at the array.
pub const TERMS: [Term; 16] = [
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
            model.scene.load_cell = on.then_some(LoadCell { noise_n: 0.003, ..LoadCell::default() });
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
    told: &'static str,
    in_base: bool,
    on: &'static [Touches],
    set: fn(&mut Model, bool),
) -> Term {
    Term { name, told, in_base, on, set }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_term_is_in_the_base_where_it_says_so_and_changes_something() {
        let (base, _) = Model::base().unwrap();
        for term in TERMS {
            assert_eq!(term.set(&base, term.in_base), base, "{}", term.name);
            assert_ne!(term.other_than(&base), base, "{}", term.name);
        }
    }

    #[test]
    fn names_fit_their_column_and_differ() {
        for (index, term) in TERMS.iter().enumerate() {
            assert!(term.name.len() <= 16 && term.told.len() <= 78, "{}", term.name);
            assert!(TERMS[..index].iter().all(|other| other.name != term.name), "{}", term.name);
        }
    }
}
