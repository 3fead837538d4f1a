//! Studies of the methods on skins read without a rig: accuracy, speed, number of presses required, and conditions of failure.

mod budget;
mod conditions;
mod covered;
pub(super) mod cramer_rao;
mod failures;
mod figures;
mod recorded;
pub(super) mod specimen;
mod speed_accuracy;
mod trial;

pub use budget::{PRESS_S, budget, budget_of};
pub use conditions::{CONDITIONS, Harm};
pub use covered::FoundCoverage;
pub use covered::STATED_PERCENT;
pub use failures::failures;
pub use figures::{budget_figures, budget_figures_of, coverage_figures, failure_figures, speed_accuracy_figures};
pub use recorded::{of_run, of_tables};
pub use specimen::{KnownReadings, NoiseReference};
pub use speed_accuracy::{AnswerTimer, MethodTrial, speed_accuracy};
pub(crate) use trial::CRAMER_RAO;
pub use trial::{MethodRow, StudiedMethod, Tally};

/// Returns the rows of one scene, method and condition, in order.
pub fn rows_of<'a>(
    rows: &'a [MethodRow],
    scene: &'a str,
    solver: &'a str,
    condition: &'a str,
) -> impl Iterator<Item = &'a MethodRow> {
    rows.iter().filter(move |row| row.scene == scene && row.solver == solver && row.condition == condition)
}
