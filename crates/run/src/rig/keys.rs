//! Keys of a rig, except those of its scene, table by table.

use super::axes::DEVICE_AXES;
use super::family::choices;
use super::scene_keys::{ROTATION, scene};
use super::spec::{Home, HomeSide};
use palpate_control::FIRST_APPROACH_MM_S;
use palpate_core::quantity::{COVERAGE, Down};
use palpate_document::layout::{CHANNELS_MAX, GRID};
use palpate_document::notify::NOTIFY;
use palpate_document::{Bounds, keys, words};

const COORDINATE: Bounds = Bounds::within(-10_000.0, 10_000.0, "mm");
const UNCERTAIN: Bounds = Bounds::above(0.0, 10.0, "mm");
/// Limits of one slope of the surface; the angle is checked separately.
const SLOPE: Bounds = Bounds::within(-1.0, 1.0, "mm/mm");
/// Limits of a step. A coarser one couldn't press by force.
const STEP: Bounds = Bounds::above(0.0, 0.05, "mm");
const SPEED: Bounds = Bounds::above(0.0, 1000.0, "mm/s");
const ACCELERATION: Bounds = Bounds::above(0.0, 100_000.0, "mm/s^2");
/// Limits of the conversion rate. A slower cell would count as stale between two of its readings.
const CONVERSIONS: Bounds = Bounds::within(5.0, 100_000.0, "Hz");
const LATER: Bounds = Bounds::within(0.0, 1000.0, "ms");
const NO_LOAD: Bounds = Bounds::within(-10_000.0, 10_000.0, "N");
/// Limits of forces in certificates and of weights.
const FORCE: Bounds = Bounds::above(0.0, 10_000.0, "N");
/// Limits of the entries of a calibration matrix.
const CROSSTALK: Bounds = Bounds::within(-1e6, 1e6, "");
const PERCENT: Bounds = Bounds::above(0.0, 100.0, "%");
/// Limits of a monitored value, its scale and its offset, which have any unit.
const VALUE: Bounds = Bounds::within(-1e12, 1e12, "");
const DATE: &str = "date, as year-month-day";
/// Limits of the largest output of an array.
const OUTPUT_RANGE: Bounds = Bounds::above(0.0, 1e6, "V");

/// Settling time of a stage with a small payload, ms: servo lag and half of its jerk time.
const SETTLE_MS: f64 = 10.0;

/// The word of a rig without a load cell.
pub(super) const NO_LOAD_CELL: [(&str, ()); 1] = [("none", ())];

pub(super) const HOMES: [(&str, Home); 2] = [("switches", Home::Switches), ("by hand", Home::ByHand)];
pub(super) const HOME_SIDES: [(&str, HomeSide); 2] = [("away", HomeSide::Away), ("toward", HomeSide::Toward)];
pub(super) const DOWN: [(&str, Down); 2] = [("-z", Down::Minus), ("+z", Down::Plus)];

keys! {
    /// The complete rig.
    root {
        stage: Table(&stage::KEYS), Refused, "the three-axis stage";
        load_cell: Either(&[Table(&load_cell::KEYS), Word(&words(&NO_LOAD_CELL))]), Refused,
            "the load cell under the specimen or over the indenter; `\"none\"`: there is none, and presses are by depth", "\"none\"";
        array: Table(&array::KEYS), Refused, "the sensor array that is calibrated";
        monitor: Tables(&monitor::KEYS), Allowed,
            "slow devices, such as a thermometer, that are read between presses; their values are recorded with each press";
        limits: Table(&limits::KEYS), Refused, "limits of the specimen, for the plan and every move";
        frame: Table(&frame::KEYS), Refused, "where the specimen is, in the stage's coordinates";
        scene: Table(&scene::KEYS), Allowed,
            "the simulated scene; what isn't given isn't modelled; without this table, the paper's scene";
        notify: Table(&NOTIFY), Allowed, "a program that gets each verdict, trip, pause and end as a JSON line";
    }
}

keys! {
    /// `[stage]`
    stage {
        driver: choices::stage::KIND, Refused, "device family of the controller, and the keys of its driver", "\"esp301\"";
        link: Text, Allowed, LINK, "\"serial:///dev/ttyUSB0?baud=921600\"";
        travel_mm: Table(&travel_mm::KEYS), Refused, "travel of the axes";
        speed_mm_s: Number(SPEED), or(10.0), "largest speed; the approach is slower", "10.0";
        acceleration_mm_s2: Number(ACCELERATION), or(100.0), "acceleration of the axes", "100.0";
        approach_mm_s: Number(SPEED), or(FIRST_APPROACH_MM_S),
            "largest approach speed before the first touch of the specimen", "0.5";
        settle_ms: Number(LATER), or(SETTLE_MS), "how long it still moves after its controller reports the end of a motion", "10.0";
        step_mm: Table(&step_mm::KEYS), Allowed,
            "smallest steps of a coarse stage, such as a printer; without it, they are too fine to matter (under 3 um)";
        home: Word(&words(&HOMES)), or_word("switches"),
            "how its position becomes known at each start: by its own switches, or by a person who brings it to the zero of `travel_mm` \
             (GRBL without switches, Marlin, Klipper)", "\"by hand\"";
        home_side: Word(&words(&HOME_SIDES)), or_word("away"),
            "end of z at which it homes; `toward` (a program only) is on the specimen's side, as on most printers: a person confirms \
             before each search that nothing is in the way", "\"toward\"";
        home_z_mm: Number(COORDINATE), Allowed,
            "ESP301: position of z at the limit where it homes; without it, the end of `travel_mm.z` away from the specimen", "12.5";
        homed: Flag, or_flag(false),
            "ESP301: whether axes whose motors are on are homed; without it, z homes away from the specimen at each start", "true";
        z_holds_unpowered: Flag, or_flag(false),
            "ESP301, XPS, Klipper: whether z stays where it is without power; then the last resort against a force that no stop ends cuts it",
            "true";
        stiffness_n_mm: Number(above(0.0, 1e6, "N/mm")), Allowed,
            "stiffness of the stage itself, such as an arm: its deflection is a part of `u_depth_mm`", "50.0";
        certificate: Table(&stage_certificate::KEYS), Allowed, "its calibration certificate";
    }
}

keys! {
    /// `step_mm` of `[stage]`.
    step_mm {
        x: Number(STEP), Refused, "smallest step of x", "0.0125";
        y: Number(STEP), Refused, "smallest step of y", "0.0125";
        z: Number(STEP), Refused, "smallest step of z; half of it limits the force that can be reached", "0.0025";
    }
}

keys! {
    /// `certificate` of `[stage]`.
    stage_certificate {
        number: Text, Refused, "certificate number, 1 to 64 characters", "\"S-2026-0042\"";
        date: Text, Refused, DATE, "\"2026-05-04\"";
        u_mm: Number(UNCERTAIN), Refused, "expanded uncertainty of a position along one axis", "0.005";
        k: Number(within(1.0, 5.0, "")), or(COVERAGE), "coverage factor of the expanded uncertainty", "2.0";
    }
}

/// Description of `link`. Each driver states which kinds of links it accepts.
const LINK: &str = "address of the device, or \"sim\"; omit it if the driver is a program";

keys! {
    /// `[load_cell]`
    load_cell {
        driver: choices::load_cell::KIND, Refused, "device family of the transmitter, and the keys of its driver",
            "{ modbus = \"generic-rs485\" }";
        link: Text, Allowed, LINK, "\"serial:///dev/ttyUSB1?baud=115200\"";
        conversions_hz: Number(CONVERSIONS), Refused, "rate of new readings", "200.0";
        lag_ms: Number(LATER), or(0.0), "delay of a reading by its filter and its transport", "2.0";
        air_n: Range(NO_LOAD), Allowed,
            "allowed range of its reading without load, tool included; without it, plus or minus `limits.force_n`",
            "[-0.1, 0.4]";
        stiffness_n_mm: Number(above(0.0, 1e6, "N/mm")), Allowed,
            "stiffness of the cell itself, from its datasheet: its deflection is a part of `u_depth_mm`", "400.0";
        axes: Table(&axes::KEYS), Allowed, "how a cell with three axes is mounted; required for such a cell";
        certificate: Table(&certificate::KEYS), Allowed, "its calibration certificate";
        check: Table(&check::KEYS), Allowed, "its gain as measured by `palpate doctor --check-weight-n`";
        axes_check: Table(&axes_check::KEYS), Allowed, "gains and crosstalk of three axes, as measured by `palpate doctor --three-axes`";
    }
}

keys! {
    /// `axes` of `[load_cell]`.
    axes {
        x: Word(&words(&DEVICE_AXES)), Refused, "axis of the cell whose reading grows with a force of the tip along x of the specimen", "\"x\"";
        y: Word(&words(&DEVICE_AXES)), Refused, "axis of the cell whose reading grows with a force of the tip along y of the specimen", "\"-y\"";
        press: Word(&words(&DEVICE_AXES)), Refused, "axis of the cell whose reading grows with a press", "\"-z\"";
        matrix: Matrix(CROSSTALK), Allowed,
            "matrix from its calibration, by which its forces along its x, y and z are multiplied first; requires `serial`",
            "[[1.0, 0.01, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]";
        tip_mm: Number(above(0.0, 1000.0, "mm")), Allowed, "distance from the cell's origin to the tip; requires `torque_n_mm`", "30.0";
        torque_n_mm: Number(above(0.0, 1e6, "N mm")), Allowed,
            "largest torque that the cell can take about any of its axes; requires `tip_mm`", "120.0";
        serial: Text, Allowed, "serial number of the cell that `matrix` belongs to, 1 to 64 characters", "\"FT12345\"";
    }
}

keys! {
    /// `certificate` of `[load_cell]`.
    certificate {
        number: Text, Refused, "certificate number, 1 to 64 characters", "\"K-2026-0815\"";
        date: Text, Refused, DATE, "\"2026-05-04\"";
        k: Number(within(1.0, 5.0, "")), or(COVERAGE), "coverage factor of the expanded uncertainty", "2.0";
        full_scale_n: Number(FORCE), Allowed, "full scale that `class_percent` refers to", "5.0";
        temperature_percent_per_c: Number(within(0.0, 10.0, "%/degree Celsius")), Allowed,
            "largest change of its sensitivity, + and -, in % of the reading per degree Celsius; it widens `u_force_n` if a monitor is \
             named `temperature_c`; requires `calibrated_at_c`", "0.02";
        calibrated_at_c: Number(within(-50.0, 150.0, "degrees Celsius")), Allowed,
            "its temperature during the calibration; requires `temperature_percent_per_c`", "21.0";
    }
    one of {
        u_n: Number(FORCE), Allowed, "expanded uncertainty of a reading", "0.002";
        u_percent: Number(PERCENT), Allowed, "expanded uncertainty of a reading, in % of the force", "0.2";
        class_percent: Number(PERCENT), Allowed, "limit of error, + and -, in % of `full_scale_n`", "0.1";
    }
}

keys! {
    /// `check` of `[load_cell]`.
    check {
        weight_n: Number(FORCE), Refused, "force of the known weight", "0.5";
        weight_u_n: Number(FORCE), Refused, "its expanded uncertainty, k = 2", "0.0005";
        pull: Flag, or_flag(false), "whether the weight hung from the tip", "true";
        gain: Number(within(-1e6, 1e6, "")), Refused, "reading of the cell divided by the weight's force", "1.0101";
        gain_sd: Number(within(0.0, 1e6, "")), Refused, "standard deviation of the gain between repeats", "0.0002";
        times: Whole(1, 1000), Refused, "number of repeats", "3";
        date: Text, Refused, DATE, "\"2026-05-04\"";
        adjusted: Flag, or_flag(false), "whether readings are divided by the gain", "true";
    }
}

keys! {
    /// `axes_check` of `[load_cell]`.
    axes_check {
        along: Matrix(CROSSTALK), Refused,
            "readings per newton: a row for a force along x, y and the press each, with the readings of x, y and the press",
            "[[1.0, 0.01, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]";
        u: Number(within(0.0, 1.0, "")), Refused, "standard uncertainty of each of these numbers", "0.0005";
        date: Text, Refused, DATE, "\"2026-05-04\"";
    }
}

keys! {
    /// `[array]`
    array {
        driver: choices::array::KIND, Refused, "device family of the converter, and the keys of its driver",
            "{ modbus = \"labjack-t7\" }";
        link: Text, Allowed, LINK, "\"tcp://192.168.1.10:502\"";
        unit: Text, or_word("V"), "unit of its outputs in tables and figures, 1 to 16 characters", "\"counts\"";
        channels_per_unit: Whole(1, CHANNELS_MAX), or_whole(1),
            "number of successive outputs of each unit: 3 for chips with three axes", "3";
        range_v: Number(OUTPUT_RANGE), Allowed,
            "largest possible output, + and -; without it, the range of NI inputs, or not known", "10.0";
    }
    one of {
        grid: Table(&GRID), Allowed, "its units are in rows and columns, centred on the specimen's origin";
        places_mm: Places(COORDINATE), Allowed, "positions of its units, in the order of its outputs", "[[0.0, 0.0]]";
    }
}

keys! {
    /// `[[monitor]]`
    monitor {
        name: Text, Refused, "name of the value: lower-case letters, digits and underscores; it ends in the unit", "\"temperature_c\"";
        scale: Number(VALUE), or(1.0), "factor of the reading: the value is scale * reading + offset", "100.0";
        offset: Number(VALUE), or(0.0), "value at a reading of 0", "-50.0";
        every_s: Number(within(0.1, 86_400.0, "s")), or(10.0), "least time from one reading to the next", "10.0";
        bounds: Range(VALUE), Allowed, "range of the value; outside, the next press waits", "[18.0, 28.0]";
        wait_s: Number(within(0.0, 86_400.0, "s")), or(600.0),
            "longest wait for a value within `bounds`; then the run stops, and `resume` continues it", "600.0";
    }
    as array { driver, link }
}

keys! {
    /// `travel_mm` of `[stage]`.
    travel_mm {
        x: Range(COORDINATE), Refused, "smallest and largest x", "[-12.5, 12.5]";
        y: Range(COORDINATE), Refused, "smallest and largest y", "[-12.5, 12.5]";
        z: Range(COORDINATE), Refused, "smallest and largest z", "[-12.5, 12.5]";
    }
}

keys! {
    /// `[limits]`
    limits {
        force_n: Number(above(0.0, 100.0, "N")), Refused, "largest force allowed on the specimen", "2.0";
        depth_mm: Number(above(0.0, 100.0, "mm")), Refused,
            "largest depth of a press, from the surface touched there", "1.6";
        stiffness_n_mm: Number(above(0.0, 100_000.0, "N/mm")), Refused,
            "largest stiffness of the specimen, relaxation included", "2.0";
        stiffness_least_n_mm: Number(above(0.0, 100_000.0, "N/mm")), Allowed,
            "smallest stiffness at the first press; it detects a load cell that reads too little", "0.8";
        drag: Table(&drag::KEYS), Allowed,
            "what a drag in contact may do; without it, x and y never move in contact";
    }
}

keys! {
    /// `drag` of `[limits]`.
    drag {
        shear_n: Number(above(0.0, 100.0, "N")), Refused, "largest force sideways allowed on the specimen", "0.8";
        slide_mm: Number(above(0.0, 100.0, "mm")), Refused, "longest way in contact", "1.0";
        stiffness_n_mm: Number(above(0.0, 100_000.0, "N/mm")), Refused, "largest stiffness of the specimen sideways", "1.5";
        friction: Number(above(0.0, 100.0, "")), Refused, "largest force sideways per pressing force", "1.2";
    }
}

keys! {
    /// `[frame]`
    frame {
        surface_mm: Table(&surface_mm::KEYS), Refused, "position of the specimen's surface";
        origin_mm: Table(&origin_mm::KEYS), Allowed, "position of the middle of the specimen; without it (0, 0)";
        rotation_deg: Number(ROTATION), or(0.0), "rotation of the specimen, from x towards y", "0.0";
        tilt_mm_per_mm: Table(&tilt_mm_per_mm::KEYS), Allowed,
            "tilt of the surface, at most 5 degrees, measured by `palpate align`; depth and force are corrected by its cosine; without it, level";
        u_origin_mm: Number(UNCERTAIN), Allowed,
            "standard uncertainty of each coordinate of the origin, measured by `palpate align`", "0.02";
        down: Word(&words(&DOWN)), Refused, "direction of z that leads into the specimen: -z if a smaller z is deeper", "\"-z\"";
    }
}

keys! {
    /// `surface_mm` of `[frame]`.
    surface_mm {
        z: Number(COORDINATE), Refused, "z at the surface", "0.0";
        uncertainty: Number(within(0.01, 10.0, "mm")), Refused, "largest error of `z`, + and -", "0.3";
    }
}

keys! {
    /// `origin_mm` of `[frame]`.
    origin_mm {
        x: Number(COORDINATE), Refused, "x of the middle", "0.0";
        y: Number(COORDINATE), Refused, "y of the middle", "0.0";
    }
}

keys! {
    /// `tilt_mm_per_mm` of `[frame]`, and of the surface of the scene.
    tilt_mm_per_mm {
        x: Number(SLOPE), or(0.0), "depth that the surface gains per mm along x of the specimen", "0.01";
        y: Number(SLOPE), or(0.0), "depth that the surface gains per mm along y of the specimen", "-0.004";
    }
}

#[cfg(test)]
mod tests {
    use crate::rig::{KEYS, parse};
    use palpate_document::sample::assert_read_is_listed;

    #[test]
    fn rig_reader_reads_exactly_the_listed_keys() {
        let beside = |_: &str| Err(std::io::ErrorKind::NotFound.into());
        assert_read_is_listed(&KEYS, |text| drop(parse("rig.toml", text, &beside)));
    }
}
