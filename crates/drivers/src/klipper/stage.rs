//! The stage: prepared without a motion, moved by one script for each motion, read back by its motors.

use super::moonraker::Moonraker;
use crate::MOTION_MARGIN;
use crate::printer::{check_by_hand, check_step, feed_mm_min, off_zero, pieces_of};
use palpate_core::quantity::{Axis, seconds};
use palpate_link::device::{
    AxisWay, DeviceError, DeviceProblem, Identity, MotionOrders, RestPlace, STARTING, Stage, StageUse,
};
use palpate_link::time::sleep;
use palpate_link::wire::Connector;
use serde_json::{Value, json};
use std::time::Duration;

/// How often a position that isn't the end yet is asked for again, and how long after. Klipper refreshes its report of a motion only every
/// 0.25 s (`motion_report`).
const REFRESHES: usize = 3;
const REFRESH: Duration = Duration::from_millis(120);

/// Rounding of reported positions, mm.
const REPORT_ROUNDING_MM: f64 = 1e-5;

/// A printer with Klipper and Moonraker.
pub struct Klipper {
    moonraker: Moonraker,
    link: String,
    usage: Option<StageUse>,
    /// Step of x, y and z, mm.
    step_mm: [f64; 3],
    /// Commands that switch the motors on.
    steppers: String,
    /// Where the zero of the rig's axes is in the printer's coordinates, mm.
    zero_mm: [f64; 3],
    /// Where the axes were sent, mm; `None` after a motion that was refused or in doubt.
    pub(super) at_mm: Option<[f64; 3]>,
    /// Where it said that the axes were sent, when it was asked last before a motion, mm.
    ends_mm: [f64; 3],
    /// How long the last motion takes.
    takes: Duration,
    /// What each motion sets first, so that nothing that somebody else set changes it.
    setup: String,
    /// Where the axes were when the printer was identified, mm; `None` if it didn't know.
    first_mm: Option<[f64; 3]>,
    under_way: UnderWay,
    /// Whether it lost its position: it restarted, or its motors were switched off.
    is_lost: bool,
}

/// What is known of the last motion.
#[derive(Clone, Copy, Debug, PartialEq)]
enum UnderWay {
    /// It has ended.
    Nothing,
    /// Its answer is awaited.
    Motion,
    /// Its answer was lost: it may be under way.
    Doubt,
}

/// What the printer reports of its axes.
struct Report {
    /// Where the motors are, mm.
    at_mm: [f64; 3],
    /// Where they were sent, mm.
    ends_mm: [f64; 3],
    /// Whether G-code calls that place otherwise: G92, an offset, a mesh, or a correction of skew or tilt, which changes a motion.
    is_shifted: bool,
    /// Whether it knows the position of all axes.
    is_known: bool,
}

impl Klipper {
    /// Creates a printer behind a link; nothing is sent yet. `link` is its name in messages.
    pub fn new(connector: Connector, link: String) -> Self {
        Klipper {
            moonraker: Moonraker::new(connector, link.clone()),
            link,
            usage: None,
            step_mm: [f64::NAN; 3],
            steppers: String::new(),
            zero_mm: [0.0; 3],
            at_mm: None,
            ends_mm: [f64::NAN; 3],
            takes: Duration::ZERO,
            setup: String::new(),
            first_mm: None,
            under_way: UnderWay::Nothing,
            is_lost: false,
        }
    }

    fn lost(&self, doing: &str) -> DeviceError {
        self.motion(doing, "it restarted, or its motors were switched off, so its position is lost".to_owned())
    }

    fn motion(&self, doing: &str, text: String) -> DeviceError {
        self.moonraker.error(doing, DeviceProblem::Motion(text))
    }

    fn mismatch(&self, doing: &str, text: String) -> DeviceError {
        self.moonraker.error(doing, DeviceProblem::Mismatch(text))
    }

    /// Compares the printer's settings with the rig's.
    async fn read_settings(&mut self, usage: &StageUse) -> Result<(), DeviceError> {
        let doing = "checking its settings against the rig";
        let asked = json!({ "objects": { "configfile": ["settings"] } });
        let answer = self.moonraker.ask(doing, "printer.objects.query", asked).await?;
        let (settings, mut differences) = (&answer["status"]["configfile"]["settings"], Vec::new());
        for axis in Axis::ALL {
            let (name, stepper) = (axis.name(), &settings[format!("stepper_{}", axis.name())]);
            let number = |key: &str| stepper[key].as_f64().filter(|number| *number > 0.0);
            let (turn_mm, microsteps) = (number("rotation_distance"), number("microsteps"));
            let full = number("full_steps_per_rotation").unwrap_or(200.0);
            let ratio = |pair: &Value| Some(pair[0].as_f64()? / pair[1].as_f64()?);
            let gears: Option<f64> = match stepper["gear_ratio"].as_array() {
                Some(pairs) => pairs.iter().map(ratio).product(),
                None => Some(1.0),
            };
            let (Some(turn_mm), Some(microsteps), Some(gears)) = (turn_mm, microsteps, gears) else {
                let text =
                    format!("[stepper_{name}] has no `rotation_distance` and `microsteps`: its step isn't known");
                return Err(self.mismatch(doing, text));
            };
            let step_mm = turn_mm / (full * microsteps * gears);
            differences.extend(check_step(axis, step_mm, &format!("[stepper_{name}]"), usage).err());
            self.step_mm[axis.index()] = step_mm;
            match self.zero_of(axis, stepper, usage) {
                Ok(zero_mm) => self.zero_mm[axis.index()] = zero_mm,
                Err(text) => differences.push(text),
            }
        }
        let steppers =
            settings.as_object().into_iter().flat_map(|all| all.keys()).filter(|key| key.starts_with("stepper_"));
        self.steppers = steppers.map(|name| format!("SET_STEPPER_ENABLE STEPPER={name} ENABLE=1\n")).collect();
        let printer = &settings["printer"];
        let all = [("max_velocity", usage.speed_mm_s), ("max_accel", usage.acceleration_mm_s2)];
        let z = [("max_z_velocity", usage.speed_mm_s), ("max_z_accel", usage.acceleration_mm_s2)];
        for (key, wanted) in all.into_iter().chain(z) {
            if printer[key].as_f64().is_some_and(|most| most < wanted) {
                let (most, rig) =
                    (&printer[key], if key.ends_with("accel") { "acceleration_mm_s2" } else { "speed_mm_s" });
                differences.push(format!("`{key}` of [printer] is {most}, the rig's `{rig}` is {wanted}"));
            }
        }
        match differences.is_empty() {
            true => Ok(()),
            false => Err(self.moonraker.error(doing, DeviceProblem::Settings(differences))),
        }
    }

    /// Returns the place of the rig's zero in the printer's coordinates, mm: the middles of both travels are at one place. It is the same
    /// after each start.
    fn zero_of(&self, axis: Axis, stepper: &Value, usage: &StageUse) -> Result<f64, String> {
        let (name, travel) = (axis.name(), usage.travel.along(axis));
        let end = |key: &str| stepper[key].as_f64();
        let (min_mm, max_mm) = (end("position_min").unwrap_or(0.0), end("position_max").unwrap_or(f64::NAN));
        if max_mm.is_nan() || travel.max - travel.min > max_mm - min_mm {
            return Err(format!(
                "{name} goes from {min_mm} to {max_mm} mm by [stepper_{name}], and the rig's travel has {} mm",
                travel.max - travel.min
            ));
        }
        Ok(self.in_steps(axis, (min_mm + max_mm - travel.min - travel.max) / 2.0))
    }

    async fn report(&mut self, doing: &str) -> Result<Report, DeviceError> {
        let asked = json!({ "objects": {
            "toolhead": ["position", "homed_axes"], "motion_report": ["live_position"],
            "gcode_move": ["gcode_position"], "webhooks": ["state", "state_message"]
        } });
        let answer = self.moonraker.ask(doing, "printer.objects.query", asked).await?;
        let status = &answer["status"];
        self.check_ready(doing, &status["webhooks"])?;
        let three = |list: &Value| -> Option<[f64; 3]> {
            let numbers: Vec<f64> = list.as_array()?.iter().take(3).map_while(Value::as_f64).collect();
            <[f64; 3]>::try_from(numbers).ok()
        };
        let own = |mm: [f64; 3]| std::array::from_fn(|axis| mm[axis] - self.zero_mm[axis]);
        let (live, sent) = (three(&status["motion_report"]["live_position"]), three(&status["toolhead"]["position"]));
        let homed = status["toolhead"]["homed_axes"].as_str().unwrap_or_default();
        let is_known = Axis::ALL.iter().all(|axis| homed.contains(axis.name()));
        let by_gcode = three(&status["gcode_move"]["gcode_position"]);
        match live.zip(sent).zip(by_gcode) {
            Some(((at_mm, ends_mm), by_gcode)) => {
                let is_same = |axis: usize| (by_gcode[axis] - ends_mm[axis]).abs() <= REPORT_ROUNDING_MM;
                let is_shifted = !(0..3).all(is_same);
                Ok(Report { at_mm: own(at_mm), ends_mm: own(ends_mm), is_shifted, is_known })
            }
            None => {
                let expected =
                    "`live_position` of motion_report, `position` of toolhead and `gcode_position` of gcode_move"
                        .to_owned();
                let problem = DeviceProblem::Misfit { answer: status.to_string(), expected };
                Err(self.moonraker.error(doing, problem))
            }
        }
    }

    fn check_ready(&self, doing: &str, webhooks: &Value) -> Result<(), DeviceError> {
        match webhooks["state"].as_str() {
            Some("ready") => Ok(()),
            state => {
                let (state, message) =
                    (state.unwrap_or("unknown"), webhooks["state_message"].as_str().unwrap_or_default());
                let message = message.lines().next().unwrap_or_default();
                Err(self.motion(doing, format!("it is in the state {state} and lost its position: {message}")))
            }
        }
    }

    /// Waits for the end of what was sent, and reads the motors back. A motor that isn't where it was sent is an error.
    async fn read_back(&mut self, doing: &str, expected: Duration) -> Result<[f64; 3], DeviceError> {
        match self.under_way {
            UnderWay::Nothing => {}
            UnderWay::Motion => {
                self.under_way = UnderWay::Doubt;
                let answer =
                    self.moonraker.answer(doing, "a motion and M400", expected.max(self.takes) + MOTION_MARGIN).await;
                match &answer {
                    Ok(_) => self.under_way = UnderWay::Nothing,
                    Err(error) => {
                        self.at_mm = None;
                        if matches!(error.problem, DeviceProblem::Refused(_)) {
                            self.under_way = UnderWay::Nothing;
                        }
                    }
                }
                answer?;
            }
            UnderWay::Doubt => {
                // scripts run one after another: this one ends after the one whose answer was lost
                self.moonraker.run(doing, "M400", expected.max(self.takes) + MOTION_MARGIN).await?;
                (self.under_way, self.at_mm) = (UnderWay::Nothing, None);
            }
        }
        let mut report = self.report(doing).await?;
        for _ in 0..REFRESHES {
            if self.off(&report).is_none() {
                break;
            }
            sleep(REFRESH).await;
            report = self.report(doing).await?;
        }
        if self.usage.is_some() && !report.is_known {
            self.count_anew(doing).await?;
            // once: a later motion away from the specimen must be possible
            if !std::mem::replace(&mut self.is_lost, true) {
                return Err(self.lost(doing));
            }
            report = self.report(doing).await?;
        }
        if let Some(axis) = self.off(&report).filter(|_| !self.is_lost) {
            let (name, at_mm, end_mm) = (axis.name(), report.at_mm[axis.index()], report.ends_mm[axis.index()]);
            let text = format!("it was sent to {name} = {end_mm:.4} mm, but its motor is at {at_mm:.4} mm");
            return Err(self.motion(doing, text));
        }
        for axis in Axis::ALL {
            let (name, at_mm) = (axis.name(), report.at_mm[axis.index()]);
            let known = self.usage.as_ref().filter(|_| !self.is_lost);
            if let Some(usage) = known.filter(|usage| !usage.reach(axis).contains(at_mm)) {
                let reach = usage.reach(axis);
                self.is_lost = true;
                self.count_anew(doing).await?;
                let text = format!("{name} is at {at_mm:.4} mm, outside {} to {} mm", reach.min, reach.max);
                return Err(self.motion(doing, text));
            }
        }
        let checked = self.check_sent(doing, &report);
        self.at_mm = checked.is_ok().then_some(report.ends_mm); // the way out stays open
        checked.map(|()| report.at_mm)
    }

    /// Makes it count from the rig's zero here. No motion: a printer that doesn't know its place, or is out of its travel, refuses all motions.
    async fn count_anew(&mut self, doing: &str) -> Result<(), DeviceError> {
        let [x, y, z] = self.zero_mm;
        let script = format!("SET_KINEMATIC_POSITION X={x:.6} Y={y:.6} Z={z:.6}\nM400");
        self.moonraker.run(doing, &script, Duration::ZERO).await?;
        self.at_mm = None;
        Ok(())
    }

    /// Checks that the axes were sent by nobody else.
    fn check_sent(&self, doing: &str, report: &Report) -> Result<(), DeviceError> {
        let Some(at_mm) = self.at_mm.filter(|_| !self.is_lost) else { return Ok(()) };
        match Axis::ALL.into_iter().find(|axis| !self.is_same(*axis, at_mm[axis.index()], report.ends_mm[axis.index()]))
        {
            None => Ok(()),
            Some(axis) => {
                let (name, sent_mm, is_mm) = (axis.name(), at_mm[axis.index()], report.ends_mm[axis.index()]);
                let text =
                    format!("{name} was sent to {sent_mm:.4} mm but is at {is_mm:.4} mm: something else moved it");
                Err(self.motion(doing, text))
            }
        }
    }

    fn is_same(&self, axis: Axis, one_mm: f64, other_mm: f64) -> bool {
        (one_mm - other_mm).abs() <= self.step_mm[axis.index()] / 2.0 + REPORT_ROUNDING_MM
    }

    /// Returns an axis whose motor isn't where it was sent.
    fn off(&self, report: &Report) -> Option<Axis> {
        Axis::ALL
            .into_iter()
            .find(|axis| !self.is_same(*axis, report.at_mm[axis.index()], report.ends_mm[axis.index()]))
    }

    /// Sends a motion of whole steps, from where the axes were sent.
    async fn send_motion(
        &mut self,
        doing: &str,
        ways: &[AxisWay],
        (speed_mm_s, usage): (f64, &StageUse),
    ) -> Result<(), DeviceError> {
        let (from_mm, is_leaving, mut by_mm) = (self.ends_mm, usage.is_leaving(ways), [0.0; 3]);
        for way in ways {
            let nth = way.axis.index();
            // where the printer was sent, in whole steps, is known better than where it was read back
            by_mm[nth] = match is_leaving {
                true => self.in_steps(way.axis, way.by_mm),
                false => self.in_steps(way.axis, way.to_mm()) - from_mm[nth],
            };
        }
        let longest_mm = by_mm.iter().fold(0.0, |most: f64, way| most.max(way.abs()));
        if longest_mm == 0.0 {
            return Ok(());
        }
        let words = Axis::ALL.into_iter().filter(|axis| by_mm[axis.index()] != 0.0);
        let words = words.map(|axis| format!("{}{:.6} ", axis.name().to_uppercase(), by_mm[axis.index()]));
        let (setup, words, feed_mm_min) = (&self.setup, words.collect::<String>(), feed_mm_min(by_mm, speed_mm_s));
        let script = format!("{setup}G91\nG1 {words}F{feed_mm_min:.3}\nG90\nM400");
        self.under_way = UnderWay::Doubt;
        self.takes = seconds(longest_mm / speed_mm_s);
        self.moonraker.begin(doing, &script).await?;
        let to_mm = std::array::from_fn(|axis| from_mm[axis] + by_mm[axis]);
        (self.under_way, self.at_mm) = (UnderWay::Motion, Some(to_mm));
        Ok(())
    }

    fn in_steps(&self, axis: Axis, mm: f64) -> f64 {
        let step_mm = self.step_mm[axis.index()];
        (mm / step_mm).round() * step_mm
    }
}

impl Stage for Klipper {
    async fn identify(&mut self, usage: &StageUse) -> Result<Identity, DeviceError> {
        let doing = "identifying it";
        (self.usage, self.under_way, self.is_lost) = (None, UnderWay::Nothing, false);
        self.moonraker.close();
        let info = self.moonraker.ask(doing, "printer.info", json!({})).await?;
        self.check_ready(doing, &info)?;
        let text = |key: &str| info[key].as_str().unwrap_or("unknown").to_owned();
        let identity = format!("Klipper {} on {}", text("software_version"), text("hostname"));
        self.read_settings(usage).await?;
        let asked = json!({ "objects": { "print_stats": ["state"] } });
        let answer = self.moonraker.ask(doing, "printer.objects.query", asked).await?;
        if let Some(state @ ("printing" | "paused")) = answer["status"]["print_stats"]["state"].as_str() {
            return Err(self.mismatch(doing, format!("it is {state} a job: nothing was changed")));
        }
        // the rig's acceleration, the whole feed, no bed mesh (z would follow x and y)
        let acceleration = usage.acceleration_mm_s2;
        self.setup = format!("BED_MESH_CLEAR\nSET_VELOCITY_LIMIT ACCEL={acceleration}\nM220 S100\n");
        // motors on, so that nothing moves by hand any more, and no idle time
        let script = format!(
            "{}SET_IDLE_TIMEOUT TIMEOUT=86400\nSET_GCODE_OFFSET X=0 Y=0 Z=0\n{}M400",
            self.steppers, self.setup
        );
        self.moonraker.run(doing, &script, MOTION_MARGIN).await?;
        let report = self.report(doing).await?;
        self.first_mm = report.is_known.then_some(report.at_mm);
        if !report.is_known {
            // where a person brought the axes
            self.count_anew(doing).await?;
            if !self.report(doing).await?.is_known {
                let text = "it doesn't know SET_KINEMATIC_POSITION: add [force_move] with `enable_force_move: True` to its printer.cfg";
                return Err(self.mismatch(doing, text.to_owned()));
            }
        }
        self.at_mm = None;
        self.read_back(doing, Duration::ZERO).await?;
        Ok(Identity { role: "stage".to_owned(), identity, link: self.link.clone(), warnings: Vec::new() })
    }

    /// Moves in pieces, between which a stop counts.
    async fn nudge_away(&mut self, way_mm: f64, usage: &StageUse, orders: &MotionOrders) -> Result<bool, DeviceError> {
        let (doing, z) = ("moving z a little", Axis::Z.index());
        let (pieces, piece_mm) = pieces_of(way_mm);
        let piece_mm = self.in_steps(Axis::Z, piece_mm).max(self.step_mm[z]);
        for _ in 0..pieces {
            if orders.stopped() {
                break;
            }
            self.ends_mm = self.report(doing).await?.ends_mm;
            let way = AxisWay { axis: Axis::Z, from_mm: self.ends_mm[z], by_mm: usage.away * piece_mm };
            self.send_motion(doing, &[way], (usage.home_speed_mm_s, usage)).await?;
            self.read_back(doing, seconds(piece_mm / usage.home_speed_mm_s)).await?;
        }
        Ok(true)
    }

    async fn home(&mut self, usage: &StageUse, _: &MotionOrders) -> Result<(), DeviceError> {
        let doing = "preparing it";
        check_by_hand(usage).map_err(|text| self.mismatch(doing, text))?;
        if let Some((axis, at_mm)) = self.first_mm.and_then(off_zero) {
            let name = axis.name();
            let text = format!(
                "{name} was at {at_mm:.2} mm by its count, but the rig's zero is 0: bring the axes to zero, then switch the motors off (M84)"
            );
            return Err(self.mismatch(doing, text));
        }
        self.usage = Some(usage.clone());
        self.read_back(doing, Duration::ZERO).await.map(drop)
    }

    fn usage(&self) -> Option<&StageUse> {
        self.usage.as_ref()
    }

    fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        self.moonraker.error(doing, problem)
    }

    /// Nothing that somebody else set prevents the way out of a contact.
    async fn rest(&mut self, is_leaving: bool, _: &MotionOrders) -> Result<Option<RestPlace>, DeviceError> {
        let doing = STARTING;
        if self.under_way != UnderWay::Nothing {
            self.read_back(doing, Duration::ZERO).await?;
        }
        let report = self.report(doing).await?;
        if !is_leaving {
            if self.is_lost || !report.is_known {
                self.is_lost = true;
                return Err(self.lost(doing));
            }
            self.check_sent(doing, &report)?;
            if report.is_shifted {
                let text = "its G-code coordinates were shifted by somebody else (G92, an offset, a bed mesh, a correction of skew or of tilt)";
                return Err(self.motion(doing, text.to_owned()));
            }
        }
        self.ends_mm = report.ends_mm;
        Ok(Some(RestPlace { at_mm: report.ends_mm, uncertainty_mm: REPORT_ROUNDING_MM }))
    }

    async fn send(
        &mut self,
        ways: &[AxisWay],
        speed_mm_s: f64,
        usage: &StageUse,
        _: &MotionOrders,
    ) -> Result<(), DeviceError> {
        self.send_motion(STARTING, ways, (speed_mm_s, usage)).await
    }

    async fn follow(&mut self, axes: &[Axis], expected: Duration, _: &MotionOrders) -> Result<Vec<f64>, DeviceError> {
        let at_mm = self.read_back("waiting for a motion to end", expected).await?;
        Ok(axes.iter().map(|axis| at_mm[axis.index()]).collect())
    }

    /// Waits for the end of a motion first: a stop can't end it earlier.
    async fn position_mm(&mut self, axis: Axis, _: &MotionOrders) -> Result<f64, DeviceError> {
        Ok(self.read_back("reading a position", Duration::ZERO).await?[axis.index()])
    }

    /// Sends nothing: a motion under way ends at its own end point, and the driver sends no further one.
    async fn stop(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }

    /// Shuts the printer down, which cuts the power of its motors, if z holds without it. Nothing else ends a motion (Klipper, G-codes).
    async fn abort(&mut self) -> Result<(), DeviceError> {
        if self.usage.as_ref().is_none_or(|usage| !usage.z_holds_unpowered) {
            return Ok(());
        }
        self.moonraker.close(); // an answer may still come
        self.moonraker.ask("stopping it at once", "printer.emergency_stop", json!({})).await.map(drop)
    }

    async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
        Ok(Vec::new())
    }
}
