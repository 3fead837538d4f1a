//! Answer of a reading as a place and a force vector, as two contacts, or as neither.

use palpate_core::quantity::{ArrayLayout, Place, round};
use palpate_solver::causes::{Causes, Explanation, MisfitCause};
use palpate_solver::two::{ContactCount, Pair};
use palpate_solver::vector::{Shear, VectorContact, VectorMap, VectorWorkspace};
use serde_json::Value;

/// Number of decimals of an answer, as in a run's tables.
const DECIMALS: i32 = 6;

/// Solves readings on the map of a calibration.
pub(super) struct VectorSolver<'a> {
    map: &'a VectorMap,
    causes: Causes<'a>,
}

/// What a reading means.
pub(super) struct VectorAnswer {
    contact: Option<VectorContact>,
    pair: Option<Pair>,
    verdict: String,
    unit: Option<usize>,
}

impl<'a> VectorSolver<'a> {
    pub(super) fn new(map: &'a VectorMap, layout: &ArrayLayout) -> Self {
        VectorSolver { map, causes: Causes::new(map, layout) }
    }

    pub(super) fn answer(&self, outputs: &[f64], workspace: &mut VectorWorkspace) -> VectorAnswer {
        let solved = self.map.solve(outputs, workspace);
        let explained = self.causes.explain(outputs, workspace);
        let (Ok(contact), Ok(explanation)) = (solved, explained) else {
            return VectorAnswer { contact: None, pair: None, verdict: "unsolved".to_owned(), unit: None };
        };
        let answer = |verdict: &str| VectorAnswer {
            contact: Some(contact),
            pair: None,
            verdict: verdict.to_owned(),
            unit: None,
        };
        match explanation {
            Explanation::Is(MisfitCause::TwoContacts) => match self.causes.two().solve(outputs, workspace) {
                Ok(ContactCount::Two(pair)) => {
                    VectorAnswer { contact: None, pair: Some(pair), ..answer("two-contacts") }
                }
                Ok(ContactCount::TwoNotSeparable(pair)) => {
                    VectorAnswer { contact: None, pair: Some(pair), ..answer("two-not-separable") }
                }
                _ => answer("not-one-contact"),
            },
            Explanation::Is(MisfitCause::BrokenUnit(unit)) => {
                VectorAnswer { unit: Some(unit + 1), ..answer("unit-fault") }
            }
            Explanation::Either(one, other) => answer(&format!("{} or {}", word(one), word(other))),
            Explanation::OneContact | Explanation::Is(MisfitCause::Shear) if contact.misfit > 1.0 => {
                answer("not-one-contact")
            }
            Explanation::OneContact | Explanation::Is(MisfitCause::Shear) => match contact.shear {
                Shear::Force(_) => answer("ok"),
                Shear::NotDeterminable { .. } => answer("shear-unknown"),
            },
        }
    }
}

/// Word of a cause where two explain a reading as well.
fn word(cause: MisfitCause) -> &'static str {
    match cause {
        MisfitCause::Shear => "shear",
        MisfitCause::TwoContacts => "two-contacts",
        MisfitCause::BrokenUnit(_) => "unit-fault",
    }
}

impl VectorAnswer {
    /// Returns the columns of the answer. Forces are in N, along x, y and into the specimen; a standard deviation has the prefix `sd_`.
    /// `shear_bound_n` is the expected error of a force along the surface that the outputs can't show.
    pub(super) fn fields(&self) -> Vec<(&'static str, Value)> {
        let number = |number: Option<f64>| {
            number.filter(|number| number.is_finite()).map_or(Value::Null, |number| round(number, DECIMALS).into())
        };
        let places: [Option<Place>; 2] = match (&self.contact, &self.pair) {
            (_, Some(pair)) => pair.places.map(Some),
            (Some(contact), None) => [Some(contact.place), None],
            (None, None) => [None, None],
        };
        let presses = match (&self.contact, &self.pair) {
            (_, Some(pair)) => pair.forces_n.map(Some),
            (contact, None) => [contact.as_ref().map(|contact| contact.press_n), None],
        };
        let (shear_n, bound_n) = match self.contact.as_ref().map(|contact| contact.shear) {
            Some(Shear::Force(shear_n)) => (shear_n.map(Some), None),
            Some(Shear::NotDeterminable { bound_n }) => ([None; 2], Some(bound_n)),
            None => ([None; 2], None),
        };
        let sd = self.contact.as_ref().map(|contact| contact.covariance.sd());
        let sd_of = |component: usize| sd.map(|sd| sd[component]);
        let sd_shear = |component: usize, axis: usize| shear_n[axis].and(sd_of(component));
        vec![
            ("x_mm", number(places[0].map(|place| place.x_mm))),
            ("y_mm", number(places[0].map(|place| place.y_mm))),
            ("force_x_n", number(shear_n[0])),
            ("force_y_n", number(shear_n[1])),
            ("force_n", number(presses[0])),
            ("sd_x_mm", number(sd_of(0))),
            ("sd_y_mm", number(sd_of(1))),
            ("sd_force_x_n", number(sd_shear(2, 0))),
            ("sd_force_y_n", number(sd_shear(3, 1))),
            ("sd_force_n", number(sd_of(4))),
            ("shear_bound_n", number(bound_n)),
            ("second_x_mm", number(places[1].map(|place| place.x_mm))),
            ("second_y_mm", number(places[1].map(|place| place.y_mm))),
            ("second_force_n", number(presses[1])),
            ("misfit", number(self.contact.as_ref().map(|contact| contact.misfit))),
            ("verdict", self.verdict.as_str().into()),
            ("unit", self.unit.map_or(Value::Null, Value::from)),
        ]
    }
}
