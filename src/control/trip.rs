//! Safety rules that were broken.

use crate::quantity::any_number;
use serde::{Deserialize, Serialize};

/// A safety rule that was broken: stop, retract, record, tell. It is never retried by itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trip {
    /// Which rule.
    pub rule: Rule,
    /// What was measured, in `unit`.
    #[serde(with = "any_number")]
    pub measured: f64,
    /// What the rule allows, in `unit`.
    #[serde(with = "any_number")]
    pub limit: f64,
    /// Unit of both.
    pub unit: String,
}

/// The rules under which a press goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rule {
    /// The mean of 10 ms is above the force limit by more than the noise explains.
    OverForce,
    /// The stage's controller saw too large a force itself and ended the motion.
    Guarded,
    /// The mean of 10 ms is below zero by more than the noise explains.
    WrongSign,
    /// The cell gives the same code again and again, which its noise makes all but impossible.
    Frozen,
    /// The cell or its transmitter says it is beyond its range or broken.
    Unhealthy,
    /// A reading that is not a number.
    NotFinite,
    /// No good reading for too long.
    Stale,
    /// The force in air is not zero any more, or not the zero the run began with.
    ZeroDrifted,
    /// The noise in air is too large a part of the force limit.
    Noisy,
    /// The force doesn't answer a step into the specimen.
    NoResponse,
    /// The force is gone although nothing was withdrawn.
    Fallen,
    /// The contact pushes harder than the declared stiffness lets it.
    HardContact,
    /// At the first press the force rises less than the declared least stiffness makes it.
    SofterThanDeclared,
    /// The force rises much less than at the presses around.
    SofterThanTaught,
    /// The stage hasn't said for too long that a motion ended.
    StageSilent,
    /// No contact where the surface must be.
    NoContact,
    /// The contact lasts after the indenter was withdrawn.
    StillTouching,
    /// The force couldn't be reached within the depth or the force that is permitted.
    OutOfReach,
    /// The force wasn't reached in as many steps as are allowed.
    NoConvergence,
    /// A place that was touched before is touched at another height.
    SurfaceMoved,
    /// The first touch came where the frame says that there is no specimen yet.
    SurfaceElsewhere,
    /// The force rose while z moved away, before there was a zero.
    ForceRose,
    /// It fell further than a contact within the limit can make it.
    ForceFell,
    /// What the load cell says in air isn't what it may say there.
    ZeroOutside,
    /// The zero is another one where z is a little farther away: it was taken in contact.
    ZeroInContact,
    /// The outputs moved before the first touch, and the force didn't.
    OutputsMoved,
    /// The load cell's gain, as a known weight showed it, is off and isn't adjusted for.
    GainOff,
    /// No known weight came to rest on the load cell in time.
    NoWeight,
    /// The known weight wasn't taken off the load cell in time.
    WeightLeftOn,
    /// A known weight reads differently from time to time.
    WeightUnsteady,
    /// A motion was asked for whose end point isn't safe.
    NotPermitted,
}

impl Rule {
    /// The rule as it stands in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Rule::OverForce => "over-force",
            Rule::Guarded => "guarded",
            Rule::WrongSign => "wrong-sign",
            Rule::Frozen => "frozen",
            Rule::Unhealthy => "unhealthy",
            Rule::NotFinite => "not-finite",
            Rule::Stale => "stale",
            Rule::ZeroDrifted => "zero-drifted",
            Rule::Noisy => "noisy",
            Rule::NoResponse => "no-response",
            Rule::Fallen => "fallen",
            Rule::HardContact => "hard-contact",
            Rule::SofterThanDeclared => "softer-than-declared",
            Rule::SofterThanTaught => "softer-than-taught",
            Rule::StageSilent => "stage-silent",
            Rule::NoContact => "no-contact",
            Rule::StillTouching => "still-touching",
            Rule::OutOfReach => "out-of-reach",
            Rule::NoConvergence => "no-convergence",
            Rule::SurfaceMoved => "surface-moved",
            Rule::SurfaceElsewhere => "surface-elsewhere",
            Rule::ForceRose => "force-rose",
            Rule::ForceFell => "force-fell",
            Rule::ZeroOutside => "zero-outside",
            Rule::ZeroInContact => "zero-in-contact",
            Rule::OutputsMoved => "outputs-moved",
            Rule::GainOff => "gain-off",
            Rule::NoWeight => "no-weight",
            Rule::WeightLeftOn => "weight-left-on",
            Rule::WeightUnsteady => "weight-unsteady",
            Rule::NotPermitted => "not-permitted",
        }
    }

    /// What to look at first.
    pub fn check(self) -> &'static str {
        match self {
            Rule::OverForce => "is the specimen stiffer than `limits.stiffness_n_mm` says?",
            Rule::Guarded => "what did the indenter press on? The controller's guard ended the motion",
            Rule::WrongSign => "is the load cell wired so that pressing reads positive?",
            Rule::Frozen => "does the transmitter still convert? Reconnect the load cell",
            Rule::Unhealthy => "is the load cell within its range and its cable whole?",
            Rule::NotFinite => "does the register map fit the transmitter?",
            Rule::Stale => "is the load cell's link slow or broken?",
            Rule::ZeroDrifted => "does something touch the indenter, or has the cell drifted since it was zeroed?",
            Rule::Noisy => "does the cell stand free of vibration, and is its range right for this force limit?",
            Rule::NoResponse => "does the load cell still measure, and has the specimen not slipped away?",
            Rule::Fallen => "has the specimen slipped or torn, or has the load cell's cable come loose?",
            Rule::HardContact => "what does the indenter press on? Is `limits.stiffness_n_mm` right for it?",
            Rule::SofterThanDeclared => {
                "does the load cell read too little (`palpate doctor --check-weight-n`)? Or is the specimen softer than \
                 `limits.stiffness_least_n_mm`?"
            }
            Rule::SofterThanTaught => {
                "does the load cell read less than before (`palpate doctor --check-weight-n`)? Or has the specimen torn or slipped?"
            }
            Rule::StageSilent => "is the stage's link slow or broken? The motion has ended by itself",
            Rule::NoContact => {
                "is the specimen where `frame.surface_mm` says? With a larger `uncertainty`, `palpate align` finds it"
            }
            Rule::StillTouching => "does the indenter stick, or is the surface higher than learned?",
            Rule::OutOfReach => "is the specimen softer than expected, or `limits.depth_mm` too small for this force?",
            Rule::NoConvergence => "is the load cell much noisier than when it was zeroed?",
            Rule::SurfaceMoved => "was the specimen or the rig touched since? Put it back, or begin a new run",
            Rule::SurfaceElsewhere => {
                "the specimen is nearer than `frame.surface_mm` says: with a larger `uncertainty`, `palpate align` finds it"
            }
            Rule::ForceRose => {
                "is `frame.down` right, and is nothing in the way of z? The stage stands where it stopped: free the indenter by hand"
            }
            Rule::ForceFell => "does something pull at the indenter, or is the load cell wired the wrong way round?",
            Rule::ZeroOutside => {
                "does something touch the indenter? If not, `load_cell.air_n` says what the cell may read in air"
            }
            Rule::ZeroInContact => "something touches the indenter where homing leaves it: free it",
            Rule::OutputsMoved => "does the load cell measure? The array felt something that the load cell didn't",
            Rule::GainOff => {
                "the rig's `check` found that the load cell's gain is off: repair it and check it again, or adjust with \
                 `palpate doctor --check-weight-n N --adjust`"
            }
            Rule::NoWeight => "was the weight put on, did it hang or lie still, and does the load cell measure?",
            Rule::WeightLeftOn => "was the weight taken off, and does nothing touch the tip?",
            Rule::WeightUnsteady => {
                "does the weight act straight along z each time, and is it heavy enough for this cell?"
            }
            Rule::NotPermitted => "are `limits` and `frame` of the rig right?",
        }
    }
}

impl Trip {
    /// A broken rule with its numbers.
    pub fn new(rule: Rule, measured: f64, limit: f64, unit: &str) -> Self {
        Trip { rule, measured, limit, unit: unit.to_owned() }
    }
}

impl std::fmt::Display for Trip {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Trip { rule, measured, limit, unit } = self;
        write!(f, "{}: {measured:.4} {unit}, limit {limit:.4} {unit}; {}", rule.name(), rule.check())
    }
}
