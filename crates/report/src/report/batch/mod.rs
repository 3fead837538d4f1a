//! Pages about a batch: its yield, each figure of the acceptance rule by sensor, control charts, deviations from the design, and all
//! sensors; or several batches side by side.
//!
//! Everything follows from the batch's journal ([`History`]). Every number is in a `data` element whose `value` has all digits, as the
//! journal has them.

mod charts;
mod compare;
mod figures;
mod headline;
mod limited;
mod maps;
mod order;
mod sensors;
mod worst;

pub use compare::batches_page;
pub use sensors::PageLink;

use super::frame::{Page, Section};
use maud::html;
use palpate_data::dataset::Status;
use palpate_run::batch::{Ended, History};

/// Creates a page about one batch. `links` gives the pages that exist about a result. Nothing on the page depends on the time or the
/// machine, so the same journal and the same links give the same bytes.
pub fn batch_page(history: &History, links: &dyn Fn(&Ended) -> Vec<PageLink>) -> Page {
    let facts = &history.state.facts;
    let title = format!("Batch {}", facts.name);
    let header = html! {
        h1 { (title) }
        p.lede { "Design " (facts.design) @if facts.simulated { ". Simulated: no real sensor was measured." } }
    };
    let sections = [
        Some(Section::from(headline::section(history))),
        sensors::conspicuous(history, links).map(Section::from),
        figures::section(history),
        charts::section(history),
        worst::section(history).map(Section::from),
        maps::section(history),
        figures::minutes(history),
        Some(Section::from(sensors::section(history, links))),
    ];
    Page::of(&title, &header, sections.into_iter().flatten())
}

/// Returns the complete results, each with its number in the order of calibration, from 1.
fn complete(history: &History) -> impl Iterator<Item = (usize, &Ended)> {
    (1..).zip(&history.results).filter(|(_, ended)| ended.status == Status::Complete)
}
