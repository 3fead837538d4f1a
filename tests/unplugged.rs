//! A device is lost in the middle of a press: unplugged, silent or garbled from one message on, whatever the press is at. The
//! run ends by itself and says which device, nothing is hurt, what was recorded stays, and the run goes on when it is back.
//!
//! `PALPATE_UNPLUGGED=50 cargo test --release --test unplugged -- --nocapture` loses each device so often in each phase of a
//! press, `all` at every message.

#[path = "support/phases.rs"]
mod phases;
#[path = "support/walks.rs"]
#[allow(dead_code, reason = "other tests use the rest")]
mod walks;

use palpate::control::Strategy;
use palpate::dataset::{Contact, Manifest, Origins, RunFolder, Status};
use palpate::emulator::{Instrument, Owed, Shared};
use palpate::quantity::stream;
use palpate::recipe::{Entry, Plan};
use palpate::rig::{self, RigSpec, SimulatedRig};
use palpate::run::{Cancel, Ending, Errand, Listener, walk_on};
use palpate::scene::{Device, Scene};
use phases::{Phase, Watcher};
use rand::RngExt;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tempfile::TempDir;
use tokio::sync::Notify;
use tokio::time::{Instant, sleep, timeout};
use walks::{Worst, bench, in_parallel, in_virtual_time, plan};

/// How often each device is lost in each way in each phase.
const LOSSES: usize = 1;

/// Of so many cases one is made by default: on a bench, and on another rig.
const EVERY: usize = if cfg!(debug_assertions) { 5 } else { 2 };
const EVERY_ELSEWHERE: usize = if cfg!(debug_assertions) { 7 } else { 3 };

/// Presses that teach, and presses in which something is lost: a staircase, a plain one, and one for that to depart to.
const TEACHES: usize = 5;
const PRESSES: usize = 3;

/// How much longer than without a loss a run may take, s: a link is waited for, and parking is tried again.
const LONGER_S: f64 = 120.0;

/// No run here is as long: one that is doesn't end by itself.
const FOR_EVER: Duration = Duration::from_secs(24 * 3600);

/// How long after a run's end all must be at rest: the longest way there is takes 3 s.
const AFTERWARDS: Duration = Duration::from_secs(5);

/// How far from where it is parked an axis may stand, mm: as far as a read-back may be off.
const PARKED_MM: f64 = 0.003;

const RECIPE: &str = r#"
name = "unplugged"
[press]
force_tolerance_n = 0.05
hold_s = 0.25
sample_s = 0.1
strategy = "STRATEGY"
[[step]]
phase = "characterisation"
units = [1]
staircase = { to_n = 1.0, step_n = 1.0, repeats = 1 }
[[step]]
phase = "calibration"
random = { count = 10, x_mm = [-2, 2], y_mm = [-2, 2] }
force_n = 1.0
"#;

/// The rigs that aren't benches.
const ELSEWHERE: [(&str, &str); 4] = [
    ("esp301", include_str!("../rigs/esp301.toml")),
    ("xps", include_str!("../rigs/xps.toml")),
    ("grbl", include_str!("../rigs/grbl.toml")),
    ("process", include_str!("../rigs/process.toml")),
];

/// How a device is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Loss {
    /// Its link is closed, and so is every one that is opened again.
    Unplugged,
    /// It takes everything and answers nothing.
    Silenced,
    /// Every answer is damaged; in every second case its line ends are not.
    Garbled,
}

impl Loss {
    const ALL: [Loss; 3] = [Loss::Unplugged, Loss::Silenced, Loss::Garbled];
}

/// What is lost, how, and at which of the rig's messages.
#[derive(Clone, Copy, Debug)]
struct Fate {
    device: Device,
    loss: Loss,
    at: usize,
}

/// A rig, how it is pressed with, and how often something is lost there.
#[derive(Clone, Copy, Debug)]
struct Setup {
    rig: &'static str,
    strategy: Strategy,
    losses: usize,
    every: usize,
}

/// A case: a setup by its number, the fate, and the phase it strikes in.
struct Case {
    setup: usize,
    fate: Fate,
    phase: Phase,
}

/// A setup's plan, and the run in which nothing is lost.
struct Sound {
    setup: Setup,
    spec: RigSpec,
    plan: Plan,
    walked: Walked,
}

#[test]
fn a_device_that_is_lost_in_any_phase_of_a_press_ends_the_run_and_costs_nothing() {
    let sounds = in_parallel(&setups(), |&setup| Sound::of(setup));
    let cases: Vec<Case> = sounds.iter().enumerate().flat_map(|(i, sound)| sound.cases(i)).collect();
    let ends = in_parallel(&cases, |case| sounds[case.setup].lose(case));
    let mut rows: BTreeMap<(&str, Loss, Phase), [usize; 2]> = BTreeMap::new();
    let (mut all, mut longest_s) = (Worst::default(), 0.0f64);
    let mut broken = Vec::new();
    for (case, end) in cases.iter().zip(&ends) {
        let row = rows.entry((case.fate.device.name(), case.fate.loss, case.phase)).or_default();
        row[usize::from(end.ended)] += 1;
        all.join(end.worst);
        longest_s = longest_s.max(end.longer_s);
        let setup = sounds[case.setup].setup;
        broken.extend(end.wrong.iter().map(|wrong| format!("{setup:?} {:?} {:?}: {wrong}", case.fate, case.phase)));
    }
    for ((device, loss, phase), [went_on, ended]) in &rows {
        println!("{device:>9} {loss:?} in {phase:?}: {ended} ended, {went_on} went on to the end");
    }
    println!(
        "{} cases: at most {:.3} N, {:.3} mm, {longest_s:.0} s longer; {} broken",
        cases.len(),
        all.force_n,
        all.depth_mm,
        broken.len()
    );
    assert!(broken.is_empty(), "{} of {} cases:\n{}", broken.len(), cases.len(), broken.join("\n"));
    assert_eq!(rows.len(), 3 * Loss::ALL.len() * Phase::ALL.len(), "each device in each way in each phase");
}

fn setups() -> Vec<Setup> {
    let asked = std::env::var("PALPATE_UNPLUGGED").ok();
    let asked = asked.map(|asked| if asked == "all" { usize::MAX } else { asked.parse().expect("a number, or all") });
    let losses = asked.unwrap_or(LOSSES);
    let every = |every| if asked.is_some() { 1 } else { every };
    let bench = |rig| {
        let every = every(EVERY);
        Strategy::ALL.map(|strategy| Setup { rig, strategy, losses, every })
    };
    let elsewhere = |(rig, _)| Setup { rig, strategy: Strategy::Guarded, losses, every: every(EVERY_ELSEWHERE) };
    let benches = ["bench-fast", "bench-esp301"].into_iter().flat_map(bench);
    benches.chain(ELSEWHERE.into_iter().map(elsewhere)).collect()
}

impl Sound {
    fn of(setup: Setup) -> Sound {
        let spec = setup.spec();
        let mut plan = plan(&spec, &RECIPE.replace("STRATEGY", setup.strategy.name()), 1);
        plan.entries.truncate(if setup.strategy == Strategy::Map { TEACHES + PRESSES } else { PRESSES });
        let walked = Kept::new(&spec, &plan).walk(&spec, &plan, None);
        assert_eq!(walked.ending.status(), Status::Complete, "{setup:?}: {:?}", walked.ending.told());
        assert_eq!(walked.contacts.len(), plan.entries.len(), "{setup:?}");
        for phase in Phase::ALL {
            assert!(walked.phases.contains(&Some(phase)), "{setup:?} has no {phase:?}");
        }
        Sound { setup, spec, plan, walked }
    }

    /// Every phase with each device lost in each way, at messages all over it.
    fn cases(&self, setup: usize) -> Vec<Case> {
        let mut cases = Vec::new();
        let combined: Vec<(Device, Loss)> =
            self.devices().into_iter().flat_map(|device| Loss::ALL.map(|loss| (device, loss))).collect();
        for phase in Phase::ALL {
            let messages: Vec<usize> =
                (0..self.walked.phases.len()).filter(|&at| self.walked.phases[at] == Some(phase)).collect();
            let losses = self.setup.losses.min(messages.len());
            for (i, &(device, loss)) in combined.iter().enumerate() {
                // each device in each way at messages of its own
                let nth = |k: usize| messages[(k * combined.len() + i) * messages.len() / (losses * combined.len())];
                cases.extend((0..losses).map(|k| Case { setup, fate: Fate { device, loss, at: nth(k) }, phase }));
            }
        }
        cases.into_iter().skip(setup % self.setup.every).step_by(self.setup.every).collect()
    }

    /// The devices that can be lost by themselves: a load cell on the stage's own controller can't.
    fn devices(&self) -> Vec<Device> {
        let shared = self.spec.emulators(1).is_ok_and(|rig| rig.load_cell.is_same(&rig.stage));
        Device::ALL.into_iter().filter(|&device| device != Device::LoadCell || !shared).collect()
    }

    /// Loses the device, then goes on with the run on a rig that is whole again; all that isn't as it must be.
    fn lose(&self, case: &Case) -> End {
        let Sound { spec, plan, .. } = self;
        let mut kept = Kept::new(spec, plan);
        let walked = kept.walk(spec, plan, Some(case.fate));
        let mut wrong = self.wrong_with(case, &walked);
        wrong.extend(kept.wrong_on_disk(&walked.ending, &walked.contacts, plan));
        let ended = walked.ending.halt.is_some();
        if ended {
            kept.reopen(spec);
            let resumed = kept.walk(spec, plan, None);
            if resumed.ending.status() != Status::Complete {
                wrong.push(format!("resumed, it ended {:?}", resumed.ending.told()));
            }
            let contacts = [&walked.contacts[..], &resumed.contacts].concat();
            wrong.extend(kept.wrong_on_disk(&resumed.ending, &contacts, plan).map(|wrong| format!("resumed: {wrong}")));
        }
        let longer_s = walked.virtual_s - self.walked.virtual_s;
        End { ended, worst: walked.worst, longer_s, wrong }
    }

    /// What is wrong with a walk in which a device was lost.
    fn wrong_with(&self, case: &Case, walked: &Walked) -> Vec<String> {
        let Fate { device, at, .. } = case.fate;
        let Walked { ending, worst, z_mm, at_rest, .. } = walked;
        let mut wrong = Vec::new();
        let mut check = |right: bool, told: String| wrong.extend((!right).then_some(told));
        check(walked.phases.get(at) == Some(&Some(case.phase)), "it struck in another phase".to_owned());
        check(walked.virtual_s < self.walked.virtual_s + LONGER_S, format!("it took {:.0} s", walked.virtual_s));
        check(worst.is_within(&self.spec), format!("{worst:?}"));
        check(*at_rest, "an axis moves on".to_owned());
        check(self.walked.contacts.starts_with(&walked.contacts), "what was recorded is another".to_owned());
        let must_park = device != Device::Stage || ending.unparked.is_none();
        let parked = *z_mm <= self.spec.clear_mm() + PARKED_MM;
        check(!must_park || parked, format!("it isn't parked: z is {z_mm} mm, {:?}", ending.told()));
        check(device == Device::Stage || ending.unparked.is_none(), format!("not parked: {:?}", ending.told()));
        match &ending.halt {
            None => check(walked.contacts.len() == self.plan.entries.len(), "it ended too soon".to_owned()),
            Some(_) => {
                let failed = matches!(ending.status(), Status::Failed | Status::Tripped);
                check(failed, format!("{:?}", ending.status()));
                let told = ending.told().unwrap_or_default();
                // what is said of parking names the stage in any case
                let halted = told.split("; the stage could not be parked").next().unwrap_or_default();
                let shared = self.devices().len() < Device::ALL.len();
                let names: &[&str] = match device {
                    Device::Stage if shared => &["stage", "load cell"],
                    Device::Stage => &["stage"],
                    Device::LoadCell => &["load cell"],
                    Device::Array => &["array"],
                };
                check(names.iter().any(|name| halted.contains(name)), format!("it says {told:?}"));
            }
        }
        wrong
    }
}

/// What came of a case.
struct End {
    /// Whether the loss ended the run.
    ended: bool,
    worst: Worst,
    /// How much longer than a sound run it took, s.
    longer_s: f64,
    wrong: Vec<String>,
}

impl Setup {
    fn spec(&self) -> RigSpec {
        match ELSEWHERE.iter().find(|(name, _)| *name == self.rig) {
            None => bench(self.rig),
            Some((name, text)) => {
                rig::parse(name, text, &|_| unreachable!("no map of its own")).expect("the shipped rig").simulated()
            }
        }
    }
}

/// How a walk went.
struct Walked {
    ending: Ending,
    /// What was recorded, in its order.
    contacts: Vec<Contact>,
    phases: Vec<Option<Phase>>,
    worst: Worst,
    /// Where z ended in the specimen frame, mm.
    z_mm: f64,
    at_rest: bool,
    virtual_s: f64,
}

/// A run in a folder, as the program keeps one. Nothing else here knows of run folders.
struct Kept {
    folder: RunFolder,
    _home: TempDir,
}

impl Kept {
    fn new(spec: &RigSpec, plan: &Plan) -> Kept {
        let home = tempfile::tempdir().expect("a folder");
        let manifest = Manifest::new(plan, true, None, String::new());
        let origins = Origins { recipe: RECIPE.to_owned(), rig: String::new(), maps: Vec::new() };
        let layout = &spec.array.layout;
        let folder = RunFolder::create(Some(&home.path().join("run")), &origins, manifest, layout).expect("a run");
        Kept { folder, _home: home }
    }

    fn reopen(&mut self, spec: &RigSpec) {
        self.folder = RunFolder::open(&self.path(), &spec.array.layout).expect("a run that was kept");
    }

    /// Walks what is left of the plan and ends the run.
    fn walk(&mut self, spec: &RigSpec, plan: &Plan, fate: Option<Fate>) -> Walked {
        let folder = &mut self.folder;
        let walked = in_virtual_time(async {
            let mut rig = spec.emulators(plan.seed).expect("emulators");
            let watcher = Arc::new(Mutex::new(Watcher::new(rig.scene.clone(), spec.frame)));
            beset(&mut rig, &watcher, fate);
            let (cancel, began) = (Cancel::default(), Instant::now());
            let rig = spec.open_on(rig).expect("drivers");
            let errand = Errand { plan, spec, ledger: folder, cancel: &cancel, shown: &|_| {} };
            let mut notes = Notes { watcher: watcher.clone(), contacts: Vec::new() };
            let ending = timeout(FOR_EVER, walk_on(rig, errand, &mut notes)).await.expect("it doesn't end by itself");
            let virtual_s = began.elapsed().as_secs_f64();
            sleep(AFTERWARDS).await;
            let mut watcher = watcher.lock().expect("the walk is over");
            let (z_mm, at_rest) = watcher.z_mm_and_rest();
            let (worst, phases) = (watcher.worst(), std::mem::take(&mut watcher.phases));
            Walked { ending, contacts: notes.contacts, phases, worst, z_mm, at_rest, virtual_s }
        });
        folder.manifest.failure = walked.ending.told();
        folder.finish(walked.ending.status()).expect("a run that ends");
        walked
    }

    /// What of a run that ended isn't on the disk as it must be: its verdict, and these contacts, each once.
    fn wrong_on_disk(
        &self,
        ending: &Ending,
        contacts: &[Contact],
        plan: &Plan,
    ) -> impl Iterator<Item = String> + use<> {
        let mut wrong = Vec::new();
        let mut check = |right: bool, told: String| wrong.extend((!right).then_some(told));
        let manifest = RunFolder::read_manifest(&self.path()).expect("a manifest");
        check(manifest.status == ending.status(), format!("the manifest says {:?}", manifest.status));
        check(manifest.failure == ending.told(), format!("the manifest tells {:?}", manifest.failure));
        let mut expected = contacts.to_vec();
        expected.sort_by_key(|contact| contact.press);
        let journal: Vec<Contact> = self.folder.contacts().expect("a journal").map(Result::unwrap).collect();
        check(journal == expected, "the journal holds other contacts".to_owned());
        let rows: Vec<(u64, u64)> =
            expected.iter().flat_map(|contact| contact.rows.iter().map(|row| (row.press, row.level))).collect();
        check(self.rows() == rows, format!("presses.csv holds {:?}, not {rows:?}", self.rows()));
        if ending.halt.is_none() {
            let levels =
                |entry: &Entry| (0..entry.task.levels.len() as u64).map(|level| (entry.press, level)).collect();
            let all: BTreeSet<(u64, u64)> = plan.entries.iter().flat_map::<Vec<_>, _>(levels).collect();
            check(rows.len() == all.len() && rows.into_iter().eq(all), "not each level of each press once".to_owned());
        }
        wrong.into_iter()
    }

    /// The press and the level of each line of `presses.csv`.
    fn rows(&self) -> Vec<(u64, u64)> {
        let mut table = csv::Reader::from_path(self.path().join("presses.csv")).expect("a table");
        let row = |line: csv::StringRecord| (line[0].parse().expect("a press"), line[1].parse().expect("a level"));
        table.records().map(|line| row(line.expect("a row"))).collect()
    }

    fn path(&self) -> PathBuf {
        self.folder.path().to_owned()
    }
}

/// Notes what is recorded, and tells the watcher of each press.
struct Notes {
    watcher: Shared<Watcher>,
    contacts: Vec<Contact>,
}

impl Listener for Notes {
    fn begins(&mut self, entry: &Entry) {
        let teaches = entry.phase == palpate::recipe::Phase::Teach;
        self.watcher.lock().expect("a test that goes on").begins(!teaches);
    }

    fn recorded(&mut self, contact: &Contact) {
        self.contacts.push(contact.clone());
    }
}

/// Puts every device of a rig on a link that is watched, and on which one device is lost.
fn beset(rig: &mut SimulatedRig, watcher: &Shared<Watcher>, fate: Option<Fate>) {
    let lost = Arc::new(Mutex::new(Lost { at: fate.map(|fate| fate.at), struck: false, bells: Vec::new() }));
    let shared = rig.load_cell.is_same(&rig.stage);
    for (device, role) in
        [(&mut rig.stage, Device::Stage), (&mut rig.load_cell, Device::LoadCell), (&mut rig.array, Device::Array)]
    {
        let Some(instrument) = device.instrument().cloned() else { continue };
        let loss =
            fate.filter(|fate| fate.device == role || shared && fate.device == Device::Stage && role != Device::Array);
        device.replace(Far::put(instrument, watcher.clone(), lost.clone(), loss));
    }
}

/// What the links of a rig know together.
struct Lost {
    at: Option<usize>,
    struck: bool,
    /// What wakes the links that wait, to be closed.
    bells: Vec<Arc<Notify>>,
}

/// A device on a link on which it may be lost.
struct Far {
    device: Shared<dyn Instrument>,
    watcher: Shared<Watcher>,
    lost: Shared<Lost>,
    /// How this device is lost, if it is this one.
    fate: Option<Fate>,
    bell: Arc<Notify>,
}

impl Far {
    fn put(
        device: Shared<dyn Instrument>,
        watcher: Shared<Watcher>,
        lost: Shared<Lost>,
        fate: Option<Fate>,
    ) -> Shared<dyn Instrument> {
        let bell = device.lock().expect("a device that lives").bell().unwrap_or_default();
        lost.lock().expect("a test that goes on").bells.push(bell.clone());
        Arc::new(Mutex::new(Far { device, watcher, lost, fate, bell }))
    }

    fn device<R>(&self, ask: impl FnOnce(&mut dyn Instrument) -> R) -> R {
        ask(&mut *self.device.lock().expect("a device that lives"))
    }

    /// A message has come, and with it maybe the end.
    fn heard(&self, message: Option<Vec<u8>>) -> Option<Vec<u8>> {
        let message = message?;
        let mut watcher = self.watcher.lock().expect("a test that goes on");
        let mut lost = self.lost.lock().expect("a test that goes on");
        if lost.at == Some(watcher.phases.len()) {
            lost.struck = true;
            lost.bells.iter().for_each(|bell| bell.notify_waiters());
        }
        watcher.hears(self.device(|device| device.device()));
        Some(message)
    }

    fn loss(&self) -> Option<Fate> {
        self.fate.filter(|_| self.lost.lock().expect("a test that goes on").struck)
    }

    /// Lets the device do something; the watcher looks at what a stage does.
    fn act<R>(&self, scene: &mut Scene, now_s: f64, act: impl FnOnce(&mut dyn Instrument, &mut Scene) -> R) -> R {
        let mut watcher = self.watcher.lock().expect("a test that goes on");
        self.device(|device| match device.device() {
            Device::Stage => watcher.acts(scene, now_s, |scene| act(device, scene)),
            _ => act(device, scene),
        })
    }

    /// What of an answer arrives.
    fn arrives(&self, answer: Vec<u8>) -> Vec<u8> {
        match self.loss() {
            None => answer,
            Some(Fate { loss: Loss::Garbled, at, .. }) => damaged(answer, at),
            Some(_) => Vec::new(),
        }
    }
}

impl Instrument for Far {
    fn device(&self) -> Device {
        self.device(|device| device.device())
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.heard(self.device(|device| device.take_request(inbox)))
    }

    fn silence(&self) -> Option<Duration> {
        self.device(|device| device.silence())
    }

    fn fall_silent(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.heard(self.device(|device| device.fall_silent(inbox)))
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        self.arrives(self.act(scene, now_s, |device, scene| device.answer(request, scene, now_s)))
    }

    fn deaf_until_s(&self) -> f64 {
        self.device(|device| device.deaf_until_s())
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        let own = self.device(|device| device.accept())?;
        Some(Far::put(own, self.watcher.clone(), self.lost.clone(), self.fate))
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        if self.loss().is_some_and(|fate| fate.loss == Loss::Unplugged) {
            return Owed::HungUp;
        }
        match self.act(scene, now_s, |device, scene| device.owed(scene, now_s)) {
            Owed::Ready(answer) => Owed::Ready(self.arrives(answer)),
            owed => owed,
        }
    }
}

/// An answer of which no byte is what it was, but for line ends in every second case.
fn damaged(mut answer: Vec<u8>, at: usize) -> Vec<u8> {
    let mut rng = stream(1, (at + answer.len()) as u64, "damage");
    let keeps_lines = at.is_multiple_of(2);
    for byte in answer.iter_mut().filter(|byte| !(keeps_lines && b"\r\n".contains(byte))) {
        *byte ^= 0x80 | rng.random::<u8>(); // never text again
    }
    answer
}
