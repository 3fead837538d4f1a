//! `palpate doctor` and `palpate align` as their user sees them.

use palpate_testing::{SMALL, TestFolder, exchanged, shipped, shipped_text};

const RIGS: [&str; 9] = ["sim", "paper", "esp301", "xps", "grbl", "process", "printer", "bench-fast", "bench-esp301"];

/// The key that no shipped rig can state.
const NEITHER: &str = "- load_cell: it has neither a certificate nor a check";

/// True position of a simulated specimen relative to that of the rig: x, y and z in mm, and degrees.
const MOUNTING: &str = "mounting = { x_mm = 0.6, y_mm = -0.4, z_mm = 0.1, rotation_deg = 3.0 }\n";

#[test]
fn doctor_accepts_every_shipped_rig_except_its_gain_in_80_columns() {
    for rig in RIGS {
        let file = shipped(&format!("rigs/{rig}.toml"));
        let output = TestFolder::new().palpate_ends(0, &format!("doctor {} --simulate", file.display()));
        let (_, advice) = output.out.split_once("\nto do\n").expect("advice");
        // these set the speed of their search for home themselves
        let homes_itself = ["paper", "xps", "grbl"].contains(&rig);
        let homes = usize::from(homes_itself && advice.contains("- stage: it homes at"));
        let items = advice.lines().filter(|line| line.starts_with("- ")).count();
        assert!(advice.contains(NEITHER) && items == 1 + homes, "{rig}: {}", output.out);
        for expected in ["stage", "load_cell", "array", "noise of a reading", "fastest safe approach:"] {
            assert!(output.out.contains(expected), "{rig}: no {expected:?} in\n{}", output.out);
        }
        let widest = output.out.lines().map(|line| line.chars().count()).max();
        assert!(widest <= Some(80), "{rig}: {widest:?} columns");
    }
}

#[test]
fn retract_moves_only_z_on_every_shipped_rig() {
    for rig in RIGS {
        let file = shipped(&format!("rigs/{rig}.toml"));
        let output = TestFolder::new().palpate_ends(0, &format!("retract {} --simulate", file.display()));
        assert!(
            output.out.contains("away from the specimen; the load cell was read on the way"),
            "{rig}: {}",
            output.out
        );
    }
}

#[test]
fn faulty_load_cell_does_not_delay_retraction() {
    for kind in ["stale", "stuck", "no-sensor"] {
        let rig = shipped_text("rigs/sim.toml") + &format!("\n[[scene.fault]]\nkind = \"{kind}\"\nfrom_s = 0.0\n");
        let output = TestFolder::with([("rig.toml", rig.as_str())]).palpate_ends(0, "retract rig.toml");
        assert!(output.out.contains("away from the specimen"), "{kind}: {}", output.out);
    }
}

#[test]
fn former_command_name_withdraw_is_accepted_and_reported_once() {
    let bench = TestFolder::with([("rig.toml", shipped_text("rigs/sim.toml").as_str())]);
    let former = bench.palpate_ends(0, "withdraw rig.toml");
    assert_eq!(former.err.matches("note: `palpate withdraw` is now `palpate retract`").count(), 1, "{}", former.err);
    let now = bench.palpate_ends(0, "retract rig.toml");
    assert!(former.out == now.out && !now.err.contains("is now"), "{former:?} {now:?}");
    assert!(!bench.palpate_ends(0, "--help").out.contains("withdraw"));
}

#[test]
fn zero_outside_the_declared_range_is_refused() {
    let rig = exchanged(&shipped_text("rigs/sim.toml"), "noise_n = 0.003", "noise_n = 0.003, offset_n = 0.3");
    let said = exchanged(&rig, "conversions_hz = 200.0", "conversions_hz = 200.0\nair_n = [-0.1, 0.1]");
    let bench = TestFolder::with([("rig.toml", rig.as_str()), ("said.toml", said.as_str()), ("r.toml", SMALL)]);
    let output = bench.palpate_ends(0, "doctor rig.toml");
    assert!(output.out.contains("`air_n = [-0.1, 0.7]`"), "{}", output.out);
    let output = bench.palpate_ends(4, "doctor said.toml");
    assert!(output.running().contains("zero-outside: 0.3"), "{}", output.err);
    let output = bench.palpate_ends(4, "run r.toml --rig said.toml --out run");
    assert!(
        output.running().contains("limit 0.1000 N; check whether something touches the indenter"),
        "{}",
        output.err
    );
}

#[test]
fn doctor_states_the_drift_of_the_load_cell() {
    let rig = |n_min: f64, more: &str| {
        let rig = exchanged(
            &shipped_text("rigs/sim.toml"),
            "noise_n = 0.003",
            &format!("noise_n = 0.003, drift_n_min = {n_min}"),
        );
        exchanged(&rig, "conversions_hz = 200.0", &format!("conversions_hz = 200.0{more}"))
    };
    let (slow, fast, over, down) = (rig(0.06, ""), rig(0.24, ""), rig(1.62, ""), rig(-0.06, "\nair_n = [-0.1, 0.1]"));
    let bench =
        TestFolder::with([("slow.toml", &*slow), ("fast.toml", &*fast), ("over.toml", &*over), ("down.toml", &*down)]);
    let said = |output: &str| output.split_whitespace().collect::<Vec<_>>().join(" ");
    for (name, drift, proposed, leaves) in [
        ("slow", "drift of the zero 1.0", "`air_n = [-0.39, 2]` in [load_cell]", "leaves `air_n` in 33 min"),
        ("fast", "drift of the zero 4.0", "`air_n = [-0.359, 2]` in [load_cell]", "leaves `air_n` in 8 min"),
    ] {
        let said = said(&bench.palpate_ends(0, &format!("doctor {name}.toml")).out);
        for expected in [drift, " mN/s, sd 0.0", " mN/s; a run passes up to 26.7 mN/s", proposed, leaves] {
            assert!(said.contains(expected), "{name}: no {expected:?} in\n{said}");
        }
    }
    let said_down = said(&bench.palpate_ends(0, "doctor down.toml").out);
    assert!(said_down.contains("drift of the zero -") && said_down.contains("leaves `air_n` in 2 min"), "{said_down}");
    let output = bench.palpate_ends(4, "doctor over.toml");
    assert!(output.running().contains("drifts: 0.027"), "{}", output.err);
    let steady = bench.palpate_ends(0, "doctor sim").out;
    assert!(!steady.contains("drift of the zero"), "{steady}");
    let json = &bench.palpate_ends(0, "doctor fast.toml --json").json_lines()[0];
    let number = |key: &str| json[key].as_f64().unwrap_or_else(|| panic!("no {key}: {json}"));
    assert!((number("drift_n_s") - 0.004).abs() < 4.0 * number("drift_sd_n_s"), "{json}");
}

#[test]
fn doctor_measures_the_values_that_a_run_uses() {
    let output = TestFolder::new().palpate_ends(0, &format!("doctor {} --json", shipped("rigs/sim.toml").display()));
    let found = &output.json_lines()[0];
    let number = |key: &str| found[key].as_f64().unwrap_or_else(|| panic!("no {key}: {found}"));
    assert!((number("noise_n") - 0.003).abs() < 0.0005 && number("zero_n").abs() < 0.001, "{found}");
    // conversion 5 ms, 1.5 times the longest exchanges of 20 and 10 ms, servo 10 ms
    assert_eq!(number("reaction_worst_ms"), 60.0);
    assert_eq!(found["reaction_ms"].as_array().map(Vec::len), Some(200));
    assert!((number("approach_mm_s") - 9.26).abs() < 0.01, "{found}");
    assert_eq!(found["advice"].as_array().map(Vec::len), Some(1), "{found}");
}

#[test]
fn doctor_on_a_simulated_rig_presses_instead_of_a_finger() {
    let output = TestFolder::new().palpate_ends(0, "doctor sim --finger");
    assert!(output.out.contains("it measures force, as a press of the simulated rig has shown"), "{}", output.out);
    assert!(output.out.contains("\nno load    zero "), "{}", output.out);
}

#[test]
fn doctor_reports_each_fault_with_advice_and_continues() {
    let noisy = exchanged(&shipped_text("rigs/sim.toml"), "noise_n = 0.003", "noise_n = 0.1, offset_n = 1.5");
    let output = TestFolder::with([("noisy.toml", noisy.as_str())]).palpate_ends(1, "doctor noisy.toml");
    let said = output.out.split_whitespace().collect::<Vec<_>>().join(" ");
    for expected in [
        "is over 2 % of the force limit: a run won't start",
        "without load. This is subtracted, but check whether it is preloaded",
    ] {
        assert!(said.contains(expected), "no {expected:?} in\n{}", output.out);
    }
    let slow = exchanged(&shipped_text("rigs/sim.toml"), "speed_mm_s = 10.0 ", "speed_mm_s = 100.0 ");
    let output = TestFolder::with([("fast.toml", slow.as_str())]).palpate_ends(3, "doctor fast.toml");
    assert!(
        output.running().contains("reaches at most 25 mm/s, less than the rig's speed_mm_s of 100"),
        "{}",
        output.err
    );
    assert!(output.out.contains("stage      fails: see below") && output.out.contains("LabJack T7"), "{}", output.out);
}

#[test]
fn align_finds_a_displaced_specimen_and_writes_only_the_frame() {
    let rig = shipped_text("rigs/sim.toml") + MOUNTING;
    let bench = TestFolder::with([("rig.toml", rig.as_str())]);
    let output = bench.palpate_ends(0, "align rig.toml");
    assert!(output.out.ends_with("written: [frame] of rig.toml\n"), "{}", output.out);
    let written = bench.read("rig.toml");
    let of =
        |key: &str| written.lines().find(|line| line.starts_with(key)).unwrap_or_else(|| panic!("no {key}")).to_owned();
    let numbers = |line: &str| -> Vec<f64> {
        let before = line.split('#').next().unwrap_or_default();
        let parts = before.split(|c: char| !(c.is_ascii_digit() || ".-".contains(c)));
        parts.filter_map(|part| part.parse().ok()).collect()
    };
    let origin = numbers(&of("origin_mm"));
    assert!((origin[0] - 0.6).hypot(origin[1] + 0.4) < 0.15, "{origin:?}");
    assert!((numbers(&of("rotation_deg"))[0] - 3.0).abs() < 1.5, "{}", of("rotation_deg"));
    // down is -z; the specimen's own plane is up to 0.07 mm off in its middle
    assert!((numbers(&of("surface_mm"))[0] + 0.1).abs() < 0.08, "{}", of("surface_mm"));
    assert!((1e-4..0.15).contains(&numbers(&of("u_origin_mm"))[0]), "{}", of("u_origin_mm"));
    assert!(of("rotation_deg").contains("# aligned, +-"), "{written}");
    // the specimen is level; a slope of 0.001 is 6 um at the edge
    let tilt = numbers(&of("tilt_mm_per_mm"));
    assert!(tilt.len() == 2 && tilt[0].hypot(tilt[1]) < 1e-3, "{tilt:?}");
    assert!(
        of("tilt_mm_per_mm").contains("# aligned, +-") && output.out.contains("um sideways over the surface"),
        "{}",
        output.out
    );
    let others = |text: &str| -> Vec<String> {
        let own = ["surface_mm", "origin_mm", "u_origin_mm", "rotation_deg", "tilt_mm_per_mm"];
        text.lines().filter(|line| !own.iter().any(|key| line.starts_with(key))).map(str::to_owned).collect()
    };
    assert_eq!(others(&written), others(&rig));
    bench.palpate_ends(0, &format!("check {} --rig rig.toml", shipped("recipes/paper.toml").display()));
}

/// A specimen with this slope along x, and travel for it.
fn sloped(per_x: f64) -> String {
    let rig = exchanged(&shipped_text("rigs/sim.toml"), "uncertainty = 0.3", "uncertainty = 0.6");
    let slope = format!("surface = {{ tilt_mm_per_mm = {{ x = {per_x}, y = 0.0 }} }}\nload_cell = {{");
    exchanged(&rig, "load_cell = {", &slope)
}

#[test]
fn a_tilt_is_aligned_stated_by_check_and_refused_above_five_degrees() {
    let (sloped_rig, steep_rig) = (sloped(-0.05), sloped(0.1));
    let bench = TestFolder::with([("rig.toml", sloped_rig.as_str()), ("steep.toml", &steep_rig), ("r.toml", SMALL)]);
    let output = bench.palpate_ends(0, "align rig.toml");
    let travels = output.out.split("travels ").nth(1).and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    // 0.05 mm per mm
    let is_right = travels.is_some_and(|travels_um| (travels_um - 50.0).abs() < 1.0);
    assert!(output.out.contains("tilt      2.8") && is_right, "{}", output.out);
    let output = bench.palpate_ends(0, "check r.toml --rig rig.toml");
    for expected in
        ["tilted by 2.8", "deeper toward 1", "um sideways per mm of depth", "mm of height over the pressed area"]
    {
        assert!(output.out.contains(expected), "no {expected:?} in\n{}", output.out);
    }
    assert!(output.out.lines().all(|line| line.chars().count() <= 80), "{}", output.out);
    let level = bench.palpate_ends(0, &format!("check r.toml --rig {}", shipped("rigs/sim.toml").display()));
    assert!(!level.out.contains("tilted"), "{}", level.out);

    let output = bench.palpate_ends(1, "align steep.toml");
    let said = output.running();
    assert!(said.contains("tilted by 5.7") && said.contains("shim the specimen"), "{said}");
    assert_eq!(bench.read("steep.toml"), steep_rig);
}

#[test]
fn align_writes_nothing_of_a_poor_fit_a_dry_run_or_a_real_rigs_simulation() {
    let swapped = exchanged(&shipped_text("rigs/paper.toml"), "Dev1/ai1:9", "Dev1/ai1:4,Dev1/ai9,Dev1/ai6:8,Dev1/ai5");
    let bench = TestFolder::with([
        ("swapped.toml", swapped.as_str()),
        ("sim.toml", &shipped_text("rigs/sim.toml")),
        ("real.toml", &shipped_text("rigs/esp301.toml")),
    ]);
    let output = bench.palpate_ends(1, "align swapped.toml");
    assert!(output.running().contains("can't locate the array"), "{}", output.err);
    assert!(bench.palpate_ends(0, "align sim.toml --dry-run").out.ends_with("not written (--dry-run)\n"));
    let output = bench.palpate_ends(0, "align real.toml --simulate");
    assert!(output.out.ends_with("not written (a simulated frame doesn't apply to a real rig)\n"), "{}", output.out);
    for (file, rig) in [("swapped.toml", &swapped), ("sim.toml", &shipped_text("rigs/sim.toml"))] {
        assert_eq!(&bench.read(file), rig);
    }
    assert_eq!(bench.read("real.toml"), shipped_text("rigs/esp301.toml"));
}

#[test]
fn a_rig_that_mixes_a_program_with_simulated_links_is_refused_and_a_printer_with_switches() {
    let mixed = exchanged(
        &shipped_text("rigs/sim.toml"),
        "driver = { modbus = \"labjack-t7\" }\nlink = \"sim\"                             # tcp://192.168.1.10:502",
        "driver = { process = [\"python3\", \"array.py\"] }",
    );
    let marlin = exchanged(&shipped_text("rigs/grbl.toml"), "\"grbl\"", "\"marlin\"");
    let bench = TestFolder::with([("mixed.toml", mixed.as_str()), ("marlin.toml", &marlin)]);
    let output = bench.palpate_ends(2, "doctor mixed.toml");
    assert!(output.running().contains("some links are simulated and others are real"), "{}", output.err);
    let output = bench.palpate_ends(2, "doctor marlin.toml");
    assert!(output.running().contains("a printer can't be stopped while it searches for home"), "{}", output.err);
}

#[cfg(unix)]
#[test]
fn a_program_that_isnt_found_and_one_that_crashed_are_named_with_what_to_do() {
    let with = |command: &str| {
        let rig = shipped_text("rigs/process.toml");
        exchanged(&rig, "[\"python3\", \"examples/stage.py\"]", command)
    };
    for (command, parts) in [
        ("[\"pyton3\", \"stage.py\"]", ["the program `pyton3` wasn't found", "check the spelling of the program"]),
        ("[\"./rig.toml\"]", ["the program `./rig.toml` can't be started", "check the spelling of the program"]),
        (
            "[\"sh\", \"-c\", \"read line; exit 3\"]",
            ["the program has ended (exit status: 3)", "see the program's own messages"],
        ),
        (
            "[\"sh\", \"-c\", \"read line; kill -9 $$\"]",
            ["the program has ended (signal: 9", "see the program's own messages"],
        ),
    ] {
        let bench = TestFolder::with([("rig.toml", with(command).as_str())]);
        let output = bench.palpate_ends(3, "doctor rig.toml --confirmed down");
        let output = output.running();
        assert!(parts.iter().all(|part| output.contains(part)) && !output.contains("cable"), "{command}: {output}");
    }
}

#[test]
fn emulate_names_devices_without_a_socket_and_refuses_a_port_for_them() {
    let rig = shipped("rigs/paper.toml");
    let bench = TestFolder::new();
    let output = bench.palpate_ends(2, &format!("emulate {} --port array=0", rig.display()));
    assert!(output.running().contains("daqmx has no socket"), "{}", output.err);
    let output = bench.palpate_ends(2, &format!("emulate {} --port stag=0", rig.display()));
    assert!(output.running().contains("there is no device with this name"), "{}", output.err);
}

#[test]
fn the_rig_of_an_arm_is_checked_before_it_moves() {
    let rig = shipped_text("rigs/ur.toml");
    let points = "[[300.0, -200.0, 100.0], [400.0, -200.0, 100.0], [300.0, -100.0, 100.0]]";
    let cases = [
        ("\"UR5e\"", "\"UR5f\"", "models: UR3, UR5, UR10"),
        (points, "[[300.0, 0.0, 0.0], [400.0, 0.0, 0.0], [500.0, 1.0, 0.0]]", "nearly on one line"),
        (points, "[[900.0, -600.0, 100.0], [950.0, -600.0, 100.0], [900.0, -500.0, 100.0]]", "a UR5e reaches 850 mm"),
        ("[0.0, 3.1416, 0.0]", "[0.0, 2.0, 0.0]", "`tool_rad` points the tool 65 degrees off `frame.down`"),
        ("[0.0, 3.1416, 0.0]", "[0.0, 3.1416]", "`tool_rad` is a list of three numbers"),
        ("[stage]\n", "[stage]\nhome = \"by hand\"\n", "remove `home`"),
        ("[stage]\n", "[stage]\nz_holds_unpowered = true\n", "remove `z_holds_unpowered`"),
    ];
    for (from, to, expected) in cases {
        let bench = TestFolder::with([("rig.toml", exchanged(&rig, from, to).as_str())]);
        let output = bench.palpate_ends(2, "doctor rig.toml");
        assert!(output.running().contains(expected), "{to}: {}", output.err);
    }
}
