//! What all pages share: the document around them, tables, figures, and numbers as they were computed.

use crate::chart::{Figure, LEVELS, Ramp, STYLE};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::fmt::Display;

/// What every page of ours has in its head: a file that has it may be replaced by another.
pub const MARK: &str = "<meta name=\"generator\" content=\"palpate\">";

/// Light and dark as the reader has it; on paper always light. No colour means anything that isn't told by a shape or a word too.
const PAGE_STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1f2328;--soft:#57606a;--paper:#fff;--band:#f3f5f7;--rule:#d8dee4;--good:#12805c;--bad:#b3261e}\
@media (prefers-color-scheme:dark){:root{--ink:#e6edf3;--soft:#9aa5b1;--paper:#0d1117;--band:#161b22;--rule:#30363d;--good:#4cc38a;--bad:#ff7b72}}\
*{box-sizing:border-box}\
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.5 system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;overflow-wrap:break-word}\
main{max-width:1120px;margin:0 auto;padding:24px 16px 64px}\
h1{font-size:30px;line-height:1.2;margin:8px 0 4px}h2{font-size:20px;line-height:1.3;margin:44px 0 8px;border-top:1px solid var(--rule);padding-top:18px}\
p{margin:6px 0;max-width:76ch}.lede{color:var(--soft)}.note{color:var(--soft);font-size:14px}\
.verdict{border-left:6px solid var(--soft);background:var(--band);padding:12px 16px;margin:18px 0}\
.verdict strong{font-size:20px}.verdict.good{border-color:var(--good)}.verdict.bad{border-color:var(--bad)}\
.wide{overflow-x:auto;margin:10px 0}\
table{border-collapse:collapse;font-size:15px;font-variant-numeric:tabular-nums}\
th,td{padding:4px 10px;text-align:right;vertical-align:top;border-bottom:1px solid var(--rule)}\
th:first-child,td:first-child{text-align:left;padding-left:0}thead th{border-bottom:2px solid var(--soft);vertical-align:bottom}\
td{white-space:nowrap}tbody th{font-weight:400}td.words,th.words{text-align:left;white-space:normal}\
.tables{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,300px),1fr));gap:16px 32px;margin:14px 0}\
.figures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,420px),1fr));gap:28px 32px;margin:14px 0}\
figure{margin:0;max-width:560px}figure svg{display:block;width:100%;height:auto}figcaption{font-size:14px;color:var(--soft)}\
figcaption strong{display:block;color:var(--ink);font-size:15px}\
.ramp{display:flex;align-items:center;gap:8px;font-size:13px;color:var(--soft);margin:2px 0 0}\
.ramp span.colours{display:flex;flex:1;max-width:260px;height:12px}.ramp i{flex:1}\
@media (max-width:640px){body{font-size:15px}th,td{padding:4px 6px}table{font-size:13.5px}h1{font-size:25px}}\
@media print{main{max-width:none;padding:0}.figures{grid-template-columns:1fr 1fr;gap:14px 20px}.tables{grid-template-columns:repeat(3,1fr)}\
figure,table,.verdict{break-inside:avoid}h2,h3{break-after:avoid}h2{margin-top:26px}body{font-size:10.5pt}}";

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
