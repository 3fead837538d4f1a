//! Pages about runs: one HTML file each that needs nothing else, neither a network nor a script.
//!
//! [`page`] tells of one [`Subject`], a sensor with all that was recorded of it: verdict and tables first, then the paper's
//! figures as measured, then how the force was controlled and on what. [`comparison`] holds many sensors, or one over time,
//! side by side. Every number that an evaluation gives stands in a `data` element whose `value` is that of `evaluate --json`,
//! not a digit less.

mod comparison;
mod facts;
mod figures;
mod frame;
mod headline;
mod judged;
mod record;
mod subject;
mod table_1;
mod uncertainty;
mod verdict;

pub use comparison::{Compared, ToCompare, comparison};
pub use frame::{MARK, counted};
pub use judged::Judged;
pub use subject::{ReportError, Subject};

use maud::html;

/// A page about one sensor. Nothing in it depends on the time or the machine: the same runs give the same bytes.
pub fn page(subject: &Subject, judged: &Judged) -> String {
    let sections = [
        headline::section(subject, judged),
        table_1::section(subject),
        figures::units(subject),
        figures::locations(judged),
        figures::distributions(judged),
        figures::dependences(subject, judged),
        figures::expected(subject, judged),
        record::section(subject),
        uncertainty::section(subject),
        facts::section(subject),
    ];
    let title = subject.title();
    let body = html! {
        header {
            h1 { (title) }
            p.lede { (subject.told()) }
        }
        @for section in sections.into_iter().flatten() { (section) }
    };
    frame::document(&title, &body)
}
