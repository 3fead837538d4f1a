//! Pages about runs: one HTML file each that needs nothing else, neither a network nor a script.
//!
//! [`page`] is about one [`Subject`], a sensor with all that was recorded of it: verdict and tables first, then its figures,
//! then how the force was controlled and on what. [`comparison`] puts many sensors, or one over time, side by side. Every number
//! that an evaluation gives is in a `data` element whose `value` is that of `evaluate --json`, not a digit less. Each figure can
//! be saved with the numbers behind it ([`Drawn`]). The paper is cited only where its numbers stand beside ours
//! ([`is_beside_paper`]).

mod beside_paper;
pub mod certificate;
mod comparison;
mod facts;
mod figures;
mod frame;
mod headline;
mod judged;
mod numbers;
mod record;
mod subject;
mod table_1;
mod uncertainty;
mod verdict;

pub use beside_paper::is_beside_paper;
pub use comparison::{Compared, ToCompare, comparison};
pub use frame::{Drawn, MARK, Page, counted};
pub use judged::Judged;
pub use numbers::{Numbers, Value};
pub use subject::{ReportError, Subject};

use frame::Section;
use maud::html;

/// A page about one sensor. Nothing in it depends on the time or the machine: the same runs give the same bytes.
pub fn page(subject: &Subject, judged: &Judged) -> Page {
    let sections = [
        headline::section(subject, judged).map(Section::from),
        table_1::section(subject).map(Section::from),
        figures::units(subject),
        figures::locations(judged),
        figures::distributions(judged),
        figures::dependences(subject, judged),
        figures::expected(subject, judged),
        record::section(subject),
        uncertainty::section(subject).map(Section::from),
        facts::section(subject).map(Section::from),
    ];
    let title = subject.title();
    let header = html! {
        h1 { (title) }
        p.lede { (subject.told()) }
    };
    Page::of(&title, &header, sections.into_iter().flatten())
}
