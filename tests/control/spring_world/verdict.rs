//! Whether a run kept its bounds, and a table of all runs.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};

/// Values of the world's rig (`examples/spring_world/setting.rs`).
const LIMIT_N: f64 = 2.0;
const DECLARED_N_MM: f64 = 2.0;

/// Bounds of the true force, times the limit: for most faults, for faults of a cell before enough presses are learned, and for counted
/// ones.
const MOST: f64 = 1.1;
const UNLEARNED_CELL: f64 = 1.25;
const OWN_MOTION: f64 = 1.05;

/// Place from which on a fault of the cell must be noticed by learned presses.
const LEARNED_PLACE: u64 = 11;

/// Time after a rise in which no program can react, s; a specimen rises or sinks within a second.
const REACTION_S: f64 = 0.1;

/// Largest force at the end that counts as none, N.
const NO_LOAD_N: f64 = 0.05;

/// Words for the remaining force in the program's output, or for a force that can't be known.
const NAMES_FORCE: [&str; 6] = ["remain", "can't be known", "isn't known", "still presses", "is left on", "may press"];

const OF_THE_START: &str = "its forces may be wrong";

/// A run and the bounds that it exceeded.
#[derive(Debug)]
pub(super) struct Verdict {
    class: String,
    run: Value,
    bound_n: Option<f64>,
    /// Whether a fault of the run began.
    fired: bool,
    names_force: bool,
    pub(super) falls: Vec<String>,
}

impl Verdict {
    pub(super) fn of(line: &str) -> Verdict {
        let run: Value = serde_json::from_str(line).unwrap_or_else(|error| panic!("{line}: {error}"));
        let number = |key: &str| run[key].as_f64().unwrap_or_else(|| panic!("{key}: {line}"));
        let text = |key: &str| run[key].as_str().unwrap_or_else(|| panic!("{key}: {line}"));
        let faults = run["fired"].as_array().expect("a list");
        let fired = faults.iter().any(|fault| fault["at_s"].is_number());
        let names: Vec<&str> = faults.iter().filter_map(|fault| fault["name"].as_str()).collect();
        let bound_n = bound_n(&run, text("fault"), text("world"));
        let class = match &names[..] {
            _ if bound_n.is_none() => "stiffer than declared".to_owned(),
            [] => "clean".to_owned(),
            [name] => name.split('-').next().unwrap_or_default().to_owned(),
            _ => "pair".to_owned(),
        };
        let (max_n, end_n, code) = (number("force_max_n"), number("end_n"), text("code"));
        // a warning at the start has these words too
        let words = text("words").to_lowercase().replace(OF_THE_START, "");
        let names_force = NAMES_FORCE.iter().any(|name| words.contains(name));
        let mut falls = Vec::new();
        if bound_n.is_some_and(|bound_n| max_n > bound_n) {
            falls.push(format!("over: {max_n:.2} N, bound {:.2} N", bound_n.unwrap_or_default()));
        }
        if bound_n.is_none() && max_n > LIMIT_N && code == "0" {
            falls.push(format!("unnoticed: {max_n:.2} N with exit 0"));
        }
        // a program that was killed prints nothing: a person calls `retract`
        if end_n > NO_LOAD_N && !names_force && !names.contains(&"host-kill") {
            falls.push(format!("left: {end_n:.2} N, and no word of it"));
        }
        if code == "0" && number("wrong_rows") > 0.0 {
            falls.push(format!("silent: {} unflagged rows, off by {:.2} N", run["wrong_rows"], number("worst_row_n")));
        }
        if code == "hung" || code == "101" || words.contains("panicked") {
            falls.push(format!("ended as {code}"));
        }
        Verdict { class, bound_n, fired, names_force, falls, run }
    }

    /// What a person needs to repeat it.
    pub(super) fn text(&self) -> String {
        let words = self.run["words"].as_str().unwrap_or_default();
        let words: String = words.chars().skip(words.chars().count().saturating_sub(160)).collect();
        let bound = self.bound_n.map_or("none".to_owned(), |n| format!("{n:.2} N"));
        let stiffness = self.run["stiffness"].as_f64().map(|share| format!("PALPATE_WORLD_STIFFNESS={share} "));
        format!(
            "PALPATE_WORLD={} PALPATE_WORLD_SEED={} {}[{}]\n  exit {}, bound {bound}: {}\n  {words}",
            self.run["fault"],
            self.run["seed"],
            stiffness.unwrap_or_default(),
            self.run["world"].as_str().unwrap_or_default(),
            self.run["code"],
            self.falls.join("; ")
        )
    }
}

/// Largest true force of a run; none for a specimen that is, or becomes, stiffer than declared.
fn bound_n(run: &Value, text: &str, world: &str) -> Option<f64> {
    let about = |key: &str| world.split(' ').find_map(|word| word.strip_prefix(key)?.parse::<f64>().ok());
    let (k, stiffening) = (about("k=").expect("a stiffness"), about("k2=").expect("a stiffening"));
    let most_k = k + 2.0 * stiffening * 3.0;
    if most_k > DECLARED_N_MM * 1.01 || text.contains("specimen-stiffer") {
        return None;
    }
    let mut bound_n = MOST * LIMIT_N;
    for fault in run["fired"].as_array().expect("a list") {
        let name = fault["name"].as_str().unwrap_or_default();
        let value = |parameter: &str, default: f64| value_of(text, name, parameter).unwrap_or(default);
        let own = match name {
            _ if name.starts_with("stage-") => {
                OWN_MOTION * (LIMIT_N + DECLARED_N_MM * run["own_mm"].as_f64().unwrap_or_default())
            }
            "specimen-jumps" => OWN_MOTION * (LIMIT_N + k * value("mm", 0.3)),
            "specimen-rises" => OWN_MOTION * (LIMIT_N + k * value("mm", 1.0) * REACTION_S),
            _ if name.starts_with("cell-") && fault["press"].as_u64().is_some_and(|press| press < LEARNED_PLACE) => {
                UNLEARNED_CELL * LIMIT_N
            }
            _ => 0.0,
        };
        bound_n = bound_n.max(own);
    }
    Some(bound_n)
}

/// The parameter of a fault in a text.
fn value_of(text: &str, name: &str, parameter: &str) -> Option<f64> {
    let fault = text.split('+').find(|fault| fault.split(':').next() == Some(name))?;
    fault.split([':', ',']).find_map(|pair| pair.strip_prefix(parameter)?.strip_prefix('=')?.parse().ok())
}

/// All runs by class.
#[derive(Debug, Default)]
pub(super) struct WorldVerdictTable {
    all: Vec<Verdict>,
}

impl WorldVerdictTable {
    pub(super) fn add(&mut self, verdict: Verdict) {
        if !verdict.falls.is_empty() {
            println!("{}", verdict.text());
        }
        self.all.push(verdict);
    }

    pub(super) fn fallen(&self) -> usize {
        self.all.iter().filter(|verdict| !verdict.falls.is_empty()).count()
    }
}

impl Display for WorldVerdictTable {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut classes: BTreeMap<&str, Vec<&Verdict>> = BTreeMap::new();
        self.all.iter().for_each(|verdict| classes.entry(&verdict.class).or_default().push(verdict));
        writeln!(
            f,
            "\n| class | runs | fired | ended before | over | left | named | silent | largest N | at rest N | exits |"
        )?;
        writeln!(f, "|---|---|---|---|---|---|---|---|---|---|---|")?;
        for (class, runs) in classes {
            let count = |what: &dyn Fn(&Verdict) -> bool| runs.iter().filter(|verdict| what(verdict)).count();
            let fell = |word: &str| count(&|verdict| verdict.falls.iter().any(|fall| fall.starts_with(word)));
            let most = |key: &str| runs.iter().filter_map(|verdict| verdict.run[key].as_f64()).fold(0.0, f64::max);
            let mut exits: BTreeMap<&str, usize> = BTreeMap::new();
            runs.iter().for_each(|verdict| *exits.entry(verdict.run["code"].as_str().unwrap_or("")).or_default() += 1);
            let exits: Vec<String> = exits.iter().map(|(code, count)| format!("{code}: {count}")).collect();
            writeln!(
                f,
                "| {class} | {} | {} | {} | {} | {} | {} | {} | {:.2} | {:.2} | {} |",
                runs.len(),
                count(&|verdict| verdict.fired),
                count(&|verdict| !verdict.fired && verdict.run["code"] != "0"),
                fell("over") + fell("unnoticed"),
                fell("left"),
                count(&|verdict| verdict.names_force),
                fell("silent"),
                most("force_max_n"),
                most("end_n"),
                exits.join(", ")
            )?;
        }
        let mut quiet: BTreeMap<&str, usize> = BTreeMap::new();
        let unnoticed = |verdict: &&Verdict| verdict.fired && verdict.run["code"] == "0" && verdict.class != "clean";
        for verdict in self.all.iter().filter(unnoticed) {
            let fault = verdict.run["fault"].as_str().unwrap_or_default();
            *quiet.entry(fault.split(':').next().unwrap_or_default()).or_default() += 1;
        }
        let quiet: Vec<String> = quiet.iter().map(|(name, count)| format!("{name} {count}")).collect();
        writeln!(f, "exit 0 although the fault began: {}", quiet.join(", "))?;
        write!(f, "{} runs, {} broke a bound", self.all.len(), self.fallen())
    }
}
