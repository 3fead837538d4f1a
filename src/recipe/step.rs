//! One step of a recipe: where, how hard and how it presses.

use crate::control::Strategy;
use crate::document::Span;
use crate::quantity::{Place, Range};
use serde::{Deserialize, Serialize};

/// What a press is made for: it decides which table its row lands in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Loading and unloading at the units' centres: Table 1.
    Characterisation,
    /// The calibration database.
    Calibration,
    /// Points whose place and force the solver is to find.
    Test,
    /// Presses from which the force loop learns before others rely on it. A plan begins with them where it has such presses;
    /// no recipe asks for them, and no table but the presses holds them.
    Teach,
}

impl Phase {
    /// Every phase.
    pub const ALL: [Phase; 4] = [Phase::Characterisation, Phase::Calibration, Phase::Test, Phase::Teach];

    /// The phase as it stands in files.
    pub const fn name(self) -> &'static str {
        match self {
            Phase::Characterisation => "characterisation",
            Phase::Calibration => "calibration",
            Phase::Test => "test",
            Phase::Teach => "teach",
        }
    }
}

/// One `[[step]]`.
#[derive(Clone, Debug)]
pub struct Step {
    /// What its presses are made for.
    pub phase: Phase,
    /// Where it presses.
    pub places: Places,
    /// How hard.
    pub load: Load,
    /// How each press is made.
    pub manner: Manner,
    /// Where the step's places stand in the text.
    pub places_span: Span,
    /// Where its force stands in the text.
    pub load_span: Span,
}

impl Step {
    /// A step that no file holds.
    pub fn new(phase: Phase, places: Places, load: Load, manner: Manner) -> Step {
        Step { phase, places, load, manner, places_span: 0..0, load_span: 0..0 }
    }
}

/// Where a step presses, in the specimen frame, mm.
#[derive(Clone, Debug)]
pub enum Places {
    /// Rows of constant y, both ends included; x changes fastest in their numbers, in any order of visits.
    Grid {
        /// First and last x.
        x_mm: Range,
        /// First and last y.
        y_mm: Range,
        /// From one point to the next.
        spacing_mm: f64,
        /// In which order.
        order: Order,
    },
    /// Places as given, each with its own stretch of the text.
    List(Vec<(Place, Span)>),
    /// Places drawn uniformly from the run's seed, to 1 um.
    Random {
        /// How many.
        count: u64,
        /// Interval of x.
        x_mm: Range,
        /// Interval of y.
        y_mm: Range,
    },
    /// Straight above the units of the rig's array.
    Units(UnitChoice),
}

/// In which order the points of a grid are visited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// As they are numbered.
    #[default]
    Raster,
    /// Every second one of every second row, four times over: what is pressed next is no neighbour, whose dent may still be
    /// there.
    Interleaved,
}

impl Order {
    /// The order as it stands in files.
    pub const fn name(self) -> &'static str {
        match self {
            Order::Raster => "raster",
            Order::Interleaved => "interleaved",
        }
    }

    /// The numbers of the points of so many columns and rows, as they are visited.
    pub fn visits(self, columns: usize, rows: usize) -> Vec<usize> {
        let pass = |(from_x, from_y, stride): (usize, usize, usize)| {
            let row = move |y: usize| (from_x..columns).step_by(stride).map(move |x| y * columns + x);
            (from_y..rows).step_by(stride).flat_map(row)
        };
        let passes: &[(usize, usize, usize)] = match self {
            Order::Raster => &[(0, 0, 1)],
            Order::Interleaved => &[(0, 0, 2), (1, 0, 2), (0, 1, 2), (1, 1, 2)],
        };
        passes.iter().copied().flat_map(pass).collect()
    }
}

/// Which units of the array.
#[derive(Clone, Debug)]
pub enum UnitChoice {
    /// Every one.
    All,
    /// These, counted from 1, with their places in the text.
    Some(Vec<(usize, Span)>),
}

/// How hard a step presses.
#[derive(Clone, Debug)]
pub enum Load {
    /// The same force everywhere, N.
    Force(f64),
    /// A force drawn uniformly for each place, N, to 1 mN.
    RandomForce(Range),
    /// Up to a force and back in equal steps, at every place several times.
    Staircase {
        /// The top, N.
        to_n: f64,
        /// From level to level, N.
        step_n: f64,
        /// How often at each place.
        repeats: u64,
        /// Rest between two repeats at a place, s.
        rest_s: f64,
    },
}

/// How each press of a step is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manner {
    /// Largest allowed difference of the force in the window from the set one, N.
    pub force_tolerance_n: f64,
    /// Dwell at the set force before the window, s.
    pub hold_s: f64,
    /// Length of the window in which force and outputs are sampled, s.
    pub sample_s: f64,
    /// How the force is found.
    pub strategy: Strategy,
    /// When the window begins, s from contact; none: as soon as the strategy can be sure of the force.
    pub sample_after_s: Option<f64>,
}

impl Manner {
    /// The paper's tolerance (PAPER S7), no extra dwell, a tenth of a second.
    pub const PAPER: Manner = Manner {
        force_tolerance_n: 0.05,
        hold_s: 0.0,
        sample_s: 0.1,
        strategy: Strategy::Guarded,
        sample_after_s: None,
    };
}

impl Default for Manner {
    fn default() -> Self {
        Manner::PAPER
    }
}

/// Most presses that can be allowed: their plan takes some 2 GB.
pub const PRESSES_CEILING: usize = 10_000_000;
