use crate::document::{Bounds, Problem, Table};
use crate::scene::{Branch, Contact, Elastomer, Latencies, LoadCell, SceneSpec};

const DEPTH: Bounds = Bounds::above(0.0, 1000.0, "mm");
const STIFFNESS: Bounds = Bounds::above(0.0, 100_000.0, "N/mm");
const CURVATURE: Bounds = Bounds::within(0.0, 100_000.0, "N/mm^2");
const TOE: Bounds = Bounds::within(0.0, 10.0, "mm");
const SHARE: Bounds = Bounds::within(0.0, 10.0, "");
const TIME: Bounds = Bounds::within(0.01, 86_400.0, "s");
const TILT: Bounds = Bounds::within(0.0, 10.0, "mm");
const FORCE: Bounds = Bounds::within(0.0, 100.0, "N");
const OFFSET: Bounds = Bounds::within(-100.0, 100.0, "N");
const PERCENT: Bounds = Bounds::within(0.0, 100.0, "%");
const LATENCY: Bounds = Bounds::within(0.0, 10_000.0, "ms");

/// PAPER Table 1, by unit: repeatability when loading and hysteresis, % of full scale.
const TABLE_1: [(f64, f64); 9] = [
    (1.60, 4.11),
    (3.74, 2.29),
    (2.19, 2.88),
    (0.83, 3.08),
    (0.51, 3.39),
    (1.02, 5.53),
    (0.71, 3.99),
    (2.84, 4.44),
    (3.97, 5.19),
];

/// What a rig answers in unless its scene says otherwise, s: an ESP301 in 5 to 20 ms; a transmitter at 115200 baud needs 1.5 ms
/// for the bytes of an exchange and two silences of 1.75 ms less what the driver waits itself; a T7 in 1 to 2 ms.
const LATENCIES: Latencies =
    Latencies { stage_s: (0.005, 0.020), load_cell_s: (0.002, 0.003), array_s: (0.001, 0.002) };

const CONTACT: Contact = Contact { linear_n_mm: 1.1, quadratic_n_mm2: 0.1556, toe_mm: 0.01 };

/// The paper's rig: what a rig without a `[scene]` is simulated with. An array of other than nine units goes through Table 1
/// again from its top.
pub(super) fn paper_scene(units: usize) -> SceneSpec {
    let table = |pick: fn(&(f64, f64)) -> f64| Some(TABLE_1.iter().cycle().take(units).map(pick).collect());
    SceneSpec {
        elastomer: Some(Elastomer { depth_mm: 5.0 }),
        contact: CONTACT,
        relaxation: vec![Branch { share: 0.05, time_s: 0.3 }, Branch { share: 0.05, time_s: 5.0 }],
        surface_tilt_mm: 0.2,
        load_cell: Some(LoadCell { noise_n: 0.003, offset_n: 0.0 }),
        taxel_noise_percent: table(|row| row.0),
        hysteresis_percent: table(|row| row.1),
        latencies: LATENCIES,
    }
}

/// Reads `[scene]`: each term is there because it is named.
pub(super) fn read_scene(mut scene: Table, units: Option<usize>) -> Option<SceneSpec> {
    let elastomer = scene.table("elastomer").and_then(|mut table| {
        let depth_mm = table.require_number("depth_mm", DEPTH);
        table.finish();
        Some(Elastomer { depth_mm: depth_mm? })
    });
    let contact = scene.require_table("contact").and_then(|mut table| {
        let linear_n_mm = table.require_number("linear_n_mm", STIFFNESS);
        let quadratic_n_mm2 = table.number("quadratic_n_mm2", CURVATURE).unwrap_or(0.0);
        let toe_mm = table.number("toe_mm", TOE).unwrap_or(0.0);
        table.finish();
        Some(Contact { linear_n_mm: linear_n_mm?, quadratic_n_mm2, toe_mm })
    });
    let relaxation = scene.tables("relaxation").into_iter().map(|mut table| {
        let (share, time_s) = (table.require_number("share", SHARE), table.require_number("time_s", TIME));
        table.finish();
        Some(Branch { share: share?, time_s: time_s? })
    });
    let relaxation: Option<Vec<Branch>> = relaxation.collect();
    let surface_tilt_mm = scene.table("surface").and_then(|mut table| {
        let tilt_mm = table.require_number("tilt_mm", TILT);
        table.finish();
        tilt_mm
    });
    let load_cell = scene.table("load_cell").map(|mut table| {
        let noise_n = table.number("noise_n", FORCE).unwrap_or(0.0);
        let offset_n = table.number("offset_n", OFFSET).unwrap_or(0.0);
        table.finish();
        LoadCell { noise_n, offset_n }
    });
    let taxel_noise_percent = read_percents(&mut scene, "taxel_noise", "repeatability_percent", units);
    let hysteresis_percent = read_percents(&mut scene, "hysteresis", "hysteresis_percent", units);
    let latencies = read_latencies(&mut scene);
    scene.finish();
    Some(SceneSpec {
        elastomer,
        contact: contact?,
        relaxation: relaxation?,
        surface_tilt_mm: surface_tilt_mm.unwrap_or(0.0),
        load_cell,
        taxel_noise_percent,
        hysteresis_percent,
        latencies,
    })
}

/// One percentage a unit.
fn read_percents(scene: &mut Table, term: &'static str, key: &'static str, units: Option<usize>) -> Option<Vec<f64>> {
    let mut table = scene.table(term)?;
    if !table.has(key) {
        table.complain(Problem::new(
            table.span(),
            format!("`{key}` is missing in `scene.{term}`: a list, one % a unit"),
        ));
    }
    let percents = table.numbers(key, PERCENT);
    if let (Some(percents), Some(units)) = (&percents, units)
        && percents.len() != units
    {
        let told = format!("`{key}` has {} values for {units} units", percents.len());
        table.complain(Problem::new(table.span_of(key), told));
    }
    table.finish();
    percents
}

fn read_latencies(scene: &mut Table) -> Latencies {
    let mut latencies = LATENCIES;
    if let Some(mut table) = scene.table("latency_ms") {
        let mut read = |key, place: &mut (f64, f64)| {
            if let Some(range) = table.range(key, LATENCY) {
                *place = (range.min / 1000.0, range.max / 1000.0);
            }
        };
        read("stage", &mut latencies.stage_s);
        read("load_cell", &mut latencies.load_cell_s);
        read("array", &mut latencies.array_s);
        table.finish();
    }
    latencies
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_scene_is_the_papers() {
        let spec = super::super::parse("sim.toml", include_str!("../../rigs/sim.toml"), &|_| unreachable!()).unwrap();
        assert_eq!(spec.scene.unwrap(), paper_scene(9));
    }
}
