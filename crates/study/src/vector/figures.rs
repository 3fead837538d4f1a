//! Figures: errors of force vectors with their bounds, and shares of pairs that are found.

use super::shear::ShearRow;
use super::taxels;
use super::two::TwoRow;
use palpate_report::chart::{ChartAxis, Figure, Grid, Hue, LineStyle, Look, Mark, Panel, Shape};

const WIDTH_PX: f64 = 1000.0;
const HUES: [(usize, Hue); 2] = [(3, Hue::Blue), (1, Hue::Orange)];

/// Returns the figure of the force vectors: the name of its file and the SVG.
pub fn shear_figures(found: &[ShearRow]) -> Vec<(String, String)> {
    type Value = fn(&ShearRow) -> f64;
    let conditions = [("noise", "noise, 1: 1 N above"), ("units", "units, a side"), ("places", "places, a side")];
    let kinds: [(&str, Value, Value); 3] = [
        ("location, mm", |row| row.location_error_mm, |row| row.location_bound_mm),
        ("shear, N", |row| row.shear_error_n, |row| row.shear_bound_n),
        ("us a solve", |row| row.us_per_solve, |_| f64::NAN),
    ];
    let panels = kinds.iter().flat_map(|(label, error, bound)| {
        conditions.map(|(condition, text)| {
            let of = |channels: usize| {
                found.iter().filter(move |row| row.condition == condition && row.taxels == taxels(channels))
            };
            let curve = |channels, value: Value| of(channels).map(|row| (row.value, value(row))).collect::<Vec<_>>();
            let all =
                HUES.iter().flat_map(|(channels, _)| [curve(*channels, *error), curve(*channels, *bound)].concat());
            let all: Vec<(f64, f64)> = all.filter(|point| point.1.is_finite()).collect();
            let at = all.first().copied().unwrap_or((1.0, 1.0));
            let marks = HUES.iter().flat_map(|(channels, hue)| {
                let bound = Mark::Curve(Look::line(*hue, LineStyle::Dashed), curve(*channels, *bound));
                [bound, Mark::Curve(look(*hue), curve(*channels, *error))]
            });
            let axis = |label: &str, values: Vec<f64>, at: f64| ChartAxis::log(label, values, (at / 1.1, 1.1 * at));
            Panel {
                x: axis(text, all.iter().map(|point| point.0).collect(), at.0),
                y: axis(label, all.iter().map(|point| point.1).collect(), at.1),
                marks: marks.collect(),
            }
        })
    });
    let figure = Figure {
        title: "Place and force vector of a contact with a shear".to_owned(),
        subtitle:
            "mean errors of contacts of 0.1 to 1 N with a shear of up to half of it; presses of 1 N and drags of 0.5 N"
                .to_owned(),
        height_px: 220.0,
        panels: panels.collect(),
        grid: Some(Grid { columns: 3, width_px: WIDTH_PX, shared: false }),
        legend: vec![legend()],
        notes: vec![
            "dashed: the least error of any unbiased method that knows the array exactly (Cramér-Rao)".to_owned(),
        ],
    };
    vec![("shear.svg".to_owned(), figure.svg())]
}

/// Returns the figure of the pairs: the name of its file and the SVG.
pub fn two_figures(found: &[TwoRow]) -> Vec<(String, String)> {
    type Value = fn(&TwoRow) -> f64;
    let places = found.iter().map(|row| row.places).max().unwrap_or(0);
    let panel = |scene: &'static str, label: &str, value: Value, range: (f64, f64)| {
        let curve = |channels: usize, is_drawn: &dyn Fn(&TwoRow) -> bool| {
            let of_it =
                found.iter().filter(|row| row.scene == scene && row.taxels == taxels(channels) && is_drawn(row));
            of_it.map(|row| (row.separation_mm, value(row).min(range.1))).collect::<Vec<_>>()
        };
        let marks = HUES.iter().flat_map(|(channels, hue)| {
            let exact = curve(*channels, &|row| row.is_true_map);
            let calibrated = curve(*channels, &|row| !row.is_true_map && row.places == places);
            [Mark::Curve(Look::line(*hue, LineStyle::Dashed), exact), Mark::Curve(look(*hue), calibrated)]
        });
        let marks = std::iter::once(Mark::Title(format!("{scene}: {label}"))).chain(marks).collect();
        Panel { x: ChartAxis::linear("separation, mm", (0.0, 8.5)), y: ChartAxis::linear("", range), marks }
    };
    let is_drawn = |scene: &&str| found.iter().any(|row| row.scene == *scene);
    let panels = ["T", "1 mV"].into_iter().filter(is_drawn).flat_map(|scene| {
        [
            panel(scene, "fraction right", |row| row.right, (0.0, 1.0)),
            panel(scene, "fraction called one", |row| row.called_one, (0.0, 1.0)),
            panel(scene, "bound of a place, mm", |row| row.location_bound_mm, (0.0, 3.0)),
        ]
    });
    let figure = Figure {
        title: "Two contacts at once".to_owned(),
        subtitle: "pairs of 0.5 N; right: both places within 1 mm and both forces within 0.1 N".to_owned(),
        height_px: 220.0,
        panels: panels.collect(),
        grid: Some(Grid { columns: 3, width_px: WIDTH_PX, shared: false }),
        legend: vec![legend()],
        notes: vec![
            "dashed: the same solver with the exact map; bound: median of the root mean square error (Cramér-Rao)"
                .to_owned(),
        ],
    };
    vec![("two-contacts.svg".to_owned(), figure.svg())]
}

fn look(hue: Hue) -> Look {
    Look { hue, shape: Some(Shape::Circle), filled: true, line: LineStyle::Solid }
}

fn legend() -> Vec<(Look, String)> {
    HUES.map(|(channels, hue)| (look(hue), format!("taxels: {}", taxels(channels)))).to_vec()
}
