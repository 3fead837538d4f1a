//! What all pages share: the document around them, tables, figures, and numbers as they were computed.

use crate::chart::{Figure, LEVELS, Ramp, STYLE};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::fmt::Display;

/// What every page of ours has in its head: a file that has it may be replaced by another.
pub const MARK: &str = "<meta name=\"generator\" content=\"palpate\">";

/// Light and dark as the reader has it; on paper always light. No colour means anything that isn't told by a shape or a word too.
const PAGE_STYLE: &str = include_str!("page.css");

/// A whole page.
pub fn document(title: &str, body: &Markup) -> String {
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

/// A part of a page.
pub fn section(title: &str, body: &Markup) -> Markup {
    html! { section { h2 { (title) } (body) } }
}

/// A number that an evaluation gave, rounded for a person, whole for a program.
pub fn number(key: &str, value: f64, digits: usize, unit: &str) -> Markup {
    html! { data value=(value) data-key=(key) { (format!("{value:.digits$}")) } (unit) }
}

/// The same for a share.
pub fn percent(key: &str, share: f64) -> Markup {
    html! { data value=(share) data-key=(key) { (format!("{:.1}", 100.0 * share)) } " %" }
}

/// A table: names of the columns, then rows that begin with their name.
pub fn table(head: &[Markup], rows: &[Vec<Markup>]) -> Markup {
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

/// Words as a cell.
pub fn words(words: impl Display) -> Markup {
    html! { (words.to_string()) }
}

/// How many of something, in words that fit one of them too.
pub fn counted(count: usize, what: &str) -> String {
    let ending = match count {
        1 => "",
        _ if what.ends_with('s') => "es",
        _ => "s",
    };
    format!("{count} {what}{ending}")
}

/// A quantity to two digits behind the point, or as many as the largest of its kind needs.
pub fn told(value: f64, largest: f64) -> String {
    let digits = if largest == 0.0 { 2.0 } else { (1.0 - largest.abs().log10().floor()).clamp(2.0, 12.0) };
    format!("{value:.0$}", digits as usize)
}

/// A time with its zone to the second, as a person writes it.
pub fn clock(time: &str) -> String {
    let zone = time.split_once('[').and_then(|(_, zone)| zone.strip_suffix(']')).unwrap_or_default();
    let second: String = time.chars().take("2026-01-01T00:00:00".len()).collect();
    format!("{} {zone}", second.replace('T', " ")).trim_end().to_owned()
}

/// What isn't known.
pub fn none() -> Markup {
    html! { "-" }
}

/// A figure with what it shows above it, and what its colours mean below.
pub struct Drawn {
    /// The figure; its title and its subtitle stand above it.
    pub figure: Figure,
    /// What the first and the last colour mean.
    pub ramp: Option<[String; 2]>,
}

impl Drawn {
    /// A figure that has no colours for numbers.
    pub fn plain(figure: Figure) -> Drawn {
        Drawn { figure, ramp: None }
    }

    fn markup(&self) -> Markup {
        let Figure { title, subtitle, notes, .. } = &self.figure;
        html! {
            figure {
                figcaption { strong { (title) } (subtitle) }
                (PreEscaped(self.figure.inline()))
                @if let Some([first, last]) = &self.ramp {
                    div.ramp {
                        span { (first) }
                        span.colours { @for level in 0..LEVELS { i class=(Ramp::class(level)) {} } }
                        span { (last) }
                    }
                }
                @for note in notes { p.note { (note) } }
            }
        }
    }
}

/// Figures side by side where there is room.
pub fn figures(drawn: &[Drawn]) -> Markup {
    html! { div.figures { @for drawn in drawn { (drawn.markup()) } } }
}
