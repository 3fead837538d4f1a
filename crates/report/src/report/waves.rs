//! Waves: forces that were held one after another, and what the output did.

use super::figures::column;
use super::frame::{PageFigure, Section, number, table, words};
use super::numbers::{NumberCell, Numbers};
use super::over_time::{FORCE, OUTPUT, means};
use crate::chart::{ChartAxis, Look, Mark, Panel};
use maud::html;
use palpate_data::dataset::Followed;

/// Largest number of presses that are drawn. The table has all.
const MOST_DRAWN: usize = 4;

/// Creates the section; `None` without waves.
pub(super) fn section(all: &[&Followed]) -> Option<Section> {
    let largest = |values: &[f64]| {
        values.iter().copied().fold(0.0, |most: f64, value| if value.abs() > most.abs() { value } else { most })
    };
    let row = |followed: &&Followed| {
        vec![
            words(format!("{} at {}, {} mm", followed.press, followed.place.x_mm, followed.place.y_mm)),
            number("span_s", followed.force_n[0].last().copied().unwrap_or_default(), 1, ""),
            number("force_most_n", largest(&followed.force_n[1]), 3, ""),
            words(format!("output {}", followed.output)),
            number("output_most", largest(&followed.values[1]), 4, ""),
        ]
    };
    let head = ["press", "time, s", "largest force, N", "output", "its largest value"];
    let note = html! {
        (table(&head.map(words), &all.iter().map(row).collect::<Vec<_>>()))
        p.note { "Each force was reached from the one before and restored every second. The windows of the levels are rows of presses.csv." }
    };
    Section::of_figures("Waves", &note, all.iter().take(MOST_DRAWN).map(|followed| drawn(followed)).collect())
}

/// Draws the force of a press and its output, one below the other.
fn drawn(followed: &Followed) -> PageFigure {
    let span_s = followed.force_n[0].last().copied().unwrap_or(1.0);
    let mut rows = Vec::new();
    let mut panel = |look: Look, name: &str, [t_s, values]: &[Vec<f64>; 2]| {
        let points = means(t_s, values);
        let ends = points.iter().map(|(_, value)| *value);
        let (least, most) = (ends.clone().fold(0.0, f64::min), ends.fold(0.0, f64::max));
        let room = 0.05 * (most - least).max(f64::MIN_POSITIVE);
        let numbers = points.iter().map(|(t_s, value)| [NumberCell::Number(*t_s), NumberCell::Number(*value)]);
        rows.extend(numbers.map(|[t_s, value]| vec![NumberCell::Words(name.to_owned()), t_s, value]));
        Panel {
            x: ChartAxis::linear("time since the first window, s", (0.0, span_s)),
            y: ChartAxis::linear(name, (least - room, most + room)),
            marks: vec![Mark::Curve(look, points)],
        }
    };
    let output = format!("output {}", followed.output);
    let panels = vec![panel(FORCE, "force, N", &followed.force_n), panel(OUTPUT, &output, &followed.values)];
    let title = format!("Wave of press {} at {}, {} mm", followed.press, followed.place.x_mm, followed.place.y_mm);
    let figure = column(title, "force and the output that answers it most", panels, Vec::new());
    let numbers = Numbers::new(&["quantity", "t_s", "value"], rows);
    PageFigure::plain(figure).named(&format!("wave-{}", followed.press)).with(numbers)
}
