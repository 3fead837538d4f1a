//! Reads a rig's `[scene]` into a [`SceneSpec`].

use super::over_time::{read_creep, read_temperature, read_wear};
use super::parse::read_tilt;
use super::scene_keys::{
    SIDEWAYS, contact, fault, friction, glitches, latency_ms, load_cell, mounting, relaxation, scene, spikes, stage,
    stiffness, surface,
};
use super::skin::read_skin;
use super::{KEYS, SIM_RIG, keys};
use palpate_core::quantity::{Limits, Place, Range, Tilt};
use palpate_document::{self as document, DefaultValue, Key, Problem, Problems, Table};
use palpate_sim::scene::{
    ContactLaw, CorruptSamples, FaultKind, Friction, GlitchKind, Latencies, LoadCellScene, Mounting, RelaxationBranch,
    Relief, SceneFault, SceneSpec, Servo, Sine, Spikes, Stiffness,
};

/// Largest stiffness that the paper's rig declares, N/mm.
const PAPER_N_MM: f64 = 2.0;

/// Returns the scene of the paper's rig, with which a rig without a `[scene]` is simulated. An array with another number than
/// nine units repeats Table 1 from its top. The specimen is as much stiffer as the rig declares, and no softer than it declares.
pub(super) fn paper_scene(
    units: usize,
    limits: Option<&Limits>,
    least_n_mm: Option<f64>,
) -> Result<SceneSpec, Problems> {
    let mut paper = document::read("rigs/sim.toml", SIM_RIG, &KEYS, |table| {
        table.table(&keys::root::scene).and_then(|table| read_scene(&table, None))
    })?;
    let noise = paper.skin.noise.as_mut().map(|noise| &mut noise.repeatability_percent);
    for percents in [noise, paper.skin.hysteresis_percent.as_mut()].into_iter().flatten() {
        *percents = percents.iter().copied().cycle().take(units).collect();
    }
    if let Some(Limits { stiffness_n_mm, .. }) = limits {
        let contact = &mut paper.contact;
        contact.linear_n_mm *= stiffness_n_mm / PAPER_N_MM;
        contact.quadratic_n_mm2 *= stiffness_n_mm / PAPER_N_MM;
        if let Some(least_n_mm) = least_n_mm.filter(|least_n_mm| *least_n_mm > contact.linear_n_mm) {
            contact.linear_n_mm = 0.5 * (least_n_mm + stiffness_n_mm);
            contact.quadratic_n_mm2 = 0.0;
        }
    }
    Ok(paper)
}

/// Reads `[scene]`. Each term exists only if it is named.
pub(super) fn read_scene(table: &Table, units: Option<usize>) -> Option<SceneSpec> {
    let skin = read_skin(table, units);
    let creep = read_creep(table);
    let wear = document::optional(table.table(&scene::wear), read_wear);
    let temperature = document::optional(table.table(&scene::temperature), read_temperature);
    let contact = table.table(&scene::contact).and_then(|table| {
        let [linear_n_mm, quadratic_n_mm2, toe_mm] =
            table.numbers([contact::linear_n_mm, contact::quadratic_n_mm2, contact::toe_mm])?;
        Some(ContactLaw { linear_n_mm, quadratic_n_mm2, toe_mm })
    });
    let relaxation = document::all(table.tables(&scene::relaxation).iter().map(|table| {
        let [share, time_s] = table.numbers([relaxation::share, relaxation::time_s])?;
        Some(RelaxationBranch { share, time_s })
    }));
    // a wrong term has been reported
    let mounting = table.table(&scene::mounting).and_then(|table| {
        let [x_mm, y_mm, z_mm, rotation_deg] =
            table.numbers([mounting::x_mm, mounting::y_mm, mounting::z_mm, mounting::rotation_deg])?;
        Some(Mounting { origin: Place { x_mm, y_mm }, rotation_deg, z_mm })
    });
    let surface = table.table(&scene::surface);
    let surface_tilt = surface.as_ref().map_or(Some(Tilt::LEVEL), |table| read_tilt(table, &surface::tilt_mm_per_mm));
    let (surface_tilt_mm, surface_wave, relief) =
        surface.and_then(|table| read_surface(&table)).unwrap_or((0.0, None, None));
    let stiffness = table.table(&scene::stiffness).and_then(|table| {
        let [smooth_percent, white_percent] = table.numbers([stiffness::smooth_percent, stiffness::white_percent])?;
        Some(Stiffness { smooth_percent, white_percent })
    });
    let stage = table.table(&scene::stage).and_then(|table| {
        let [servo_ms, quantum_mm, backlash_mm] =
            table.numbers([stage::servo_ms, stage::quantum_mm, stage::backlash_mm])?;
        Some(Servo { lag_s: servo_ms / 1000.0, quantum_mm, backlash_mm })
    });
    let load_cell = table.table(&scene::load_cell).and_then(|table| read_load_cell(&table));
    let latencies = read_latencies(table.table(&scene::latency_ms).as_ref());
    let friction = document::optional(table.table(&scene::friction), read_friction);
    let faults = document::all(table.tables(&scene::fault).iter().map(read_fault));
    let (taxel_creep, taxel_lag_s) = creep?;
    Some(SceneSpec {
        taxel_creep,
        taxel_lag_s,
        wear: wear?,
        temperature: temperature?,
        relaxation: relaxation?,
        friction: friction?,
        mounting,
        surface_tilt_mm,
        surface_tilt: surface_tilt?,
        surface_wave,
        relief,
        stiffness,
        stage,
        load_cell,
        latencies: latencies?,
        faults: faults?,
        ..SceneSpec::of(skin?, contact?)
    })
}

/// Reads the plane's tilt, mm, and the deviations from the plane.
fn read_surface(table: &Table) -> Option<(f64, Option<Sine>, Option<Relief>)> {
    let numbers = table.numbers([surface::tilt_mm, surface::wave_mm, surface::wave_s]);
    let bumps_mm = table.number(&surface::bumps_mm);
    let wavelength = table.range(&surface::bumps_wavelength_mm);
    let roughness_mm = table.number(&surface::roughness_mm);
    if table.has(&surface::bumps_wavelength_mm) && !table.has(&surface::bumps_mm) {
        let text = "`bumps_wavelength_mm` requires `bumps_mm`";
        table.complain(Problem::new(table.span_of(&surface::bumps_wavelength_mm), text));
    }
    let Range { min, max } = wavelength?;
    let relief = (bumps_mm.is_some() || roughness_mm.is_some()).then(|| Relief {
        bumps_mm: bumps_mm.unwrap_or(0.0),
        bumps_wavelength_mm: (min, max),
        roughness_mm: roughness_mm.unwrap_or(0.0),
    });
    let [tilt_mm, wave_mm, wave_s] = numbers?;
    Some((tilt_mm, wave(wave_mm, wave_s), relief))
}

fn read_friction(table: &Table) -> Option<Friction> {
    let [sticking, sliding, stiffness_n_mm] =
        table.numbers([friction::sticking, friction::sliding, friction::stiffness_n_mm])?;
    if sliding > sticking {
        let text = format!("`sliding` is {sliding}, over `sticking` of {sticking}: a tip that slips holds less");
        table.complain(Problem::new(table.span_of(&friction::sliding), text).help("use at most `sticking`"));
    }
    Some(Friction { sticking, sliding, stiffness_n_mm })
}

fn read_fault(table: &Table) -> Option<SceneFault> {
    let kind = table.word(&fault::kind, &FaultKind::ALL);
    let from_s = table.number(&fault::from_s);
    let value = match kind? {
        FaultKind::Saturated => table.number(&fault::saturated::value),
        FaultKind::HardContact => table.number(&fault::hard_contact::value),
        FaultKind::ArrayLost => table.number(&fault::array_lost::value),
        FaultKind::ScaledOutputs => table.number(&fault::scaled_outputs::value),
        FaultKind::SlowStage => table.number(&fault::slow_stage::value),
        FaultKind::Noisy => table.number(&fault::noisy::value),
        FaultKind::DriftedZero => table.number(&fault::drifted_zero::value),
        FaultKind::LostGain => table.number(&fault::lost_gain::value),
        FaultKind::RollsOver => table.number(&fault::rolls_over::value),
        _ => None,
    };
    Some(SceneFault { kind: kind?, from_s: from_s?, value })
}

/// Returns a wave; `None` if the amplitude is 0.
pub(super) fn wave(amplitude: f64, period_s: f64) -> Option<Sine> {
    (amplitude > 0.0).then_some(Sine { amplitude, period_s })
}

fn read_load_cell(table: &Table) -> Option<LoadCellScene> {
    use load_cell as key;
    let (low_pass_hz, stiffness_n_mm) = (table.number(&key::low_pass_hz), table.number(&key::stiffness_n_mm));
    let noise = table.numbers([key::noise_n, key::noise_ahead_n, key::offset_n, key::drift_n_min]);
    let waves = table.numbers([key::wander_n, key::wander_s, key::hum_n, key::hum_hz]);
    let others = table.numbers([key::gain_error_percent, key::transport_ms, key::tool_kg, key::crosstalk_percent]);
    let side_axes = table.word(&key::sideways, &SIDEWAYS);
    let glitches = document::optional(table.table(&key::glitches), read_glitches);
    let [noise_n, noise_ahead_n, offset_n, drift_n_min] = noise?;
    let ([wander_n, wander_s, hum_n, hum_hz], [gain_error_percent, transport_ms, tool_kg, crosstalk_percent]) =
        (waves?, others?);
    Some(LoadCellScene {
        noise_n,
        noise_ahead_n,
        offset_n,
        drift_n_s: drift_n_min / 60.0,
        slow_drift: wave(wander_n, wander_s),
        mains: wave(hum_n, 1.0 / hum_hz),
        gain: 1.0 + gain_error_percent / 100.0,
        transport_s: transport_ms / 1000.0,
        low_pass_hz,
        stiffness_n_mm,
        tool_kg,
        crosstalk: crosstalk_percent / 100.0,
        side_axes: side_axes?,
        glitches: glitches?,
    })
}

fn read_glitches(table: &Table) -> Option<CorruptSamples> {
    let kind = table.word(&glitches::kind, &GlitchKind::ALL);
    let in_a_row = table.whole(&glitches::in_a_row);
    let for_s = table.number(&glitches::for_s).unwrap_or(f64::INFINITY);
    let [share, range_n, from_s] = table.numbers([glitches::share, glitches::range_n, glitches::from_s])?;
    Some(CorruptSamples { kind: kind?, share, in_a_row: u32::try_from(in_a_row?).ok()?, range_n, from_s, for_s })
}

fn read_latencies(table: Option<&Table>) -> Option<Latencies> {
    let seconds = |key: Key| {
        let range = table.map_or_else(|| key.default().and_then(DefaultValue::range), |table| table.range(&key));
        range.map(|ms| (ms.min / 1000.0, ms.max / 1000.0))
    };
    let (stage_s, load_cell_s, array_s) =
        (seconds(latency_ms::stage), seconds(latency_ms::load_cell), seconds(latency_ms::array));
    let stage_spikes = table.and_then(|table| table.table(&latency_ms::spikes)).and_then(|table| {
        let [share, longer_ms] = table.numbers([spikes::share, spikes::ms])?;
        Some(Spikes { share, longer_s: longer_ms / 1000.0 })
    });
    Some(Latencies { stage_s: stage_s?, load_cell_s: load_cell_s?, array_s: array_s?, stage_spikes })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rig_without_a_scene_is_simulated_with_that_of_the_paper() {
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
    fn each_named_term_is_present_in_its_units() {
        let plain = changed("[scene]", "[scene]").unwrap();
        assert_eq!(
            (plain.relief, plain.stiffness, plain.stage, plain.latencies.stage_spikes),
            (None, None, None, None)
        );
        assert_eq!(plain.surface_tilt_mm, 0.0);
        assert!(plain.faults.is_empty());
        let cell = LoadCellScene { noise_n: 0.003, ..LoadCellScene::default() };
        assert_eq!(plain.load_cell, Some(cell));

        let scene = changed("noise_n = 0.003", "noise_n = 0.003, transport_ms = 2.0, low_pass_hz = 100.0").unwrap();
        assert_eq!(scene.load_cell, Some(LoadCellScene { transport_s: 0.002, low_pass_hz: Some(100.0), ..cell }));
        let scene = changed("relaxation =", &surface("bumps_mm = 0.03, bumps_wavelength_mm = [1.0, 2.0]")).unwrap();
        let short = Relief { bumps_mm: 0.03, bumps_wavelength_mm: (1.0, 2.0), roughness_mm: 0.0 };
        assert_eq!((scene.surface_tilt_mm, scene.relief), (0.0, Some(short)));
        let scene = changed("relaxation =", &surface("tilt_mm = 0.2, bumps_mm = 0.005, roughness_mm = 0.001")).unwrap();
        let nominal = Relief { bumps_mm: 0.005, bumps_wavelength_mm: (6.0, 12.0), roughness_mm: 0.001 };
        assert_eq!((scene.surface_tilt_mm, scene.relief), (0.2, Some(nominal)));
        let more = "stiffness = { smooth_percent = 6.0, white_percent = 0.5 }\nstage = { servo_ms = 7.0, quantum_mm = 0.0001 }\nelastomer";
        let scene = changed("elastomer", more).unwrap();
        assert_eq!(scene.stiffness, Some(Stiffness { smooth_percent: 6.0, white_percent: 0.5 }));
        assert_eq!(scene.stage, Some(Servo { lag_s: 0.007, quantum_mm: 0.0001, backlash_mm: 0.0 }));
        let of = "glitches = { kind = \"minus-one\", share = 0.004";
        let scene = changed("noise_n = 0.003", &format!("noise_n = 0.003, {of} }}")).unwrap();
        let usual = CorruptSamples::of(GlitchKind::MinusOne, 0.004);
        assert_eq!(scene.load_cell, Some(LoadCellScene { glitches: Some(usual), ..cell }));
        let burst = format!("noise_n = 0.003, {of}, in_a_row = 2, range_n = 50.0, from_s = 12.0, for_s = 1.0 }}");
        let burst = changed("noise_n = 0.003", &burst).unwrap().load_cell.and_then(|cell| cell.glitches);
        let expected = CorruptSamples { in_a_row: 2, range_n: 50.0, from_s: 12.0, for_s: 1.0, ..usual };
        assert_eq!(burst, Some(expected));
        let scene = changed("latency_ms = {", "latency_ms = { spikes = { share = 0.02, ms = 200.0 },").unwrap();
        assert_eq!(scene.latencies.stage_spikes, Some(Spikes { share: 0.02, longer_s: 0.2 }));
    }

    #[test]
    fn every_fault_can_be_named() {
        let last = "array = [1.0, 2.0] }";
        for (name, kind) in FaultKind::ALL {
            let fault = format!("{last}\n[[scene.fault]]\nkind = \"{name}\"\nfrom_s = 12.0\n");
            assert_eq!(changed(last, &fault).unwrap().faults, [SceneFault { kind, from_s: 12.0, value: None }]);
            let valued = changed(last, &format!("{fault}value = 1.5\n"));
            // without a value, the array is silent for ever
            match kind.usual().is_some() || kind == FaultKind::ArrayLost {
                true => assert_eq!(valued.unwrap().faults[0].value, Some(1.5), "{name}"),
                false => assert!(valued.unwrap_err()[0].contains("value"), "{name} takes no value"),
            }
        }
    }

    #[test]
    fn scene_error_is_reported() {
        let last = "array = [1.0, 2.0] }";
        let fault = |text: &str| format!("{last}\n[[scene.fault]]\n{text}\n");
        for (from, to, words) in [
            ("relaxation =", surface("bumps_wavelength_mm = [6.0, 12.0]").as_str(), "requires `bumps_mm`"),
            ("relaxation =", &surface("bumps_mm = -0.1"), "bumps_mm"),
            ("relaxation =", &surface("bumps_mm = 0.1, bumps_wavelength_mm = [0.0, 12.0]"), "bumps_wavelength_mm"),
            ("noise_n = 0.003", "low_pass_hz = 0.0", "low_pass_hz"),
            ("noise_n = 0.003", "transport_ms = -1.0", "transport_ms"),
            ("noise_n = 0.003", "glitches = { kind = \"minus-one\", share = 1.5 }", "share"),
            ("noise_n = 0.003", "glitches = { kind = \"minus\", share = 0.5 }", "minus-one"),
            ("noise_n = 0.003", "glitches = { share = 0.5 }", "`kind` is missing"),
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
            assert!(problems.iter().any(|line| line.contains(words)), "{to}: {problems:?}");
        }
    }
}
