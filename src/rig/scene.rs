use super::SIM_RIG;
use crate::document::{self, Bounds, Problem, Problems, Table};
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

/// What a rig answers in unless its scene says otherwise, s: an ESP301 in 5 to 20 ms; a transmitter at 115200 baud needs 1.5 ms
/// for the bytes of an exchange and two silences of 1.75 ms less what the driver waits itself; a T7 in 1 to 2 ms.
const LATENCIES: Latencies =
    Latencies { stage_s: (0.005, 0.020), load_cell_s: (0.002, 0.003), array_s: (0.001, 0.002) };

/// The paper's rig's scene: what a rig without a `[scene]` is simulated with. An array of other than nine units goes through
/// Table 1 again from its top.
pub(super) fn paper_scene(units: usize) -> Result<SceneSpec, Problems> {
    let mut paper = document::read("rigs/sim.toml", SIM_RIG, |root| {
        root.leave_the_rest();
        root.require_table("scene").and_then(|table| read_scene(table, None))
    })?;
    for percents in [&mut paper.taxel_noise_percent, &mut paper.hysteresis_percent].into_iter().flatten() {
        *percents = percents.iter().copied().cycle().take(units).collect();
    }
    Ok(paper)
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
    let relaxation = document::all(scene.tables("relaxation").into_iter().map(|mut table| {
        let (share, time_s) = (table.require_number("share", SHARE), table.require_number("time_s", TIME));
        table.finish();
        Some(Branch { share: share?, time_s: time_s? })
    }));
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
    fn a_rig_without_a_scene_is_simulated_with_the_papers() {
        let (with, without) = (SIM_RIG, SIM_RIG.split("[scene]").next().unwrap());
        let scene = |text| super::super::parse("rig.toml", text, &|_| unreachable!()).unwrap().scene;
        assert_eq!(scene(with), scene(without));
        let wider = without.replace("columns = 3", "columns = 4");
        let noise = scene(&wider).taxel_noise_percent.unwrap();
        assert_eq!((noise.len(), noise[9]), (12, noise[0]));
    }
}
