//! Pages about runs. Each is one self-contained HTML file that needs no network and no script.
//!
//! [`page`] is about one [`Subject`]: a sensor with all its recorded data. The verdict comes first, then the errors with the places
//! found. After these come tables and figures, the control of the force, and the equipment used. [`comparison`] compares many sensors, or
//! one sensor over time. [`batch_page`] is about a batch, and [`batches_page`] compares batches. Every number of an evaluation is in a
//! `data` element whose `value` is that of `evaluate --json`, with all digits. Each figure can be saved with its numbers ([`PageFigure`]).
//! The paper is cited only if its numbers are shown next to this program's ([`is_beside_paper`]).

mod batch;
mod beside_paper;
pub mod certificate;
mod comparison;
mod facts;
mod figures;
mod frame;
mod headline;
mod judged;
mod monitors;
mod numbers;
#[cfg(feature = "files")]
mod over_time;
#[cfg(feature = "files")]
mod ramps;
mod record;
mod side_by_side;
mod subject;
mod table_1;
mod temperatures;
mod uncertainty;
mod vectors;
mod verdict;
#[cfg(feature = "files")]
mod waves;
mod wear;

pub use batch::{PageLink, batch_page, batches_page};
pub use beside_paper::is_beside_paper;
pub use comparison::{Compared, ToCompare, comparison};
pub use frame::{MARK, Page, PageFigure, counted};
pub use judged::SensorResults;
pub use numbers::{NumberCell, Numbers};
pub use subject::{ReportError, Subject};

use frame::Section;
use maud::html;

/// Creates a page about one sensor. Nothing in it depends on the time or the machine, so the same runs give the same bytes.
pub fn page(subject: &Subject, judged: &SensorResults) -> Page {
    #[cfg(feature = "files")]
    let over_time = over_time::sections(subject);
    #[cfg(not(feature = "files"))]
    let over_time = Vec::new();
    let sections = [
        Some(verdict::section(subject, judged).into()),
        headline::section(subject, judged),
        headline::cross_validated(judged).map(Section::from),
        vectors::section(subject),
        table_1::section(subject).map(Section::from),
        figures::units(subject),
        figures::distributions(judged),
        figures::dependences(subject, judged),
        figures::expected(subject, judged),
    ];
    let about_the_run = [
        record::section(subject),
        wear::section(subject),
        monitors::section(subject),
        temperatures::section(subject),
        uncertainty::section(subject).map(Section::from),
        facts::section(subject).map(Section::from),
    ];
    let title = subject.title();
    let header = html! {
        h1 { (title) }
        p.lede { (subject.text()) }
    };
    Page::of(
        &title,
        &header,
        sections.into_iter().flatten().chain(over_time).chain(about_the_run.into_iter().flatten()),
    )
}
