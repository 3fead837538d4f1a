//! Error on new contacts as a function of minutes at the bench, one panel for each family.

use super::{HANDLING_MIN, MinutesRow, UnitFamily};
use palpate_control::Strategy;
use palpate_report::chart::{Anchor, ChartAxis, Figure, Hue, LineStyle, Look, Mark, Panel, Shape};

/// Least relative decrease of the error from the last labelled point at which a point is labelled with its number of presses.
const WORTH_TELLING: f64 = 0.01;

/// Returns the figure: the name of its file and the SVG.
pub fn minutes_figures(found: &[MinutesRow]) -> Vec<(String, String)> {
    let points = found.iter().map(|row| row.found.points).max().unwrap_or(0);
    let specimens = found.iter().map(|row| row.found.calibrations).max().unwrap_or(0);
    let repeats = repeats(found);
    let figure = Figure {
        title: "Accuracy of a calibration against the total minutes at the bench".to_owned(),
        subtitle: format!(
            "square grids of 1 N presses on ±6 mm, {points} fresh contacts of 0.1 to 1 N on {specimens} specimens, solved by the \
             method that cross-validation finds best"
        ),
        height_px: 420.0,
        panels: UnitFamily::ALL.map(|family| panel(family, found, &repeats)).to_vec(),
        legend: vec![
            Strategy::ALL.map(|strategy| (look(strategy, 0), strategy.name().to_owned())).to_vec(),
            repeats
                .iter()
                .enumerate()
                .map(|(nth, repeats)| {
                    let look = Look { hue: Hue::Grey, line: LineStyle::None, ..look(Strategy::Map, nth) };
                    (look, if *repeats == 1 { "each place once".to_owned() } else { format!("{repeats} times") })
                })
                .collect(),
        ],
        notes: vec![
            format!(
                "minutes: {HANDLING_MIN} for mounting, warm-up and zeroing, and those of the run, simulated on the fast bench"
            ),
            "bound: the least mean error of any unbiased method that knows the array exactly (Cramér-Rao)".to_owned(),
            "ringed and joined: no other way is both faster and more exact; next to a ring: its presses, if it is 1 % more exact".to_owned(),
        ],
        ..Figure::default()
    };
    vec![("minutes.svg".to_owned(), figure.svg())]
}

/// Numbers of presses at each place, the least first.
fn repeats(found: &[MinutesRow]) -> Vec<usize> {
    let mut repeats: Vec<usize> = found.iter().map(|row| row.repeats).collect();
    repeats.sort_unstable();
    repeats.dedup();
    repeats
}

fn panel(family: UnitFamily, found: &[MinutesRow], repeats: &[usize]) -> Panel {
    let point = |row: &MinutesRow| Some((row.found.minutes?, row.found.mean_mm()?));
    let of_it = || found.iter().filter(|row| row.found.scene == family.name());
    // both panels have the same axes
    let points = || found.iter().filter_map(point);
    let (minutes, mm) = points().next().unwrap_or((HANDLING_MIN, 1.0));
    let x =
        ChartAxis::log("minutes at the bench", points().map(|(minutes, _)| minutes), (minutes / 1.1, minutes * 1.1));
    let y = ChartAxis::log(
        "location error, mean, mm",
        points().map(|(_, mm)| mm).chain(found.iter().filter_map(|row| row.found.location_bound_mm)),
        (mm / 1.1, mm * 1.1),
    );
    let mut marks = vec![Mark::Title(family.text().to_owned())];
    let bound_mm = of_it().find_map(|row| row.found.location_bound_mm);
    marks.extend(bound_mm.map(|mm| Mark::Level(mm, format!("bound: {mm:.3} mm"))));
    let mut front: Vec<((f64, f64), usize)> = of_it()
        .filter(|row| row.found.pareto == Some(true))
        .filter_map(|row| Some((point(row)?, row.found.calibration_presses)))
        .collect();
    front.sort_by(|a, b| a.0.0.total_cmp(&b.0.0));
    marks.push(Mark::Curve(Look::line(Hue::Grey, LineStyle::Dashed), front.iter().map(|(point, _)| *point).collect()));
    for strategy in Strategy::ALL {
        for (nth, repeats) in repeats.iter().enumerate() {
            let rows = of_it().filter(|row| (row.strategy, row.repeats) == (strategy, *repeats));
            marks.push(Mark::Curve(look(strategy, nth), rows.filter_map(point).collect()));
        }
    }
    let mut stated_mm = f64::INFINITY;
    for (point, presses) in front {
        marks.push(Mark::Ring(point));
        if point.1 < (1.0 - WORTH_TELLING) * stated_mm {
            stated_mm = point.1;
            marks.push(Mark::Words(point, (-4.0, 20.0), Anchor::End, presses.to_string()));
        }
    }
    Panel { x, y, marks }
}

/// Look of a strategy: the colour shows the strategy, the shape shows the number of presses at each place.
fn look(strategy: Strategy, nth: usize) -> Look {
    let hue = match strategy {
        Strategy::Guarded => Hue::Blue,
        Strategy::Velocity => Hue::Orange,
        Strategy::Map => Hue::Green,
    };
    let shape = [Shape::Circle, Shape::Square, Shape::Triangle][nth.min(2)];
    Look { hue, shape: Some(shape), filled: nth == 0, line: LineStyle::None }
}
