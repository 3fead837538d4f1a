//! Safety rules that were broken.

use palpate_core::quantity::any_number;
use serde::{Deserialize, Serialize};

/// A broken safety rule: stop, retract, record, report. The press is never retried automatically.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trip {
    /// The broken rule.
    pub rule: SafetyRule,
    /// Measured value, in `unit`.
    #[serde(with = "any_number")]
    pub measured: f64,
    /// Value that the rule allows, in `unit`.
    #[serde(with = "any_number")]
    pub limit: f64,
    /// Unit of both values.
    pub unit: String,
}

/// Rules under which a press continues.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SafetyRule {
    /// The mean of 10 ms exceeds the force limit by more than the noise explains.
    OverForce,
    /// The stage's controller detected too large a force and ended the motion itself.
    Guarded,
    /// The mean of 10 ms is below zero by more than the noise explains.
    WrongSign,
    /// The cell repeats the same code; its noise makes that almost impossible.
    Frozen,
    /// The cell or its transmitter reports an overrange or a fault.
    Unhealthy,
    /// A reading that is not a number.
    NotFinite,
    /// No good reading for too long.
    Stale,
    /// The force without load is no longer zero, or no longer the zero of the run's start.
    ZeroDrifted,
    /// The noise without load is too large a fraction of the force limit.
    Noisy,
    /// The force doesn't change after a step into the specimen.
    NoResponse,
    /// The force vanished although the indenter didn't retract.
    Fallen,
    /// The contact pushes harder than the declared stiffness allows.
    HardContact,
    /// At the first press the force rises less than the declared least stiffness requires.
    SofterThanDeclared,
    /// The force rises much less than at the presses around.
    SofterThanTaught,
    /// The force rises much more than at the presses around.
    StifferThanTaught,
    /// The force rises while the stage rests in contact.
    RisesAtRest,
    /// The outputs for each newton differ from those of the presses around.
    OutputsDiffer,
    /// The stage hasn't reported the end of a motion for too long.
    StageSilent,
    /// There is no contact where the surface must be.
    NoContact,
    /// The contact lasts after the indenter was retracted.
    StillTouching,
    /// The force couldn't be reached within the permitted depth or force.
    OutOfReach,
    /// The force wasn't reached within the allowed number of steps.
    NoConvergence,
    /// A place that was touched before now has its surface at another height.
    SurfaceMoved,
    /// Presses that were repeated felt as if made elsewhere: the array or the stage's zero moved sideways.
    ZeroShifted,
    /// The first touch came at a position where the frame has no specimen yet.
    SurfaceElsewhere,
    /// The force rose while z moved away, before there was a zero.
    ForceRose,
    /// The force fell further than a contact within the limit can explain.
    ForceFell,
    /// The load cell's reading without load is outside the allowed range.
    ZeroOutside,
    /// The zero changes when z moves a little away: the zero was measured in contact.
    ZeroInContact,
    /// The outputs changed before the first touch, but the force didn't.
    OutputsMoved,
    /// The load cell's gain, measured with a known weight, is wrong and isn't corrected.
    GainOff,
    /// No known weight rested on the load cell in time.
    NoWeight,
    /// The known weight wasn't removed from the load cell in time.
    WeightLeftOn,
    /// The readings of a known weight differ between repetitions.
    WeightUnsteady,
    /// The stage moves on although it was stopped.
    NotStopped,
    /// The end point of a requested motion isn't safe.
    NotPermitted,
}

impl SafetyRule {
    /// Name of the rule in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            SafetyRule::OverForce => "over-force",
            SafetyRule::Guarded => "guarded",
            SafetyRule::WrongSign => "wrong-sign",
            SafetyRule::Frozen => "frozen",
            SafetyRule::Unhealthy => "unhealthy",
            SafetyRule::NotFinite => "not-finite",
            SafetyRule::Stale => "stale",
            SafetyRule::ZeroDrifted => "zero-drifted",
            SafetyRule::Noisy => "noisy",
            SafetyRule::NoResponse => "no-response",
            SafetyRule::Fallen => "fallen",
            SafetyRule::HardContact => "hard-contact",
            SafetyRule::SofterThanDeclared => "softer-than-declared",
            SafetyRule::SofterThanTaught => "softer-than-taught",
            SafetyRule::StifferThanTaught => "stiffer-than-taught",
            SafetyRule::RisesAtRest => "rises-at-rest",
            SafetyRule::OutputsDiffer => "outputs-differ",
            SafetyRule::StageSilent => "stage-silent",
            SafetyRule::NoContact => "no-contact",
            SafetyRule::StillTouching => "still-touching",
            SafetyRule::OutOfReach => "out-of-reach",
            SafetyRule::NoConvergence => "no-convergence",
            SafetyRule::SurfaceMoved => "surface-moved",
            SafetyRule::ZeroShifted => "zero-shifted",
            SafetyRule::SurfaceElsewhere => "surface-elsewhere",
            SafetyRule::ForceRose => "force-rose",
            SafetyRule::ForceFell => "force-fell",
            SafetyRule::ZeroOutside => "zero-outside",
            SafetyRule::ZeroInContact => "zero-in-contact",
            SafetyRule::OutputsMoved => "outputs-moved",
            SafetyRule::GainOff => "gain-off",
            SafetyRule::NoWeight => "no-weight",
            SafetyRule::WeightLeftOn => "weight-left-on",
            SafetyRule::WeightUnsteady => "weight-unsteady",
            SafetyRule::NotStopped => "not-stopped",
            SafetyRule::NotPermitted => "not-permitted",
        }
    }

    /// Whether the load cell is in doubt after this rule was broken, so that its readings show nothing of the force that is left.
    pub fn doubts_load_cell(self) -> bool {
        match self {
            SafetyRule::WrongSign
            | SafetyRule::Frozen
            | SafetyRule::Unhealthy
            | SafetyRule::NotFinite
            | SafetyRule::Stale
            | SafetyRule::ZeroDrifted
            | SafetyRule::Noisy
            | SafetyRule::NoResponse
            | SafetyRule::Fallen
            | SafetyRule::SofterThanDeclared
            | SafetyRule::SofterThanTaught
            | SafetyRule::StifferThanTaught
            | SafetyRule::RisesAtRest
            | SafetyRule::OutputsDiffer
            | SafetyRule::OutputsMoved
            | SafetyRule::ForceRose
            | SafetyRule::ForceFell
            | SafetyRule::ZeroOutside
            | SafetyRule::ZeroInContact
            | SafetyRule::GainOff
            | SafetyRule::NoWeight
            | SafetyRule::WeightLeftOn
            | SafetyRule::WeightUnsteady => true,
            SafetyRule::OverForce
            | SafetyRule::Guarded
            | SafetyRule::HardContact
            | SafetyRule::StageSilent
            | SafetyRule::NoContact
            | SafetyRule::StillTouching
            | SafetyRule::OutOfReach
            | SafetyRule::NoConvergence
            | SafetyRule::SurfaceMoved
            | SafetyRule::ZeroShifted
            | SafetyRule::SurfaceElsewhere
            | SafetyRule::NotStopped
            | SafetyRule::NotPermitted => false,
        }
    }

    /// First thing to check.
    pub fn check(self) -> &'static str {
        match self {
            SafetyRule::OverForce => "check whether the specimen is stiffer than `limits.stiffness_n_mm`",
            SafetyRule::Guarded => "the controller's guard ended the motion: check what the indenter pressed on",
            SafetyRule::WrongSign => "check the load cell's wiring: pressing must read positive",
            SafetyRule::Frozen => "check that the transmitter still converts; reconnect the load cell",
            SafetyRule::Unhealthy => "check that the load cell is within its range and its cable is undamaged",
            SafetyRule::NotFinite => "check that the register map fits the transmitter",
            SafetyRule::Stale => "check whether the load cell's link is slow or broken",
            SafetyRule::ZeroDrifted => {
                "check whether something touches the indenter, or the cell has drifted since it was zeroed"
            }
            SafetyRule::Noisy => "check the cell for vibration, and that its range suits this force limit",
            SafetyRule::NoResponse => "check that the load cell still measures, and that the specimen hasn't slipped",
            SafetyRule::Fallen => "check whether the specimen slipped or tore, or the load cell's cable is loose",
            SafetyRule::HardContact => {
                "check what the indenter presses on, and whether `limits.stiffness_n_mm` is right for it"
            }
            SafetyRule::SofterThanDeclared => {
                "check whether the load cell reads too little (`palpate doctor --check-weight-n`), or the specimen is \
                 softer than `limits.stiffness_least_n_mm`"
            }
            SafetyRule::SofterThanTaught => {
                "check whether the load cell reads less than before (`palpate doctor --check-weight-n`), or the specimen tore or slipped"
            }
            SafetyRule::StifferThanTaught => {
                "check whether the load cell reads more than before (`palpate doctor --check-weight-n`), or something hard lies on \
                 the specimen"
            }
            SafetyRule::RisesAtRest => {
                "check whether the load cell is slower than `load_cell.lag_ms` states (its filter), or the specimen moves"
            }
            SafetyRule::OutputsDiffer => {
                "check the load cell with a known weight (`palpate doctor --check-weight-n`), and whether the array has moved or \
                 changed"
            }
            SafetyRule::StageSilent => {
                "the stage still reports that it moves, so long after its motion was due to end: check whether its link is slow or broken"
            }
            SafetyRule::NoContact => {
                "check that `frame.surface_mm` is right; with a larger `uncertainty`, `palpate align` finds the surface"
            }
            SafetyRule::StillTouching => {
                "check whether the indenter sticks, or the surface is higher than measured before"
            }
            SafetyRule::OutOfReach => {
                "check whether the specimen is softer than expected, or `limits.depth_mm` is too small for this force"
            }
            SafetyRule::NoConvergence => "check why the load cell is much noisier than when it was zeroed",
            SafetyRule::SurfaceMoved => {
                "check whether the specimen or the rig has moved; put it back, or start a new run"
            }
            SafetyRule::ZeroShifted => {
                "bring the stage to its zero again, more exactly, and check that the array is where it was; then `palpate resume`"
            }
            SafetyRule::SurfaceElsewhere => {
                "the specimen is nearer than `frame.surface_mm`; with a larger `uncertainty`, `palpate align` finds the surface"
            }
            SafetyRule::ForceRose => {
                "the stage has stopped and wasn't parked: free the indenter by hand, then check `frame.down` and the way of z"
            }
            SafetyRule::ForceFell => {
                "check whether something pulls at the indenter, or the load cell's wires are swapped"
            }
            SafetyRule::ZeroOutside => {
                "check whether something touches the indenter; if not, correct `load_cell.air_n`, the allowed range without load"
            }
            SafetyRule::ZeroInContact => "something touches the indenter after homing: remove it",
            SafetyRule::OutputsMoved => "the array detected a contact but the load cell didn't: check the load cell",
            SafetyRule::GainOff => {
                "the rig's `check` found that the load cell's gain is off: repair it and check it again, or adjust with \
                 `palpate doctor --check-weight-n N --adjust`"
            }
            SafetyRule::NoWeight => "check that the weight was put on and didn't move, and that the load cell measures",
            SafetyRule::WeightLeftOn => "check that the weight was taken off, and that nothing touches the tip",
            SafetyRule::WeightUnsteady => {
                "check that the weight acts along z each time, and is heavy enough for this cell"
            }
            SafetyRule::NotStopped => "the stage does not stop: press the emergency stop",
            SafetyRule::NotPermitted => "check `limits` and `frame` of the rig",
        }
    }
}

impl Trip {
    /// Creates a broken rule with its numbers.
    pub fn new(rule: SafetyRule, measured: f64, limit: f64, unit: &str) -> Self {
        Trip { rule, measured, limit, unit: unit.to_owned() }
    }
}

impl std::fmt::Display for Trip {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Trip { rule, measured, limit, unit } = self;
        write!(f, "{}: {measured:.4} {unit}, limit {limit:.4} {unit}; {}", rule.name(), rule.check())
    }
}
