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
    /// What else is known of the cause, in words; `None` if nothing is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known: Option<String>,
}

/// Declares the rules: `Rule, "name in files and messages", doubts_load_cell: ..., "first thing to check"`. The comment of a rule is its
/// meaning in `palpate reference safety-rules`.
macro_rules! rules {
    ($($(#[doc = $meaning:literal])* $rule:ident, $name:literal, doubts_load_cell: $doubts:literal, $check:literal;)*) => {
        /// Rules under which a press continues.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        pub enum SafetyRule { $($(#[doc = $meaning])* #[serde(rename = $name)] $rule,)* }

        impl SafetyRule {
            /// All rules.
            pub const ALL: &[SafetyRule] = &[$(SafetyRule::$rule),*];

            /// Name of the rule in files and messages.
            pub fn name(self) -> &'static str {
                match self { $(SafetyRule::$rule => $name,)* }
            }

            /// What broke the rule, in a sentence.
            pub fn meaning(self) -> &'static str {
                match self { $(SafetyRule::$rule => concat!($($meaning),*).trim_ascii(),)* }
            }

            /// Whether the load cell is in doubt after this rule was broken, so that its readings show nothing of the remaining force.
            pub fn doubts_load_cell(self) -> bool {
                match self { $(SafetyRule::$rule => $doubts,)* }
            }

            /// First thing to check.
            pub fn check(self) -> &'static str {
                match self { $(SafetyRule::$rule => $check,)* }
            }
        }
    };
}

rules! {
    /// The mean force of 10 ms exceeds the force limit by more than noise explains.
    OverForce, "over-force", doubts_load_cell: false,
        "check whether the specimen is stiffer than `limits.stiffness_n_mm`";
    /// The controller's own guard ended the motion.
    Guarded, "guarded", doubts_load_cell: false,
        "the controller's guard ended the motion: check what the indenter pressed on";
    /// The mean force of 10 ms is below zero by more than noise explains.
    WrongSign, "wrong-sign", doubts_load_cell: true,
        "check the load cell's wiring: pressing must read positive";
    /// The cell returns the same value again and again.
    Frozen, "frozen", doubts_load_cell: true,
        "check that the transmitter still converts; reconnect the load cell";
    /// The cell repeated one value under load, and reads less since the load is gone.
    Saturated, "saturated", doubts_load_cell: false,
        "the load cell can't read more than this: check that its range is larger than the force limit and its reading without load together";
    /// The cell or its transmitter reports overload or a fault.
    Unhealthy, "unhealthy", doubts_load_cell: true,
        "check that the load cell is within its range and its cable is undamaged";
    /// Too many readings of the load cell are ones that the stage can't have caused.
    Glitches, "glitches", doubts_load_cell: true,
        "check the load cell's cable, its supply and its ground, and whether its converter is read while it converts";
    /// A reading isn't a number.
    NotFinite, "not-finite", doubts_load_cell: true,
        "check that the register map fits the transmitter";
    /// There was no good reading for too long.
    Stale, "stale", doubts_load_cell: true,
        "check whether the load cell's link is slow or broken";
    /// The force without load differs from the zero of the run.
    ZeroDrifted, "zero-drifted", doubts_load_cell: true,
        "check whether something touches the indenter, or the cell has drifted since it was zeroed";
    /// The load cell's reading changed at once by more than the stage and the specimen can cause.
    Jumped, "jumped", doubts_load_cell: true,
        "check the load cell's range, because its count turns around at its end, and its supply and cable, because its zero or gain may have changed";
    /// The zero drifts so fast that it moves by a fifth of the force limit in a press.
    Drifts, "drifts", doubts_load_cell: true,
        "let the load cell warm up, away from drafts and motors";
    /// The noise without load is too large a part of the force limit.
    Noisy, "noisy", doubts_load_cell: true,
        "check the cell for vibration, and that its range suits this force limit";
    /// The force doesn't change after a step into the specimen.
    NoResponse, "no-response", doubts_load_cell: true,
        "check that the load cell still measures, and that the specimen hasn't slipped";
    /// The force sideways is over its limit.
    OverShear, "over-shear", doubts_load_cell: false,
        "check whether the specimen holds the tip more than `limits.drag` states; drag less far";
    /// The tip slipped in a drag whose recipe ends there.
    Slipped, "slipped", doubts_load_cell: false,
        "press harder, or drag less far; with `slip = \"record\"` the drag continues";
    /// The force sideways doesn't follow the drag.
    AxesDiffer, "axes-differ", doubts_load_cell: true,
        "check `load_cell.axes`: an axis is swapped or has the wrong sign";
    /// The force disappeared although the indenter wasn't retracted.
    Fallen, "fallen", doubts_load_cell: true,
        "check whether the specimen slipped or tore, or the load cell's cable is loose";
    /// The contact is stiffer than the declared stiffness allows.
    HardContact, "hard-contact", doubts_load_cell: false,
        "check what the indenter presses on, and whether `limits.stiffness_n_mm` is right for it";
    /// At the first press the force rises less than `stiffness_least_n_mm` requires.
    SofterThanDeclared, "softer-than-declared", doubts_load_cell: true,
        "check whether the load cell reads too little (`palpate doctor --check-weight-n`), or the specimen is softer than `limits.stiffness_least_n_mm`";
    /// The force rises much less than the presses around predict.
    SofterThanTaught, "softer-than-taught", doubts_load_cell: true,
        "check whether the load cell reads less than before (`palpate doctor --check-weight-n`), or the specimen tore or slipped";
    /// The force rises much more than the presses around predict.
    StifferThanTaught, "stiffer-than-taught", doubts_load_cell: true,
        "check whether the load cell reads more than before (`palpate doctor --check-weight-n`), or something hard is on the specimen";
    /// The force rises while the stage rests in contact.
    RisesAtRest, "rises-at-rest", doubts_load_cell: true,
        "check whether the load cell is slower than `load_cell.lag_ms` states (its filter), `load_cell.conversions_hz` is too high, or the specimen moves";
    /// The outputs for each newton, or their pattern, differ from what the presses around predict.
    OutputsDiffer, "outputs-differ", doubts_load_cell: true,
        "check the load cell with a known weight (`palpate doctor --check-weight-n`), and whether the array has moved or changed";
    /// The end of a motion wasn't reported in time.
    StageSilent, "stage-silent", doubts_load_cell: false,
        "the stage still reports that it moves, so long after its motion was due to end: check whether its link is slow or broken";
    /// There is no contact where the surface must be.
    NoContact, "no-contact", doubts_load_cell: false,
        "correct `frame.surface_mm`; with a load cell and a larger `uncertainty`, `palpate align` measures it";
    /// The contact continues after the indenter was retracted.
    StillTouching, "still-touching", doubts_load_cell: false,
        "check whether the indenter sticks, or the surface is higher than measured before";
    /// The force isn't reached within the permitted depth or force.
    OutOfReach, "out-of-reach", doubts_load_cell: false,
        "check whether the load cell reads too little (`palpate doctor --check-weight-n`), the specimen is softer than expected, `limits.depth_mm` is too small for this force, or the force is within \
         `stiffness_n_mm` times a few `step_mm.z` of `limits.force_n`; \
         for its way back in one motion, a ramp needs a smaller force or a smaller `limits.stiffness_n_mm`";
    /// The force isn't reached in the permitted number of steps.
    NoConvergence, "no-convergence", doubts_load_cell: false,
        "check why the load cell is much noisier than when it was zeroed";
    /// `resume` touched a known place at another height.
    SurfaceMoved, "surface-moved", doubts_load_cell: false,
        "check whether the specimen or the rig has moved; put it back, or start a new run";
    /// `resume` repeated presses with a stage without switches, and the outputs belong to places next to these.
    ZeroShifted, "zero-shifted", doubts_load_cell: false,
        "bring the stage to its zero again, more exactly, and check that the array is where it was; then `palpate resume`";
    /// The first touch came earlier than the frame allows.
    SurfaceElsewhere, "surface-elsewhere", doubts_load_cell: false,
        "the specimen is nearer than `frame.surface_mm`: correct it; with a load cell and a larger `uncertainty`, `palpate align` measures it";
    /// The force rose while z moved away, before there was a zero.
    ForceRose, "force-rose", doubts_load_cell: true,
        "the stage has stopped and wasn't parked: free the indenter by hand, then check `frame.down` and the way of z";
    /// The force fell further than a contact within the limit allows.
    ForceFell, "force-fell", doubts_load_cell: true,
        "check whether something pulls at the indenter, or the load cell's wires are swapped";
    /// The cell's reading without load is outside `load_cell.air_n`.
    ZeroOutside, "zero-outside", doubts_load_cell: true,
        "check whether something touches the indenter; if not, the cell has drifted, or `load_cell.air_n`, the allowed range without load, is too narrow";
    /// The zero changes when z moves a little, so it was taken in contact.
    ZeroInContact, "zero-in-contact", doubts_load_cell: true,
        "something touches the indenter after homing: remove it";
    /// While the stage homes, or before the first touch, the outputs changed but the force didn't.
    OutputsMoved, "outputs-moved", doubts_load_cell: true,
        "the array detected a contact but the load cell didn't: check the load cell";
    /// A known weight showed that the cell's gain is off.
    GainOff, "gain-off", doubts_load_cell: true,
        "the rig's `check` found that the load cell's gain is off: repair it and check it again, or adjust with `palpate doctor --check-weight-n N --adjust`";
    /// No known weight rested on the load cell in time.
    NoWeight, "no-weight", doubts_load_cell: true,
        "check that the weight was put on and didn't move, and that the load cell measures";
    /// The known weight wasn't taken off in time.
    WeightLeftOn, "weight-left-on", doubts_load_cell: true,
        "check that the weight was taken off, and that nothing touches the tip";
    /// The readings of a known weight differ between repetitions.
    WeightUnsteady, "weight-unsteady", doubts_load_cell: true,
        "check that the weight acts along z each time, and is heavy enough for this cell";
    /// The stage moves on although it was stopped.
    NotStopped, "not-stopped", doubts_load_cell: false,
        "the stage does not stop: press the emergency stop";
    /// A motion with an unsafe end point was requested.
    NotPermitted, "not-permitted", doubts_load_cell: false,
        "check `limits` and `frame` of the rig";
}

impl Trip {
    /// Creates a broken rule with its numbers.
    pub fn new(rule: SafetyRule, measured: f64, limit: f64, unit: &str) -> Self {
        Trip { rule, measured, limit, unit: unit.to_owned(), known: None }
    }

    /// Returns it with what else is known of the cause, which the message states before what to check.
    #[must_use]
    pub fn with(self, known: String) -> Self {
        Trip { known: Some(known), ..self }
    }
}

impl std::fmt::Display for Trip {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Trip { rule, measured, limit, unit, known } = self;
        let known = known.iter().map(|known| format!("{known}; ")).collect::<String>();
        if unit.contains("readings") {
            let digits = if measured.fract() == 0.0 { 0 } else { 1 };
            return write!(f, "{}: {measured:.digits$} {unit}, limit {limit:.0}; {known}{}", rule.name(), rule.check());
        }
        write!(f, "{}: {measured:.4} {unit}, limit {limit:.4} {unit}; {known}{}", rule.name(), rule.check())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_to_align_is_for_a_rig_with_a_load_cell() {
        let advised: Vec<&str> =
            SafetyRule::ALL.iter().map(|rule| rule.check()).filter(|check| check.contains("palpate align")).collect();
        assert_eq!(advised.len(), 2, "{advised:?}");
        assert!(advised.iter().all(|check| check.contains("with a load cell")), "{advised:?}");
    }
}
