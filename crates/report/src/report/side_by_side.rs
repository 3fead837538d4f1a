//! Figures of many runs or many batches, a row for each.

use super::figures::WIDTH_PX;
use crate::chart::{ChartAxis, Figure, Grid, Look, Mark, Panel};

/// Height of a row, px. It contains the name and the time.
const ROW_PX: f64 = 38.0;

/// Distance between the values and the edge of a panel, relative to the axis.
const ROOM: f64 = 0.06;

/// Distance of the marks of two series in a row, rows.
const SHIFT: f64 = 0.3;

/// Values of one kind: for each row low end, value and high end; `None` where a row has none.
pub(super) struct Series {
    pub look: Look,
    pub name: String,
    pub rows: Vec<Option<[f64; 3]>>,
}

/// Draws marks with strokes over their ranges, a row for each name, on an axis from 0. The limit is a vertical line with its words.
/// A legend is drawn for more than one series, or a series with a name. `None` if no value is above 0.
pub(super) fn spread(
    title: &str,
    subtitle: &str,
    label: &str,
    names: &[String],
    series: &[Series],
    limit: Option<(f64, String)>,
) -> Option<Figure> {
    let values = series.iter().flat_map(|series| series.rows.iter().flatten().flatten().copied());
    let values = values.chain(limit.as_ref().map(|(limit, _)| *limit));
    let most = values.filter(|value| value.is_finite()).fold(0.0, f64::max);
    let mut marks = Vec::new();
    for (nth, series_) in series.iter().enumerate() {
        // one above the other, so that all are seen
        let shift = SHIFT * (nth as f64 - 0.5 * (series.len() - 1) as f64);
        let at = |(row, values): (usize, &Option<[f64; 3]>)| Some((row as f64 + shift, (*values)?));
        let all: Vec<(f64, [f64; 3])> = series_.rows.iter().enumerate().filter_map(at).collect();
        let strokes = all.iter().map(|&(row, [low, _, high])| ((low, row), (high, row))).collect();
        let points = all.iter().map(|&(row, [_, value, _])| (value, row)).collect();
        marks.extend([Mark::Strokes(series_.look.hue, strokes), Mark::Curve(series_.look, points)]);
    }
    marks.extend(limit.map(|(limit, words)| Mark::At(limit, words)));
    let named = series.iter().filter(|series| !series.name.is_empty());
    let figure = Figure {
        legend: vec![named.map(|series| (series.look, series.name.clone())).collect()],
        ..rows(title, subtitle, ChartAxis::linear(label, (0.0, (1.0 + ROOM) * most)), names, marks)
    };
    (most > 0.0).then_some(figure)
}

/// Returns a figure of one panel with a row for each name.
pub(super) fn rows(title: &str, subtitle: &str, x: ChartAxis, names: &[String], marks: Vec<Mark>) -> Figure {
    Figure {
        title: title.to_owned(),
        subtitle: subtitle.to_owned(),
        height_px: ROW_PX * names.len() as f64,
        panels: vec![Panel { x, y: ChartAxis::rows(names.to_vec()), marks }],
        grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
        ..Figure::default()
    }
}
