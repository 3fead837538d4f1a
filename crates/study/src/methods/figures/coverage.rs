//! Stated coverage compared with measured coverage: for each condition, a panel of locations and a panel of forces.

use super::failures::{COLUMNS, axis, curve};
use super::{FigureFile, look, methods};
use crate::methods::conditions::{CONDITIONS, Harm, MEANINGS};
use crate::methods::{FoundCoverage, MethodRow, NoiseReference, STATED_PERCENT};
use palpate_report::chart::{ChartAxis, Figure, Grid, LineStyle, Look, Mark, Panel};
use palpate_solver::{BEST, SOLVERS};

/// Draws one figure for each scene.
pub fn coverage_figures(found: &[MethodRow]) -> Vec<FigureFile> {
    NoiseReference::ALL.map(|noise| (format!("coverage-{}.svg", noise.name()), figure(noise, found).svg())).to_vec()
}

/// Fractions of one kind, one for each of [`STATED_PERCENT`].
type Shares = fn(&FoundCoverage) -> Option<[f64; 2]>;

fn figure(noise: NoiseReference, found: &[MethodRow]) -> Figure {
    let points = found.first().map_or(0, |row| row.points);
    let presses = found.first().map_or(0, |row| row.calibration_presses);
    let panels = CONDITIONS.chunks(COLUMNS).flat_map(|harms| {
        let of = |label: &'static str, labelled, shares: Shares| {
            harms.iter().map(move |harm| panel(harm, noise, found, label, labelled, shares))
        };
        let location = of("location, found, %", false, |coverage| Some(coverage.location));
        location.chain(of("force, found, %", true, |coverage| coverage.force)).collect::<Vec<Panel>>()
    });
    let [narrow, wide] = STATED_PERCENT;
    Figure {
        title: format!("How often the true value is within the stated interval; {}", noise.text()),
        subtitle: format!(
            "share of answers within the stated {narrow} % (markers) and {wide} % half-width (dashed); dotted: as stated; \
             calibrated with 1 N at {presses} places on ±6 mm, {points} contacts at each value"
        ),
        height_px: 150.0,
        panels: panels.collect(),
        grid: Some(Grid { columns: COLUMNS, width_px: 1240.0, shared: false }),
        legend: vec![methods().filter(|(_, name)| name != BEST).collect()],
        notes: MEANINGS.map(str::to_owned).to_vec(),
    }
}

fn panel(
    harm: &Harm,
    noise: NoiseReference,
    found: &[MethodRow],
    label: &str,
    labelled: bool,
    shares: Shares,
) -> Panel {
    let mut marks: Vec<Mark> = STATED_PERCENT.map(|percent| Mark::Level(percent, String::new())).to_vec();
    if !labelled {
        marks.insert(0, Mark::Title(harm.name.to_owned()));
    }
    for solver in SOLVERS {
        let of = |index: usize| {
            let percent = |row: &MethodRow| row.coverage.as_ref().and_then(shares).map(|shares| 100.0 * shares[index]);
            curve(harm, noise, solver, found, percent)
        };
        let look = look(solver);
        marks.push(Mark::Curve(look, of(0)));
        marks.push(Mark::Curve(Look::line(look.hue, LineStyle::Dashed), of(1)));
    }
    Panel { x: axis(harm, labelled), y: ChartAxis::linear(label, (0.0, 103.0)), marks }
}
