//! Mean error against the time of a solve.

use super::{Drawn, look, told_bound};
use crate::chart::{Anchor, ChartAxis, Figure, Hue, Line, Look, Mark, Panel};
use crate::solver::BEST;
use crate::study::methods::trial::CRAMER_RAO;
use crate::study::methods::{MethodRow, MethodTrial, Rows};

/// Size of a panel, px: to keep words apart.
const HEIGHT_PX: f64 = 420.0;
const WIDTHS_PX: [f64; 2] = [800.0, 340.0];
/// A mark with its ring, px.
const MARK_PX: f64 = 20.0;
/// Width and height of words, px.
const LETTER_PX: f64 = 6.3;
const WORD_PX: f64 = 14.0;

/// One panel a trial.
pub fn speed_accuracy_figures(trials: &[(String, String, usize)], found: &Rows) -> Vec<Drawn> {
    let presses = |calibration: bool| {
        let counts = trials.iter().map(|(_, _, tests)| *tests);
        let rows = found.rows.iter().map(|row| row.calibration_presses);
        if calibration { rows.max() } else { counts.max() }.unwrap_or(0)
    };
    let panels: Vec<Panel> = trials
        .iter()
        .map(|(scene, told, _)| {
            let rows: Vec<&MethodRow> = found.rows.iter().filter(|row| row.scene == *scene).collect();
            panel(told, &rows, WIDTHS_PX[usize::from(trials.len() > 1)])
        })
        .collect();
    let figure = Figure {
        title: "How near each method comes, and what a solve takes".to_owned(),
        subtitle: format!(
            "calibrated with {} presses, {} test contacts; bars: 95 % of the mean; times measured on this machine, one core",
            presses(true),
            presses(false)
        ),
        height_px: HEIGHT_PX,
        panels,
        notes: std::iter::once("ringed and joined: no other method is both faster and nearer")
            .chain(found.rows.first().and_then(told_bound))
            .map(str::to_owned)
            .collect(),
        ..Figure::default()
    };
    vec![("speed-accuracy.svg".to_owned(), figure.svg())]
}

fn panel(told: &str, rows: &[&MethodRow], width_px: f64) -> Panel {
    let point = |row: &MethodRow| Some((row.ns_per_solve?, row.mean_mm()?));
    let ends = |row: &MethodRow| {
        let (mean_mm, within_mm) = (row.mean_mm()?, row.location_error_within_mm?);
        Some((mean_mm - within_mm, mean_mm + within_mm))
    };
    let points = || rows.iter().filter_map(|row| point(row));
    let bound = rows.first().and_then(|row| {
        let (mm, name) = (row.location_bound_mm?, if row.bound == Some(CRAMER_RAO) { "bound" } else { "stated" });
        Some((mm, format!("{name}: {mm:.3} mm")))
    });
    let errors_mm = points().map(|(_, mm)| mm).chain(rows.iter().filter_map(|row| ends(row)).flat_map(|(a, b)| [a, b]));
    let (fast_ns, slow_ns) = points().fold((f64::MAX, 1.0), |(l, m): (f64, f64), (ns, _)| (l.min(ns), m.max(ns)));
    // room for words at either side
    let x = ChartAxis::log("time per solve, median, ns", [], (fast_ns.min(slow_ns) / 2.5, slow_ns * 2.5));
    let first_mm = points().map(|(_, mm)| mm).next().unwrap_or(1.0);
    let y = ChartAxis::log(
        "location error, mean, mm",
        errors_mm.chain(bound.iter().map(|(mm, _)| mm / 1.3)),
        (first_mm, first_mm * 1.15),
    );
    let mut marks = vec![Mark::Title(told.to_owned())];
    if let Some((mm, told)) = bound {
        marks.push(Mark::Level(mm, String::new()));
        // to the left and below there is no method that is both faster and nearer
        marks.push(Mark::Words((x.range.0, mm), (6.0, 15.0), Anchor::Start, told));
    }
    let mut front: Vec<(f64, f64)> =
        rows.iter().filter(|row| row.pareto == Some(true)).filter_map(|row| point(row)).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    front.dedup();
    marks.push(Mark::Curve(Look { hue: Hue::Grey, shape: None, filled: true, line: Line::Dashed }, front.clone()));
    let at = |(ns, mm): (f64, f64)| (width_px * x.share(ns), HEIGHT_PX * (1.0 - y.share(mm)));
    let mut taken: Vec<Box> = points().map(|point| Box::around(at(point), MARK_PX, MARK_PX)).collect();
    let bars = rows.iter().filter_map(|row| Some((point(row)?.0, ends(row)?)));
    taken.extend(bars.flat_map(|(ns, (from, to))| along(at((ns, from)), at((ns, to)))));
    taken.extend(front.windows(2).flat_map(|ends| along(at(ends[0]), at(ends[1]))));
    for row in rows.iter().filter(|row| row.solver != BEST) {
        let Some(point) = point(row) else { continue };
        let look = Look { line: Line::None, ..look(row.solver) };
        marks.extend(ends(row).map(|ends| Mark::Bar(look.hue, point.0, ends)));
        marks.push(Mark::Curve(look, vec![point]));
        let is_best = rows.iter().any(|best| best.solver == BEST && best.chosen == Some(row.solver));
        let name = if is_best { format!("{} = best", row.solver) } else { row.solver.to_owned() };
        let (by_px, anchor, place) = beside(at(point), name.chars().count() as f64 * LETTER_PX, width_px, &taken);
        taken.push(place);
        marks.push(Mark::Words(point, by_px, anchor, name));
    }
    marks.extend(front.into_iter().map(Mark::Ring));
    Panel { x, y, marks }
}

/// Where something is, px.
#[derive(Clone, Copy)]
struct Box {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
}

impl Box {
    fn around((x, y): (f64, f64), width: f64, height: f64) -> Box {
        Box { left: x - width / 2.0, right: x + width / 2.0, top: y - height / 2.0, bottom: y + height / 2.0 }
    }

    fn meets(&self, other: &Box) -> bool {
        self.left < other.right && other.left < self.right && self.top < other.bottom && other.top < self.bottom
    }
}

/// A line from one point to another, in small boxes.
fn along((x1, y1): (f64, f64), (x2, y2): (f64, f64)) -> impl Iterator<Item = Box> {
    const PIECES: u32 = 100;
    (0..=PIECES).map(move |piece| {
        let share = f64::from(piece) / f64::from(PIECES);
        Box::around((x1 + share * (x2 - x1), y1 + share * (y2 - y1)), 3.0, 3.0)
    })
}

/// Where words go that are to stand beside a mark and over nothing else: right, left, above, below, then farther off.
fn beside((x, y): (f64, f64), words_px: f64, width_px: f64, taken: &[Box]) -> ((f64, f64), Anchor, Box) {
    let places = [13.0, 22.0, 34.0].into_iter().flat_map(|aside| {
        [0.0, 15.0, -15.0, 30.0, -30.0].into_iter().flat_map(move |down| {
            [(aside, Anchor::Start), (-aside, Anchor::End)].map(|(right, anchor)| ((right, down), anchor))
        })
    });
    let place = |(right, down): (f64, f64), anchor: Anchor| {
        let middle = x + right + if anchor == Anchor::Start { words_px / 2.0 } else { -words_px / 2.0 };
        Box::around((middle, y + down), words_px, WORD_PX)
    };
    let is_free = |words: &Box| {
        words.left > 2.0
            && words.right < width_px - 2.0
            && words.top > 2.0
            && words.bottom < HEIGHT_PX - 2.0
            && !taken.iter().any(|other| words.meets(other))
    };
    let found =
        places.map(|(by_px, anchor)| (by_px, anchor, place(by_px, anchor))).find(|(_, _, words)| is_free(words));
    let ((right, down), anchor, words) =
        found.unwrap_or(((13.0, 0.0), Anchor::Start, place((13.0, 0.0), Anchor::Start)));
    ((right, down + 4.0), anchor, words) // words stand on their line
}

/// What a figure needs to know of a trial.
pub fn told(trial: &MethodTrial) -> (String, String, usize) {
    (trial.scene.clone(), trial.told.clone(), trial.test.truths.len())
}
