//! Studies of the methods: how near and how fast, with how many presses, and where they fail, on skins read without a rig.

mod budget;
mod conditions;
pub(super) mod cramer_rao;
mod failures;
mod figures;
mod recorded;
pub(super) mod specimen;
mod speed_accuracy;
mod trial;

pub use budget::{BudgetSize, PRESS_S, budget};
pub use conditions::{CONDITIONS, Harm};
pub use failures::{FailuresSize, failures};
pub use figures::{budget_figures, failure_figures, speed_accuracy_figures};
pub use recorded::{of_run, of_tables};
pub use specimen::NoiseReference;
pub use speed_accuracy::{MethodTrial, speed_accuracy};
pub use trial::{Method, MethodRow};

use super::ndjson;

/// What came of a study.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// A row a method and condition.
    pub rows: Vec<MethodRow>,
}

impl Rows {
    /// One JSON object a line.
    pub fn ndjson(&self) -> String {
        ndjson(&self.rows)
    }

    /// The rows of one scene, method and condition, in order.
    pub fn of<'a>(
        &'a self,
        scene: &'a str,
        solver: &'a str,
        condition: &'a str,
    ) -> impl Iterator<Item = &'a MethodRow> {
        self.rows.iter().filter(move |row| row.scene == scene && row.solver == solver && row.condition == condition)
    }
}
