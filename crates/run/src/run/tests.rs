//! The hand with instruments of straw: what is commanded, and what isn't.

use super::rig_control::RigControl;
use super::watched_cell::WatchedLoadCell;
use super::{Cancel, Halt, LargestForce};
use crate::rig::GroundTruth;
use palpate_control::{Believed, NoLoadReadings, Permit, SafetyRule, Timing, Trip, Watch, Zero};
use palpate_core::quantity::{
    Axis, Down, ForceReading, Frame, Health, Limits, Place, Range, StageAbilities, StageBounds, Steps, Travel,
};
use palpate_link::device::{
    AxisWay, DeviceError, DeviceProblem, HomeSearch, Identity, Instruments, LoadCell, MotionOrders, RestPlace,
    SensorArray, Stage, StageUse,
};
use palpate_link::time::{Instant, sleep};
use palpate_link::wire::Claims;
use std::cell::{Cell, RefCell};
use std::time::Duration;

const LIMITS: Limits = Limits { force_n: 2.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };

/// A stage that is where it was sent as soon as it was, and keeps its commands.
struct StrawStage<'a> {
    text: &'a RefCell<Vec<String>>,
    at_mm: [f64; 3],
    /// How long it says that a motion takes, s.
    takes_s: f64,
    /// Whether a stop ends it.
    obeys: bool,
}

impl Stage for StrawStage<'_> {
    async fn identify(&mut self, _: &StageUse) -> Result<Identity, DeviceError> {
        unreachable!("the hand gets it prepared")
    }
    async fn home(&mut self, _: &StageUse, _: &MotionOrders) -> Result<(), DeviceError> {
        unreachable!("the hand gets it prepared")
    }
    fn usage(&self) -> Option<&StageUse> {
        unreachable!("it doesn't check")
    }
    fn error(&self, _: &str, _: DeviceProblem) -> DeviceError {
        unreachable!("it doesn't fail")
    }
    async fn rest(&mut self, _: bool, _: &MotionOrders) -> Result<Option<RestPlace>, DeviceError> {
        unreachable!("it doesn't check")
    }
    async fn send(&mut self, _: &[AxisWay], _: f64, _: &StageUse, _: &MotionOrders) -> Result<(), DeviceError> {
        unreachable!("it doesn't check")
    }
    async fn begin(&mut self, ways: &[AxisWay], _: f64, _: &MotionOrders) -> Result<(), DeviceError> {
        for way in ways {
            self.text.borrow_mut().push(format!("{} to {}", way.axis.name(), way.to_mm()));
            self.at_mm[way.axis.index()] = way.to_mm();
        }
        Ok(())
    }
    async fn follow(&mut self, axes: &[Axis], _: Duration, orders: &MotionOrders) -> Result<Vec<f64>, DeviceError> {
        tokio::select! {
            biased;
            () = orders.pulled().notified(), if self.obeys => self.text.borrow_mut().push("stop".to_owned()),
            () = sleep(Duration::from_secs_f64(self.takes_s)) => {}
        }
        Ok(axes.iter().map(|axis| self.at_mm[axis.index()]).collect())
    }
    async fn position_mm(&mut self, axis: Axis, _: &MotionOrders) -> Result<f64, DeviceError> {
        Ok(self.at_mm[axis.index()])
    }
    async fn stop(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }
    async fn abort(&mut self) -> Result<(), DeviceError> {
        self.text.borrow_mut().push("abort".to_owned());
        Ok(())
    }
    async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
        Ok(Vec::new())
    }
}

/// A load cell that reads one force before an instant and another after it.
struct StrawCell {
    began: Instant,
    early_n: f64,
    late_n: f64,
    /// How fast it rises then, N/s.
    rises_n_s: f64,
    /// When that is, s.
    until_s: f64,
}

impl LoadCell for StrawCell {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        unreachable!("the hand gets it prepared")
    }
    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        sleep(Duration::from_millis(1)).await;
        let at_s = self.began.elapsed().as_secs_f64();
        let late_n = self.late_n + self.rises_n_s * (at_s - self.until_s);
        let force_n = if at_s < self.until_s { self.early_n } else { late_n };
        Ok(ForceReading { at_s, force_n, side_n: None, health: Health::default() })
    }
    fn conversion(&self) -> Duration {
        Duration::from_millis(5)
    }
}

struct StrawArray;

impl SensorArray for StrawArray {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        unreachable!("the hand gets it prepared")
    }
    async fn read(&mut self, outputs: &mut [f64]) -> Result<(), DeviceError> {
        outputs.fill(0.25);
        Ok(())
    }
    fn units(&self) -> usize {
        2
    }
}

fn rig_control<'a>(
    text: &'a RefCell<Vec<String>>,
    cancel: &'a Cancel,
    (early_n, late_n): (f64, f64),
) -> RigControl<'a, StrawStage<'a>, StrawCell, StrawArray> {
    let zero = Zero::with_noise(0.003);
    let cell = StrawCell { began: Instant::now(), early_n, late_n, rises_n_s: 0.0, until_s: 0.2 };
    let parts = Instruments {
        stage: StrawStage { text, at_mm: [0.0; 3], takes_s: 0.4, obeys: true },
        load_cell: WatchedLoadCell::new(cell, Watch::new(&LIMITS, zero), cancel, &|_| {}),
        array: StrawArray,
    };
    let frame = Frame::level(0.0, 0.3, Down::Minus);
    let usage = StageUse {
        travel: Travel { axes: [Range { min: -12.5, max: 12.5 }; 3] },
        away: 1.0,
        speed_mm_s: 10.0,
        acceleration_mm_s2: 100.0,
        home_speed_mm_s: 2.0,
        home_z_mm: 12.5,
        homed: false,
        z_holds_unpowered: false,
        by_hand: false,
        steps: Steps::FINE,
        home_search: HomeSearch::Away,
        abilities: StageAbilities::FULL,
    };
    let timing = Timing {
        exchange_s: 0.02,
        settle_s: 0.01,
        lag_s: 0.0,
        conversion_s: 0.005,
        acceleration_mm_s2: 100.0,
        reaction_s: 0.05,
    };
    let mut rig_control =
        RigControl::new(parts, frame, usage, timing, GroundTruth::new(None, Instant::now()), Claims::default());
    rig_control.no_load = vec![0.1, 0.2];
    rig_control
}

fn permit() -> Permit {
    let zero = Zero::with_noise(0.003);
    Permit::new(LIMITS, StageBounds::fine(100.0), 0.05, &zero)
}

fn rule(result: Result<(), Halt>) -> SafetyRule {
    match result {
        Err(Halt::Tripped(trip)) => trip.rule,
        other => panic!("{other:?}"),
    }
}

#[tokio::test(start_paused = true)]
async fn sideways_motion_needs_clearance() {
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let mut rig_control = rig_control(&text, &cancel, (0.0, 0.0));
    rig_control.z_mm = -0.12;
    assert_eq!(rule(rig_control.travel(Place::new(1.0, 0.0), &permit(), -0.1).await), SafetyRule::NotPermitted);
    assert!(text.borrow().is_empty());
    rig_control.z_mm = -0.14;
    rig_control.travel(Place::new(1.0, 0.0), &permit(), -0.1).await.unwrap();
    assert_eq!(*text.borrow(), ["x to 1", "y to 0"]);
}

#[tokio::test(start_paused = true)]
async fn sideways_motion_under_force_is_refused() {
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let mut rig_control = rig_control(&text, &cancel, (0.05, 0.05));
    rig_control.z_mm = -1.0;
    assert_eq!(rule(rig_control.travel(Place::new(1.0, 0.0), &permit(), 0.0).await), SafetyRule::StillTouching);
    assert!(text.borrow().is_empty());
}

/// A retraction that the permit grants, to this z.
fn away(z_mm: f64) -> palpate_control::Permitted {
    permit().retract(1.0, z_mm, 10.0).unwrap()
}

#[tokio::test(start_paused = true)]
async fn x_and_y_move_once_z_reads_back_clear() {
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let mut rig_control = rig_control(&text, &cancel, (0.0, 0.0));
    rig_control.z_mm = 0.8;
    rig_control.leave_contact(away(-0.1), Place::new(0.5, 0.0), &permit(), 0.0).await.unwrap();
    assert_eq!(*text.borrow(), ["z to 0.1", "x to 0.5", "y to 0"]);
    assert_eq!((rig_control.place, rig_control.z_mm), (Place::new(0.5, 0.0), -0.1));
    let no_load = rig_control.cell.end_no_load().await.unwrap();
    assert!(no_load.readings > palpate_control::NO_LOAD_READINGS && no_load.mean_n == 0.0, "{no_load:?}");
}

#[tokio::test(start_paused = true)]
async fn x_and_y_do_not_move_unless_z_is_clear_and_the_contact_is_over() {
    for (force_n, clear_mm, broken) in [(0.0, -0.02, SafetyRule::NotPermitted), (0.05, -0.1, SafetyRule::StillTouching)]
    {
        let (text, cancel) = (RefCell::default(), Cancel::default());
        let mut rig_control = rig_control(&text, &cancel, (force_n, force_n));
        rig_control.z_mm = 0.8;
        assert_eq!(rule(rig_control.leave_contact(away(clear_mm), Place::new(0.5, 0.0), &permit(), 0.0).await), broken);
        assert!(text.borrow().iter().any(|text| text.starts_with('z')), "{text:?}");
        assert!(text.borrow().iter().all(|text| !text.starts_with(['x', 'y'])), "{text:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn contact_after_x_and_y_have_begun_stops_them() {
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let mut rig_control = rig_control(&text, &cancel, (0.0, 0.05));
    rig_control.z_mm = 0.5;
    let left_contact = rig_control.leave_contact(away(-0.1), Place::new(5.0, 0.0), &permit(), 0.0).await;
    assert_eq!(rule(left_contact), SafetyRule::StillTouching);
    assert_eq!(text.borrow().last().map(String::as_str), Some("stop"));
}

#[tokio::test(start_paused = true)]
async fn retraction_stops_where_the_force_rises() {
    // pressed and then free, by a right cell and by one with the wrong sign; then into an obstacle
    for (forces_n, rises) in [((1.0, 0.0), false), ((-1.0, 0.0), false), ((0.0, 0.5), true), ((1.0, 1.5), true)] {
        let (text, cancel) = (RefCell::default(), Cancel::default());
        let mut rig_control = rig_control(&text, &cancel, forces_n);
        rig_control.cell.cell.device.until_s = 0.6; // half-way: the stage takes 0.4 s to report rest, and as long to retract
        let retracted = rig_control.retract(-0.3).await;
        if rises {
            assert_eq!(rule(retracted), SafetyRule::ForceRose, "{forces_n:?}");
            // the array shows nothing here: one short retraction is allowed after the stop, and no more
            assert_eq!(text.borrow()[1..], ["stop", "z to 0.3"], "{forces_n:?}");
        } else {
            assert!(retracted.is_ok(), "{forces_n:?}: {retracted:?}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn an_end_takes_no_longer_than_the_way_up_and_five_seconds() {
    // the stage takes a minute for each motion, which is also what a stage does that is busy without end
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let mut rig_control = rig_control(&text, &cancel, (1.0, 1.0));
    rig_control.stage.takes_s = 60.0;
    let began = Instant::now();
    let left = rig_control.leave(Some(&Halt::Cancelled), -0.3, &LIMITS).await.unwrap_err();
    // 25 mm at 10 mm/s, twice, and 5 s
    let Halt::Device(error) = left else { panic!("{left:?}") };
    assert!(error.to_string().contains("isn't parked after 10 s: press the emergency stop"), "{error}");
    assert!(began.elapsed() <= Duration::from_millis(10_001), "{:?}", began.elapsed());
}

#[tokio::test(start_paused = true)]
async fn a_force_that_no_stop_ends_takes_the_last_resort() {
    // it is a tenth over the limit of 2 N, and rises; a stage that rests in contact is freed by its way out
    for (force_n, rises_n_s, aborts) in [(2.1, 0.01, false), (2.5, 0.0, false), (2.5, 5.0, true)] {
        let (text, cancel) = (RefCell::default(), Cancel::default());
        let mut rig_control = rig_control(&text, &cancel, (0.0, force_n));
        rig_control.cell.cell.device.rises_n_s = rises_n_s;
        rig_control.stage.obeys = false;
        rig_control.stage.takes_s = 1.0;
        rig_control.z_mm = 0.5;
        let began = Instant::now();
        let halt = rig_control.move_z(away(0.0), None).await.unwrap_err();
        assert!(matches!(&halt, Halt::Tripped(trip) if trip.rule == SafetyRule::OverForce), "{halt:?}");
        // the motion that doesn't end is given up, not waited for
        assert_eq!(began.elapsed() < Duration::from_millis(500), aborts, "{:?}", began.elapsed());
        let _ = rig_control.leave(Some(&halt), -0.3, &LIMITS).await;
        assert_eq!(text.borrow().iter().any(|text| text == "abort"), aborts, "{text:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn the_depth_at_a_trip_says_what_the_force_may_have_been() {
    let tripped = Halt::Tripped(Trip::new(SafetyRule::OverForce, 2.1, 2.0, "N"));
    // 2 mm below the nominal surface, which is uncertain by 0.3 mm, at 2 N/mm
    for (halt, expected_n) in [(tripped, Some(4.6)), (Halt::Cancelled, None)] {
        let (text, cancel) = (RefCell::default(), Cancel::default());
        let mut rig_control = rig_control(&text, &cancel, (0.0, 0.0));
        rig_control.stage.at_mm[2] = -2.0;
        let _ = rig_control.leave(Some(&halt), -0.3, &LIMITS).await;
        assert_eq!(rig_control.by_depth_n, expected_n, "{halt:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn the_largest_force_is_what_two_successive_readings_reached() {
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let mut rig_control = rig_control(&text, &cancel, (1.5, 0.2));
    assert_eq!(rig_control.largest(), None, "nothing was read");
    let cell = &mut rig_control.cell.cell;
    cell.device.until_s = 0.0015; // one reading
    for _ in 0..3 {
        cell.read().await.unwrap();
    }
    assert_eq!(
        rig_control.largest(),
        Some(LargestForce { force_n: 0.2, is_least: false, by_depth_n: None }),
        "one reading is none"
    );
    let cell = &mut rig_control.cell.cell;
    cell.device.until_s = f64::INFINITY;
    for _ in 0..2 {
        cell.read().await.unwrap();
    }
    assert_eq!(rig_control.largest(), Some(LargestForce { force_n: 1.5, is_least: false, by_depth_n: None }));
}

#[tokio::test(start_paused = true)]
async fn the_largest_force_stays_when_forces_count_from_newer_air() {
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let mut rig_control = rig_control(&text, &cancel, (1.5, 1.5));
    for _ in 0..2 {
        rig_control.cell.cell.read().await.unwrap();
    }
    let mut air =
        NoLoadReadings { mean_n: -0.8, sigma_n: 0.003, readings: 100, at_s: 20.0, ..NoLoadReadings::default() };
    rig_control.cell.count_from(&mut air);
    assert_eq!(rig_control.largest().map(|largest| largest.force_n), Some(1.5));
}

#[tokio::test(start_paused = true)]
async fn readings_that_are_left_out_are_no_largest_force() {
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let mut rig_control = rig_control(&text, &cancel, (1.5, 0.2));
    let mut believed = Believed::new(2.0, 0.001, 0.0);
    believed.rests_at(0.2, 0.0);
    rig_control.cell.believed = Some(believed);
    rig_control.cell.cell.device.until_s = 0.0085; // two readings
    for _ in 0..2 {
        assert_eq!(rig_control.cell.force_n().await.unwrap(), 0.2);
    }
    assert_eq!(rig_control.cell.glitches().left_out, 2);
    assert_eq!(rig_control.largest().map(|largest| largest.force_n), Some(0.2));
}

#[tokio::test(start_paused = true)]
async fn stage_that_becomes_silent_in_a_motion_trips() {
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let mut rig_control = rig_control(&text, &cancel, (0.0, 0.0));
    rig_control.stage.takes_s = 30.0;
    rig_control.z_mm = 0.5;
    let began = Instant::now();
    assert_eq!(rule(rig_control.move_z(away(0.0), None).await), SafetyRule::StageSilent);
    assert!(began.elapsed() < Duration::from_secs(1));
    assert_eq!(*text.borrow(), ["z to 0", "stop"]);
}

#[tokio::test(start_paused = true)]
async fn contact_on_the_way_stops_it() {
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let mut rig_control = rig_control(&text, &cancel, (0.0, 0.05));
    rig_control.z_mm = -1.0;
    assert_eq!(rule(rig_control.travel(Place::new(1.0, 0.0), &permit(), 0.0).await), SafetyRule::StillTouching);
    assert_eq!(*text.borrow(), ["x to 1", "y to 0", "stop"]);
}

#[tokio::test(start_paused = true)]
async fn window_outputs_count_from_those_without_load() {
    let (text, cancel) = (RefCell::default(), Cancel::default());
    let window = rig_control(&text, &cancel, (0.5, 0.5)).sample(0.1, None).await.unwrap();
    assert!((window.outputs[0] - 0.15).abs() < 1e-12 && (window.outputs[1] - 0.05).abs() < 1e-12);
    assert!((window.force_n - 0.5).abs() < 1e-12);
}

#[tokio::test(start_paused = true)]
async fn every_force_is_shown_with_its_age() {
    let (text, cancel, shown) = (RefCell::default(), Cancel::default(), Cell::new(0.0));
    let mut rig_control = rig_control(&text, &cancel, (0.5, 0.5));
    let show = |force_n| shown.set(force_n);
    rig_control.cell.shown = &show;
    assert_eq!(rig_control.cell.age_s(), f64::INFINITY);
    rig_control.cell.force_n().await.unwrap();
    sleep(Duration::from_millis(300)).await;
    assert_eq!(shown.get(), 0.5);
    assert!((rig_control.cell.age_s() - 0.3).abs() < 1e-6);
    cancel.ask();
    assert!(matches!(rig_control.cell.force_n().await, Err(Halt::Cancelled)));
}
