//! Load cells with three axes: the drivers read their emulators, mounted in any way, in virtual time and over a real socket.

use palpate_core::parallel::lock;
use palpate_core::quantity::Axis;
use palpate_link::device::LoadCell;
use palpate_link::time::{Instant, run_virtually, sleep};
use palpate_run::rig::parse;
use palpate_sim::scene::Trajectory;
use palpate_testing::served::ServedProgram;
use palpate_testing::{TestFolder, exchanged, shipped_text};
use std::time::Duration;

/// Mountings, with and without a calibration matrix.
const AXES: [&str; 3] = [
    "x = \"x\", y = \"y\", press = \"z\"",
    "x = \"-y\", y = \"z\", press = \"-x\"",
    "x = \"y\", y = \"-x\", press = \"-z\", serial = \"FT1\", matrix = [[1.0, 0.1, 0.0], [0.0, 0.9, -0.2], [0.05, 0.0, 1.1]]",
];

/// Cells with three axes, and the resolution of their forces, N. The last has six bridges on inputs of an NI device.
const CELLS: [(&str, f64); 5] = [
    ("lines = \"ati-netft\"", 1e-6),
    ("lines = \"bota-serial\"", 1e-6),
    ("lines = \"me-gsv8\"", 1e-6),
    ("modbus = \"robotiq-ft300\"", 0.01),
    (
        "daqmx = \"Dev1/ai0:5\", range_v = 0.2, serial = \"FT1\", newton_per_volt = [[0.3, -5.0, 0.2, 5.1, -0.1, 0.4], \
         [-0.2, 2.9, 0.1, 2.8, 0.3, -5.8], [3.9, 0.2, 4.1, -0.1, 4.0, 0.3]]",
        1e-4,
    ),
];

/// The simulated rig with a quiet cell with three axes, and a tilted surface.
fn rig(cell: &str, axes: &str) -> String {
    let cell = format!("{{ {cell} }}\naxes = {{ {axes} }}\n#");
    let rig = exchanged(&shipped_text("rigs/sim.toml"), "{ modbus = \"generic-rs485\" }", &cell);
    exchanged(&rig, "load_cell = { noise_n = 0.003 }", "surface = { tilt_mm_per_mm = { x = 0.05, y = -0.02 } }")
}

#[test]
fn forces_sideways_are_those_of_the_tilted_surface_in_every_mounting() {
    for (name, step_n) in CELLS {
        for axes in AXES {
            let spec = parse("rig.toml", &rig(name, axes), &|_| unreachable!()).expect("a rig");
            let (before, pressed) = run_virtually(async move {
                let simulated = spec.emulators(1).expect("emulators");
                let scene = simulated.scene.clone();
                let mut cell = spec.open_on(simulated).expect("a rig").instruments.load_cell;
                let origin = Instant::now();
                cell.prepare().await.expect("a cell");
                let before = cell.read().await.expect("a reading");
                let now_s = origin.elapsed().as_secs_f64();
                for (axis, place_mm) in [(Axis::X, 0.0), (Axis::Y, 0.0), (Axis::Z, -0.8)] {
                    lock(&scene).set_motion(axis, Trajectory::at_rest(place_mm), now_s);
                }
                sleep(Duration::from_secs(1)).await;
                (before, cell.read().await.expect("a reading"))
            });
            let [x_n, y_n] = pressed.side_n.expect("forces sideways");
            assert!(pressed.force_n > 0.5, "{name}, {axes}: {pressed:?}");
            let slopes = (x_n / pressed.force_n + 0.05, y_n / pressed.force_n - 0.02);
            let most = step_n.max(1e-4);
            assert!(slopes.0.abs() < most && slopes.1.abs() < most, "{name}, {axes}: {pressed:?}");
            assert!(before.force_n.abs() < 1e-5 && !pressed.health.saturated && !pressed.health.fault, "{before:?}");
        }
    }
}

#[test]
fn a_run_with_a_cell_with_three_axes_is_complete() {
    let recipe = "name = \"few\"\n[[step]]\nphase = \"test\"\nforce_n = 1.0\nlist = { places_mm = [[0, 0], [3, 2]] }\n";
    for (cell, step_n) in CELLS {
        let bench = TestFolder::with([("rig.toml", &*rig(cell, AXES[2])), ("r.toml", recipe)]);
        bench.palpate_ends(0, "run r.toml --rig rig.toml --out run");
        let forces = bench.column("run/presses.csv", "force_n");
        let number = |text: &String| text.parse::<f64>().expect("a number");
        assert!(forces.iter().all(|force| (number(force) - 1.0).abs() < 0.02 + step_n), "{cell}: {forces:?}");
    }
}

#[test]
fn a_net_ft_over_a_real_socket_is_examined() {
    let offset = exchanged(
        &rig(CELLS[0].0, AXES[1]),
        "surface = {",
        "load_cell = { noise_n = 0.003, offset_n = 0.25 }\nsurface = {",
    );
    let served = ServedProgram::new(&offset, "--port stage=0");
    let mut text = offset.split("[scene]").next().expect("a rig").to_owned();
    for (device, link) in [("stage", "tcp"), ("load_cell", "udp"), ("array", "tcp")] {
        text = exchanged(&text, "link = \"sim\"", &format!("link = \"{link}://{}\"", served.address(device)));
    }
    let bench = TestFolder::with([("rig.toml", &*text)]);
    let output = bench.palpate_ends(1, "doctor rig.toml --json --confirmed down");
    let output: serde_json::Value = serde_json::from_str(&output.out).expect("one JSON object");
    let identity = &output["devices"][1]["identity"];
    assert_eq!(
        (&identity["identity"], &identity["warnings"][1]),
        (&"ATI Net F/T".into(), &serde_json::Value::Null),
        "{output}"
    );
    assert!(output["zero_n"].as_f64().is_some_and(|zero_n| (zero_n - 0.25).abs() < 0.002), "{output}");
}
