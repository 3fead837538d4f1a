use super::SIM_RIG;
use super::parse::ROTATION;
use super::skin::read_skin;
use crate::document::{self, Bounds, Problem, Problems, Table};
use crate::quantity::Place;
use crate::scene::{
    Branch, Contact, Fault, FaultKind, Latencies, LoadCell, Mounting, Relief, SceneSpec, Servo, Spikes, Stiffness,
};

const STIFFNESS: Bounds = Bounds::above(0.0, 100_000.0, "N/mm");
const CURVATURE: Bounds = Bounds::within(0.0, 100_000.0, "N/mm^2");
const TOE: Bounds = Bounds::within(0.0, 10.0, "mm");
const SHARE: Bounds = Bounds::within(0.0, 10.0, "");
const TIME: Bounds = Bounds::within(0.01, 86_400.0, "s");
const PLACE: Bounds = Bounds::within(-100.0, 100.0, "mm");
const HEIGHT: Bounds = Bounds::within(0.0, 10.0, "mm");
const WAVELENGTH: Bounds = Bounds::within(0.1, 1000.0, "mm");
const STIFFER: Bounds = Bounds::within(0.0, 50.0, "%");
const LAG: Bounds = Bounds::within(0.0, 1000.0, "ms");
const QUANTUM: Bounds = Bounds::within(0.0, 1.0, "mm");
const CORNER: Bounds = Bounds::within(0.1, 1e6, "Hz");
const FORCE: Bounds = Bounds::within(0.0, 100.0, "N");
const OFFSET: Bounds = Bounds::within(-100.0, 100.0, "N");
const LATENCY: Bounds = Bounds::within(0.0, 10_000.0, "ms");
const ANY_SHARE: Bounds = Bounds::within(0.0, 1.0, "");
const FROM: Bounds = Bounds::within(0.0, 1e9, "s");
const TIMES: Bounds = Bounds::within(0.0, 1e6, "times");

/// Wavelengths of a surface's bumps unless it says others, mm.
const BUMPS_WAVELENGTH_MM: (f64, f64) = (6.0, 12.0);

/// What a rig answers in unless its scene says otherwise, s: an ESP301 in 5 to 20 ms; a transmitter at 115200 baud needs 1.5 ms
/// for the bytes of an exchange and two silences of 1.75 ms less what the driver waits itself; a T7 in 1 to 2 ms.
const LATENCIES: Latencies =
    Latencies { stage_s: (0.005, 0.020), load_cell_s: (0.002, 0.003), array_s: (0.001, 0.002), stage_spikes: None };

/// The paper's rig's scene: what a rig without a `[scene]` is simulated with. An array of other than nine units goes through
/// Table 1 again from its top.
pub(super) fn paper_scene(units: usize) -> Result<SceneSpec, Problems> {
    let mut paper = document::read("rigs/sim.toml", SIM_RIG, |root| {
        root.leave_the_rest();
        root.require_table("scene").and_then(|table| read_scene(table, None))
    })?;
    let noise = paper.skin.noise.as_mut().map(|noise| &mut noise.repeatability_percent);
    for percents in [noise, paper.skin.hysteresis_percent.as_mut()].into_iter().flatten() {
        *percents = percents.iter().copied().cycle().take(units).collect();
    }
    Ok(paper)
}

/// Reads `[scene]`: each term is there because it is named.
pub(super) fn read_scene(mut scene: Table, units: Option<usize>) -> Option<SceneSpec> {
    let skin = read_skin(&mut scene, units);
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
    let mounting = scene.table("mounting").map(|mut table| {
        let mut along = |key, bounds| table.number(key, bounds).unwrap_or(0.0);
        let origin = Place::new(along("x_mm", PLACE), along("y_mm", PLACE));
        let (z_mm, rotation_deg) = (along("z_mm", PLACE), along("rotation_deg", ROTATION));
        table.finish();
        Mounting { origin, rotation_deg, z_mm }
    });
    let (surface_tilt_mm, relief) = scene.table("surface").map_or((0.0, None), read_surface);
    let stiffness = scene.table("stiffness").map(|mut table| {
        let smooth_percent = table.number("smooth_percent", STIFFER).unwrap_or(0.0);
        let white_percent = table.number("white_percent", STIFFER).unwrap_or(0.0);
        table.finish();
        Stiffness { smooth_percent, white_percent }
    });
    let stage = scene.table("stage").map(|mut table| {
        let lag_s = table.number("servo_ms", LAG).unwrap_or(0.0) / 1000.0;
        let quantum_mm = table.number("quantum_mm", QUANTUM).unwrap_or(0.0);
        table.finish();
        Servo { lag_s, quantum_mm }
    });
    let load_cell = scene.table("load_cell").map(|mut table| {
        let noise_n = table.number("noise_n", FORCE).unwrap_or(0.0);
        let offset_n = table.number("offset_n", OFFSET).unwrap_or(0.0);
        let transport_s = table.number("transport_ms", LAG).unwrap_or(0.0) / 1000.0;
        let low_pass_hz = table.number("low_pass_hz", CORNER);
        table.finish();
        LoadCell { noise_n, offset_n, transport_s, low_pass_hz }
    });
    let latencies = read_latencies(&mut scene);
    let faults = document::all(scene.tables("fault").into_iter().map(read_fault));
    scene.finish();
    Some(SceneSpec {
        skin: skin?,
        contact: contact?,
        relaxation: relaxation?,
        mounting,
        surface_tilt_mm,
        relief,
        stiffness,
        stage,
        load_cell,
        latencies,
        faults: faults?,
    })
}

/// The plane's tilt, mm, and what is over the plane.
fn read_surface(mut table: Table) -> (f64, Option<Relief>) {
    let tilt_mm = table.number("tilt_mm", HEIGHT).unwrap_or(0.0);
    let bumps_mm = table.number("bumps_mm", HEIGHT);
    let wavelength = table.range("bumps_wavelength_mm", WAVELENGTH);
    let roughness_mm = table.number("roughness_mm", HEIGHT);
    if wavelength.is_some() && bumps_mm.is_none() {
        let told = "`bumps_wavelength_mm` without `bumps_mm`: there is nothing of that length";
        table.complain(Problem::new(table.span_of("bumps_wavelength_mm"), told));
    }
    table.finish();
    let relief = (bumps_mm.is_some() || roughness_mm.is_some()).then(|| Relief {
        bumps_mm: bumps_mm.unwrap_or(0.0),
        bumps_wavelength_mm: wavelength.map_or(BUMPS_WAVELENGTH_MM, |range| (range.min, range.max)),
        roughness_mm: roughness_mm.unwrap_or(0.0),
    });
    (tilt_mm, relief)
}

fn read_fault(mut table: Table) -> Option<Fault> {
    let kind = table.require_choice("kind", &FaultKind::ALL);
    let from_s = table.require_number("from_s", FROM);
    let value_bounds = match kind? {
        FaultKind::Saturated => FORCE,
        FaultKind::HardContact => STIFFNESS,
        FaultKind::SlowStage => LATENCY,
        FaultKind::Noisy => TIMES,
        FaultKind::DriftedZero => OFFSET,
        _ => {
            // one that isn't there to be read is told of by finish()
            table.finish();
            return Some(Fault { kind: kind?, from_s: from_s?, value: None });
        }
    };
    let value = table.number("value", value_bounds);
    table.finish();
    Some(Fault { kind: kind?, from_s: from_s?, value })
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
        latencies.stage_spikes = table.table("spikes").and_then(|mut table| {
            let share = table.require_number("share", ANY_SHARE);
            let longer_ms = table.require_number("ms", LATENCY);
            table.finish();
            Some(Spikes { share: share?, longer_s: longer_ms? / 1000.0 })
        });
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
        let noise = scene(&wider).skin.noise.unwrap().repeatability_percent;
        assert_eq!((noise.len(), noise[9]), (12, noise[0]));
    }

    fn changed(from: &str, to: &str) -> Result<SceneSpec, Vec<String>> {
        assert!(SIM_RIG.contains(from), "{from}");
        let text = SIM_RIG.replace(from, to);
        let rig = super::super::parse("rig.toml", &text, &|_| unreachable!());
        rig.map(|rig| rig.scene).map_err(|problems| problems.lines())
    }

    /// The term, on a line before the one of relaxation.
    fn surface(terms: &str) -> String {
        format!("surface = {{ {terms} }}\nrelaxation =")
    }

    #[test]
    fn each_term_is_there_if_it_is_named_and_in_the_units_it_is_named_in() {
        let plain = changed("[scene]", "[scene]").unwrap();
        assert_eq!(
            (plain.relief, plain.stiffness, plain.stage, plain.latencies.stage_spikes),
            (None, None, None, None)
        );
        assert_eq!(plain.surface_tilt_mm, 0.0);
        assert!(plain.faults.is_empty());
        let cell = LoadCell { noise_n: 0.003, ..LoadCell::default() };
        assert_eq!(plain.load_cell, Some(cell));

        let scene = changed("noise_n = 0.003", "noise_n = 0.003, transport_ms = 2.0, low_pass_hz = 100.0").unwrap();
        assert_eq!(scene.load_cell, Some(LoadCell { transport_s: 0.002, low_pass_hz: Some(100.0), ..cell }));
        let scene = changed("relaxation =", &surface("bumps_mm = 0.03, bumps_wavelength_mm = [1.0, 2.0]")).unwrap();
        let short = Relief { bumps_mm: 0.03, bumps_wavelength_mm: (1.0, 2.0), roughness_mm: 0.0 };
        assert_eq!((scene.surface_tilt_mm, scene.relief), (0.0, Some(short)));
        let scene = changed("relaxation =", &surface("tilt_mm = 0.2, bumps_mm = 0.005, roughness_mm = 0.001")).unwrap();
        let nominal = Relief { bumps_mm: 0.005, bumps_wavelength_mm: (6.0, 12.0), roughness_mm: 0.001 };
        assert_eq!((scene.surface_tilt_mm, scene.relief), (0.2, Some(nominal)));
        let more = "stiffness = { smooth_percent = 6.0, white_percent = 0.5 }\nstage = { servo_ms = 7.0, quantum_mm = 0.0001 }\nelastomer";
        let scene = changed("elastomer", more).unwrap();
        assert_eq!(scene.stiffness, Some(Stiffness { smooth_percent: 6.0, white_percent: 0.5 }));
        assert_eq!(scene.stage, Some(Servo { lag_s: 0.007, quantum_mm: 0.0001 }));
        let scene = changed("latency_ms = {", "latency_ms = { spikes = { share = 0.02, ms = 200.0 },").unwrap();
        assert_eq!(scene.latencies.stage_spikes, Some(Spikes { share: 0.02, longer_s: 0.2 }));
    }

    #[test]
    fn every_fault_can_be_named() {
        let last = "array = [1.0, 2.0] }";
        for (name, kind) in FaultKind::ALL {
            let fault = format!("{last}\n[[scene.fault]]\nkind = \"{name}\"\nfrom_s = 12.0\n");
            assert_eq!(changed(last, &fault).unwrap().faults, [Fault { kind, from_s: 12.0, value: None }]);
            let valued = changed(last, &format!("{fault}value = 1.5\n"));
            match kind.usual() {
                Some(_) => assert_eq!(valued.unwrap().faults[0].value, Some(1.5), "{name}"),
                None => assert!(valued.unwrap_err()[0].contains("value"), "{name} takes no value"),
            }
        }
    }

    #[test]
    fn what_is_wrong_in_a_scene_is_told() {
        let last = "array = [1.0, 2.0] }";
        let fault = |text: &str| format!("{last}\n[[scene.fault]]\n{text}\n");
        for (from, to, told) in [
            ("relaxation =", surface("bumps_wavelength_mm = [6.0, 12.0]").as_str(), "without `bumps_mm`"),
            ("relaxation =", &surface("bumps_mm = -0.1"), "bumps_mm"),
            ("relaxation =", &surface("bumps_mm = 0.1, bumps_wavelength_mm = [0.0, 12.0]"), "bumps_wavelength_mm"),
            ("noise_n = 0.003", "low_pass_hz = 0.0", "low_pass_hz"),
            ("noise_n = 0.003", "transport_ms = -1.0", "transport_ms"),
            ("elastomer", "stiffness = { smooth_percent = 60.0 }\nelastomer", "smooth_percent"),
            ("elastomer", "stage = { servo_ms = -1.0 }\nelastomer", "servo_ms"),
            ("elastomer", "stage = { lag_ms = 1.0 }\nelastomer", "lag_ms"),
            ("latency_ms = {", "latency_ms = { spikes = { share = 1.5, ms = 200.0 },", "share"),
            ("latency_ms = {", "latency_ms = { spikes = { share = 0.5 },", "`ms` is missing"),
            (last, &fault("kind = \"stuk\"\nfrom_s = 1.0"), "stuck"),
            (last, &fault("kind = \"stuck\""), "`from_s` is missing"),
            (last, &fault("kind = \"slow-stage\"\nfrom_s = 1.0\nvalue = -1.0"), "value"),
            (last, &fault("from_s = 1.0"), "`kind` is missing"),
        ] {
            let problems = changed(from, to).expect_err(to);
            assert!(problems.iter().any(|line| line.contains(told)), "{to}: {problems:?}");
        }
    }
}
