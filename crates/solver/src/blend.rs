//! Mean of a regression and a map, each weighted by its expected error.

use super::heldout::HeldPress;
use super::method::FittedMethod;
use super::widths::rank_68;
use super::{Locate, LocatedContact, SolveError, Workspace};
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// Weighted mean of two methods that have different kinds of errors. Each weight is the inverse of the expected square error. The
/// expected error combines the method's own statement for this reading and the method's results on held-out presses. If the two
/// answers are too far apart to belong to one contact, only the more certain answer counts. A reading is unlike one contact if
/// both members find it so.
#[derive(Serialize, Deserialize)]
pub(super) struct Blend {
    members: Box<[FittedMethod; 2]>,
    errors: [MemberErrors; 2],
}

/// Results of a member on held-out presses: the ratios of location and force errors to the member's own scale that 68 % of the presses
/// don't exceed, which a few answers at a wrong place hardly change; and the mean residue.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct MemberErrors {
    location: f64,
    force: f64,
    residue: f64,
}

/// Distance of two answers, as a multiple of their expected distance, above which they aren't averaged.
const APART: f64 = 4.0;

impl Blend {
    pub(crate) fn new(members: [FittedMethod; 2], errors: [MemberErrors; 2]) -> Self {
        Blend { members: Box::new(members), errors }
    }

    /// Returns the trials of the blend, from the members' trials on the same held-out presses.
    pub(crate) fn trials(trials: [&[HeldPress]; 2]) -> Vec<HeldPress> {
        let errors = &trials.map(MemberErrors::of);
        let blended = |(one, other): (&HeldPress, &HeldPress)| HeldPress {
            answer: match (&one.answer, &other.answer) {
                (Ok(one), Ok(other)) => Ok(mean([one, other], errors)),
                (Err(error), _) | (_, Err(error)) => Err(error.clone()),
            },
            ..*one
        };
        trials[0].iter().zip(trials[1]).map(blended).collect()
    }
}

impl MemberErrors {
    /// Returns the errors of a member that was tried on held-out presses.
    pub(crate) fn of(trials: &[HeldPress]) -> Self {
        let answered = || trials.iter().filter_map(|trial| Some((trial, trial.answer.as_ref().ok()?)));
        let known = |error: &dyn Fn(&HeldPress, &LocatedContact) -> f64| -> Vec<f64> {
            answered().map(|(trial, answer)| error(trial, answer)).filter(|error| error.is_finite()).collect()
        };
        let typical = |errors: Vec<f64>| rank_68(errors).filter(|error| *error > 0.0).unwrap_or(1.0);
        let residues = known(&|_, answer| answer.residue);
        let residue = residues.iter().sum::<f64>() / residues.len() as f64;
        MemberErrors {
            location: typical(known(&|trial, answer| answer.place.distance_mm(trial.place) / answer.scale_mm)),
            force: typical(known(&|trial, answer| (answer.force_n - trial.force_n).abs() / answer.scale_n)),
            residue: if residue > 0.0 { residue } else { 1.0 },
        }
    }
}

impl Locate for Blend {
    fn name(&self) -> &'static str {
        "blend"
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<LocatedContact, SolveError> {
        let [one, other] = &*self.members;
        Ok(mean([&one.locate(outputs, workspace)?, &other.locate(outputs, workspace)?], &self.errors))
    }
}

/// Returns the mean of two answers. Its scales are standard deviations, which include the mean's expected error and the
/// difference of the two answers.
fn mean(answers: [&LocatedContact; 2], errors: &[MemberErrors; 2]) -> LocatedContact {
    let [one, other] = answers;
    let of = |of_member: fn(&MemberErrors) -> f64, scale: fn(&LocatedContact) -> f64, apart: f64| {
        let sd = |member: usize| of_member(&errors[member]) * scale(answers[member]);
        WeightedMean::of([sd(0), sd(1)], apart)
    };
    let location = of(|errors| errors.location, |answer| answer.scale_mm, one.place.distance_mm(other.place));
    let force = of(|errors| errors.force, |answer| answer.scale_n, one.force_n - other.force_n);
    LocatedContact {
        place: Place::new(
            location.mean(one.place.x_mm, other.place.x_mm),
            location.mean(one.place.y_mm, other.place.y_mm),
        ),
        force_n: force.mean(one.force_n, other.force_n),
        residue: (one.residue / errors[0].residue).min(other.residue / errors[1].residue),
        scale_mm: location.sd,
        scale_n: force.sd,
        ..LocatedContact::PLAIN
    }
}

/// Weight of the first of two values, and the standard deviation of their weighted mean.
struct WeightedMean {
    first: f64,
    sd: f64,
}

impl WeightedMean {
    /// Returns the weights for two values with these standard deviations and this difference. A value whose standard deviation is
    /// unknown has no weight.
    fn of(sds: [f64; 2], apart: f64) -> Self {
        let [one, other] = sds.map(|sd| if sd > 0.0 { sd * sd } else { f64::INFINITY });
        let first = match (one.is_finite(), other.is_finite()) {
            (true, true) if apart.abs() > APART * (one + other).sqrt() => f64::from(u8::from(one <= other)),
            (true, true) => other / (one + other),
            (first, second) => 0.5 * (1.0 + f64::from(u8::from(first)) - f64::from(u8::from(second))),
        };
        let own = [(first, one), (1.0 - first, other)];
        let own: f64 =
            own.iter().filter(|(weight, _)| *weight > 0.0).map(|(weight, variance)| weight.powi(2) * variance).sum();
        WeightedMean { first, sd: (own + first * (1.0 - first) * apart * apart).sqrt() }
    }

    fn mean(&self, one: f64, other: f64) -> f64 {
        self.first * one + (1.0 - self.first) * other
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ERRORS: MemberErrors = MemberErrors { location: 0.1, force: 0.01, residue: 2.0 };

    fn answer(x_mm: f64, force_n: f64, scale_mm: f64) -> LocatedContact {
        LocatedContact { place: Place::new(x_mm, 0.0), force_n, residue: 2.0, scale_mm, ..LocatedContact::PLAIN }
    }

    #[test]
    fn answer_with_the_smaller_error_weighs_more() {
        let blended = mean([&answer(0.0, 1.0, 1.0), &answer(0.3, 1.02, 2.0)], &[ERRORS, ERRORS]);
        // squares of 0.1 and 0.2 mm: four to one
        assert!((blended.place.x_mm - 0.06).abs() < 1e-12, "{blended:?}");
        assert!((blended.force_n - 1.01).abs() < 1e-12 && blended.residue == 1.0, "{blended:?}");
        let (own, apart) = (0.8 * 0.8 * 0.01 + 0.2 * 0.2 * 0.04, 0.8 * 0.2 * 0.09);
        assert!((blended.scale_mm - f64::sqrt(own + apart)).abs() < 1e-12, "{blended:?}");
    }

    #[test]
    fn places_that_are_far_apart_are_not_averaged() {
        let blended = mean([&answer(0.0, 1.0, 2.0), &answer(5.0, 1.0, 1.0)], &[ERRORS, ERRORS]);
        assert_eq!(blended.place, Place::new(5.0, 0.0));
    }

    #[test]
    fn answer_without_stated_error_has_no_weight() {
        let blended = mean([&answer(0.0, 1.0, f64::NAN), &answer(0.1, 1.0, 1.0)], &[ERRORS, ERRORS]);
        assert_eq!((blended.place, blended.scale_mm), (Place::new(0.1, 0.0), 0.1));
        let neither = mean([&answer(0.0, 1.0, f64::NAN), &answer(0.1, 1.0, f64::NAN)], &[ERRORS, ERRORS]);
        assert_eq!(neither.place, Place::new(0.05, 0.0));
    }
}
