//! Ramps of a press: the output against the force, away from the specimen and back, at each speed.

use super::figures::column;
use super::frame::{PageFigure, Section, none, number, table, words};
use super::numbers::{NumberCell, Numbers};
use crate::chart::{ChartAxis, Hue, LineStyle, Look, Mark, Panel};
use maud::html;
use palpate_data::dataset::Followed;

/// Largest number of points of a curve, and of presses that are drawn. The table has all.
const MOST_POINTS: usize = 200;
const MOST_DRAWN: usize = 4;

/// Number of forces at which the way away and the way back are compared.
const FORCES: usize = 50;

/// Part of the largest force below which they aren't compared: there the noise of the force counts most.
const LEAST_SHARE: f64 = 0.1;

const HUES: [Hue; 4] = [Hue::Blue, Hue::Orange, Hue::Green, Hue::Ink];

type Points = Vec<(f64, f64)>;

/// Creates the section; `None` without ramps.
pub(super) fn section(all: &[&Followed]) -> Option<Section> {
    let presses: Vec<&[&Followed]> = all.chunk_by(|a, b| a.press == b.press).collect();
    let mut rows = Vec::new();
    for press in &presses {
        for pair in press.chunks_exact(2) {
            let [away, back] = [pair[0], pair[1]].map(curve);
            let Some(&(most_n, output)) = back.iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            let gap = gap(&away, &back, most_n).map(|gap| 100.0 * gap / output.abs());
            rows.push(vec![
                words(format!("{} at {}, {} mm", pair[0].press, pair[0].place.x_mm, pair[0].place.y_mm)),
                number("speed_mm_s", speed_mm_s(pair[0]), 3, ""),
                number("force_most_n", most_n, 3, ""),
                words(format!("output {}", pair[0].output)),
                number("output_most", output, 4, ""),
                gap.map_or_else(none, |gap| number("gap_percent", gap, 2, "")),
            ]);
        }
    }
    let head = ["press", "speed, mm/s", "largest force, N", "output", "its value there", "largest gap, % of it"];
    let note = html! {
        (table(&head.map(words), &rows))
        p.note {
            "After the window the tip leaves the specimen and comes back to where it was held, at each speed. The gap is that between the output on the way "
            "away and on the way back, at the same force: hysteresis, creep and delays of the devices."
        }
    };
    Section::of_figures("Ramps", &note, presses.iter().take(MOST_DRAWN).map(drawn).collect())
}

fn speed_mm_s(followed: &Followed) -> f64 {
    followed.speed_mm_s.unwrap_or_default().abs()
}

/// Returns the output against the force at the same time, in the order of time.
fn curve(followed: &Followed) -> Points {
    let [force_s, force_n] = &followed.force_n;
    let [output_s, outputs] = &followed.values;
    let at = |t_s: f64| {
        let next = force_s.partition_point(|force_s| *force_s < t_s);
        let (before, after) = (next.checked_sub(1)?, (next < force_s.len()).then_some(next)?);
        let share = (t_s - force_s[before]) / (force_s[after] - force_s[before]);
        Some(force_n[before] + share * (force_n[after] - force_n[before]))
    };
    output_s.iter().zip(outputs).filter_map(|(t_s, output)| Some((at(*t_s)?, *output))).collect()
}

/// Returns the largest difference of two curves at the same force; `None` if they have no force in common.
fn gap(away: &Points, back: &Points, most_n: f64) -> Option<f64> {
    let forces = (0..FORCES).map(|nth| most_n * (LEAST_SHARE + (1.0 - LEAST_SHARE) * nth as f64 / FORCES as f64));
    forces.filter_map(|force_n| Some((output_at(away, force_n)? - output_at(back, force_n)?).abs())).reduce(f64::max)
}

/// Returns the output of a curve at a force, from the two points around it.
fn output_at(curve: &Points, force_n: f64) -> Option<f64> {
    let pair = curve.windows(2).find(|pair| (pair[0].0 - force_n) * (pair[1].0 - force_n) <= 0.0)?;
    let ((from_n, from), (to_n, to)) = (pair[0], pair[1]);
    Some(if to_n == from_n { from } else { from + (to - from) * (force_n - from_n) / (to_n - from_n) })
}

fn drawn(press: &&[&Followed]) -> PageFigure {
    let (mut marks, mut legend, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    let (mut most_n, mut least, mut most) = (0.0f64, 0.0f64, 0.0f64);
    for (index, followed) in press.iter().enumerate() {
        let is_away = index.is_multiple_of(2);
        let line = if is_away { LineStyle::Dashed } else { LineStyle::Solid };
        let look = Look { hue: HUES[index / 2 % HUES.len()], shape: None, filled: false, line };
        let curve = curve(followed);
        let (way, speed) = (if is_away { "away" } else { "back" }, speed_mm_s(followed));
        legend.push((look, format!("{way}, {speed} mm/s")));
        for (force_n, output) in &curve {
            (most_n, least, most) = (most_n.max(*force_n), least.min(*output), most.max(*output));
            rows.push(vec![
                NumberCell::Number(followed.speed_mm_s.unwrap_or_default()),
                NumberCell::Number(*force_n),
                NumberCell::Number(*output),
            ]);
        }
        let one_in = curve.len().div_ceil(MOST_POINTS).max(1);
        marks.push(Mark::Curve(look, curve.into_iter().step_by(one_in).collect()));
    }
    let (name, place) = (press[0].press, press[0].place);
    let room = 0.05 * (most - least).max(f64::MIN_POSITIVE);
    let panel = Panel {
        x: ChartAxis::linear("force, N", (0.0, 1.02 * most_n)),
        y: ChartAxis::linear("output", (least - room, most + room)),
        marks,
    };
    let figure = column(
        format!("Ramps of press {name} at {}, {} mm", place.x_mm, place.y_mm),
        &format!("output {} against the force", press[0].output),
        vec![panel],
        legend.chunks(2).map(<[_]>::to_vec).collect(),
    );
    let numbers = Numbers::new(&["speed_mm_s", "force_n", "output"], rows);
    PageFigure::plain(figure).named(&format!("ramps-{name}")).with(numbers)
}
