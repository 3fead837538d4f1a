//! Time from a force to a stop on the wire, for every stage driver, measured on the links themselves. See the histograms with `cargo test
//! --release --test control reaction:: -- --nocapture`.

use palpate_core::quantity::Axis;
use palpate_data::dataset::Memory;
use palpate_data::recipe::Entry;
use palpate_link::time::Instant;
use palpate_link::wire::Connector;
use palpate_run::rig::{Dial, EmulatedDevice, RigSpec};
use palpate_run::run::{Cancel, Halt, Listener, RunJob, execute_on};
use palpate_sim::emulator::{Instrument, Shared, serve};
use palpate_sim::scene::{FaultKind, Scene, SceneFault};
use palpate_testing::executions::{plan, run_virtually};
use palpate_testing::{campaign, exchanged, shipped_text};
use std::ops::Range;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};

const RECIPE: &str = "
name = \"reaction\"
[[step]]
phase = \"calibration\"
list = { places_mm = [[0.0, 0.0], [1.0, 0.5], [-2.0, 1.0]] }
force_n = 1.0
";

/// Added force from the fault on, N: far over any limit, and beyond the range of any converter here.
const LEAP_N: f64 = 50.0;

/// Runs of each rig; the fault comes at another time in each.
const RUNS: (usize, usize) = (12, 60);

/// Time of a message on a wire.
#[derive(Default)]
struct ReactionHeard {
    /// The first reading over the limit, on arrival.
    over: Option<Instant>,
    /// The first stop after it, or the reading itself if the motion was stopped already.
    stop: Option<Instant>,
    /// Whether the stage's last command is a stop.
    stopped: bool,
    /// Arrivals of the readings over the limit, and whether the stage moved at each.
    overs: Vec<(Instant, bool)>,
}

impl ReactionHeard {
    fn is_over(&mut self, moves: bool) {
        let now = Instant::now();
        self.overs.push((now, moves));
        if self.over.is_none() {
            (self.over, self.stop) = (Some(now), self.stopped.then_some(now));
        }
    }

    /// Commands that are sent to the stage at once are one piece of the stream.
    fn text(&mut self, piece: &[u8], stop: &[u8], motion: &[u8]) {
        let has = |word: &[u8]| piece.windows(word.len()).any(|window| window == word);
        if has(stop) {
            self.stopped = true;
            if self.over.is_some() {
                self.stop.get_or_insert(Instant::now());
            }
        } else if has(motion) {
            self.stopped = false;
        }
    }
}

/// Notes the time when the presses begin.
struct Begin(Option<Instant>);

impl Listener for Begin {
    fn begins(&mut self, _: &Entry) {
        self.0.get_or_insert(Instant::now());
    }
}

/// How stops and motions look on a stage's wire.
type ReactionWords = [&'static [u8]; 2];

/// The rigs: name, text, and the look of stops and motions on the wire of the stage.
fn rigs() -> [(&'static str, String, ReactionWords); 4] {
    // a cell whose every answer is a force
    let force_alone = |text: String| {
        let text = exchanged(&text, "modbus = \"generic-rs485\"", "modbus = \"labjack-t7\"");
        exchanged(&text, "serial:///dev/ttyUSB1?baud=115200", "tcp://192.168.1.11:502")
    };
    [
        ("esp301", force_alone(shipped_text("rigs/esp301.toml")), [b"ST\r", b"PR"]),
        (
            "xps",
            exchanged(&shipped_text("rigs/xps.toml"), ", guard = true", ""),
            [b"GroupMoveAbort", b"GroupMoveRelative"],
        ),
        ("grbl", force_alone(shipped_text("rigs/grbl.toml")), [b"\x85", b"$J="]),
        ("process", shipped_text("rigs/process.toml"), [b"{\"do\":\"stop\"}", b"\"do\":\"move\""]),
    ]
}

#[test]
fn stop_is_sent_with_the_second_sample() {
    for (name, text, words) in rigs() {
        let spec = palpate_run::rig::parse(name, &text, &|_| unreachable!()).expect("a rig").simulated();
        let period = Duration::from_secs_f64(1.0 / spec.load_cell.conversions_hz);
        let mut from_force_ms = Vec::new();
        // in a motion, and at rest
        let (mut longest, mut counts) = ([Duration::ZERO; 2], [0; 2]);
        let presses_s = presses_s(&spec);
        let runs = campaign::size(RUNS.0, RUNS.1);
        for run in 0..runs {
            let share = (run as f64 + 0.5) / runs as f64;
            let from_s = presses_s.start + share * (presses_s.end - presses_s.start);
            let (heard, origin) = tripped(&spec, from_s, words);
            let (Some(over), Some(stopped)) = (heard.over, heard.stop) else {
                panic!("{name}, fault at {from_s} s: over the limit {:?}, stop {:?}", heard.over, heard.stop)
            };
            // the second reading stops a motion; at rest the median of seven decides
            let moved = heard.overs.iter().take(2).all(|(_, moves)| *moves);
            let deciding = heard.overs.get(if moved { 1 } else { 6 }).map_or(stopped, |(at, _)| *at);
            let longest = &mut longest[usize::from(!moved)];
            *longest = (*longest).max(stopped.duration_since(deciding));
            counts[usize::from(!moved)] += 1;
            assert!(stopped >= over, "{name}");
            from_force_ms.push(1000.0 * ((stopped - origin).as_secs_f64() - from_s));
        }
        let [moving, resting] = longest;
        println!(
            "{name}: {counts:?} runs, from the deciding sample to the stop at most {moving:?}, at rest {resting:?}, period {period:?}; \
             from the force to the stop"
        );
        print!("{}", histogram(&from_force_ms));
        assert!(counts[0] > 0, "{name}: no fault in a motion");
        assert!(moving.max(resting) <= period, "{name}: {longest:?} from the sample to the stop");
    }
}

/// Begin and end of the presses without a fault, s.
fn presses_s(spec: &RigSpec) -> Range<f64> {
    run_virtually(async {
        let (plan, origin, cancel) = (plan(spec, RECIPE, 1), Instant::now(), Cancel::default());
        let (mut ledger, mut begin) = (Memory::default(), Begin(None));
        let job = RunJob { plan: &plan, spec, ledger: &mut ledger, cancel: &cancel, shown: &|_| {} };
        let ending = execute_on(spec.open(1).expect("drivers"), job, &mut begin).await;
        assert!(ending.halt.is_none(), "{:?}", ending.text());
        let last_s = ledger.contacts().last().expect("a press").levels[0].t_s.expect("a time");
        (begin.0.expect("presses") - origin).as_secs_f64()..last_s
    })
}

/// Makes a run with a force far over the limit; returns the messages, and the time when the scene began.
fn tripped(spec: &RigSpec, from_s: f64, words: ReactionWords) -> (ReactionHeard, Instant) {
    let mut spec = spec.clone();
    spec.scene.faults.push(SceneFault { kind: FaultKind::DriftedZero, from_s, value: Some(LEAP_N) });
    run_virtually(async {
        let (plan, origin) = (plan(&spec, RECIPE, 1), Instant::now());
        let simulated = spec.emulators(1).expect("emulators");
        let heard = Arc::new(Mutex::new(ReactionHeard::default()));
        let tapped = |device: &EmulatedDevice, tap: Tap| {
            let line = ReactionLine {
                instrument: device.instrument().expect("a link").clone(),
                scene: simulated.scene.clone(),
                origin,
                heard: heard.clone(),
                tap,
            };
            move |_| line.connector()
        };
        let to_stage = tapped(&simulated.stage, Tap::Stage(words));
        let from = origin + Duration::from_secs_f64(from_s);
        let to_cell = tapped(&simulated.load_cell, Tap::Over(spec.limits.force_n, from));
        let mut rig = spec.open_on(simulated).expect("drivers");
        rig.instruments.stage = spec.stage_on(Dial(&to_stage));
        rig.instruments.load_cell = spec.load_cell_on(Dial(&to_cell), origin).expect("a driver");
        let (mut ledger, cancel) = (Memory::default(), Cancel::default());
        let job = RunJob { plan: &plan, spec: &spec, ledger: &mut ledger, cancel: &cancel, shown: &|_| {} };
        let ending = execute_on(rig, job, &mut Begin(None)).await;
        assert!(matches!(ending.halt, Some(Halt::Tripped(_))), "at {from_s} s: {:?}", ending.text());
        let heard = std::mem::take(&mut *heard.lock().unwrap());
        (heard, origin)
    })
}

/// What is observed on a link.
#[derive(Clone, Copy)]
enum Tap {
    /// Stops and motions to the device.
    Stage(ReactionWords),
    /// A force over this value, N, after a time: answers during identification aren't forces.
    Over(f64, Instant),
}

/// A device behind an observed link.
struct ReactionLine {
    instrument: Shared<dyn Instrument>,
    scene: Shared<Scene>,
    origin: Instant,
    heard: Arc<Mutex<ReactionHeard>>,
    tap: Tap,
}

impl ReactionLine {
    fn connector(&self) -> Connector {
        let (instrument, scene, origin) = (self.instrument.clone(), self.scene.clone(), self.origin);
        let (heard, tap) = (self.heard.clone(), self.tap);
        Connector::in_memory(move || {
            let ((near, beside), (behind, far)) = (duplex(4096), duplex(4096));
            palpate_link::time::spawn(serve(far, instrument.clone(), scene.clone(), origin));
            let moves = Moves { scene: scene.clone(), origin };
            palpate_link::time::spawn(relay(beside, behind, heard.clone(), (tap, moves)));
            near
        })
    }
}

/// Whether an axis of a scene moves.
struct Moves {
    scene: Shared<Scene>,
    origin: Instant,
}

impl Moves {
    fn now(&self) -> bool {
        let (scene, now_s) = (self.scene.lock().unwrap(), self.origin.elapsed().as_secs_f64());
        Axis::ALL.into_iter().any(|axis| scene.motion(axis).moving(now_s))
    }
}

/// Passes bytes on at once in both directions.
async fn relay(
    mut near: DuplexStream,
    mut far: DuplexStream,
    heard: Arc<Mutex<ReactionHeard>>,
    (tap, moves): (Tap, Moves),
) {
    let (mut there, mut back) = ([0; 1024], [0; 1024]);
    loop {
        tokio::select! {
            biased;
            Ok(count @ 1..) = near.read(&mut there) => {
                if let Tap::Stage([stop, motion]) = tap {
                    heard.lock().unwrap().text(&there[..count], stop, motion);
                }
                let _ = far.write_all(&there[..count]).await;
            }
            Ok(count @ 1..) = far.read(&mut back) => {
                if let Tap::Over(limit_n, from) = tap
                    && Instant::now() >= from
                    && force_n(&back[..count]).is_some_and(|force_n| force_n > limit_n)
                {
                    heard.lock().unwrap().is_over(moves.now());
                }
                let _ = near.write_all(&back[..count]).await;
            }
            else => return,
        }
    }
}

/// The force in an answer: a float in a Modbus TCP frame, a voltage of an XPS, a JSON number.
fn force_n(answer: &[u8]) -> Option<f64> {
    if let (Ok(text), Some(b'0' | b'{')) = (str::from_utf8(answer), answer.first()) {
        let number = match text.strip_prefix("0,") {
            Some(xps) => xps.split(',').next()?.to_owned(),
            None => serde_json::from_str::<serde_json::Value>(text).ok()?.get("force_n")?.to_string(),
        };
        return number.parse().ok();
    }
    let float: [u8; 4] = answer.get(9..13)?.try_into().ok()?;
    (answer.len() == 13).then(|| f64::from(f32::from_be_bytes(float)))
}

fn histogram(times_ms: &[f64]) -> String {
    let mut counts = std::collections::BTreeMap::new();
    times_ms.iter().for_each(|ms| *counts.entry((ms / 5.0).floor() as i64 * 5).or_insert(0) += 1);
    counts.iter().map(|(from, count)| format!("  {from:>4} to {:>3} ms {}\n", from + 5, "#".repeat(*count))).collect()
}
