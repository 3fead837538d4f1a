//! Answer to a reading: a place and a force vector, two contacts, or the reason why it is neither.

use super::{Shear, VectorContact, VectorWorkspace};
use crate::SolveError;
use crate::causes::{Causes, Explanation, MisfitCause, explain};
use crate::two::Pair;
use std::borrow::Cow;

/// What a reading means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VectorSolution {
    /// Best single contact.
    pub contact: VectorContact,
    /// Both contacts, if there are two.
    pub pair: Option<Pair>,
    /// Sum of squares that the contact, or both contacts leave, divided by the limit of the accepted false alarms.
    pub misfit: f64,
    /// Whether the answer is credible.
    pub verdict: VectorVerdict,
}

/// Whether an answer is credible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VectorVerdict {
    /// No reason for doubt was found.
    Ok,
    /// The reading can't be distinguished from a reading without contact.
    WeakSignal,
    /// The contact lies outside the calibrated area.
    OutsideArea,
    /// The outputs can't show the force along the surface.
    ShearUnknown,
    /// Two contacts.
    TwoContacts,
    /// Two contacts, whose places or forces the outputs hardly show.
    TwoNotSeparable,
    /// No single contact gives this reading, and no other cause explains it.
    NotOneContact,
    /// One unit, counted from 0, contradicts all others.
    UnitFault(usize),
    /// Not one known contact: both causes explain the reading.
    Either(MisfitCause, MisfitCause),
}

impl VectorVerdict {
    /// Returns the word for the verdict.
    pub fn word(self) -> Cow<'static, str> {
        let word = |cause: MisfitCause| match cause {
            MisfitCause::Shear => "shear",
            MisfitCause::TwoContacts => "two-contacts",
            MisfitCause::BrokenUnit(_) => "unit-fault",
            MisfitCause::Outside => "outside-area",
        };
        Cow::Borrowed(match self {
            VectorVerdict::Ok => "ok",
            VectorVerdict::WeakSignal => "weak-signal",
            VectorVerdict::OutsideArea => "outside-area",
            VectorVerdict::ShearUnknown => "shear-unknown",
            VectorVerdict::TwoContacts => "two-contacts",
            VectorVerdict::TwoNotSeparable => "two-not-separable",
            VectorVerdict::NotOneContact => "not-one-contact",
            VectorVerdict::UnitFault(_) => "unit-fault",
            VectorVerdict::Either(one, other) => return Cow::Owned(format!("{} or {}", word(one), word(other))),
        })
    }

    /// Returns the unit that contradicts the others, counted from 1.
    pub fn unit(self) -> Option<usize> {
        match self {
            VectorVerdict::UnitFault(unit) => Some(unit + 1),
            _ => None,
        }
    }
}

/// Numbers of an answer, in their order. Forces are in N, along x, along y and into the specimen; `shear_bound_n` is the expected
/// error of a force along the surface that the outputs can't show.
pub const VECTOR_NUMBERS: [&str; 15] = [
    "x_mm",
    "y_mm",
    "force_x_n",
    "force_y_n",
    "force_n",
    "sd_x_mm",
    "sd_y_mm",
    "sd_force_x_n",
    "sd_force_y_n",
    "sd_force_n",
    "shear_bound_n",
    "second_x_mm",
    "second_y_mm",
    "second_force_n",
    "misfit",
];

impl VectorSolution {
    /// Returns the numbers in the order of [`VECTOR_NUMBERS`]; NaN if a number is unknown. Of two contacts only the
    /// standard deviation of the first force is stated.
    pub fn numbers(&self) -> [f64; VECTOR_NUMBERS.len()] {
        const UNKNOWN: f64 = f64::NAN;
        let VectorContact { place, press_n, shear, covariance, .. } = self.contact;
        let misfit = self.misfit;
        if let Some(Pair { places: [first, second], forces_n, errors_n, .. }) = self.pair {
            let mut numbers = [UNKNOWN; VECTOR_NUMBERS.len()];
            [numbers[0], numbers[1], numbers[4], numbers[9]] = [first.x_mm, first.y_mm, forces_n[0], errors_n[0]];
            numbers[11..].copy_from_slice(&[second.x_mm, second.y_mm, forces_n[1], misfit]);
            return numbers;
        }
        let [sd_x, sd_y, sd_force_x, sd_force_y, sd_force] = covariance.sd();
        let ([x_n, y_n], sd_shear, bound_n) = match shear {
            Shear::Force(force_n) => (force_n, [sd_force_x, sd_force_y], UNKNOWN),
            Shear::NotDeterminable { bound_n } => ([UNKNOWN; 2], [UNKNOWN; 2], bound_n),
        };
        let contact = [place.x_mm, place.y_mm, x_n, y_n, press_n, sd_x, sd_y, sd_shear[0], sd_shear[1], sd_force];
        let mut numbers = [UNKNOWN; VECTOR_NUMBERS.len()];
        numbers[..contact.len()].copy_from_slice(&contact);
        [numbers[10], numbers[14]] = [bound_n, misfit];
        numbers
    }
}

impl Causes {
    /// Returns what a reading means, with numbers.
    ///
    /// # Errors
    /// The reading has another number of outputs, a number isn't finite, or no press explains any of it.
    pub fn solve(&self, outputs: &[f64], workspace: &mut VectorWorkspace) -> Result<VectorSolution, SolveError> {
        let contact = self.map().solve(outputs, workspace)?;
        let answer = |verdict: VectorVerdict| VectorSolution { contact, pair: None, misfit: contact.misfit, verdict };
        if self.map().is_weak(outputs) {
            return Ok(answer(VectorVerdict::WeakSignal));
        }
        let (candidates, pair) = self.compared(outputs, workspace)?;
        Ok(match explain(&candidates) {
            Explanation::Is(MisfitCause::TwoContacts) => {
                let misfit = pair.map_or(f64::INFINITY, |pair| self.map().pair_misfit(&pair));
                let is_separable = misfit <= 1.0 && pair.is_some_and(|pair| pair.is_separable());
                let verdict = if is_separable { VectorVerdict::TwoContacts } else { VectorVerdict::TwoNotSeparable };
                VectorSolution { pair, misfit, ..answer(verdict) }
            }
            Explanation::Is(MisfitCause::BrokenUnit(unit)) => answer(VectorVerdict::UnitFault(unit)),
            Explanation::Is(MisfitCause::Outside) => answer(VectorVerdict::OutsideArea),
            Explanation::Either(one, other) => answer(VectorVerdict::Either(one, other)),
            Explanation::OneContact | Explanation::Is(MisfitCause::Shear) => answer(match contact.shear {
                _ if contact.beyond > self.map().beyond_most() => VectorVerdict::OutsideArea,
                _ if contact.misfit > 1.0 => VectorVerdict::NotOneContact,
                Shear::Force(_) => VectorVerdict::Ok,
                Shear::NotDeterminable { .. } => VectorVerdict::ShearUnknown,
            }),
        })
    }
}
