//! Stage behind a program of the user.

use super::port::{JsonObject, PREPARE_DEADLINE, ProgramPort};
use crate::MOTION_MARGIN;
use palpate_core::quantity::Axis;
use palpate_link::device::{
    AxisWay, DeviceError, DeviceProblem, HomeSearch, Identity, MotionOrders, RestPlace, STARTING, Stage, StageUse,
};
use palpate_link::time::{Instant, sleep_until};
use palpate_link::wire::Connector;
use serde_json::{Value, json};
use std::time::Duration;

/// Interval of status questions while a motion is late.
const STATUS_EVERY: Duration = Duration::from_millis(2);

/// Rounding of reported positions, mm.
const REPORT_ROUNDING_MM: f64 = 1e-4;

/// Largest number of stored error messages. Further messages add nothing new.
const COMPLAINTS_MAX: usize = 16;

/// A stage behind a program.
pub struct ProcessStage {
    port: ProgramPort,
    /// Use of the stage, which limits the travel of the axes; `None` before the stage is prepared.
    usage: Option<StageUse>,
    /// Where the axes rest, as the program counts it, before a motion that isn't the way out; mm. Its steps may have led it to another
    /// place than it was sent to.
    rests_mm: Option<[f64; 3]>,
    complaints: Vec<String>,
}

struct StageStatus {
    moving: bool,
    position_mm: [f64; 3],
    /// Whether home is known; `false` if the program doesn't report it.
    homed: bool,
}

impl ProcessStage {
    /// Creates a stage behind a link; nothing is sent yet.
    /// `start` is the longest time until the program answers for the first time.
    pub fn new(connector: Connector, link: String, start: Duration) -> Self {
        let port = ProgramPort::new(connector, "stage", link, start);
        ProcessStage { port, usage: None, rests_mm: None, complaints: Vec::new() }
    }

    async fn status(&mut self, doing: &str, orders: Option<&MotionOrders>) -> Result<StageStatus, DeviceError> {
        let said = self.port.ask(doing, "status", JsonObject::new(), orders).await?;
        for complaint in said.get("complaints").and_then(Value::as_array).into_iter().flatten() {
            if self.complaints.len() < COMPLAINTS_MAX {
                self.complaints.push(complaint.as_str().map_or_else(|| complaint.to_string(), str::to_owned));
            }
        }
        let along = |axis: Axis| {
            let place_mm = said.get("position_mm")?.get(axis.name())?.as_f64()?;
            let reachable = self.usage.as_ref().is_none_or(|usage| usage.reach(axis).contains(place_mm));
            (place_mm.is_finite() && reachable).then_some(place_mm)
        };
        let homed = said.get("homed").and_then(Value::as_bool).unwrap_or(false);
        match (said.get("moving").and_then(Value::as_bool), along(Axis::X), along(Axis::Y), along(Axis::Z)) {
            (Some(moving), Some(x), Some(y), Some(z)) => Ok(StageStatus { moving, position_mm: [x, y, z], homed }),
            _ => {
                let expected = "\"moving\", and \"position_mm\" with x, y and z within the travel".to_owned();
                Err(self.port.misfit(doing, &said, expected))
            }
        }
    }
}

impl Stage for ProcessStage {
    async fn identify(&mut self, _: &StageUse) -> Result<Identity, DeviceError> {
        let (identity, _) = self.port.identify().await?;
        Ok(identity)
    }

    async fn is_homed(&mut self) -> Result<bool, DeviceError> {
        Ok(self.status("asking whether home is known", None).await?.homed)
    }

    async fn home(&mut self, usage: &StageUse, orders: &MotionOrders) -> Result<(), DeviceError> {
        let range = |axis: Axis| json!([usage.travel.along(axis).min, usage.travel.along(axis).max]);
        let request = json!({
            "travel_mm": { "x": range(Axis::X), "y": range(Axis::Y), "z": range(Axis::Z) },
            "away": usage.away,
            "speed_mm_s": usage.speed_mm_s,
            "acceleration_mm_s2": usage.acceleration_mm_s2,
            "home_speed_mm_s": usage.home_speed_mm_s,
        });
        let mut request = request.as_object().cloned().unwrap_or_default();
        let home_side = match usage.home_search {
            HomeSearch::Away => None,
            HomeSearch::Toward => Some("toward"),
            HomeSearch::Never => Some("none"),
        };
        request.extend(home_side.map(|side| ("home_side".to_owned(), json!(side))));
        let doing = "preparing it";
        self.port.ask_within(doing, "prepare", request, Some(orders), PREPARE_DEADLINE).await?;
        if self.status(doing, None).await?.moving {
            let text = "it reports that it is prepared, but it moves".to_owned();
            return Err(self.port.error(doing, DeviceProblem::Motion(text)));
        }
        self.usage = Some(usage.clone());
        self.complaints.clear();
        Ok(())
    }

    fn usage(&self) -> Option<&StageUse> {
        self.usage.as_ref()
    }

    fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        self.port.error(doing, problem)
    }

    /// The way out is open from anywhere.
    async fn rest(&mut self, is_leaving: bool, orders: &MotionOrders) -> Result<Option<RestPlace>, DeviceError> {
        self.rests_mm = None;
        if is_leaving {
            return Ok(None);
        }
        let at_mm = self.status(STARTING, Some(orders)).await?.position_mm;
        self.rests_mm = Some(at_mm);
        Ok(Some(RestPlace { at_mm, uncertainty_mm: REPORT_ROUNDING_MM }))
    }

    async fn send(
        &mut self,
        ways: &[AxisWay],
        speed_mm_s: f64,
        usage: &StageUse,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let of = |mm: &dyn Fn(&AxisWay) -> f64| -> JsonObject {
            ways.iter().map(|way| (way.axis.name().to_owned(), json!(mm(way)))).collect()
        };
        let rests_mm = self.rests_mm.take();
        let from_mm = |way: &AxisWay| rests_mm.map_or(way.from_mm, |rests_mm| rests_mm[way.axis.index()]);
        let by_mm = |way: &AxisWay| usage.from_count(way, from_mm(way), REPORT_ROUNDING_MM);
        let mut request = json!({ "by_mm": of(&by_mm), "speed_mm_s": speed_mm_s });
        if rests_mm.is_some() {
            request["from_mm"] = json!(of(&from_mm));
        }
        let request = request.as_object().cloned().unwrap_or_default();
        self.port.ask(STARTING, "move", request, Some(orders)).await.map(|_| ())
    }

    async fn follow(
        &mut self,
        axes: &[Axis],
        expected: Duration,
        orders: &MotionOrders,
    ) -> Result<Vec<f64>, DeviceError> {
        let doing = "waiting for a motion to end";
        let began = Instant::now();
        let mut look = began + expected;
        loop {
            // earlier requests waited too
            self.port.obey(doing, orders).await?;
            if orders.stopped() {
                look = look.min(Instant::now());
            }
            tokio::select! {
                biased;
                () = orders.pulled().notified() => continue,
                () = sleep_until(look) => {}
            }
            let StageStatus { moving, position_mm, .. } = self.status(doing, Some(orders)).await?;
            if !moving {
                return Ok(axes.iter().map(|axis| position_mm[axis.index()]).collect());
            }
            if began.elapsed() > expected + MOTION_MARGIN {
                self.port.stop(doing).await?;
                let text = format!("still moving {} s after it should have ended", MOTION_MARGIN.as_secs());
                return Err(self.port.error(doing, DeviceProblem::Motion(text)));
            }
            look = Instant::now() + STATUS_EVERY;
        }
    }

    async fn position_mm(&mut self, axis: Axis, orders: &MotionOrders) -> Result<f64, DeviceError> {
        Ok(self.status("reading a position", Some(orders)).await?.position_mm[axis.index()])
    }

    async fn stop(&mut self) -> Result<(), DeviceError> {
        self.port.stop("stopping").await
    }

    async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
        self.status("reading its errors", None).await?;
        Ok(std::mem::take(&mut self.complaints))
    }
}
