//! Stages: their reported positions are compared with the possible ones, and their final positions with their targets.

use super::{BadLineOutcome, BadLineSubject, rig};
use palpate_core::parallel::lock;
use palpate_core::quantity::{Axis, RandomStream, Range, StageAbilities, Steps, Travel, stream};
use palpate_drivers::grbl::Grbl;
use palpate_drivers::process::ProcessStage;
use palpate_drivers::xps::{Grouping, Xps};
use palpate_drivers::{AnyStage, Esp301};
use palpate_link::device::{AxisWay, DeviceError, HomeSearch, MotionOrders, Stage, StageUse};
use palpate_link::time::{Instant, sleep, timeout};
use palpate_sim::emulator::{self, GrblBoard, Instrument, Shared};
use palpate_sim::scene::Scene;
use palpate_testing::bad_line::{BadLineFate, Framing, connector};
use palpate_testing::made_ready;
use rand::RngExt;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Longest wait for a program's first answer.
const START: Duration = Duration::from_secs(10);

/// Largest error of a true position, mm: a step of GRBL, and a last decimal.
const TOLERANCE_MM: f64 = 0.003;

/// Distance from its target at which an axis is elsewhere, mm: a caller would notice it.
const NOTICED_MM: f64 = 0.02;

/// Time until all motions have ended, s.
const AFTERWARDS: Duration = Duration::from_secs(60);

/// Longest calls, s, from the deadlines and retries that the drivers name. Each begins with resynchronising the link.
struct Deadlines {
    /// One question.
    ask_s: f64,
    begin_s: f64,
    stop_s: f64,
    /// In addition to the duration of the motion.
    follow_s: f64,
    prepare_s: f64,
}

/// Largest number of messages of a call, and per second: a driver asks repeatedly while it waits for a motion.
const MESSAGES_MOST: usize = 128;
const MESSAGES_A_SECOND: f64 = 520.0;

fn deadlines(subject: BadLineSubject) -> Deadlines {
    match subject {
        BadLineSubject::Esp301 => {
            Deadlines { ask_s: 40.0, begin_s: 40.0, stop_s: 6.0, follow_s: 60.0, prepare_s: 600.0 }
        }
        BadLineSubject::Xps => Deadlines { ask_s: 4.0, begin_s: 50.0, stop_s: 8.0, follow_s: 80.0, prepare_s: 300.0 },
        BadLineSubject::Grbl => {
            Deadlines { ask_s: 45.0, begin_s: 60.0, stop_s: 1.0, follow_s: 180.0, prepare_s: 300.0 }
        }
        _ => Deadlines { ask_s: 4.0, begin_s: 4.0, stop_s: 2.0, follow_s: 20.0, prepare_s: 130.0 },
    }
}

/// A stage under test.
struct BadStageTrial {
    subject: BadLineSubject,
    stage: AnyStage,
    fate: Shared<BadLineFate>,
    rng: RandomStream,
    bad: bool,
    outcome: BadLineOutcome,
    /// True position minus counted one, mm, of each axis: the value at power-up, and none after homing.
    off_mm: [Vec<f64>; 3],
    /// Target of each axis, and its possible positions without one, true mm.
    sent_mm: [Vec<f64>; 3],
    /// Where each axis rests by the last read-back, mm; `None` after an error.
    at_mm: Option<[f64; 3]>,
    scene: Shared<Scene>,
    /// Whether it was stopped, or may have been: an error leaves that open.
    stopped: bool,
    noticed: bool,
    /// A message was garbled while it was prepared: its count may be wrong.
    lost: bool,
}

pub(super) async fn run(subject: BadLineSubject, seed: u64, bad: bool) -> BadLineOutcome {
    let origin = Instant::now();
    let stage = match subject {
        // a GRBL gets its own board below, because a simulated rig's board counts differently
        BadLineSubject::Esp301 | BadLineSubject::Grbl => r#""esp301""#,
        BadLineSubject::Xps => r#"{ xps = "XYZ" }"#,
        _ => r#"{ process = ["x"] }"#,
    };
    let cell =
        if subject == BadLineSubject::ProcessStage { r#"{ process = ["x"] }"# } else { r#"{ modbus = "labjack-t7" }"# };
    let simulated = rig(stage, cell, cell).emulators(seed).expect("emulators");
    let scene = simulated.scene.clone();
    let device: Shared<dyn Instrument> = match subject {
        // its frame is that of the others, and counts from minus its travel
        BadLineSubject::Grbl => {
            let board = GrblBoard { plus_ends_mm: [12.5; 3], ..GrblBoard::default() };
            Arc::new(Mutex::new(emulator::GrblEmulator::new(board, &lock(&scene))))
        }
        _ => simulated.stage.instrument().expect("it has a link").clone(),
    };
    let fate = BadLineFate::new(seed, scene.clone(), origin);
    let mut rng = stream(seed, 1, "bad line");
    let power_on_mm = Axis::ALL.map(|axis| lock(&scene).motion(axis).end_mm());
    if subject == BadLineSubject::Esp301 && rng.random_bool(0.9) {
        switch_on(&device, &scene); // a search for home takes thousands of messages
    }
    let trial = BadStageTrial {
        subject,
        stage: driver(subject, device, &scene, origin, &fate),
        fate,
        rng,
        bad,
        outcome: BadLineOutcome::default(),
        off_mm: power_on_mm.map(|place_mm| vec![-middle_mm(subject), place_mm]),
        // where each axis homes: at an end, off it, or in the middle
        sent_mm: power_on_mm.map(|place_mm| vec![place_mm, 0.0, -12.5, 12.0, 12.5]),
        at_mm: None,
        scene: scene.clone(),
        stopped: false,
        noticed: false,
        lost: false,
    };
    trial.run(&scene).await
}

impl BadStageTrial {
    async fn run(mut self, scene: &Shared<Scene>) -> BadLineOutcome {
        let clean = self.rng.random_bool(0.75);
        lock(&self.fate).bad = self.bad && !clean;
        let usage = StageUse {
            travel: Travel { axes: [travel(self.subject); 3] },
            away: 1.0,
            speed_mm_s: 10.0,
            acceleration_mm_s2: 100.0,
            home_speed_mm_s: 5.0,
            home_z_mm: 12.5,
            homed: false,
            z_holds_unpowered: false,
            by_hand: false,
            steps: Steps::FINE,
            home_search: HomeSearch::Away,
            abilities: StageAbilities::FULL,
        };
        let orders = MotionOrders::default();
        let limit_s = deadlines(self.subject).prepare_s;
        let fate = self.fate.clone();
        let prepared =
            call("prepare", limit_s, &mut self.outcome, &fate, made_ready(&mut self.stage, &usage, &orders)).await;
        let prepared = self.note(prepared).is_some();
        assert!(prepared || !clean && self.bad, "it can't be prepared on a good line");
        self.lost = !lock(&fate).altered_s.is_empty();
        if prepared {
            // after its preparation it goes where it is sent
            let at_mm = Axis::ALL.map(|axis| lock(scene).motion(axis).end_mm());
            (self.sent_mm, self.stopped) = (at_mm.map(|place_mm| vec![place_mm]), false);
            lock(&fate).bad = self.bad;
            if self.bad && self.rng.random_bool(0.25) {
                lock(&fate).close_in = Some(self.rng.random_range(1..60));
            }
            for _ in 0..self.rng.random_range(2..6) {
                self.act().await;
            }
        }
        let BadStageTrial { stage, fate, mut outcome, sent_mm, stopped, noticed, .. } = self;
        drop(stage);
        sleep(AFTERWARDS).await;
        let now_s = lock(&fate).now_s();
        for axis in Axis::ALL {
            let motion = lock(scene).motion(axis).clone();
            let (end_mm, sent_mm) = (motion.position_mm(now_s), &sent_mm[axis.index()]);
            let is_sent = sent_mm.iter().any(|sent_mm| (sent_mm - end_mm).abs() < TOLERANCE_MM);
            let (least_mm, most_mm) = sent_mm.iter().fold((f64::MAX, f64::MIN), |(a, b), mm| (a.min(*mm), b.max(*mm)));
            let on_the_way = stopped && end_mm > least_mm - TOLERANCE_MM && end_mm < most_mm + TOLERANCE_MM;
            let altered = lock(&fate).altered_command;
            if motion.moving(now_s) && !altered {
                outcome.broken.push(format!("{} still moves after it all", axis.name()));
            } else if !is_sent && !on_the_way {
                if altered {
                    outcome.elsewhere += 1;
                    outcome.unnoticed += usize::from(!noticed);
                } else {
                    outcome.broken.push(format!("{} ends at {end_mm} mm, sent to {sent_mm:?}", axis.name()));
                }
            }
        }
        outcome
    }

    /// One operation of a stage.
    async fn act(&mut self) {
        match self.rng.random_range(0..10) {
            0..7 => self.move_somewhere().await,
            7..9 => {
                let axis = Axis::ALL[self.rng.random_range(0..3)];
                self.ask(axis).await;
            }
            _ => self.stop().await,
        }
    }

    async fn move_somewhere(&mut self) {
        let mut axes = Axis::ALL.to_vec();
        let gone = self.rng.random_range(0..3);
        axes.remove(gone);
        axes.truncate(self.rng.random_range(1..3));
        let middle_mm = middle_mm(self.subject);
        let mut target_mm = || (self.rng.random_range(-3.0..3.0f64) * 1e3).round() / 1e3 + middle_mm;
        let targets: Vec<(Axis, f64)> = axes.iter().map(|&axis| (axis, target_mm())).collect();
        let Some(at_mm) = self.rest().await else { return };
        let way = |(axis, target_mm): &(Axis, f64)| AxisWay::between(*axis, at_mm[axis.index()], *target_mm);
        let ways: Vec<AxisWay> = targets.iter().map(way).collect();
        for way in &ways {
            let true_mm = lock(&self.scene).motion(way.axis).end_mm() + way.by_mm;
            self.sent_mm[way.axis.index()].push(true_mm.clamp(-12.5, 12.5));
        }
        let speed_mm_s = self.rng.random_range(2.0..10.0);
        let (fate, deadlines) = (self.fate.clone(), deadlines(self.subject));
        let begun = call(
            "begin",
            deadlines.begin_s,
            &mut self.outcome,
            &fate,
            self.stage.begin(&ways, speed_mm_s, &MotionOrders::default()),
        )
        .await;
        if self.note(begun).is_none() && self.rng.random_bool(0.5) {
            return;
        }
        if self.rng.random_bool(0.2) {
            self.ask(axes[0]).await; // in motion
        }
        let expected = Duration::from_secs_f64(6.0 / speed_mm_s + 0.2);
        let orders = MotionOrders::default();
        let pulls = if self.rng.random_bool(0.3) { Some(self.rng.random_range(0.0..1.0)) } else { None };
        let speed = if self.rng.random_bool(0.2) { Some(self.rng.random_range(0.0..0.5)) } else { None };
        let pull = async {
            if let Some(after_s) = speed {
                sleep(Duration::from_secs_f64(after_s)).await;
                orders.speed(1.0 + 5.0 * after_s);
            }
            if let Some(after_s) = pulls {
                sleep(Duration::from_secs_f64(after_s)).await;
                orders.stop();
            }
        };
        // one of its speeds stops and restarts
        self.stopped |= pulls.is_some() || speed.is_some();
        let from_s = lock(&fate).now_s();
        let limit_s = 2.0 * expected.as_secs_f64() + deadlines.follow_s;
        let follow = async {
            let followed = self.stage.follow(&axes, expected, &orders);
            tokio::pin!(followed);
            tokio::select! {
                biased;
                followed = &mut followed => followed,
                () = async { pull.await; std::future::pending().await } => unreachable!("it waits for ever"),
            }
        };
        let followed = call("follow", limit_s, &mut self.outcome, &fate, follow).await;
        let Some(places_mm) = self.note(followed) else { return };
        if let Some(at_mm) = &mut self.at_mm {
            axes.iter().zip(&places_mm).for_each(|(axis, place_mm)| at_mm[axis.index()] = *place_mm);
        }
        lock(&fate).look();
        let to_s = lock(&fate).now_s();
        for ((axis, target_mm), place_mm) in targets.iter().zip(&places_mm) {
            let stands = !lock(&fate).moves(*axis);
            self.judge("follow", *axis, *place_mm, (from_s, to_s), stands);
            self.noticed |= pulls.is_none() && (target_mm - place_mm).abs() > NOTICED_MM;
        }
    }

    /// Returns where the axes rest. After an error the stage is stopped and read back, as a run does.
    async fn rest(&mut self) -> Option<[f64; 3]> {
        if self.at_mm.is_none() {
            self.stop().await;
            let (fate, limit_s) = (self.fate.clone(), 10.0 + deadlines(self.subject).follow_s);
            let orders = MotionOrders::default();
            let follow = self.stage.follow(&Axis::ALL, Duration::ZERO, &orders);
            let followed = call("follow", limit_s, &mut self.outcome, &fate, follow).await;
            self.at_mm = self.note(followed).and_then(|places_mm| places_mm.try_into().ok());
        }
        self.at_mm
    }

    async fn ask(&mut self, axis: Axis) {
        let (fate, limit_s) = (self.fate.clone(), deadlines(self.subject).ask_s);
        let from_s = lock(&fate).now_s();
        let asked =
            call("position", limit_s, &mut self.outcome, &fate, self.stage.position_mm(axis, &MotionOrders::default()))
                .await;
        let Some(place_mm) = self.note(asked) else { return };
        lock(&fate).look();
        let to_s = lock(&fate).now_s();
        self.judge("position", axis, place_mm, (from_s, to_s), true);
    }

    async fn stop(&mut self) {
        self.stopped = true;
        let (fate, limit_s) = (self.fate.clone(), deadlines(self.subject).stop_s);
        let stopped = call("stop", limit_s, &mut self.outcome, &fate, self.stage.stop()).await;
        self.note(stopped);
    }

    fn judge(&mut self, name: &str, axis: Axis, place_mm: f64, (from_s, to_s): (f64, f64), stands: bool) {
        let fate = lock(&self.fate);
        let is_true = self.off_mm[axis.index()]
            .iter()
            .any(|off_mm| fate.could_be(axis, (from_s, to_s), place_mm + off_mm, TOLERANCE_MM));
        if is_true && stands {
            self.outcome.values += 1;
            return;
        }
        let in_range = (place_mm - middle_mm(self.subject)).abs() <= 12.5 + 0.1;
        let (altered, stray) = fate.happened(from_s, to_s);
        drop(fate);
        let altered = altered || self.lost;
        let output = || {
            format!(
                "{name} of {} gave {place_mm} mm between {from_s} and {to_s} s, stands {stands}, altered {altered}, stray \
                 {stray}",
                axis.name()
            )
        };
        self.outcome.judge(self.subject, altered && in_range, stray && in_range, output);
    }

    /// Result of a call; errors are counted.
    fn note<T>(&mut self, came: Result<T, DeviceError>) -> Option<T> {
        if let Err(error) = &came {
            assert!(self.bad, "an error on a good line: {error}");
            self.outcome.errors += 1;
            (self.noticed, self.stopped, self.at_mm) = (true, true, None);
        }
        came.ok()
    }
}

/// The stage's count in the middle of its frame after homing, mm: a stock GRBL counts from minus its travel to 0.
fn middle_mm(subject: BadLineSubject) -> f64 {
    if subject == BadLineSubject::Grbl { -12.5 } else { 0.0 }
}

/// Its travel: that of a stock GRBL ends off its switch.
fn travel(subject: BadLineSubject) -> Range {
    if subject == BadLineSubject::Grbl { Range { min: -25.0, max: -0.5 } } else { Range { min: -12.5, max: 12.5 } }
}

/// Carries out an operation within a limit of time and messages.
async fn call<T>(
    name: &'static str,
    limit_s: f64,
    outcome: &mut BadLineOutcome,
    fate: &Shared<BadLineFate>,
    done: impl Future<Output = T>,
) -> T {
    let (began, sent) = (Instant::now(), lock(fate).sent);
    let came = timeout(Duration::from_secs_f64(limit_s), done).await;
    let (took_s, messages) = (began.elapsed().as_secs_f64(), lock(fate).sent - sent);
    outcome.took(name, took_s, messages);
    let most = MESSAGES_MOST + (MESSAGES_A_SECOND * took_s) as usize;
    assert!(messages <= most, "{name} took {messages} messages in {took_s} s");
    came.unwrap_or_else(|_| panic!("{name} hangs"))
}

/// Motors on: the driver takes it as homed.
fn switch_on(device: &Shared<dyn Instrument>, scene: &Shared<Scene>) {
    let (mut device, mut scene) = (lock(device), lock(scene));
    let mut inbox = b"1MO;2MO;3MO\r".to_vec();
    while let Some(request) = device.take_request(&mut inbox) {
        device.answer(&request, &mut scene, 0.0);
    }
}

fn driver(
    subject: BadLineSubject,
    device: Shared<dyn Instrument>,
    scene: &Shared<Scene>,
    origin: Instant,
    fate: &Shared<BadLineFate>,
) -> AnyStage {
    let link = |framing| connector(framing, device.clone(), scene.clone(), origin, fate.clone());
    let name = || "bad".to_owned();
    match subject {
        BadLineSubject::Esp301 => AnyStage::Esp301(Esp301::new(link(Framing::Esp301), name())),
        BadLineSubject::Xps => {
            let grouping = Grouping::one("XYZ", ["X", "Y", "Z"], true);
            AnyStage::Xps(Box::new(Xps::new(|| link(Framing::Xps), name(), grouping, None)))
        }
        BadLineSubject::Grbl => AnyStage::Grbl(Grbl::new(link(Framing::Grbl), name())),
        _ => AnyStage::Process(ProcessStage::new(link(Framing::Process), name(), START)),
    }
}
