//! One step of a recipe: place, force and manner of its presses.

use palpate_control::{Drag, OverTime, Strategy};
use palpate_core::quantity::{Place, Range};
use palpate_document::Span;
use serde::{Deserialize, Serialize};

/// Purpose of a press, which determines the table of its row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Loading and unloading at the units' centres: Table 1.
    Characterisation,
    /// The calibration database.
    Calibration,
    /// Points whose place and force the solver must find.
    Test,
    /// Presses whose last level is followed over time.
    Creep,
    /// Presses with ramps at constant speeds.
    Ramp,
    /// Times without load, followed in the same way.
    Rest,
    /// Many presses at one place, with presses at a reference place in between.
    Cycles,
    /// Forces one after another, each held for a time.
    Wave,
    /// Presses from which the force loop learns before others rely on it. A plan begins with these presses if it has any. No
    /// recipe requests them, and only the table of presses contains them.
    Teach,
    /// Checks before and after presses of the plan. No recipe requests them with a step, and no table contains them.
    Check,
}

impl Phase {
    /// All phases of a plan.
    pub const ALL: [Phase; 9] = [
        Phase::Characterisation,
        Phase::Calibration,
        Phase::Test,
        Phase::Creep,
        Phase::Ramp,
        Phase::Rest,
        Phase::Cycles,
        Phase::Wave,
        Phase::Teach,
    ];

    /// Name of the phase in files.
    pub const fn name(self) -> &'static str {
        match self {
            Phase::Characterisation => "characterisation",
            Phase::Calibration => "calibration",
            Phase::Test => "test",
            Phase::Creep => "creep",
            Phase::Ramp => "ramp",
            Phase::Rest => "rest",
            Phase::Cycles => "cycles",
            Phase::Wave => "wave",
            Phase::Teach => "teach",
            Phase::Check => "check",
        }
    }
}

/// When a run presses a place again, to check that load cell and sensor haven't changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Checks {
    /// After the last press.
    #[default]
    End,
    /// Also between calibration or test presses, at most 100 presses and one hour of them apart.
    Between,
    /// Never.
    None,
}

impl Checks {
    /// Name in a recipe.
    pub const fn name(self) -> &'static str {
        match self {
            Checks::End => "end",
            Checks::Between => "between",
            Checks::None => "none",
        }
    }
}

/// What becomes of a press if a reading of the array or of a monitor is missed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnMiss {
    /// It is made again; if readings are missed again and again, the run ends.
    #[default]
    Retry,
    /// It is made again; then its row has a flag and blanks, and the run continues.
    Flag,
    /// The run ends.
    End,
}

impl OnMiss {
    /// Name in a recipe.
    pub const fn name(self) -> &'static str {
        match self {
            OnMiss::Retry => "retry",
            OnMiss::Flag => "flag",
            OnMiss::End => "end",
        }
    }
}

/// Which readings of a press a run keeps beside the means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SeriesScope {
    /// None.
    #[default]
    None,
    /// Those of its windows.
    Window,
    /// All, from the reading without load before the press to the one after it.
    Press,
}

impl SeriesScope {
    /// Name in a recipe.
    pub const fn name(self) -> &'static str {
        match self {
            SeriesScope::None => "none",
            SeriesScope::Window => "window",
            SeriesScope::Press => "press",
        }
    }
}

/// One `[[step]]`.
#[derive(Clone, Debug)]
pub struct Step {
    /// Purpose of its presses.
    pub phase: Phase,
    /// Places of its presses.
    pub places: Places,
    /// Force of its presses.
    pub load: StepLoad,
    /// Drags after the window, one press for each; none if it is empty.
    pub drags: Vec<Drag>,
    /// What its presses do over time.
    pub over_time: OverTime,
    /// Manner of each press.
    pub manner: Manner,
    /// Position of the step's places in the text.
    pub places_span: Span,
    /// Position of the step's force in the text.
    pub load_span: Span,
    /// Position of the step's drag in the text.
    pub drag_span: Span,
}

impl Step {
    /// Creates a step that isn't in a file.
    pub fn new(phase: Phase, places: Places, load: StepLoad, manner: Manner) -> Step {
        Step {
            phase,
            places,
            load,
            drags: Vec::new(),
            over_time: OverTime::default(),
            manner,
            places_span: 0..0,
            load_span: 0..0,
            drag_span: 0..0,
        }
    }
}

/// Places of a step, in the specimen frame, mm.
#[derive(Clone, Debug)]
pub enum Places {
    /// Rows of constant y, both ends included. The numbering goes along x first; the order of visits may differ.
    Grid {
        /// First and last x.
        x_mm: Range,
        /// First and last y.
        y_mm: Range,
        /// Distance from one point to the next.
        spacing_mm: f64,
        /// Order of the visits.
        order: GridOrder,
    },
    /// Centres of equal cells, row by row.
    Cells {
        /// Interval of x that the cells divide.
        x_mm: Range,
        /// Interval of y that the cells divide.
        y_mm: Range,
        /// Number of cells along x.
        columns: usize,
        /// Number of cells along y.
        rows: usize,
    },
    /// Places as given, each with its position in the text.
    List(Vec<(Place, Span)>),
    /// Places drawn uniformly from the run's seed, to 1 um.
    Random {
        /// Number of places.
        count: u64,
        /// Interval of x.
        x_mm: Range,
        /// Interval of y.
        y_mm: Range,
    },
    /// Straight above the units of the rig's array.
    Units(UnitChoice),
}

/// Order in which the points of a grid are visited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GridOrder {
    /// Order of their numbers.
    #[default]
    Raster,
    /// Every second point of every second row, four times. So the next press is not at a neighbour, where the dent of the last
    /// press may remain.
    Interleaved,
}

impl GridOrder {
    /// Name of the order in files.
    pub const fn name(self) -> &'static str {
        match self {
            GridOrder::Raster => "raster",
            GridOrder::Interleaved => "interleaved",
        }
    }

    /// Returns the numbers of the points of this number of columns and rows, in the order of the visits.
    pub(crate) fn visits(self, columns: usize, rows: usize) -> Vec<usize> {
        let pass = |(from_x, from_y, stride): (usize, usize, usize)| {
            let row = move |y: usize| (from_x..columns).step_by(stride).map(move |x| y * columns + x);
            (from_y..rows).step_by(stride).flat_map(row)
        };
        let passes: &[(usize, usize, usize)] = match self {
            GridOrder::Raster => &[(0, 0, 1)],
            GridOrder::Interleaved => &[(0, 0, 2), (1, 0, 2), (0, 1, 2), (1, 1, 2)],
        };
        passes.iter().copied().flat_map(pass).collect()
    }
}

/// Selection of units of the array.
#[derive(Clone, Debug)]
pub enum UnitChoice {
    /// All units.
    All,
    /// These units, counted from 1, with their positions in the text.
    Some(Vec<(usize, Span)>),
}

/// Force or depth of a step's presses.
#[derive(Clone, Debug)]
pub enum StepLoad {
    /// The same force everywhere, N.
    Force(f64),
    /// A force drawn uniformly for each place, N, to 1 mN.
    RandomForce(Range),
    /// These depths at each place, one after another, mm.
    Depths(Vec<f64>),
    /// A depth drawn uniformly for each place, mm, to 1 um.
    RandomDepth(Range),
    /// Up to a force and back in equal steps, several times at each place.
    Staircase {
        /// Largest force, N.
        to_n: f64,
        /// Step from level to level, N.
        step_n: f64,
        /// Number of repetitions at each place.
        repeats: u64,
        /// Rest between two repetitions at a place, s.
        rest_s: f64,
    },
    /// None: all devices are read without load.
    Rest,
    /// Forces one after another, each held for a time.
    Wave {
        /// The forces, N; 0 is without load.
        forces_n: Vec<f64>,
        /// Time for which each is held, s.
        for_s: Vec<f64>,
    },
    /// The same force many times at each place, N.
    Cycles {
        /// The force, N.
        force_n: f64,
        /// Number of presses at each place.
        presses: u64,
        /// Number of presses after which the reference place is pressed. It is also pressed before the first.
        reference_every: u64,
        /// The reference place.
        reference: Place,
    },
}

/// Manner of each press of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manner {
    /// Largest allowed difference between the force in the window and the set force, N.
    pub force_tolerance_n: f64,
    /// Largest allowed difference between depth and set depth, mm.
    pub depth_tolerance_mm: f64,
    /// Dwell at the set force or depth before the window, s.
    pub hold_s: f64,
    /// Length of the window in which force and outputs are sampled, s.
    pub sample_s: f64,
    /// Method by which the force is reached.
    pub strategy: Strategy,
    /// Time at which the window begins, s from contact; `None`: as soon as the strategy can rely on the force.
    pub sample_after_s: Option<f64>,
    /// Time for which the last level is followed after its window, s.
    pub follow_s: f64,
}

impl Manner {
    /// The paper's tolerance (PAPER S7), no extra dwell, a tenth of a second.
    pub const PAPER: Manner = Manner {
        force_tolerance_n: 0.05,
        depth_tolerance_mm: 0.02,
        hold_s: 0.0,
        sample_s: 0.1,
        strategy: Strategy::Guarded,
        sample_after_s: None,
        follow_s: 0.0,
    };
}

impl Default for Manner {
    fn default() -> Self {
        Manner::PAPER
    }
}

/// Largest number of presses that can be allowed; their plan takes some 2 GB.
pub const PRESSES_CEILING: usize = 10_000_000;
