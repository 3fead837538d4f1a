//! Common parts of all pages: document, tables, figures, and numbers as computed.

use super::figures::WIDTH_PX;
use super::numbers::Numbers;
use crate::chart::{Figure, Ramp, STYLE};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::fmt::Display;

/// Mark in the head of every page of this program. A file with this mark may be replaced by another page.
pub const MARK: &str = "<meta name=\"generator\" content=\"palpate\">";

/// Style of a page. Light or dark follows the reader's setting; on paper it is always light. Every meaning of a colour is also
/// shown by a shape or a word.
const PAGE_STYLE: &str = include_str!("page.css");

/// Returns a complete page.
pub(super) fn document(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                (PreEscaped(MARK))
                title { (title) }
                // an icon of its own: none is asked for
                link rel="icon" href="data:,";
                style { (PreEscaped(STYLE)) (PreEscaped(Ramp::style())) (PreEscaped(PAGE_STYLE)) }
            }
            body { main { (body) } }
        }
    };
    page.into_string() + "\n"
}

/// Returns a section of a page.
pub(super) fn section(title: &str, body: &Markup) -> Markup {
    html! { section { h2 { (title) } (body) } }
}

/// Returns a number of an evaluation: rounded for people, exact for programs.
pub(super) fn number(key: &str, value: f64, digits: usize, unit: &str) -> Markup {
    html! { data value=(value) data-key=(key) { (format!("{value:.digits$}")) } (unit) }
}

/// Returns a fraction as a percentage, in the same way.
pub(super) fn percent(key: &str, share: f64) -> Markup {
    html! { data value=(share) data-key=(key) { (format!("{:.1}", 100.0 * share)) } " %" }
}

/// Returns a table: names of the columns, then rows that begin with their name.
pub(super) fn table(head: &[Markup], rows: &[Vec<Markup>]) -> Markup {
    html! {
        div.wide {
            table {
                thead { tr { @for cell in head { th scope="col" { (cell) } } } }
                tbody {
                    @for row in rows {
                        tr {
                            @for (column, cell) in row.iter().enumerate() {
                                @if column == 0 { th scope="row" { (cell) } } @else { td { (cell) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Capitalises words at the beginning of a sentence.
pub(super) fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}

/// Returns words as a cell.
pub(super) fn words(words: impl Display) -> Markup {
    html! { (words.to_string()) }
}

/// Returns a count with its noun, singular or plural.
pub fn counted(count: usize, what: &str) -> String {
    let ending = match count {
        1 => "",
        _ if what.ends_with('s') || what.ends_with("ch") => "es",
        _ => "s",
    };
    format!("{count} {what}{ending}")
}

/// Returns a time with its zone, to the second, for people.
pub(super) fn clock(time: &str) -> String {
    let zone = time.split_once('[').and_then(|(_, zone)| zone.strip_suffix(']')).unwrap_or_default();
    let second: String = time.chars().take("2026-01-01T00:00:00".len()).collect();
    format!("{} {zone}", second.replace('T', " ")).trim_end().to_owned()
}

/// Returns the mark for a value that doesn't exist.
pub(super) fn none() -> Markup {
    html! { "-" }
}

/// A figure of a page, and its file name.
pub struct PageFigure {
    /// Stem of the names of its files, in kebab-case.
    pub stem: String,
    /// The figure. Its title and its subtitle are above it, its notes below.
    pub figure: Figure,
    /// Numbers shown in the figure.
    pub numbers: Numbers,
}

impl PageFigure {
    /// Takes a figure and the numbers of its marks. The file name follows from the title unless another name is given.
    pub fn plain(figure: Figure) -> PageFigure {
        let numbers = Numbers::of(&figure);
        PageFigure { stem: kebab_case(&figure.title), figure, numbers }
    }

    /// Sets another name.
    #[must_use]
    pub fn named(self, stem: &str) -> PageFigure {
        PageFigure { stem: kebab_case(stem), ..self }
    }

    /// Sets other numbers than those of the marks.
    #[must_use]
    pub fn with(self, numbers: Numbers) -> PageFigure {
        PageFigure { numbers, ..self }
    }

    fn markup(&self) -> Markup {
        let Figure { title, subtitle, notes, grid, .. } = &self.figure;
        let broad_px = grid.map(|grid| grid.width_px).filter(|px| *px > WIDTH_PX);
        html! {
            figure.broad[broad_px.is_some()] style=[broad_px.map(|px| format!("--width:{px}px"))] {
                figcaption { strong { (title) } (subtitle) }
                div.wide[broad_px.is_some()] { (PreEscaped(self.figure.inline())) }
                @for note in notes { p.note { (note) } }
            }
        }
    }
}

/// Returns figures, next to each other where there is room.
pub(super) fn figures_of(drawn: &[PageFigure]) -> Markup {
    html! { @if !drawn.is_empty() { div.figures { @for drawn in drawn { (drawn.markup()) } } } }
}

/// Converts to lower-case letters and digits, with hyphens for other characters.
fn kebab_case(words: &str) -> String {
    let letters = |letter: char| if letter.is_ascii_alphanumeric() { letter.to_ascii_lowercase() } else { ' ' };
    words.chars().map(letters).collect::<String>().split_whitespace().collect::<Vec<_>>().join("-")
}

/// A part of a page, and its figures.
pub struct Section {
    /// Heading, texts and figures.
    pub markup: Markup,
    /// The same figures separately, in order.
    pub figures: Vec<PageFigure>,
}

impl Section {
    /// Creates a section with a heading, some words and figures; `None` without figures.
    pub(crate) fn of_figures(title: &str, before: &Markup, figures: Vec<PageFigure>) -> Option<Section> {
        (!figures.is_empty()).then(|| Section::new(title, before, figures))
    }

    /// Creates a section with words and figures under a heading.
    pub fn new(title: &str, before: &Markup, figures: Vec<PageFigure>) -> Section {
        let body = html! { (before) (figures_of(&figures)) };
        Section { markup: section(title, &body), figures }
    }
}

impl From<Markup> for Section {
    fn from(markup: Markup) -> Section {
        Section { markup, figures: Vec::new() }
    }
}

/// A page, and its figures.
pub struct Page {
    /// A self-contained HTML file.
    pub html: String,
    /// Figures in the order of the page.
    pub figures: Vec<PageFigure>,
}

impl Page {
    /// Creates a page of sections below a header.
    pub fn of(title: &str, header: &Markup, sections: impl IntoIterator<Item = Section>) -> Page {
        let (markups, figures): (Vec<Markup>, Vec<Vec<PageFigure>>) =
            sections.into_iter().map(|section| (section.markup, section.figures)).unzip();
        let body = html! { header { (header) } @for markup in markups { (markup) } };
        Page { html: document(title, &body), figures: figures.into_iter().flatten().collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_is_saved_under_a_name_of_small_letters() {
        assert_eq!(kebab_case("Error against the force, N (best)"), "error-against-the-force-n-best");
        assert_eq!(kebab_case("locations-pearson"), "locations-pearson");
    }
}
