//! One run of palpate in a world: rig and recipe, the program, signals to it, and what came of it as a line of JSON.

use crate::devices::{self, WorldShared, now};
use crate::faults::Fault;
use crate::setting::{TOLERANCE_N, WorldSetting};
use crate::world::World;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

/// Longest that a run takes; then it counts as hung and is killed.
const RUN_DEADLINE: Duration = Duration::from_secs(120);

/// Longest wait for the stage to rest after the program's end, and how long the force is watched then.
const REST_DEADLINE: Duration = Duration::from_secs(10);
const WATCHED: Duration = Duration::from_millis(300);

/// Time between two checks of the program and the simulated world.
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// A row is wrong if its true force differs from the set one by more than so much: a share, and the noise.
const ROW_SHARE: f64 = 0.05;
const ROW_NOISE_N: f64 = 0.01;

/// How near to a row's place the outputs were read, mm, and from how many of the last readings its force is taken.
const HERE_MM: f64 = 0.02;
const READS: usize = 3;

pub(crate) struct WorldTask {
    pub(crate) palpate: PathBuf,
    pub(crate) fault: String,
    pub(crate) seed: u64,
    /// True stiffness as a share of the declared one, where it was given.
    pub(crate) share: Option<f64>,
    pub(crate) keep: Option<PathBuf>,
    pub(crate) setting: WorldSetting,
}

/// Carries a run out; returns the line that describes it.
pub(crate) fn carry_out(task: WorldTask) -> Result<String, String> {
    let faults = Fault::parse_all(&task.fault)?;
    let folder = task
        .keep
        .clone()
        .unwrap_or_else(|| std::env::temp_dir().join(format!("spring-world-{}-{}", std::process::id(), task.seed)));
    let text = made_in(&task, faults, &folder)
        .map_err(|error| format!("{} in {}: {error}", task.palpate.display(), folder.display()));
    if task.keep.is_none() {
        // the rest of a scratch folder does no harm
        let _ = fs::remove_dir_all(&folder);
    }
    text
}

fn made_in(task: &WorldTask, faults: Vec<Fault>, folder: &Path) -> io::Result<String> {
    fs::create_dir_all(folder)?;
    let (recipe, description) = (task.setting.recipe(), describe(&task.setting));
    let world = World::new(task.setting.clone(), faults, task.seed);
    let world: WorldShared = Arc::new(Mutex::new(world));
    let port = devices::serve(&world)?;
    let this = std::env::current_exe()?;
    let command = |role: &str| format!("[{:?}, {role:?}, \"{port}\"]", this.display().to_string());
    fs::write(folder.join("rig.toml"), task.setting.rig(&command))?;
    fs::write(folder.join("recipe.toml"), recipe)?;
    // the program works in the folder, for any current folder
    let mut program = Command::new(fs::canonicalize(&task.palpate)?);
    program.args(["run", "recipe.toml", "--rig", "rig.toml", "--out", "run", "--json", "--confirmed", "down"]);
    program.arg("--seed").arg(task.seed.to_string()).current_dir(folder).stdin(Stdio::null());
    program.env("NO_COLOR", "1").env("LC_ALL", "C.UTF-8").env("XDG_STATE_HOME", folder);
    program.stdout(File::create(folder.join("out"))?).stderr(File::create(folder.join("err"))?);
    let child = program.spawn()?;
    let (code, took) = attend(&world, child)?;
    let until = Instant::now() + REST_DEADLINE;
    let mut rested = Instant::now();
    while Instant::now() < until && rested.elapsed() < WATCHED {
        if !now(&world).rests() {
            rested = Instant::now();
        }
        thread::sleep(LOOK_EVERY);
    }
    let state = now(&world);
    let words = fs::read_to_string(folder.join("err")).unwrap_or_default();
    let trace: String = state.seen.trace_n.iter().map(|n| format!("{n:.4}\n")).collect();
    fs::write(folder.join("force-each-5-ms.txt"), trace)?;
    let rows = fs::read_to_string(folder.join("run/presses.csv")).unwrap_or_default();
    let (rows, wrong, worst_n) = compare(&rows, &state.seen.reads);
    let line = WorldLine { task, code, took, words: &words, rows, wrong, worst_n, description };
    Ok(line.json(&state))
}

/// Waits for the end of the program, and sends it the signals of the faults that begin.
fn attend(world: &WorldShared, mut child: Child) -> io::Result<(String, Duration)> {
    let began = Instant::now();
    let mut resume_at = None;
    loop {
        if let Some(status) = child.try_wait()? {
            let code = status.code().map_or("signal".to_owned(), |code| code.to_string());
            return Ok((code, began.elapsed()));
        }
        if began.elapsed() > RUN_DEADLINE {
            child.kill()?;
            child.wait()?;
            return Ok(("hung".to_owned(), began.elapsed()));
        }
        let signals = std::mem::take(&mut now(world).signals);
        for fault in signals {
            let (name, times) = match fault.name {
                "host-kill" => ("KILL", 1),
                "host-stop" => ("STOP", 1),
                "host-term" => ("TERM", 1),
                "host-int-twice" => ("INT", 2),
                _ => ("INT", 1),
            };
            (0..times).for_each(|_| signal(&child, name));
            if name == "STOP" {
                resume_at = Some(Instant::now() + Duration::from_secs_f64(fault.value));
            }
        }
        if resume_at.is_some_and(|at| Instant::now() >= at) {
            signal(&child, "CONT");
            resume_at = None;
        }
        thread::sleep(LOOK_EVERY);
    }
}

fn signal(child: &Child, name: &str) {
    // a program that has just ended needs none
    let _ = Command::new("kill").arg(format!("-{name}")).arg(child.id().to_string()).status();
}

/// Compares the rows of a table with the true force in their windows: rows, unflagged rows that are wrong, and the largest error
/// of the unflagged. palpate reads the outputs in contact in the window, and in a descent before it.
fn compare(table: &str, reads: &[[f64; 3]]) -> (usize, usize, f64) {
    let is_near = |a: &[f64], b: &[f64]| (a[0] - b[0]).abs() < HERE_MM && (a[1] - b[1]).abs() < HERE_MM;
    let visits: Vec<&[[f64; 3]]> = reads.chunk_by(|a, b| is_near(a, b)).collect();
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().unwrap_or("").split(',').collect();
    let rows = lines.map(|line| header.iter().copied().zip(line.split(',')).collect());
    let mut rows: Vec<BTreeMap<&str, &str>> = rows.collect();
    // in the order of the presses: training presses come first
    rows.sort_by_key(|cells| cells.get("phase") != Some(&"teach"));
    let (mut pressed, mut wrong, mut worst_n): (Vec<[f64; 2]>, usize, f64) = (Vec::new(), 0, 0.0);
    for cells in rows {
        let number = |name: &str| cells.get(name).and_then(|text| text.parse::<f64>().ok());
        let (Some(set_n), Some(x_mm), Some(y_mm)) = (number("force_set_n"), number("x_mm"), number("y_mm")) else {
            continue;
        };
        // a place may be pressed before, for training, and again at the end, as a check
        let place = [x_mm, y_mm];
        let before = pressed.iter().filter(|other| is_near(&place, *other)).count();
        pressed.push(place);
        let visit = visits.iter().filter(|visit| is_near(&place, &visit[0])).nth(before).copied().unwrap_or_default();
        let mut window: Vec<f64> = visit.iter().rev().take(READS).map(|[_, _, n]| *n).collect();
        window.sort_by(f64::total_cmp);
        if let Some(true_n) = window.get(window.len() / 2)
            && cells.get("flags").is_some_and(|flags| flags.is_empty())
        {
            let off_n = (true_n - set_n).abs();
            worst_n = worst_n.max(off_n);
            wrong += usize::from(off_n > (ROW_SHARE * set_n).max(TOLERANCE_N) + ROW_NOISE_N);
        }
    }
    (pressed.len(), wrong, worst_n)
}

fn describe(setting: &WorldSetting) -> String {
    format!(
        "{} k={:.2} k2={:.2} hz={} n={} presses={}",
        setting.strategy,
        setting.stiffness_n_mm,
        setting.stiffening_n_mm2,
        setting.conversions_hz,
        setting.units(),
        setting.presses
    )
}

/// What a run came to.
struct WorldLine<'a> {
    task: &'a WorldTask,
    code: String,
    took: Duration,
    words: &'a str,
    rows: usize,
    wrong: usize,
    worst_n: f64,
    description: String,
}

impl WorldLine<'_> {
    fn json(&self, state: &World) -> String {
        let (seen, fired) = (&state.seen, state.faults.iter().filter(|fault| fault.name != "none"));
        let fired: Vec<String> = fired
            .map(|fault| {
                let at = fault.fired_s.map_or("null".to_owned(), |s| format!("{s:.3}"));
                format!("{{\"name\": {:?}, \"at_s\": {at}, \"press\": {}}}", fault.name, fault.fired_press)
            })
            .collect();
        let end_n = state.force_n();
        let words = self.words.replace(['│', '·', '├', '╰', '─', '▶', '×'], " ");
        let words = words.split_whitespace().collect::<Vec<_>>().join(" ").replace(['"', '\\'], "'");
        let words: String = words.chars().filter(|letter| !letter.is_control()).collect();
        let [seed, rows, wrong] = [self.task.seed, self.rows as u64, self.wrong as u64];
        let share = self.task.share.map_or("null".to_owned(), |share| share.to_string());
        let took_s = self.took.as_secs_f64();
        let (fault, world, code, worst_n) = (&self.task.fault, &self.description, &self.code, self.worst_n);
        let numbers = format!(
            "\"force_max_n\": {:.4}, \"max_at_s\": {:.3}, \"before_n\": {:.4}, \"after_n\": {:.4}, \"end_n\": {end_n:.4}, \"own_mm\": {:.4}, \
             \"toward_after\": {}",
            seen.force_max_n, seen.max_at_s, seen.before_n, seen.after_n, seen.own_mm, seen.toward_after
        );
        format!(
            "{{\"seed\": {seed}, \"stiffness\": {share}, \"fault\": {fault:?}, \"world\": {world:?}, \"code\": {code:?}, \"took_s\": {took_s:.1}, \
             \"fired\": [{}], {numbers}, \"presses\": {}, \"rests\": {}, \"rows\": {rows}, \"wrong_rows\": {wrong}, \
             \"worst_row_n\": {worst_n:.4}, \"words\": \"{words}\"}}",
            fired.join(", "),
            state.press,
            state.rests(),
        )
    }
}
