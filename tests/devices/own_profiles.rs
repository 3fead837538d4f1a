//! Devices that only their profile knows, and what the rig states of a device, in simulated runs.

use palpate_run::rig::{self, RigSpec};
use palpate_testing::executions::{ExecutedRun, executed, in_parallel, must_be_none, plan};
use palpate_testing::{TestFolder, campaign, exchanged, shipped_text};
use std::io;

/// Largest relative difference of a run's true peak force when only what the rig states of a device differs.
const APART: f64 = 0.02;

/// Largest force of the recipe, N.
const FORCE_N: f64 = 0.5;

const RECIPE: &str = "name = \"own\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.0\nsample_s = 0.1\nstrategy = \"guarded\"\n\
     [[step]]\nphase = \"calibration\"\nlist = { places_mm = [[0.0, 0.0], [2.0, -1.0]] }\nforce_n = 0.5\n";

const CELL_LINK: &str = "link = \"serial:///dev/ttyACM0?baud=115200\"";
const ARRAY_LINK: &str = "link = \"serial:///dev/ttyACM1?baud=115200\"";

/// The rig `esp301` with another load cell.
fn with_cell(driver: &str, link: &str, more: &str) -> String {
    let rig = shipped_text("rigs/esp301.toml");
    section(&rig, "[load_cell]", &format!("driver = {driver}\n{link}\n{more}"))
}

/// A rig with another array.
fn with_array(rig: &str, driver: &str, link: &str, layout: &str) -> String {
    section(rig, "[array]", &format!("driver = {driver}\n{link}\n{layout}\n"))
}

fn section(rig: &str, name: &str, content: &str) -> String {
    let (before, own) = rig.split_once(name).expect("a section");
    let after = own.find("\n[").map_or("", |at| &own[at..]);
    format!("{before}{name}\n{content}{after}")
}

/// Reads a rig with a file of its own, simulated.
fn spec(rig: &str, file: &'static str) -> RigSpec {
    let beside = |name: &str| match name {
        "mine.toml" => Ok(file.to_owned()),
        _ => Err(io::ErrorKind::NotFound.into()),
    };
    let mut spec =
        rig::parse("rig.toml", rig, &beside).unwrap_or_else(|p| panic!("{rig}\n{:?}", p.lines())).simulated();
    // a cell without noise: then two runs differ only by what they are about
    if let Some(cell) = &mut spec.scene.load_cell {
        cell.noise_n = cell.noise_n.min(0.001);
    }
    spec
}

fn run(spec: &RigSpec) -> ExecutedRun {
    executed(spec, &plan(spec, RECIPE, 1))
}

/// What isn't as it should be in a run of two presses; `None` if nothing.
fn wrong(name: &str, run: &ExecutedRun) -> Option<String> {
    let rows = run.ledger.contacts().count();
    let is_sound = run.ending.text().is_none() && rows == 2 && (run.truth.force_n / FORCE_N - 1.0).abs() < 0.1;
    (!is_sound).then(|| format!("{name}: {rows} presses, {:.3} N, {:?}", run.truth.force_n, run.ending.text()))
}

/// A load cell of the rig, with the keys that state its gain, and the changes of them.
const CELLS: [(&str, &str, f64, f64); 5] = [
    ("hx711", "conversions_hz = 80.0\n", 0.000_002_5, 84_000.0),
    ("mark-10", "conversions_hz = 50.0\n", 1.0, 0.0),
    ("ati-netft", "conversions_hz = 500.0\naxes = { x = \"x\", y = \"y\", press = \"-z\" }\n", 0.000_001, 0.0),
    ("bota-serial", "conversions_hz = 100.0\naxes = { x = \"x\", y = \"y\", press = \"-z\" }\n", 1.0, 0.0),
    ("me-gsv8", "conversions_hz = 100.0\naxes = { x = \"x\", y = \"y\", press = \"-z\" }\n", 1.0, 0.0),
];

/// Shipped arrays, their layouts and their scales.
const ARRAYS: [(&str, &str, f64); 3] = [
    ("velostat-16", "grid = { rows = 4, columns = 4, pitch_mm = 4.5 }", -1.0),
    ("reskin", "grid = { rows = 3, columns = 5, pitch_mm = 4.5 }", 1.0),
    ("mlx90393-text", "grid = { rows = 3, columns = 5, pitch_mm = 4.5 }", 1.0),
];

const FACTORS: [f64; 3] = [2.0, 0.5, -1.0];

/// Each rig, and the rigs that state something else: their names and texts.
fn restated() -> Vec<(String, String, Vec<String>)> {
    let cell = |(name, more, gain, offset): (&str, &str, f64, f64)| {
        let link = if name == "ati-netft" { "link = \"udp://192.168.1.1:49152\"" } else { CELL_LINK };
        let rig = |gain: f64, offset: f64| {
            let driver = format!("{{ lines = \"{name}\", newton_per_unit = {gain:?}, offset = {offset:?} }}");
            with_cell(&driver, link, more)
        };
        let others = FACTORS.iter().map(|factor| rig(gain * factor, offset));
        let others = others.chain([rig(gain, offset / 2.0 + 0.1 / gain)]).collect();
        (format!("cell {name}"), rig(gain, offset), others)
    };
    let array = |(name, layout, scale): (&str, &str, f64)| {
        let rig = |scale: f64, offset: f64| {
            let driver = format!("{{ lines = \"{name}\", scale = {scale:?}, offset = {offset:?} }}");
            with_array(&shipped_text("rigs/esp301.toml"), &driver, ARRAY_LINK, layout)
        };
        let others = FACTORS.iter().map(|factor| rig(scale * factor, 0.0)).chain([rig(scale, 100.0)]).collect();
        (format!("array {name}"), rig(scale, 0.0), others)
    };
    let (cells, arrays) = (campaign::size(1, CELLS.len()), campaign::size(1, ARRAYS.len()));
    CELLS.into_iter().take(cells).map(cell).chain(ARRAYS.into_iter().take(arrays).map(array)).collect()
}

#[test]
fn the_true_peak_is_the_same_whatever_gain_the_rig_states() {
    let ends = in_parallel(&restated(), |(name, first, others)| {
        let first = run(&spec(first, ""));
        let mut bad: Vec<String> = wrong(name, &first).into_iter().collect();
        for (nth, other) in others.iter().enumerate() {
            let other = run(&spec(other, ""));
            bad.extend(wrong(&format!("{name}, change {nth}"), &other));
            let apart = (other.truth.force_n / first.truth.force_n - 1.0).abs();
            if apart > APART {
                bad.push(format!("{name}, change {nth}: {:.3} and {:.3} N", first.truth.force_n, other.truth.force_n));
            }
        }
        bad
    });
    must_be_none(&ends.concat());
}

/// A board with a force and five outputs a line, among other numbers.
const TEXT: &str = "name = \"mine\"\n[text]\nbefore = \"F,\"\nafter = \";end\"\nseparator = \",\"\ncolumns = 9\n\
     [force]\ncolumn = 2\nnewton_per_unit = -0.01\noffset = 300.0\n[outputs]\ncolumns = \"4-8\"\npossible = [0, 1023]\n\
     [time]\ncolumn = 9\nunit_s = 0.001\n";

/// Frames with a count, a state, a check sum and integers.
const FRAME: &str = "name = \"mine\"\n[frame]\nhead = \"AA 55\"\nnumbers = [\"u8\", \"u16\", \"skip\", \"i32\", \"5 i16\"]\n\
     order = \"big\"\nchecksum = \"crc16-x25\"\n[counter]\ncolumn = 1\nstep = 1\n[status]\ncolumn = 2\nsaturated_mask = 8\n\
     [force]\ncolumn = 3\nnewton_per_unit = 0.0001\n[outputs]\ncolumns = \"4-8\"\nscale = -0.5\n";

/// Datagrams that begin after a command.
const PACKET: &str = "name = \"mine\"\non_start_hex = \"01 02\"\n[frame]\npacket = true\nnumbers = [\"u32\", \"3 f32\"]\n\
     [counter]\ncolumn = 1\nstep = 1\n[force]\ncolumns = \"2-4\"\nnewton_per_unit = 0.5\n";

/// A gauge that answers a question.
const ASKED: &str =
    "name = \"mine\"\nask = \"R\\r\"\n[text]\ncolumns = 1\nafter = \" mN\"\n[force]\nnewton_per_unit = 0.001\n";

/// A transmitter with decimals, a sign bit, a state and a number that proves the map.
const CELL_MAP: &str = "name = \"mine\"\ntransport = \"rtu\"\nunit_id = 7\ndeadline_ms = 200\naddress_base = 40001\n\
     [force]\naddress = 40008\ntype = \"u32\"\nword_order = \"little\"\nnewton_per_unit = 2.0\noffset = 12.0\n\
     decimals = { address = 40020, mask = 112, shift = 4 }\nsign = { address = 40007, bit = 7 }\n\
     [status]\naddress = 40007\nsaturated_bits = [2]\n\
     [[probe]]\nwhat = \"model\"\naddress = 40002\ntype = \"u16\"\nvalue = 17\n";

/// A converter with 16 bits.
const ARRAY_MAP: &str = "name = \"mine\"\ntransport = \"tcp\"\nunit_id = 1\ndeadline_ms = 200\n\
     [outputs]\nfunction = \"input\"\naddress = 100\ntype = \"u16\"\nmask = 4095\ncount_max = 9\n";

/// A supply whose voltage is between other numbers, in half volts above 100.
const MONITOR: &str = "name = \"mine\"\n[text]\ncolumns = 3\nseparator = \" \"\n[outputs]\ncolumns = \"2\"\nscale = 0.5\n\
     offset = 100.0\npossible = [0, 1000]\n";

const FIVE: &str = "places_mm = [[-3, -3], [3, -3], [-3, 3], [3, 3], [0, 0]]";

/// Rigs with devices that only their profile knows.
fn own_rigs() -> Vec<(&'static str, String, &'static str)> {
    let esp301 = shipped_text("rigs/esp301.toml");
    let (own, map) = ("{ lines = \"mine.toml\" }", "{ modbus = \"mine.toml\" }");
    let cell = |link: &str, more: &str| with_cell(own, link, more);
    let hz = "conversions_hz = 100.0\n";
    vec![
        ("board with both", with_array(&cell(CELL_LINK, hz), own, CELL_LINK, FIVE), TEXT),
        ("map of a cell", with_cell(map, CELL_LINK, hz), CELL_MAP),
        (
            "packets",
            cell(
                "link = \"udp://192.168.1.1:4000\"",
                "conversions_hz = 500.0\naxes = { x = \"y\", y = \"x\", press = \"z\" }\n",
            ),
            PACKET,
        ),
        ("frames with both", with_array(&cell(CELL_LINK, hz), own, CELL_LINK, FIVE), FRAME),
        ("two boards", with_array(&cell(CELL_LINK, hz), own, ARRAY_LINK, FIVE), TEXT),
        ("asked", cell(CELL_LINK, "conversions_hz = 20.0\n"), ASKED),
        ("over TCP", cell("link = \"tcp://192.168.1.1:4000\"", hz), TEXT),
        (
            "monitor",
            exchanged(
                &esp301,
                "[limits]",
                "[[monitor]]\nname = \"supply_v\"\ndriver = { lines = \"mine.toml\" }\nlink = \"serial:///dev/ttyUSB5?baud=9600\"\n\
                 bounds = [11.9, 12.1]\n\n[limits]",
            ),
            MONITOR,
        ),
        (
            "map of an array",
            with_array(
                &esp301,
                map,
                "link = \"tcp://192.168.1.2:502\"",
                "grid = { rows = 3, columns = 3, pitch_mm = 4.5 }",
            ),
            ARRAY_MAP,
        ),
    ]
}

#[test]
fn a_run_with_a_profile_or_a_map_of_the_user_is_complete() {
    let rigs: Vec<_> = own_rigs().into_iter().take(campaign::size(3, usize::MAX)).collect();
    let ends = in_parallel(&rigs, |(name, rig, file)| {
        let run = run(&spec(rig, file));
        let outputs = run.ledger.contacts().flat_map(|contact| &contact.levels).flat_map(|press| &press.outputs);
        let moved = outputs.fold(0.0, |most: f64, output| most.max(output.abs()));
        let dead = (moved == 0.0).then(|| format!("{name}: the outputs don't move"));
        wrong(name, &run).into_iter().chain(dead).collect::<Vec<_>>()
    });
    must_be_none(&ends.concat());
}

/// Lines of load cells: profile, link and conversions per second.
const LINES: [(&str, &str, f64); 4] = [
    ("seneca-zsg", "2400", 10.0),
    ("generic-rs485", "9600", 50.0),
    ("generic-rs485", "19200&parity=even", 100.0),
    ("laumas-tlb", "9600&stop_bits=2", 30.0),
];

#[test]
fn a_run_on_a_slow_serial_line_is_complete_and_takes_the_time_of_its_bytes() {
    let lines = &LINES[..campaign::size(1, LINES.len())];
    let ends = in_parallel(lines, |(name, rate, hz)| {
        let rig = |rate: &str| {
            let link = format!("link = \"serial:///dev/ttyUSB1?baud={rate}\"");
            let mut spec =
                spec(&with_cell(&format!("{{ modbus = \"{name}\" }}"), &link, "conversions_hz = 100.0\n"), "");
            spec.load_cell.conversions_hz = *hz;
            spec
        };
        let (slow, quick) = (run(&rig(rate)), run(&rig("921600")));
        let is_longer = slow.virtual_s > quick.virtual_s;
        let times = format!("{name} at {rate}: {:.1} s, at 921600: {:.1} s", slow.virtual_s, quick.virtual_s);
        println!("{times}");
        wrong(&format!("{name} at {rate}"), &slow).into_iter().chain((!is_longer).then_some(times)).collect::<Vec<_>>()
    });
    must_be_none(&ends.concat());
}

#[test]
fn what_the_numbers_of_a_device_cannot_hold_is_named_by_its_key() {
    let own = "{ lines = \"mine.toml\" }";
    let map = "{ modbus = \"mine.toml\" }";
    let frame = FRAME.replace("\"i32\"", "\"i8\"");
    let registers = CELL_MAP.replace(
        "type = \"u32\"\nword_order = \"little\"\nnewton_per_unit = 2.0",
        "type = \"u16\"\nnewton_per_unit = 0.00001",
    );
    for (driver, file, expected) in [
        (
            own,
            frame.as_str(),
            "\"mine.toml\" can't be simulated: 2 N is the number 20000, but its numbers go from -128 to 127",
        ),
        (
            map,
            registers.as_str(),
            "can't be simulated: 2 N is the number 200012, but its numbers go from -65535 to 65535: correct `newton_per_unit` or `offset`",
        ),
    ] {
        let bench = TestFolder::with([
            ("rig.toml", &*with_cell(driver, CELL_LINK, "conversions_hz = 100.0\n")),
            ("mine.toml", file),
            ("recipe.toml", RECIPE),
        ]);
        let refused = bench.palpate_ends(2, "run recipe.toml --rig rig.toml --simulate").running();
        assert!(refused.contains(expected), "{refused}");
        let noted = bench.palpate_ends(0, "check recipe.toml --rig rig.toml").out;
        let noted = noted.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(noted.contains("not rehearsed, so no time is known: ") && noted.contains(expected), "{noted}");
    }
}
