//! The stage of the process protocol.

use super::fault::{ProcessStageFault, ProcessStageFaultAfterBytes, ProcessStageFaultKind, StageFaults};
use super::{Instrument, ProcessReply, Request, identity, object, reply, reply_line, take_line, unknown};
use crate::emulator::Owed;
use crate::scene::{Scene, SceneDevice, Trajectory};
use palpate_core::quantity::{Axis, Range, Steps, round};
use serde_json::{Map, Value, json};
use std::sync::Arc;
use tokio::sync::Notify;

/// Ends of each axis of the stage that isn't a printer, true mm.
const ENDS_MM: Range = Range { min: -crate::emulator::STAGE_TRAVEL_MM, max: crate::emulator::STAGE_TRAVEL_MM };
/// Largest speed, mm/s.
const MOST_MM_S: f64 = 25.0;
/// Largest acceleration, mm/s^2.
const MOST_MM_S2: f64 = 100.0;
/// Acceleration of a stop before the first `prepare`, mm/s^2.
const FIRST_MM_S2: f64 = 50.0;
/// Resolution of the read-back, steps per mm.
const COUNTS_PER_MM: f64 = 1e4;
/// Distance from a place at which an axis counts as being there, mm; with coarse steps, half a step more.
const IN_POSITION_MM: f64 = 0.003;
/// Longest search for home, s.
const SEARCH_MOST_S: f64 = 110.0;

/// Mechanics behind a program that moves like a printer: stepper motors without encoders.
///
/// An axis rests on whole steps only. It counts the steps that were sent, and reads back this count. A stop ends at the next step
/// after the way of braking.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Printer {
    /// Ends of the axes, true mm.
    pub ends_mm: [Range; 3],
    /// Steps of the axes, counted from zero.
    pub steps: Steps,
    /// Whether it was homed before it is connected, as a printer is whose host has been running.
    pub homed: bool,
}

/// A stage of the process protocol: 12.5 mm to either side, 25 mm/s, 100 mm/s^2. Until it is homed, its place at power-on counts
/// as zero. Each axis moves at the requested speed. A new target is accepted during a motion too.
///
/// Homing moves z to its `away` end (with `"home_side": "toward"` to the other), then x and y to the marks in the middle of their
/// travel. Until homing is done, or ended by a `stop`, a `move` and another `prepare` are errors.
pub struct ProcessStageEmulator {
    ends_mm: [Range; 3],
    steps: Steps,
    /// Whether `status` reports that home is known.
    reports_home: bool,
    /// True place minus counted place, mm; zero once homed.
    offset_mm: [f64; 3],
    homed: bool,
    /// Limits set by `prepare`; `None` before.
    limits_mm: Option<[Range; 3]>,
    acceleration_mm_s2: f64,
    preparing: Option<Preparing>,
    faults: StageFaults,
    bell: Arc<Notify>,
}

/// `prepare` in progress.
struct Preparing {
    id: Option<i64>,
    outcome: Result<[Range; 3], String>,
    homes: bool,
    /// Time of its answer, s.
    end_s: f64,
}

impl ProcessStageEmulator {
    /// Creates a stage that is switched on at the present place of the scene's axes.
    pub fn new(scene: &Scene) -> Self {
        ProcessStageEmulator {
            ends_mm: [ENDS_MM; 3],
            steps: Steps::FINE,
            reports_home: false,
            offset_mm: Axis::ALL.map(|axis| scene.motion(axis).end_mm()),
            homed: false,
            limits_mm: None,
            acceleration_mm_s2: FIRST_MM_S2,
            preparing: None,
            faults: StageFaults::new(&[], &[]),
            bell: Arc::default(),
        }
    }

    /// Creates a stage with the mechanics of a printer.
    pub fn printer(scene: &Scene, printer: Printer) -> Self {
        let Printer { ends_mm, steps, homed } = printer;
        let stage =
            ProcessStageEmulator { ends_mm, steps, homed, reports_home: true, ..ProcessStageEmulator::new(scene) };
        if homed { ProcessStageEmulator { offset_mm: [0.0; 3], ..stage } } else { stage }
    }

    /// Gives the stage faults: at their times, and after some bytes.
    #[must_use]
    pub fn with_faults(self, timed: &[ProcessStageFault], after_bytes: &[ProcessStageFaultAfterBytes]) -> Self {
        ProcessStageEmulator { faults: StageFaults::new(timed, after_bytes), ..self }
    }
}

impl Instrument for ProcessStageEmulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.faults.pending.admit(inbox, &mut self.faults.held, take_line)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let is_lost = self.go_on(scene, now_s) || request.is_empty();
        let reply = if is_lost { Vec::new() } else { self.carry_out(request, scene, now_s) };
        self.faults.said(reply, now_s)
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        self.go_on(scene, now_s);
        if let Some(preparing) = self.preparing.take_if(|preparing| preparing.end_s <= now_s) {
            let reply = self.end_preparing(preparing);
            return Owed::Ready(self.faults.said(reply, now_s));
        }
        let prepared_s = self.preparing.as_ref().map_or(f64::INFINITY, |preparing| preparing.end_s);
        let next_s = prepared_s.min(self.faults.next_s());
        if next_s.is_finite() { Owed::At(next_s) } else { Owed::Nothing }
    }
}

impl ProcessStageEmulator {
    /// Lets the faults happen that are due. Returns whether what came last is lost in a restart.
    fn go_on(&mut self, scene: &mut Scene, now_s: f64) -> bool {
        self.faults.pending.come(now_s);
        let mut is_lost = false;
        let at_s = self.faults.next_s();
        while let Some(kind) = self.faults.pending.take(now_s, ProcessStageFaultKind::is_timed) {
            match kind {
                ProcessStageFaultKind::NeverDone => self.faults.never_done = true,
                ProcessStageFaultKind::LosesCount => self.count_from_here(scene),
                ProcessStageFaultKind::CountsJump(by_mm) => {
                    self.offset_mm = std::array::from_fn(|n| self.offset_mm[n] - by_mm[n]);
                }
                ProcessStageFaultKind::Restart => {
                    self.brake_all(scene, now_s);
                    self.count_from_here(scene);
                    (self.homed, self.limits_mm, self.preparing, self.faults.never_done) = (false, None, None, false);
                    self.faults.held.clear();
                    is_lost = at_s == now_s;
                }
                ProcessStageFaultKind::IgnoresStop => self.faults.ignores_stop = true,
                ProcessStageFaultKind::ToIsRelative => self.faults.to_is_relative = true,
                ProcessStageFaultKind::Other(lines) => {
                    for line in lines.lines() {
                        self.carry_out(line.as_bytes(), scene, now_s);
                    }
                }
                ProcessStageFaultKind::LostAnswer | ProcessStageFaultKind::DoubledAnswer => {}
            }
        }
        is_lost
    }

    fn count_from_here(&mut self, scene: &Scene) {
        self.offset_mm = Axis::ALL.map(|axis| scene.motion(axis).end_mm());
    }

    /// Carries out a request, and returns its answer, unless it is owed.
    fn carry_out(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let parsed = Request::parse(request);
        match parsed.as_ref().map(|request| (request, request.verb())) {
            Ok((_, Ok("stop"))) => self.stop(scene, now_s),
            Ok((request, Ok("speed"))) => self.change_speed(request, scene, now_s),
            Ok((request, Ok("prepare"))) if request.id().is_some() && self.preparing.is_none() => {
                self.prepare(request, scene, now_s);
            }
            _ => {
                return reply(request, |request| match request.verb()? {
                    "identify" => Ok(identity("stage")),
                    "status" => Ok(self.status(scene, now_s)),
                    "move" | "prepare" if self.preparing.is_some() => Err("the stage is being prepared".into()),
                    "move" => self.start_move(request, scene, now_s),
                    verb => Err(unknown(verb)),
                });
            }
        }
        self.bell.notify_waiters();
        Vec::new()
    }

    /// Brings the stage to rest, and starts a search for home if its home isn't known.
    fn prepare(&mut self, request: &Request, scene: &mut Scene, now_s: f64) {
        let outcome = self.begin(request, scene, now_s);
        let homes = outcome.is_ok() && !self.homed;
        self.preparing = Some(Preparing { id: request.id(), outcome, homes, end_s: rest_s(scene, now_s) });
    }

    fn begin(&mut self, request: &Request, scene: &mut Scene, now_s: f64) -> Result<[Range; 3], String> {
        let travel_mm = request.object("travel_mm")?;
        let mut limits_mm = self.ends_mm;
        for (limits_mm, axis) in limits_mm.iter_mut().zip(Axis::ALL) {
            let ends_mm =
                travel_mm.get(axis.name()).and_then(|ends| serde_json::from_value::<[f64; 2]>(ends.clone()).ok());
            let [min, max] = ends_mm.ok_or_else(|| format!("travel_mm has no range for {}", axis.name()))?;
            if !(limits_mm.min <= min && min < max && max <= limits_mm.max) {
                return Err(format!("{} can't travel from {min} to {max} mm", axis.name()));
            }
            *limits_mm = Range { min, max };
        }
        let away = request.number("away")?;
        if away.abs() != 1.0 {
            return Err("away must be +1 or -1".into());
        }
        let home_end = match request.word("home_side") {
            Some("none") if !self.homed => return Err("home isn't known".into()),
            Some("toward") => -away,
            _ => away,
        };
        let speed_mm_s = within(request.number("speed_mm_s")?, MOST_MM_S, "mm/s")?;
        let acceleration_mm_s2 = within(request.number("acceleration_mm_s2")?, MOST_MM_S2, "mm/s^2")?;
        // with the old one: a weaker brake could carry an axis past the end
        self.brake_all(scene, now_s);
        self.acceleration_mm_s2 = acceleration_mm_s2;
        if !self.homed {
            let mut from_s = now_s;
            for axes in [&[Axis::Z][..], &[Axis::X, Axis::Y]] {
                let mut end_s = from_s;
                for &axis in axes {
                    let ends_mm = self.ends_mm[axis.index()];
                    let middle_mm = (ends_mm.min + ends_mm.max) / 2.0;
                    let home_mm = if axis == Axis::Z { ends_mm.end(home_end) } else { middle_mm };
                    let brake = scene.motion(axis).clone();
                    let start_s = brake.end_s().max(from_s);
                    let state = (brake.end_mm(), 0.0);
                    let search = Trajectory::to(start_s, state, home_mm, speed_mm_s, self.acceleration_mm_s2);
                    end_s = end_s.max(search.end_s());
                    scene.set_motion(axis, brake.then(&search), now_s);
                }
                from_s = end_s;
                if home_end != away && axes == [Axis::Z] {
                    let motion = scene.motion(Axis::Z).clone();
                    let Range { min, max } = limits_mm[Axis::Z.index()];
                    let back = (motion.end_mm(), motion.end_mm().clamp(min, max));
                    let back = Trajectory::to(from_s, (back.0, 0.0), back.1, speed_mm_s, self.acceleration_mm_s2);
                    from_s = back.end_s().max(from_s);
                    scene.set_motion(Axis::Z, motion.then(&back), now_s);
                }
            }
            if from_s > now_s + SEARCH_MOST_S {
                self.brake_all(scene, now_s);
                return Err("homing would take too long at this speed".into());
            }
        }
        Ok(limits_mm)
    }

    fn end_preparing(&mut self, Preparing { id, outcome, homes, .. }: Preparing) -> Vec<u8> {
        let answer = outcome.map(|limits_mm| {
            if homes {
                (self.homed, self.offset_mm) = (true, [0.0; 3]);
            }
            self.limits_mm = Some(limits_mm);
            Map::new()
        });
        reply_line(id, answer)
    }

    fn start_move(&mut self, request: &Request, scene: &mut Scene, now_s: f64) -> ProcessReply {
        let limits_mm = self.limits_mm.ok_or("the stage isn't prepared")?;
        let speed_mm_s = within(request.number("speed_mm_s")?, MOST_MM_S, "mm/s")?;
        let rests_mm = |axis: Axis| scene.motion(axis).end_mm() - self.offset_mm[axis.index()];
        let mut targets_mm = match request.axes("to_mm")? {
            Some(by_mm) if self.faults.to_is_relative => {
                Axis::ALL.map(|axis| by_mm[axis.index()].map(|by_mm| rests_mm(axis) + by_mm))
            }
            Some(to_mm) => to_mm,
            None => self.ends_of_ways(request, scene, now_s)?,
        };
        for (axis, target_mm) in Axis::ALL.into_iter().zip(&mut targets_mm) {
            let Some(target_mm) = target_mm else { continue };
            *target_mm = round(*target_mm, 6);
            if !limits_mm[axis.index()].contains(*target_mm) {
                return Err(format!("{} = {target_mm} mm exceeds the travel", axis.name()));
            }
            let Range { min, max } = self.ends_mm[axis.index()];
            let place_mm = self.offset_mm[axis.index()] + self.nearest_mm(axis, scene.target_mm(*target_mm));
            *target_mm = place_mm.clamp(min, max);
        }
        for (axis, target_mm) in Axis::ALL.into_iter().zip(targets_mm) {
            if let Some(target_mm) = target_mm {
                self.go(axis, target_mm, speed_mm_s, scene, now_s);
            }
        }
        Ok(Map::new())
    }

    /// Targets of a move by a distance: from where each axis rests, if it reads where the request assumes it.
    fn ends_of_ways(&self, request: &Request, scene: &mut Scene, now_s: f64) -> Result<[Option<f64>; 3], String> {
        let by_mm = request.axes("by_mm")?.ok_or("to_mm is not an object, and neither is by_mm")?;
        let from_mm = request.axes("from_mm")?.unwrap_or_default();
        let mut targets_mm = [None; 3];
        for axis in Axis::ALL {
            let Some(by_mm) = by_mm[axis.index()] else { continue };
            let name = axis.name();
            if scene.motion(axis).moving(now_s) {
                return Err(format!("{name} moves"));
            }
            let (count_mm, slack_mm) =
                (self.count_mm(axis, scene, now_s), self.steps.along(axis) / 2.0 + IN_POSITION_MM);
            if let Some(from_mm) = from_mm[axis.index()].filter(|from_mm| (count_mm - from_mm).abs() > slack_mm) {
                return Err(format!("{name} is at {count_mm} mm, not at {from_mm} mm"));
            }
            targets_mm[axis.index()] = Some(scene.motion(axis).end_mm() - self.offset_mm[axis.index()] + by_mm);
        }
        Ok(targets_mm)
    }

    fn go(&self, axis: Axis, target_mm: f64, speed_mm_s: f64, scene: &mut Scene, now_s: f64) {
        let way = Trajectory::to(now_s, commanded(axis, scene, now_s), target_mm, speed_mm_s, self.acceleration_mm_s2);
        scene.set_motion(axis, way, now_s);
    }

    /// Changes the speed of moving axes. An impossible speed is ignored, because this request has no answer.
    fn change_speed(&mut self, request: &Request, scene: &mut Scene, now_s: f64) {
        let Ok(speed_mm_s) = request.number("speed_mm_s").and_then(|speed| within(speed, MOST_MM_S, "mm/s")) else {
            return;
        };
        if self.preparing.is_some() {
            return;
        }
        for axis in Axis::ALL {
            if scene.motion(axis).moving(now_s) {
                self.go(axis, scene.motion(axis).end_mm(), speed_mm_s, scene, now_s);
            }
        }
    }

    fn stop(&mut self, scene: &mut Scene, now_s: f64) {
        if self.faults.ignores_stop {
            return;
        }
        self.brake_all(scene, now_s);
        if let Some(preparing) = &mut self.preparing {
            preparing.outcome = Err("stopped while it was being prepared".into());
            preparing.end_s = rest_s(scene, now_s);
        }
    }

    fn brake_all(&self, scene: &mut Scene, now_s: f64) {
        for axis in Axis::ALL {
            scene.set_motion(axis, self.brake(axis, scene, now_s), now_s);
        }
    }

    /// Motion that brakes an axis: to rest, or to the next step after it.
    fn brake(&self, axis: Axis, scene: &Scene, now_s: f64) -> Trajectory {
        let state = commanded(axis, scene, now_s);
        let brake = Trajectory::stop(now_s, state, self.acceleration_mm_s2);
        let (step_mm, speed_mm_s) = (self.steps.along(axis), state.1);
        if step_mm == 0.0 || speed_mm_s == 0.0 {
            return brake;
        }
        let end_mm = (brake.end_mm() * speed_mm_s.signum() / step_mm).ceil() * step_mm * speed_mm_s.signum();
        Trajectory::to(now_s, state, end_mm, speed_mm_s.abs(), self.acceleration_mm_s2)
    }

    /// Position of an axis in whole steps, mm.
    fn nearest_mm(&self, axis: Axis, mm: f64) -> f64 {
        let step_mm = self.steps.along(axis);
        if step_mm > 0.0 { (mm / step_mm).round() * step_mm } else { mm }
    }

    /// Position of an axis as `status` reports it, mm: measured, or counted in steps.
    fn count_mm(&self, axis: Axis, scene: &mut Scene, now_s: f64) -> f64 {
        let offset_mm = self.offset_mm[axis.index()];
        let count_mm = match self.steps.along(axis) {
            0.0 => scene.axis(axis, now_s).0 - offset_mm,
            _ => self.nearest_mm(axis, scene.motion(axis).position_mm(now_s) - offset_mm),
        };
        (count_mm * COUNTS_PER_MM).round() / COUNTS_PER_MM + 0.0
    }

    fn status(&self, scene: &mut Scene, now_s: f64) -> Map<String, Value> {
        let moving = self.faults.never_done || Axis::ALL.into_iter().any(|axis| scene.motion(axis).moving(now_s));
        let place_mm = |axis: Axis| (axis.name().to_owned(), json!(self.count_mm(axis, scene, now_s)));
        let position_mm: Map<String, Value> = Axis::ALL.into_iter().map(place_mm).collect();
        let mut status = object(json!({ "moving": moving, "position_mm": position_mm }));
        if self.reports_home {
            status.insert("homed".into(), json!(self.homed));
        }
        status
    }
}

/// Returns a number above zero and up to `most`.
fn within(value: f64, most: f64, unit: &str) -> Result<f64, String> {
    if value > 0.0 && value <= most {
        Ok(value)
    } else {
        Err(format!("{value} {unit} is not above 0 and up to {most}"))
    }
}

/// Time at which all axes are at rest, s.
fn rest_s(scene: &Scene, now_s: f64) -> f64 {
    Axis::ALL.into_iter().map(|axis| scene.motion(axis).end_s()).fold(now_s, f64::max)
}

fn commanded(axis: Axis, scene: &Scene, now_s: f64) -> (f64, f64) {
    let motion = scene.motion(axis);
    (motion.position_mm(now_s), motion.speed_mm_s(now_s))
}
