//! Host and links may die at any time: the devices can safely finish all earlier commands. Judged by the true values until all is at rest.

use palpate_control::Strategy;
use palpate_run::rig::{RigSpec, SimulatedRig};
use palpate_sim::emulator::{Instrument, Shared};
use palpate_sim::scene::{Scene, SceneDevice};
use palpate_testing::campaign;
use palpate_testing::executions::{
    BENCHES, Deaths, ExecutedRun, WorstTruth, bench, end_of, executed_with, in_parallel, plan,
};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// One in so many commands has a mishap: quick and full.
const EVERY: (usize, usize) = (97, 1);

/// Delay of late messages, s.
const LATE_S: f64 = 10.0;

/// Training presses, and all presses.
const TRAINING_PRESSES: usize = 5;
const PRESSES: usize = 3;

/// Number of the stage's last command before it is homed, and number of commands that park it after a window: both are waited for.
const HOMES_AT: usize = 6;
const PARKS: usize = 2;

/// Largest part of a peak that a scene may miss between two looks, N.
const PEAK_N: f64 = 0.0005;

/// Longest run with a mishap, s.
const LONGEST_S: f64 = 180.0;

/// What happens when the stage gets one of its commands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mishap {
    /// Nothing.
    None,
    /// The stage's link is cut before the command.
    StageCut,
    /// The stage's link is cut after the command: this and later commands are carried out, but no answers come.
    StageMute,
    /// The command is delayed on the link, and so are the later ones.
    CommandLate,
    /// The command is carried out, but its answer is delayed on the link.
    AnswerLate,
    /// The command is answered but not carried out.
    CommandIgnored,
    /// The load cell's link is cut.
    CellCut,
    /// The load cell is silent for a while, then answers everything.
    CellLate,
}

impl Mishap {
    const ALL: [Mishap; 7] = [
        Mishap::StageCut,
        Mishap::StageMute,
        Mishap::CommandLate,
        Mishap::AnswerLate,
        Mishap::CommandIgnored,
        Mishap::CellCut,
        Mishap::CellLate,
    ];

    /// Whether it may remain unnoticed at the stage's `at`-th command.
    fn may_be_missed(self, at: usize, commands: Commands) -> bool {
        let parks = |end: usize| (end - PARKS..end).contains(&at);
        let measured = parks(commands.all);
        match self {
            // the next reading of z shows it, and missing messages are requested again
            Mishap::None | Mishap::CommandIgnored => true,
            // a stage that can't be parked is reported, although all presses were made
            Mishap::StageCut | Mishap::StageMute => false,
            Mishap::CommandLate | Mishap::AnswerLate => measured || parks(commands.planned) || at == HOMES_AT,
            Mishap::CellCut | Mishap::CellLate => measured,
        }
    }
}

/// Number of the stage's commands in a run: for the plan, and with the closing check.
#[derive(Clone, Copy)]
struct Commands {
    planned: usize,
    all: usize,
}

/// A rig, and its strategy.
#[derive(Clone, Copy, Debug)]
struct HostSetup {
    bench: &'static str,
    speed_mm_s: f64,
    strategy: Strategy,
    checks: &'static str,
}

impl HostSetup {
    fn spec(&self) -> RigSpec {
        let mut spec = bench(self.bench);
        spec.stage.speed_mm_s = self.speed_mm_s;
        spec
    }

    fn executed(&self, deaths: Deaths, seed: u64, tamper: &dyn Fn(&mut SimulatedRig)) -> ExecutedRun {
        let text = format!(
            "name = \"host\"\nchecks = \"{}\"\n[press]\nforce_tolerance_n = 0.01\nhold_s = 0.0\nsample_s = 0.1\nstrategy = \"{}\"\n\
             [[step]]\nphase = \"calibration\"\nrandom = {{ count = 10, x_mm = [-0.4, 0.4], y_mm = [-0.4, 0.4] }}\n\
             force_n = 1.0\n",
            self.checks,
            self.strategy.name()
        );
        let spec = self.spec();
        let mut plan = plan(&spec, &text, seed);
        plan.entries.truncate(if self.strategy == Strategy::Map { TRAINING_PRESSES + PRESSES } else { PRESSES });
        executed_with(&spec, &plan, deaths, tamper)
    }

    /// The same with a mishap at the stage's `at`-th command; the number of commands.
    fn struck(&self, mishap: Mishap, at: usize) -> (ExecutedRun, usize) {
        let commands = Arc::new(AtomicUsize::new(0));
        let executed = self.executed(Deaths::Ignored, 4, &|rig| {
            let fate =
                Arc::new(Mutex::new(HostFate { mishap, at, commands: commands.clone(), struck_s: None, now_s: 0.0 }));
            for device in [&mut rig.stage, &mut rig.load_cell] {
                let instrument = device.instrument().expect("it has a link").clone();
                device.replace(Arc::new(Mutex::new(Beset { device: instrument, fate: fate.clone(), held: None })));
            }
        });
        (executed, commands.load(Ordering::Relaxed))
    }
}

fn setups(speeds_mm_s: &[f64]) -> Vec<HostSetup> {
    let with_speed = |&speed_mm_s: &f64| {
        BENCHES.into_iter().flat_map(move |(bench, _)| {
            Strategy::ALL.map(|strategy| HostSetup { bench, speed_mm_s, strategy, checks: "end" })
        })
    };
    speeds_mm_s.iter().flat_map(with_speed).collect()
}

/// The mishap of a rig.
struct HostFate {
    mishap: Mishap,
    /// Which of the stage's commands, from 0.
    at: usize,
    commands: Arc<AtomicUsize>,
    struck_s: Option<f64>,
    now_s: f64,
}

/// A device on a link with a mishap.
struct Beset {
    device: Shared<dyn Instrument>,
    fate: Shared<HostFate>,
    /// An answer that is delayed on the link.
    held: Option<Vec<u8>>,
}

/// Whether a message makes the stage do something: move, change its speed, stop, home.
fn is_command(request: &[u8]) -> bool {
    ["PA", "VA", "ST", "OR"].iter().any(|word| request.windows(2).any(|two| two == word.as_bytes()))
}

/// The request in a message to the stage, without its values.
fn questions(request: &[u8]) -> Vec<u8> {
    let text = String::from_utf8_lossy(request);
    let asks: Vec<&str> =
        text.trim_end().split(';').filter(|part| part.ends_with('?') || part.ends_with("TP")).collect();
    asks.join(";").into_bytes()
}

impl Instrument for Beset {
    fn device(&self) -> SceneDevice {
        self.device.lock().unwrap().device()
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        let request = self.device.lock().unwrap().take_request(inbox)?;
        if self.device() == SceneDevice::Stage && is_command(&request) {
            let mut fate = self.fate.lock().unwrap();
            if fate.commands.fetch_add(1, Ordering::Relaxed) == fate.at {
                fate.struck_s = Some(fate.now_s);
            }
        }
        Some(request)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let device = self.device();
        let (mishap, struck_s) = {
            let mut fate = self.fate.lock().unwrap();
            fate.now_s = now_s;
            (fate.mishap, fate.struck_s)
        };
        if mishap == Mishap::CommandIgnored && device == SceneDevice::Stage && struck_s.is_some() && self.held.is_none()
        {
            self.held = Some(Vec::new());
            return self.device.lock().unwrap().answer(&questions(request), scene, now_s);
        }
        let Some(struck_s) = struck_s else { return self.device.lock().unwrap().answer(request, scene, now_s) };
        let mut answer = || self.device.lock().unwrap().answer(request, scene, now_s);
        match (mishap, device) {
            (Mishap::StageCut, SceneDevice::Stage) | (Mishap::CellCut, SceneDevice::LoadCell) => Vec::new(),
            (Mishap::StageMute, SceneDevice::Stage) => {
                answer();
                Vec::new()
            }
            (Mishap::AnswerLate, SceneDevice::Stage) => {
                let answer = answer();
                match &self.held {
                    None if !answer.is_empty() => {
                        self.held = Some(answer);
                        Vec::new()
                    }
                    // delayed messages come before the first answer after their time
                    Some(held) if !held.is_empty() && now_s > struck_s + LATE_S => {
                        let late = std::mem::take(self.held.as_mut().expect("it is held"));
                        [late, answer].concat()
                    }
                    _ => answer,
                }
            }
            _ => answer(),
        }
    }

    fn silence(&self) -> Option<std::time::Duration> {
        self.device.lock().unwrap().silence()
    }

    fn deaf_until_s(&self) -> f64 {
        let device = self.device();
        let fate = self.fate.lock().unwrap();
        let own_s = self.device.lock().unwrap().deaf_until_s();
        match (fate.mishap, device, fate.struck_s) {
            (Mishap::CommandLate, SceneDevice::Stage, Some(struck_s))
            | (Mishap::CellLate, SceneDevice::LoadCell, Some(struck_s)) => own_s.max(struck_s + LATE_S),
            _ => own_s,
        }
    }
}

/// Only messages to the stage change a motion, so each of them is tried. Messages to readers can't matter once the host is dead.
#[test]
fn host_death_after_any_message_keeps_the_limits() {
    let speeds: &[f64] = if campaign::is_quick() { &[25.0] } else { &[0.5, 5.0, 25.0] };
    let seeds = campaign::size(1, 2) as u64;
    let jobs: Vec<(HostSetup, u64)> =
        setups(speeds).into_iter().flat_map(|setup| (1..=seeds).map(move |seed| (setup, seed))).collect();
    let executions = in_parallel(&jobs, |(setup, seed)| setup.executed(Deaths::Tried, *seed, &|_| {}));
    let mut messages = 0;
    let mut all = WorstTruth::default();
    for ((setup, seed), ExecutedRun { ending, truth, orphaned, messages: taken, .. }) in jobs.iter().zip(&executions) {
        assert!(ending.halt.is_none(), "{setup:?}, seed {seed}: {:?}", ending.text());
        assert!(orphaned.force_n >= truth.force_n - PEAK_N, "{setup:?}: {truth:?}, {orphaned:?}");
        assert!(orphaned.is_within(&setup.spec()), "{setup:?}, seed {seed}: {orphaned:?}");
        all.join(*orphaned);
        messages += taken;
    }
    println!("{messages} deaths: at most {:.3} N and {:.3} mm", all.force_n, all.depth_mm);
}

/// Results of the runs with one mishap.
#[derive(Default)]
struct HostRow {
    runs: usize,
    worst: WorstTruth,
    longest_s: f64,
    ends: BTreeMap<&'static str, usize>,
}

#[test]
fn cut_or_late_link_at_any_command_keeps_the_limits_and_is_noticed() {
    let every = campaign::every(EVERY.0, EVERY.1);
    let mut jobs = Vec::new();
    for setup in setups(&[25.0]) {
        let sound = |checks| {
            let (sound, commands) = HostSetup { checks, ..setup }.struck(Mishap::None, 0);
            assert!(sound.ending.halt.is_none(), "{setup:?}: {:?}", sound.ending.text());
            commands
        };
        let commands = Commands { planned: sound("none"), all: sound(setup.checks) };
        let struck = |mishap| (0..commands.all).step_by(every).map(move |at| (setup, mishap, at, commands));
        jobs.extend(Mishap::ALL.into_iter().flat_map(struck));
    }
    if every > 1 {
        println!("each {every}th command");
    }
    let executions = in_parallel(&jobs, |&(setup, mishap, at, _)| setup.struck(mishap, at).0);
    let mut broken = Vec::new();
    let mut rows: BTreeMap<String, HostRow> = BTreeMap::new();
    for ((setup, mishap, at, commands), executed) in jobs.iter().zip(&executions) {
        let row = rows.entry(format!("{mishap:?}")).or_default();
        row.runs += 1;
        row.worst.join(executed.truth);
        row.longest_s = row.longest_s.max(executed.virtual_s);
        let end = end_of(&executed.ending);
        *row.ends.entry(end).or_default() += 1;
        let may_be_missed = mishap.may_be_missed(*at, *commands);
        if end == "-" && !may_be_missed || !executed.truth.is_within(&setup.spec()) || executed.virtual_s > LONGEST_S {
            let output = executed.ending.text();
            broken.push(format!(
                "{setup:?} {mishap:?} at {at}: {:?}, {:.0} s, {output:?}",
                executed.truth, executed.virtual_s
            ));
        }
    }
    for (mishap, HostRow { runs, worst, longest_s, ends }) in rows {
        let WorstTruth { force_n, depth_mm, .. } = worst;
        println!("{mishap}: {runs} runs, at most {force_n:.3} N, {depth_mm:.3} mm, {longest_s:.0} s: {ends:?}");
    }
    assert!(broken.is_empty(), "{} runs:\n{}", broken.len(), broken.join("\n"));
}
