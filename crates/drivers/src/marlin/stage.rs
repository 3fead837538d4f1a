//! The stage: prepared without a motion, moved by one motion at a time, read back by its counted steps.

use super::port::MarlinPort;
use super::report::setting;
use crate::MOTION_MARGIN;
use crate::printer::{check_by_hand, check_step, feed_mm_min, off_zero, pieces_of};
use palpate_core::quantity::{Axis, seconds};
use palpate_link::device::{
    AxisWay, DeviceError, DeviceProblem, Identity, MotionOrders, RestPlace, STARTING, Stage, StageUse,
};
use palpate_link::time::{Instant, timeout_at};
use palpate_link::wire::Connector;
use std::time::Duration;

/// Least number of steps of a motion. Marlin doesn't make a shorter one, but reports it as made (planner, `MIN_STEPS_PER_SEGMENT`).
pub const LEAST_STEPS: u32 = 6;

/// Calls the present place zero (Marlin documents, G92), and reports the count.
const ZERO_HERE: &str = "G92 X0 Y0 Z0";

/// Number of times that a piece is sent which moved nothing.
const NUDGE_TRIES: usize = 2;

/// A printer with Marlin 2 on a serial line.
pub struct Marlin {
    port: MarlinPort,
    link: String,
    usage: Option<StageUse>,
    /// Steps per mm of x, y and z, by `M503`.
    pub(super) steps_per_mm: [f64; 3],
    /// Where the axes are, in steps from the rig's zero: kept as differences of counts, because the printer's own count may begin again.
    pub(super) at: [i64; 3],
    /// What the printer counted at the last read-back, and what it counts where it calls itself at 0.
    counted: [i64; 3],
    zero: [i64; 3],
    /// Number of the printer's restarts until then.
    restarts: u64,
    /// Whether somebody else may set inches.
    knows_inches: bool,
    /// What the axes counted when the printer was identified, mm.
    first_mm: [f64; 3],
}

impl Marlin {
    /// Creates a printer behind a link; nothing is sent yet. `link` is its name in messages.
    pub fn new(connector: Connector, link: String) -> Self {
        let port = MarlinPort::new(connector, link.clone());
        Marlin {
            port,
            link,
            usage: None,
            steps_per_mm: [f64::NAN; 3],
            at: [0; 3],
            counted: [0; 3],
            zero: [0; 3],
            restarts: 0,
            knows_inches: true,
            first_mm: [0.0; 3],
        }
    }

    /// Compares the printer's settings with the rig's.
    async fn read_settings(&mut self, usage: &StageUse) -> Result<(), DeviceError> {
        let doing = "checking its settings against the rig";
        self.port.texts.clear();
        self.port.command(doing, "M503").await?;
        let texts = std::mem::take(&mut self.port.texts);
        let missing = |name: &str| format!("`M503` doesn't report {name} with X, Y and Z");
        let mismatch = |text: String| self.port.error(doing, DeviceProblem::Mismatch(text));
        let steps_per_mm = setting(&texts, "M92").ok_or_else(|| mismatch(missing("the steps per mm (M92)")))?;
        let most_mm_s = setting(&texts, "M203").ok_or_else(|| mismatch(missing("the largest speeds (M203)")))?;
        let most_mm_s2 =
            setting(&texts, "M201").ok_or_else(|| mismatch(missing("the largest accelerations (M201)")))?;
        let mut differences = Vec::new();
        for axis in Axis::ALL {
            let (nth, name) = (axis.index(), axis.name());
            differences.extend(check_step(axis, 1.0 / steps_per_mm[nth], "its setting M92", usage).err());
            let (accelerates_mm_s2, acceleration_mm_s2) = (most_mm_s2[nth], usage.acceleration_mm_s2);
            if accelerates_mm_s2 < acceleration_mm_s2 {
                differences.push(format!(
                    "its largest acceleration of {name} is {accelerates_mm_s2} mm/s^2 by its setting M201, the rig's `acceleration_mm_s2` is \
                     {acceleration_mm_s2}"
                ));
            }
            let (most_mm_s, speed_mm_s) = (most_mm_s[nth], usage.speed_mm_s);
            if most_mm_s < speed_mm_s {
                differences.push(format!(
                    "its largest speed of {name} is {most_mm_s} mm/s by its setting M203, the rig's `speed_mm_s` is {speed_mm_s}"
                ));
            }
        }
        if !differences.is_empty() {
            return Err(self.port.error(doing, DeviceProblem::Settings(differences)));
        }
        self.steps_per_mm = steps_per_mm;
        Ok(())
    }

    /// Waits for the end of the queue, and reads the counted steps back. Marlin reports a motion as made that it didn't make: a count that
    /// isn't at the reported end is an error.
    async fn read_back(&mut self, doing: &str, expected: Duration) -> Result<[f64; 3], DeviceError> {
        self.port.take_position();
        self.port.both(doing, ["M400", "M114"], expected).await?;
        let position = match self.port.take_position() {
            Some(position) => position,
            None => self.port.position(doing).await?, // damaged
        };
        self.take_count(position.steps);
        // once: a later motion away from the specimen must be possible
        let complaints = std::mem::take(&mut self.port.complaints);
        if !complaints.is_empty() {
            let text = complaints.join("; ");
            return Err(self.port.error(doing, DeviceProblem::Motion(text)));
        }
        let mut at_mm = [0.0; 3];
        for axis in Axis::ALL {
            let (index, name) = (axis.index(), axis.name());
            let step_mm = 1.0 / self.steps_per_mm[index];
            at_mm[index] = self.at[index] as f64 * step_mm;
            let (motor_mm, end_mm) =
                ((position.steps[index] - self.zero[index]) as f64 * step_mm, position.ends_mm[index]);
            // half a step, and the rounding of the report
            if (motor_mm - end_mm).abs() > 0.5 * step_mm + REPORT_ROUNDING_MM {
                let steps_to_end = |axis: usize| (position.ends_mm[axis] * self.steps_per_mm[axis]).round() as i64;
                self.zero = std::array::from_fn(|axis| position.steps[axis] - steps_to_end(axis)); // stated once
                let text = format!("it reports {name} at {end_mm} mm, but its motor is at {motor_mm:.4} mm");
                return Err(self.port.error(doing, DeviceProblem::Motion(text)));
            }
            let known = self.usage.as_ref().filter(|_| !self.port.is_lost);
            if let Some(usage) = known.filter(|usage| !usage.reach(axis).contains(at_mm[index])) {
                let reach = usage.reach(axis);
                self.port.is_lost = true; // stated once: the way out depends on no place
                let text = format!("{name} is at {:.4} mm, outside {} to {} mm", at_mm[index], reach.min, reach.max);
                return Err(self.port.error(doing, DeviceProblem::Motion(text)));
            }
        }
        Ok(at_mm)
    }

    /// Adds to the place what was counted since the last read-back. A printer that restarted counts from 0 again.
    fn take_count(&mut self, steps: [i64; 3]) {
        if std::mem::replace(&mut self.restarts, self.port.restarts) == self.port.restarts {
            (0..3).for_each(|axis| self.at[axis] += steps[axis] - self.counted[axis]);
        } else {
            self.zero = [0; 3];
        }
        self.counted = steps;
    }

    /// Returns the ends of the lines that bring the axes along a way, in steps from its start. A shorter way than [`LEAST_STEPS`] first goes
    /// back, so that it ends in the same direction; along z first away from the specimen, so that it ends toward it. Z then ends no
    /// deeper, even if somebody else sets another zero between the two.
    fn legs(way: [i64; 3], away: f64) -> Vec<[i64; 3]> {
        let least = i64::from(LEAST_STEPS);
        match way.iter().map(|steps| steps.abs()).max().unwrap_or(0) {
            0 => Vec::new(),
            longest if longest >= least => vec![way],
            _ => {
                let mut back = [0; 3];
                let z = Axis::Z.index();
                if way[z] != 0 {
                    let away = if away > 0.0 { 1 } else { -1 };
                    back[z] = away * (least + (away * way[z]).max(0));
                } else {
                    (0..z).for_each(|axis| back[axis] = -way[axis].signum() * least);
                }
                vec![back, way]
            }
        }
    }

    /// Sends a motion of whole steps from rest. The printer first calls its place 0 and counts in mm, so the motion is the same after anything
    /// that it or somebody else did before: a restart, another zero, relative or absolute coordinates (Marlin documents, G21, G91, G92).
    async fn send_motion(
        &mut self,
        doing: &str,
        legs: &[[i64; 3]],
        speed_mm_s: f64,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let mut from = [0; 3];
        let lines = legs.iter().map(|end| self.line(std::mem::replace(&mut from, *end), *end, speed_mm_s));
        let lines: Vec<String> = lines.collect();
        if self.knows_inches {
            self.port.command(doing, "G21").await?;
        }
        self.port.take_position();
        self.port.command(doing, ZERO_HERE).await?;
        self.take_zero(doing).await?;
        for line in lines {
            if orders.stopped() {
                break;
            }
            self.port.command_of(doing, &line, Duration::ZERO, Some(orders)).await?;
        }
        Ok(())
    }

    /// Returns the line of a motion between two places, in steps from where it is 0.
    fn line(&self, from: [i64; 3], end: [i64; 3], speed_mm_s: f64) -> String {
        let mm = |axis: usize, steps: i64| steps as f64 / self.steps_per_mm[axis];
        let way_mm: [f64; 3] = std::array::from_fn(|axis| mm(axis, end[axis] - from[axis]));
        let words = Axis::ALL.into_iter().filter(|axis| way_mm[axis.index()] != 0.0);
        let words =
            words.map(|axis| format!("{}{:.5} ", axis.name().to_uppercase(), mm(axis.index(), end[axis.index()])));
        format!("G1 {}F{:.3}", words.collect::<String>(), feed_mm_min(way_mm, speed_mm_s))
    }

    /// Takes the count that `G92` reported at rest.
    ///
    /// # Errors
    /// It isn't that of the last read-back. Stated once, so that the way out is open.
    async fn take_zero(&mut self, doing: &str) -> Result<(), DeviceError> {
        let position = match self.port.take_position() {
            Some(position) => position,
            None => self.port.position(doing).await?,
        };
        // firmware without workspace offsets sets the count too
        let counts_anew = position.steps == [0; 3] || self.restarts != self.port.restarts;
        let moved = Axis::ALL.into_iter().find(|axis| position.steps[axis.index()] != self.counted[axis.index()]);
        (self.counted, self.zero, self.restarts) = (position.steps, position.steps, self.port.restarts);
        match moved.filter(|_| !counts_anew) {
            None => Ok(()),
            Some(axis) => {
                let text = format!("its count of {} changed while it rested: something else moved it", axis.name());
                Err(self.port.error(doing, DeviceProblem::Motion(text)))
            }
        }
    }
}

/// Rounding of the positions in the answer to `M114`, which have two decimals.
const REPORT_ROUNDING_MM: f64 = 0.005 + 1e-9;

impl Stage for Marlin {
    async fn identify(&mut self, usage: &StageUse) -> Result<Identity, DeviceError> {
        let doing = "identifying it";
        self.usage = None;
        self.port.wake(doing).await?;
        self.port.is_lost = false;
        self.port.texts.clear();
        self.port.command(doing, "M115").await?;
        let texts = std::mem::take(&mut self.port.texts);
        let named = texts.iter().find_map(|text| text.split_once("FIRMWARE_NAME:")).map(|(_, name)| name.trim());
        let name = named.and_then(|name| name.split(" (").next()).unwrap_or_default().to_owned();
        // makers name their own builds after themselves, such as `Creality Marlin`
        if !name.contains("Marlin") {
            let expected = "FIRMWARE_NAME:Marlin".to_owned();
            return Err(self.port.error(doing, DeviceProblem::Misfit { answer: texts.join(" "), expected }));
        }
        self.read_settings(usage).await?;
        // motors on, no idle time, no bed levelling (z would follow x and y), no reports of temperatures, the whole feed, absolute mm
        for command in ["M17", "M84 S0", "M420 S0", "M155 S0", "M220 S100"] {
            self.port.command(doing, command).await?;
        }
        // a stock build doesn't know inches, and G21 has no effect then
        self.port.texts.clear();
        self.port.command(doing, "G20").await?;
        self.knows_inches = !self.port.texts.iter().any(|text| text.contains("Unknown command"));
        for command in ["G21", "G90"] {
            self.port.command(doing, command).await?;
        }
        (self.at, self.counted, self.zero, self.restarts) = ([0; 3], [0; 3], [0; 3], self.port.restarts);
        self.first_mm = self.read_back(doing, MOTION_MARGIN).await?;
        Ok(Identity { role: "stage".to_owned(), identity: name, link: self.link.clone(), warnings: Vec::new() })
    }

    /// Moves in pieces, between which a stop counts.
    async fn nudge_away(&mut self, way_mm: f64, usage: &StageUse, orders: &MotionOrders) -> Result<bool, DeviceError> {
        let (doing, z) = ("moving z a little", Axis::Z.index());
        let (pieces, piece_mm) = pieces_of(way_mm);
        for _ in 0..pieces {
            if orders.stopped() {
                break;
            }
            let steps = ((piece_mm * self.steps_per_mm[z]).round() as i64).max(i64::from(LEAST_STEPS));
            let (mut way, from) = ([0; 3], self.at[z]);
            way[z] = if usage.away > 0.0 { steps } else { -steps };
            // a printer may take a line that it doesn't carry out: what the read-back shows is left
            for _ in 0..NUDGE_TRIES {
                self.send_motion(doing, &[way], usage.home_speed_mm_s, orders).await?;
                self.read_back(doing, seconds(piece_mm / usage.home_speed_mm_s)).await?;
                if self.at[z] != from || orders.stopped() {
                    break;
                }
            }
            if self.at[z] != from + way[z] && !orders.stopped() {
                let text = "z didn't move; does its firmware require a search for home first?".to_owned();
                return Err(self.port.error(doing, DeviceProblem::Motion(text)));
            }
        }
        Ok(true)
    }

    async fn home(&mut self, usage: &StageUse, _: &MotionOrders) -> Result<(), DeviceError> {
        let doing = "preparing it";
        check_by_hand(usage).map_err(|text| self.port.error(doing, DeviceProblem::Mismatch(text)))?;
        if let Some((axis, counts_mm)) = off_zero(self.first_mm) {
            let name = axis.name();
            let text = format!(
                "{name} counted {counts_mm:.2} mm where it was switched on, but the rig's zero is 0: bring the axes to zero, then switch the \
                 printer off and on"
            );
            return Err(self.port.error(doing, DeviceProblem::Mismatch(text)));
        }
        self.usage = Some(usage.clone());
        self.read_back(doing, Duration::ZERO).await?;
        self.port.complaints.clear();
        Ok(())
    }

    fn usage(&self) -> Option<&StageUse> {
        self.usage.as_ref()
    }

    fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        self.port.error(doing, problem)
    }

    async fn rest(&mut self, is_leaving: bool, _: &MotionOrders) -> Result<Option<RestPlace>, DeviceError> {
        if self.port.is_lost && !is_leaving {
            return Err(self.port.lost(STARTING));
        }
        let at_mm = std::array::from_fn(|axis| self.at[axis] as f64 / self.steps_per_mm[axis]);
        Ok(Some(RestPlace { at_mm, uncertainty_mm: 0.0 }))
    }

    async fn send(
        &mut self,
        ways: &[AxisWay],
        speed_mm_s: f64,
        usage: &StageUse,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let (is_leaving, mut by) = (usage.is_leaving(ways), [0; 3]);
        for way in ways {
            let (nth, steps) = (way.axis.index(), self.steps_per_mm[way.axis.index()]);
            // the counted place is known better than the one that was read back
            by[nth] = match is_leaving {
                true => (way.by_mm * steps).round() as i64,
                false => (way.to_mm() * steps).round() as i64 - self.at[nth],
            };
        }
        let legs = Marlin::legs(by, usage.away);
        if legs.is_empty() {
            return Ok(());
        }
        self.send_motion(STARTING, &legs, speed_mm_s, orders).await
    }

    async fn follow(&mut self, axes: &[Axis], expected: Duration, _: &MotionOrders) -> Result<Vec<f64>, DeviceError> {
        let doing = "waiting for a motion to end";
        let until = Instant::now() + expected + MOTION_MARGIN;
        match timeout_at(until, self.read_back(doing, expected)).await {
            Ok(at_mm) => at_mm.map(|at_mm| axes.iter().map(|axis| at_mm[axis.index()]).collect()),
            Err(_) => {
                let text = format!("still moving {} s after it should have ended", MOTION_MARGIN.as_secs());
                Err(self.port.error(doing, DeviceProblem::Motion(text)))
            }
        }
    }

    /// Waits for the end of a motion first: what a printer reports before it is the end point.
    async fn position_mm(&mut self, axis: Axis, _: &MotionOrders) -> Result<f64, DeviceError> {
        Ok(self.read_back("reading a position", Duration::ZERO).await?[axis.index()])
    }

    /// Sends nothing: a motion under way ends at its own end point, and the driver sends no further one.
    async fn stop(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }

    /// Sends M410, which ends what is planned at once.
    async fn abort(&mut self) -> Result<(), DeviceError> {
        self.port.quick_stop("stopping it at once").await
    }

    async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
        Ok(std::mem::take(&mut self.port.complaints))
    }
}
