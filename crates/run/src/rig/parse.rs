//! Reads a rig's text into a [`RigSpec`].

use super::axes::{Lever, check_axes, read_axes};
use super::certificate::{read_axes_check, read_certificate, read_check, read_stage_certificate};
use super::driver::{read_array_driver, read_load_cell_driver, read_stage_driver};
use super::family::{Beside, with_help};
use super::keys::{
    self, array, drag, frame, limits, load_cell, origin_mm, root, stage, step_mm, surface_mm, tilt_mm_per_mm, travel_mm,
};
use super::monitor::{check_monitors, read_monitors};
use super::scene::{paper_scene, read_scene};
use super::simulated::TOO_MANY_CHANNELS;
use super::spec::{Driver, Home, HomeSide, LastResort};
use super::{ArraySpec, LoadCellSpec, RigSpec, StageSpec};
use palpate_control::{DragLimits, SEARCH_ROOM_MM};
use palpate_core::quantity::{
    Axis, FINEST_STEP_MM, Frame, Limits, Place, Range, Steps, TILT_MOST_DEG, Tilt, Travel, round,
};
use palpate_document::layout::{LayoutKeys, read_unit};
use palpate_document::notify::read_command;
use palpate_document::{self as document, Key, Problem, Problems, Table};
use palpate_link::wire::Link;
use palpate_sim::scene::SKIN_CHANNELS_MAX;

/// Reads a rig's text. `file` is its name in messages. `beside` gives the text of a file in the same folder, for the user's own
/// register maps.
///
/// # Errors
/// Every problem of the text, each with its line.
pub fn parse(file: &str, text: &str, beside: Beside) -> Result<RigSpec, Problems> {
    if document::has_key(text, "step") && !document::has_key(text, root::stage.name) {
        let problem = Problem::new(0..0, "this is a recipe, not a rig");
        let problem =
            problem.help("give a rig file: `palpate init` writes one, and `palpate list` names the shipped ones");
        return Err(Problems::new(file, text, vec![problem]));
    }
    if let Some((table, place)) = document::text_in_table(text, root::load_cell.name) {
        let words = format!("`{}` is in the table [{table}], so the rig doesn't have it", root::load_cell.name);
        let problem = Problem::new(place, words).help("move it above the first table");
        return Err(Problems::new(file, text, vec![problem]));
    }
    document::read(file, text, &root::KEYS, |table| {
        let stage = table.table(&root::stage).and_then(|table| read_stage(&table, beside));
        let load_cell = match table.is_text(&root::load_cell) {
            true => table.word(&root::load_cell, &keys::NO_LOAD_CELL).map(|()| LoadCellSpec::none()),
            false if table.has(&root::load_cell) && !table.is_table(&root::load_cell) => {
                let text = "`load_cell` is neither a table nor \"none\"";
                let help = "a rig without a load cell has load_cell = \"none\" above its first table";
                table.complain(Problem::new(table.span_of(&root::load_cell), text).help(help));
                None
            }
            false => table.table(&root::load_cell).and_then(|table| read_load_cell(&table, beside)),
        };
        let array = table.table(&root::array).and_then(|table| read_array(&table, beside));
        let monitors = read_monitors(table, beside);
        let limits = table.table(&root::limits);
        let (limits, stiffness_least_n_mm, drag) = match limits.as_ref() {
            Some(table) => {
                let least = read_least(table);
                (read_limits(table), least, read_drag(table, least.flatten()))
            }
            None => (None, None, None),
        };
        let frame = table.table(&root::frame);
        let u_origin_mm = frame.as_ref().and_then(|table| table.number(&frame::u_origin_mm));
        let frame = frame.and_then(|table| read_frame(&table));
        let units = array.as_ref().map(|array| array.layout.units().len());
        let scene = match table.table(&root::scene) {
            Some(table) => read_scene(&table, units),
            // a test shows that the shipped text is sound
            None => paper_scene(units.unwrap_or_default(), limits.as_ref(), stiffness_least_n_mm.flatten()).ok(),
        };
        let notify = document::optional(table.table(&root::notify), read_command);
        let spec = RigSpec {
            stage: stage?,
            load_cell: load_cell?,
            array: array?,
            monitors: monitors?,
            limits: limits?,
            stiffness_least_n_mm: stiffness_least_n_mm?,
            drag: drag?,
            frame: frame?,
            u_origin_mm,
            scene: scene?,
            full_scale_n: None,
            notify: notify?.unwrap_or_default(),
            which_way: None,
            is_touched: false,
        };
        check_links(&spec, table);
        check_ports(&spec, table);
        check_zero(&spec, table);
        check_without_load_cell(&spec, table);
        check_steps(&spec, table);
        check_drivers(&spec, table);
        check_monitors(&spec, table);
        check_room(&spec, table);
        check_torque(&spec, table);
        Some(spec)
    })
}

/// Checks that the largest force at the tip, in any direction, doesn't exceed the cell's largest torque.
fn check_torque(spec: &RigSpec, table: &Table) {
    let Some(Lever { mm, torque_n_mm }) = spec.load_cell.axes.as_ref().and_then(|axes| axes.lever) else { return };
    let most_n_mm = mm * spec.limits.force_n;
    if most_n_mm > torque_n_mm {
        let text = format!(
            "`force_n` is {} N at a tip {mm} mm from the cell's origin: up to {most_n_mm} N mm, but the cell allows {torque_n_mm} N mm",
            spec.limits.force_n
        );
        table.complain(
            Problem::new(table.span_of(&root::limits), text).help("lower `force_n`, or shorten the indenter"),
        );
    }
}

fn read_stage(table: &Table, beside: Beside) -> Option<StageSpec> {
    let driver = read_stage_driver(table, beside);
    let travel = table.table(&stage::travel_mm).and_then(|table| {
        let axes = [travel_mm::x, travel_mm::y, travel_mm::z].map(|axis| table.range(&axis));
        let [Some(x), Some(y), Some(z)] = axes else { return None };
        Some(Travel { axes: [x, y, z] })
    });
    let numbers = table.numbers([stage::speed_mm_s, stage::acceleration_mm_s2, stage::approach_mm_s, stage::settle_ms]);
    let steps = document::optional(table.table(&stage::step_mm), read_steps);
    let certificate = document::optional(table.table(&stage::certificate), read_stage_certificate);
    let homed = table.flag(&stage::homed);
    let z_holds_unpowered = table.flag(&stage::z_holds_unpowered);
    let home = table.word(&stage::home, &keys::HOMES);
    let home_side = table.word(&stage::home_side, &keys::HOME_SIDES);
    let (driver, link) = driver?;
    if home_side == Some(HomeSide::Toward) && !driver.homes_toward() {
        let text = "this stage homes away from the specimen: `home_side = \"toward\"` is for a program of your own";
        table.complain(Problem::new(table.span_of(&stage::home_side), text).help("remove `home_side`"));
    }
    if home == Some(Home::ByHand) && !driver.homes_by_hand() {
        let text = "this stage finds its position itself: `home = \"by hand\"` is for GRBL without switches, Marlin and Klipper";
        table.complain(Problem::new(table.span_of(&stage::home), text).help("remove `home`"));
    }
    if z_holds_unpowered == Some(true) && matches!(driver.last_resort(), LastResort::KeepsPower(_)) {
        let text =
            "nothing that is sent to this stage cuts its power: `z_holds_unpowered` is for ESP301, XPS and Klipper";
        table.complain(Problem::new(table.span_of(&stage::z_holds_unpowered), text).help("remove `z_holds_unpowered`"));
    }
    let [speed_mm_s, acceleration_mm_s2, approach_mm_s, settle_ms] = numbers?;
    Some(StageSpec {
        driver,
        link,
        travel: travel?,
        speed_mm_s,
        acceleration_mm_s2,
        approach_mm_s,
        settle_s: settle_ms / 1000.0,
        steps: steps?.unwrap_or(Steps::FINE),
        certificate: certificate?,
        stiffness_n_mm: table.number(&stage::stiffness_n_mm),
        home_z_mm: table.number(&stage::home_z_mm),
        homed: homed?,
        z_holds_unpowered: z_holds_unpowered?,
        home: home?,
        home_side: home_side?,
    })
}

fn read_steps(table: &Table) -> Option<Steps> {
    Some(Steps { mm: table.numbers([step_mm::x, step_mm::y, step_mm::z])?, ..Steps::FINE })
}

fn read_load_cell(table: &Table, beside: Beside) -> Option<LoadCellSpec> {
    let driver = read_load_cell_driver(table, beside);
    let numbers = table.numbers([load_cell::conversions_hz, load_cell::lag_ms]);
    let certificate = document::optional(table.table(&load_cell::certificate), read_certificate);
    let check = document::optional(table.table(&load_cell::check), read_check);
    let axes = document::optional(table.table(&load_cell::axes), read_axes);
    let axes_check = document::optional(table.table(&load_cell::axes_check), read_axes_check);
    let (driver, link) = driver?;
    let axes = axes?;
    let span = table.span_of(if axes.is_some() { &load_cell::axes } else { &load_cell::driver });
    check_axes(&*driver, axes.as_ref(), table, span);
    if axes.is_none() && table.has(&load_cell::axes_check) {
        table.complain(Problem::new(table.span_of(&load_cell::axes_check), "`axes_check` requires `axes`"));
    }
    let (certificate, check, axes_check) = (certificate?, check?, axes_check?);
    let air_n = table.range(&load_cell::air_n);
    let [conversions_hz, lag_ms] = numbers?;
    let stiffness_n_mm = table.number(&load_cell::stiffness_n_mm);
    let lag_s = lag_ms / 1000.0;
    Some(LoadCellSpec {
        driver,
        link,
        conversions_hz,
        lag_s,
        air_n,
        stiffness_n_mm,
        axes,
        certificate,
        check,
        axes_check,
    })
}

fn read_array(table: &Table, beside: Beside) -> Option<ArraySpec> {
    let driver = read_array_driver(table, beside);
    let layout = LAYOUT.read(table);
    let unit = read_unit(table, &array::unit);
    let misfit = driver.as_ref().zip(layout.as_ref()).and_then(|((driver, _), layout)| driver.misfit(layout));
    if let Some((text, help)) = misfit {
        table.complain(with_help(table.span_of(LAYOUT.place(table)), text, help));
    }
    let range_v = table.number(&array::range_v);
    let (driver, link) = driver?;
    let range_v = range_v.or(driver.range_v());
    let layout = layout?;
    let many = layout.units().any(|unit| unit.len() > SKIN_CHANNELS_MAX);
    if link == Link::Sim && many {
        table.complain(Problem::new(table.span_of(&array::channels_per_unit), TOO_MANY_CHANNELS));
    }
    Some(ArraySpec { driver, link, layout, range_v, unit: unit?.to_owned() })
}

/// Keys of `[array]` that state the origin of its outputs.
const LAYOUT: LayoutKeys =
    LayoutKeys { grid: array::grid, places_mm: array::places_mm, channels_per_unit: array::channels_per_unit };

/// Where the stiffness of a specimen is found.
const STIFFNESS: &str = "a number in N/mm, the largest that the specimen can have, from its datasheet or from a kitchen scale: \
                         push the indenter 0.5 mm into the specimen on it; 100 g more are 1.96 N/mm";

fn read_limits(table: &Table) -> Option<Limits> {
    if !table.require_as(&limits::stiffness_n_mm, STIFFNESS) {
        table.numbers([limits::force_n, limits::depth_mm]); // their problems are reported too
        return None;
    }
    let [force_n, depth_mm, stiffness_n_mm] =
        table.numbers([limits::force_n, limits::depth_mm, limits::stiffness_n_mm])?;
    Some(Limits { force_n, depth_mm, stiffness_n_mm })
}

/// Reads what a drag may do; the inner value is `None` if the rig allows no drag.
fn read_drag(table: &Table, softest_n_mm: Option<f64>) -> Option<Option<DragLimits>> {
    document::optional(table.table(&limits::drag), |table| {
        let numbers = [drag::shear_n, drag::slide_mm, drag::stiffness_n_mm, drag::friction];
        let [shear_n, slide_mm, stiffness_n_mm, friction] = table.numbers(numbers)?;
        Some(DragLimits { shear_n, slide_mm, stiffness_n_mm, friction, softest_n_mm })
    })
}

/// Reads the least stiffness if it is declared. The outer value is `None` if it is invalid.
fn read_least(table: &Table) -> Option<Option<f64>> {
    if !table.has(&limits::stiffness_least_n_mm) {
        return Some(None);
    }
    let least_n_mm = table.number(&limits::stiffness_least_n_mm)?;
    let most_n_mm = table.number(&limits::stiffness_n_mm)?;
    if least_n_mm > most_n_mm {
        let text = format!("`stiffness_least_n_mm` is {least_n_mm}, over `stiffness_n_mm` of {most_n_mm} N/mm");
        table.complain(Problem::new(table.span_of(&limits::stiffness_least_n_mm), text));
        return None;
    }
    Some(Some(least_n_mm))
}

fn read_frame(table: &Table) -> Option<Frame> {
    let surface = table.table(&frame::surface_mm);
    let surface = surface.and_then(|table| table.numbers([surface_mm::z, surface_mm::uncertainty]));
    let down = table.word(&frame::down, &keys::DOWN);
    let origin = match table.table(&frame::origin_mm) {
        None => Some(Place::default()),
        Some(table) => table.numbers([origin_mm::x, origin_mm::y]).map(|[x, y]| Place::new(x, y)),
    };
    let rotation_deg = table.number(&frame::rotation_deg);
    let tilt = read_tilt(table, &frame::tilt_mm_per_mm);
    if let Some(tilt) = tilt.filter(|tilt| !tilt.is_allowed()) {
        let text = format!("the surface is tilted by {:.2} degrees, over {TILT_MOST_DEG}", tilt.degrees());
        let help = "shim the specimen until it is level, and run `palpate align` again; with an arm, teach its frame on the surface";
        table.complain(Problem::new(table.span_of(&frame::tilt_mm_per_mm), text).help(help));
        return None;
    }
    let [surface_z_mm, uncertainty_mm] = surface?;
    Some(Frame { origin: origin?, rotation_deg: rotation_deg?, surface_z_mm, uncertainty_mm, down: down?, tilt: tilt? })
}

/// Reads a tilt that may be missing; then the surface is level.
pub(super) fn read_tilt(table: &Table, key: &Key) -> Option<Tilt> {
    let tilt = document::optional(table.table(key), |table| {
        let [per_x, per_y] = table.numbers([tilt_mm_per_mm::x, tilt_mm_per_mm::y])?;
        Some(Tilt { per_x, per_y })
    });
    tilt.map(|tilt| tilt.unwrap_or(Tilt::LEVEL))
}

fn check_links(spec: &RigSpec, table: &Table) {
    let cell = spec.has_load_cell().then_some(&spec.load_cell.link);
    let monitors = spec.monitors.iter().map(|monitor| &monitor.array.link);
    let mut links = [&spec.stage.link, &spec.array.link].into_iter().chain(cell).chain(monitors);
    if links.clone().any(|link| *link == Link::Sim) && !links.all(|link| *link == Link::Sim) {
        let text = "some links are simulated and others are real: they can't use the same clock";
        let help = "set all links to \"sim\", or none; `--simulate` simulates the whole rig";
        table.complain(Problem::new(table.span_of(&root::stage), text).help(help));
    }
}

/// Checks that a serial port belongs to one device. Only devices that send lines for load cell and array share one.
fn check_ports(spec: &RigSpec, table: &Table) {
    let cell_and_array = [&*spec.load_cell.driver as &dyn Driver, &*spec.array.driver];
    let is_shared = spec.load_cell.link == spec.array.link && cell_and_array.iter().all(|driver| driver.shares_port());
    let roles =
        [(&spec.stage.link, root::stage), (&spec.load_cell.link, root::load_cell), (&spec.array.link, root::array)];
    for (i, (link, key)) in roles.iter().enumerate() {
        let Link::Serial { port, .. } = link else { continue };
        let is_same = |other: &&(&Link, Key)| matches!(other.0, Link::Serial { port: other, .. } if other == port);
        let Some((_, first)) = roles[..i].iter().find(is_same).filter(|(_, first)| *first == root::stage || !is_shared)
        else {
            continue;
        };
        let text = format!("[{}] and [{}] have the same serial port {port}", first.name, key.name);
        let help = "each device has a port of its own: `palpate ports` lists them. Only a load cell and an array that are one \
                    device with one line profile have the same `link`";
        table.complain(Problem::new(table.span_of(key), text).help(help));
    }
}

/// Checks that a stage that is brought to its zero may stand there.
fn check_zero(spec: &RigSpec, table: &Table) {
    let outside = Axis::ALL.into_iter().find(|axis| !spec.stage.travel.along(*axis).contains(0.0));
    if let (Home::ByHand, Some(axis)) = (spec.stage.home, outside) {
        let text = format!("`home = \"by hand\"` begins at 0, which `travel_mm.{}` doesn't contain", axis.name());
        let help = "state the travel from the place to which a person brings the stage";
        table.complain(Problem::new(table.span_of(&root::stage), text).help(help));
    }
}

/// Checks that a rig without a load cell homes z away from the specimen: no force would show a search that presses on it.
fn check_without_load_cell(spec: &RigSpec, table: &Table) {
    if !spec.has_load_cell() && spec.stage.home_side == HomeSide::Toward {
        let text = "a rig without a load cell can't home z toward the specimen: no force would stop the search";
        let help = "home z at the end away from the specimen, or add a load cell";
        table.complain(Problem::new(table.span_of(&root::stage), text).help(help));
    }
}

/// Largest part of the force limit that one step of z may add. With more, hardly a motion would be permitted.
const STEP_SHARE: f64 = 0.05;

/// Checks that the steps of z are fine enough for the limits.
fn check_steps(spec: &RigSpec, table: &Table) {
    let limits = &spec.limits;
    let (step_mm, most_n) = (spec.stage.steps.least_z_mm(), STEP_SHARE * limits.force_n);
    let step_n = limits.stiffness_n_mm * step_mm;
    if step_n > most_n {
        let text = format!(
            "a step of z of {step_mm} mm changes the force by up to {} N at `stiffness_n_mm` = {}, over {} N, which is {} % of \
             `force_n`: it is too coarse to press by force",
            round(step_n, 4),
            limits.stiffness_n_mm,
            round(most_n, 4),
            100.0 * STEP_SHARE,
        );
        let help = format!(
            "with this step, `stiffness_n_mm` may be {} at most: put a softer layer or a spring under the specimen, or use finer steps of z \
             (more microsteps, a finer screw), of {} mm at most; none is finer than {FINEST_STEP_MM} mm",
            round(most_n / step_mm, 1),
            round(most_n / limits.stiffness_n_mm, 6),
        );
        table.complain(Problem::new(table.span_of(&root::stage), text).help(help));
    }
}

/// Checks that the drivers can work together.
fn check_drivers(spec: &RigSpec, table: &Table) {
    let drivers: [&dyn Driver; 3] = [&*spec.stage.driver, &*spec.load_cell.driver, &*spec.array.driver];
    for misfit in drivers.into_iter().flat_map(|driver| driver.misfits(spec)) {
        let role = [root::stage, root::load_cell, root::array][misfit.role as usize];
        table.complain(with_help(table.span_of(&role), misfit.text, misfit.help));
    }
}

/// Checks that z can move from clearance height to the deepest press.
fn check_room(spec: &RigSpec, table: &Table) {
    let frame = &spec.frame;
    let travel = spec.stage.travel.along(Axis::Z);
    let clear = frame.to_stage(Place::default(), spec.clear_mm()).z_mm;
    let deepest = frame.to_stage(Place::default(), frame.uncertainty_mm + spec.limits.depth_mm).z_mm;
    let least_mm = 2.0 * frame.uncertainty_mm + SEARCH_ROOM_MM;
    if spec.limits.depth_mm < least_mm {
        let text = format!(
            "with `depth_mm` = {} the search ends above the deepest possible surface, {} mm + and -",
            spec.limits.depth_mm, frame.uncertainty_mm
        );
        let help = format!("use at least {least_mm:.2} mm, or a smaller `surface_mm.uncertainty`");
        table.complain(Problem::new(table.span_of(&root::limits), text).help(help));
    }
    if !travel.contains(clear) || !travel.contains(deepest) {
        let Range { min, max } = travel;
        let (clear, deepest) = (round(clear, 4), round(deepest, 4));
        let text =
            format!("pressing takes z from {clear} to {deepest} mm, but the stage's z goes from {min} to {max} mm");
        let help = "check `surface_mm`, `down`, `limits.depth_mm` and `stage.travel_mm.z` against each other";
        table.complain(Problem::new(table.span_of(&root::frame), text).help(help));
    }
}

#[cfg(test)]
mod tests {
    use super::super::SIM_RIG;
    use super::*;
    use palpate_core::quantity::ArrayLayout;

    fn problems(from: &str, to: &str) -> Vec<String> {
        assert!(SIM_RIG.contains(from), "{from}");
        let none = |_: &str| Err(std::io::Error::from(std::io::ErrorKind::NotFound));
        match parse("rig.toml", &SIM_RIG.replacen(from, to, 1), &none) {
            Ok(_) => Vec::new(),
            Err(problems) => problems.lines().iter().map(|line| line.split_once(": ").unwrap().1.to_owned()).collect(),
        }
    }

    #[test]
    fn two_devices_on_one_serial_port_are_refused() {
        let text = include_str!("../../../../rigs/esp301.toml");
        let none = |_: &str| Err(std::io::Error::from(std::io::ErrorKind::NotFound));
        assert!(parse("rig.toml", text, &none).is_ok());
        let words = parse("rig.toml", &text.replace("ttyUSB1", "ttyUSB0"), &none).unwrap_err().lines();
        assert_eq!(words.len(), 1, "{words:?}");
        assert!(words[0].contains("[stage] and [load_cell] have the same serial port /dev/ttyUSB0"), "{words:?}");
    }

    #[test]
    fn a_load_cell_in_a_wrong_place_or_of_a_wrong_kind_is_one_problem() {
        let (before, cell) = SIM_RIG.split_once("[load_cell]").unwrap();
        let after = &cell[cell.find("\n[").unwrap()..];
        let none = |_: &str| Err(std::io::Error::from(std::io::ErrorKind::NotFound));
        let problems = |text: &str| {
            let problems = parse("rig.toml", text, &none).unwrap_err();
            problems.text().map(|(line, help)| (line, help.unwrap_or_default().to_owned())).collect::<Vec<_>>()
        };
        let line = "load_cell = \"none\"\n";
        // the shipped scene has a table of this name
        let scene: String = after.split_inclusive('\n').filter(|line| !line.starts_with("load_cell")).collect();
        let last = problems(&format!("{before}{scene}{line}"));
        assert_eq!(last.len(), 1, "{last:?}");
        assert!(last[0].0.contains("`load_cell` is in the table [scene], so the rig doesn't have it"), "{last:?}");
        assert_eq!(last[0].1, "move it above the first table");
        let first = problems(&format!("{before}{after}").replacen("[stage]\n", &format!("[stage]\n{line}"), 1));
        assert!(first.len() == 1 && first[0].0.contains("in the table [stage]"), "{first:?}");
        let wrong = problems(&format!("load_cell = false\n{before}{after}"));
        assert_eq!(wrong.len(), 1, "{wrong:?}");
        assert!(wrong[0].0.ends_with("1:13: `load_cell` is neither a table nor \"none\""), "{wrong:?}");
        assert!(wrong[0].1.contains("load_cell = \"none\""), "{wrong:?}");
        let both = problems(&format!("{line}{SIM_RIG}"));
        assert!(both[0].0.contains("[load_cell] is a table here, but line 1 gives `load_cell` a value"), "{both:?}");
    }

    #[test]
    fn a_layout_that_is_given_twice_is_reported_at_both_lines() {
        let text = problems("range_v = 10.0", "places_mm = [[0.0, 0.0]]\nrange_v = 10.0");
        let twice = "`array` gives the positions of its units twice: `grid` and `places_mm`";
        assert_eq!(text, [twice, twice]);
    }

    #[test]
    fn wrong_variants_of_the_shipped_rig_are_refused() {
        assert_eq!(problems("force_n", "force_n"), [""; 0]);
        for (from, to, text) in [
            (
                "\"esp301\"",
                "\"esp310\"",
                "`driver` is \"esp310\", expected one of esp301, esp300, grbl, marlin, klipper, or a table: { ur = ... }, { xps = ... }, { process = [...] }",
            ),
            ("modbus = \"labjack-t7\"", "modbus = \"labjack\"", "there is no register map \"labjack\""),
            (
                "modbus = \"labjack-t7\"",
                "modbus = \"generic-rs485\"",
                "the register map \"generic-rs485\" has no [outputs], which this device needs",
            ),
            (
                "stiffness_n_mm = 2.0",
                "stiffness_n_mm = -2.0",
                "`stiffness_n_mm` is -2, must be over 0, at most 100000 N/mm",
            ),
            ("stiffness_n_mm = 2.0", "stifness_n_mm = 2.0", "unknown key `stifness_n_mm` in `limits`"),
            ("{ modbus = \"labjack-t7\" }", "\"labjack-t7\"", "`driver` is a string, expected a table"),
            ("{ modbus = \"labjack-t7\" }", "3", "`driver` is an integer, expected a table"),
            ("\"esp301\"", "3", "`driver` is an integer, expected a table"),
            (
                "\"esp301\"",
                "{}",
                "unknown driver: expected one of ur, xps, process, or only a name: esp301, esp300, grbl, marlin, klipper",
            ),
            ("{ modbus = \"labjack-t7\" }", "{}", "unknown driver: expected one of modbus, lines, daqmx, process"),
            ("down = \"-z\"", "down = \"z\"", "`down` is \"z\", expected one of -z, +z"),
        ] {
            assert_eq!(problems(from, to)[0], text);
        }
    }

    #[test]
    fn a_rig_that_mixes_real_and_simulated_links_is_refused() {
        let text = problems("link = \"sim\"", "link = \"serial:///dev/ttyUSB0?baud=921600\"");
        assert_eq!(text, ["some links are simulated and others are real: they can't use the same clock"]);
    }

    #[test]
    fn a_labjack_on_a_serial_port_is_refused_and_its_network_named() {
        let text = SIM_RIG.replace("link = \"sim\"", "link = \"serial:///dev/ttyACM0?baud=115200\"");
        let text = text.split("[scene]").next().unwrap();
        let problems = parse("rig.toml", text, &|_| unreachable!()).unwrap_err();
        let words =
            "LabJack T7 speaks Modbus over TCP only, but its link is the serial port serial:///dev/ttyACM0?baud=115200";
        assert!(problems.lines().iter().any(|line| line.ends_with(words)), "{:?}", problems.lines());
        let whole = format!("{problems:?}");
        assert!(whole.contains("tcp://ADDRESS:502") && whole.contains("USB port of a LabJack"), "{whole}");
    }

    #[test]
    fn a_tilt_above_five_degrees_is_refused_at_its_line() {
        let with =
            |tilt: &str| SIM_RIG.replacen("down = \"-z\"", &format!("down = \"-z\"\ntilt_mm_per_mm = {tilt}"), 1);
        let read = |tilt: &str| parse("rig.toml", &with(tilt), &|_| unreachable!());
        let tilt = read("{ x = 0.06, y = -0.06 }").unwrap().frame.tilt;
        assert_eq!(tilt, Tilt { per_x: 0.06, per_y: -0.06 });
        assert_eq!(read("{ y = 0.01 }").unwrap().frame.tilt, Tilt { per_x: 0.0, per_y: 0.01 });
        let line = 1 + with("{ x = 0.07, y = 0.06 }").lines().position(|line| line.starts_with("tilt_mm")).unwrap();
        let text = read("{ x = 0.07, y = 0.06 }").unwrap_err().lines();
        let expected = format!("rig.toml:{line}:18: the surface is tilted by 5.27 degrees, over 5");
        assert!(text.len() == 1 && text[0].starts_with(&expected), "{expected} {text:?}");
        assert!(read("{ x = nan, y = 0.0 }").is_err() && read("{ x = 0.01, z = 0.0 }").is_err());
    }

    #[test]
    fn specimen_beyond_the_travel_is_refused() {
        let text = problems("z = 0.0", "z = -12.0");
        assert!(text[0].starts_with("pressing takes z from -11.4 to -13.9 mm"), "{text:?}");
    }

    #[test]
    fn steps_are_of_all_axes_and_not_too_coarse_for_the_limits() {
        let steps = |text: &str| problems("settle_ms = 10.0", &format!("settle_ms = 10.0\nstep_mm = {text}"));
        assert_eq!(steps("{ x = 0.0125, y = 0.0125, z = 0.0025 }"), [""; 0]);
        assert_eq!(
            steps("{ x = 0.0125, y = 0.0125 }"),
            ["`z` is missing in `stage.step_mm`: a number in mm, over 0, at most 0.05"]
        );
        assert_eq!(steps("{ x = 0.1, y = 0.01, z = 0.0025 }"), ["`x` is 0.1, must be over 0, at most 0.05 mm"]);
        assert_eq!(
            problems(
                "stiffness_n_mm = 2.0",
                "stiffness_n_mm = 50.0\n[stage.step_mm]\nx = 0.0125\ny = 0.0125\nz = 0.0025"
            ),
            [
                "a step of z of 0.0025 mm changes the force by up to 0.125 N at `stiffness_n_mm` = 50, over 0.1 N, which is 5 % of \
              `force_n`: it is too coarse to press by force"
            ]
        );
    }

    #[test]
    fn a_specimen_on_which_the_smallest_step_is_a_twentieth_of_the_limit_is_refused() {
        let stiff = |n_mm: f64| problems("stiffness_n_mm = 2.0", &format!("stiffness_n_mm = {n_mm:.1}"));
        assert_eq!(stiff(1000.0), [""; 0], "0.1 N of 2 N");
        assert_eq!(
            stiff(1001.0),
            [
                "a step of z of 0.0001 mm changes the force by up to 0.1001 N at `stiffness_n_mm` = 1001, over 0.1 N, which is 5 % of \
              `force_n`: it is too coarse to press by force"
            ]
        );
    }

    #[test]
    fn only_a_program_homes_on_the_specimens_side() {
        assert_eq!(
            problems("settle_ms = 10.0", "home_side = \"toward\""),
            ["this stage homes away from the specimen: `home_side = \"toward\"` is for a program of your own"]
        );
        let rig = SIM_RIG.replacen("\"esp301\"", "{ process = [\"a\"] }", 1);
        let rig = rig.replacen("settle_ms = 10.0", "home_side = \"toward\"", 1);
        let read = parse("rig.toml", &rig, &|_| unreachable!()).expect("a rig");
        assert_eq!(read.stage.home_side, HomeSide::Toward);
    }

    #[test]
    fn a_label_and_channels_of_the_outputs_are_read() {
        let array = |more: &str| {
            let text = SIM_RIG.replacen("range_v = 10.0", &format!("range_v = 10.0\n{more}\n"), 1);
            let text = text.replacen("modbus = \"labjack-t7\"", "process = [\"a\"]", 1);
            parse("rig.toml", &text, &|_| unreachable!()).map(|rig| rig.array).map_err(|problems| problems.lines())
        };
        let plain = array("").unwrap();
        assert_eq!((plain.unit.as_str(), plain.layout), ("V", ArrayLayout::grid(3, 3, 4.5)));
        let three = array("unit = \"N/mm²\"\nchannels_per_unit = 3").unwrap();
        assert_eq!((three.unit.as_str(), three.layout.len()), ("N/mm²", 27));
        for (text, words) in [
            ("unit = \"\"", "`unit` is \"\", expected 1 to 16 printable characters"),
            ("unit = \"seventeen letters\"", "expected 1 to 16 printable characters"),
            ("unit = \"a\\tb\"", "expected 1 to 16 printable characters"),
            ("channels_per_unit = 0", "`channels_per_unit` is 0, must be 1 to 16"),
            ("channels_per_unit = 4", "a simulated unit has at most 3 channels"),
        ] {
            let problems = array(text).unwrap_err();
            assert!(problems.len() == 1 && problems[0].contains(words), "{text}: {problems:?}");
        }
        let words = problems("range_v = 10.0", "channels_per_unit = 2");
        assert_eq!(words, ["18 outputs of 9 units, but LabJack T7 has 14 outputs"]);
    }
}
