//! A batch file: which sensors are calibrated, with which rig and recipes, and how they are judged.

use super::keys::{nest, offset_mm, prior, reference, root, serials, typical};
use super::{KEYS, ReferenceSensor, SERIALS_MAX, check_serial};
use palpate_core::quantity::Place;
use palpate_data::dataset::{LABEL_MOST, is_label};
use palpate_document::notify::read_command;
use palpate_document::{self as document, Key, Problem, Problems, Table};
use palpate_solver::SENSORS_LEAST;
use std::collections::HashSet;

/// Largest numbers of recipes, nests and words of a command.
const RECIPES_MAX: usize = 10;
const NESTS_MAX: usize = 100;
const PRIOR_RUNS_MAX: usize = 100;

/// A parsed batch file. File names are as written: relative to the batch file, or names of shipped files.
#[derive(Clone, Debug, PartialEq)]
pub struct BatchFile {
    /// Name of the batch, which is also that of its folder.
    pub name: String,
    /// Name of the design.
    pub design: String,
    /// The design's prior.
    pub prior: Option<PriorRuns>,
    /// Rig file.
    pub rig: String,
    /// Recipe files, at least one.
    pub recipes: Vec<String>,
    /// File with the acceptance rule; `None`: that of the first recipe, if it has one.
    pub accept: Option<String>,
    /// Serial numbers in their order.
    pub serials: Vec<String>,
    /// Name of the operator.
    pub operator: Option<String>,
    /// Name of the bench; `None`: that of the rig file.
    pub bench: Option<String>,
    /// Random seed of a simulated batch.
    pub seed: u64,
    /// Time between the last serial number and the first motion, s.
    pub warm_up_s: f64,
    /// The reference sensor.
    pub reference: Option<ReferenceSensor>,
    /// Places of the tray; empty: one sensor at a time at the rig's own origin.
    pub nests: Vec<Nest>,
    /// Errors of a typical sensor.
    pub typical: Typical,
    /// Program that is started for events, with its arguments; empty: none.
    pub notify: Vec<String>,
}

/// What makes the design's prior.
#[derive(Clone, Debug, PartialEq)]
pub struct PriorRuns {
    /// Run folders of full calibrations, one for each sensor.
    pub runs: Vec<String>,
    /// Expected mean location error above which more presses are used, mm.
    pub enough_mm: Option<f64>,
}

/// A place of a tray.
#[derive(Clone, Debug, PartialEq)]
pub struct Nest {
    /// Its name.
    pub name: String,
    /// Distance of its specimen's origin from the rig's, along the stage's axes, mm.
    pub offset: Place,
}

/// Stated errors of a typical sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Typical {
    /// Mean location error, mm.
    pub location_mean_mm: Option<f64>,
    /// Mean force error, N.
    pub force_mean_n: Option<f64>,
}

/// Reads a batch file's text; `file` is its name in messages.
///
/// # Errors
/// All problems of the text, each with its line.
pub fn parse(file: &str, text: &str) -> Result<BatchFile, Problems> {
    if !document::has_key(text, root::serials.name) && document::has_key(text, "step") {
        let problem =
            Problem::new(0..0, "this is a recipe, not a batch file").help("name it in `recipes` of a batch file");
        return Err(Problems::new(file, text, vec![problem]));
    }
    document::read(file, text, &KEYS, read)
}

fn read(table: &Table) -> Option<BatchFile> {
    let name = read_name(table, &root::name);
    let design = label(table, &root::design);
    let prior = document::optional(table.table(&root::prior), read_prior);
    let rig = label(table, &root::rig);
    let recipes = read_recipes(table);
    let accept = optional_label(table, &root::accept);
    let listed = if table.is_table(&root::serials) { read_counted(table) } else { read_listed(table) };
    let operator = optional_label(table, &root::operator);
    let bench = optional_label(table, &root::bench);
    let (seed, warm_up_s) = (table.whole(&root::seed), table.number(&root::warm_up_s));
    let reference = document::optional(table.table(&root::reference), |inner| read_reference(inner, &listed));
    let nests = read_nests(table);
    let typical = document::optional(table.table(&root::typical), |typical| {
        let location_mean_mm = typical.number(&typical::location_mean_mm);
        Some(Typical { location_mean_mm, force_mean_n: typical.number(&typical::force_mean_n) })
    });
    let notify = document::optional(table.table(&root::notify), read_command);
    Some(BatchFile {
        name: name?,
        design: design?,
        prior: prior?,
        rig: rig?,
        recipes: recipes?,
        accept: accept?,
        serials: listed?,
        operator: operator?,
        bench: bench?,
        seed: seed?,
        warm_up_s: warm_up_s?,
        reference: reference?,
        nests: nests?,
        typical: typical?.unwrap_or_default(),
        notify: notify?.unwrap_or_default(),
    })
}

/// Reads a name that is also the name of a folder.
fn read_name(table: &Table, key: &Key) -> Option<String> {
    let name = table.text(key)?;
    match check_serial(name) {
        Ok(()) => Some(name.to_owned()),
        Err(_) => complain(
            table,
            key,
            format!("`{}` is {name:?}, which isn't a valid folder name", key.name),
            "use letters, digits, '-', '_' and '.'; the first character can't be '.'",
        ),
    }
}

/// Reads a text that can be printed anywhere.
fn label(table: &Table, key: &Key) -> Option<String> {
    let text = table.text(key)?;
    match is_label(text) {
        true => Some(text.to_owned()),
        false => {
            let problem = format!("`{}` has no, too many or unprintable characters", key.name);
            complain(table, key, problem, &format!("use 1 to {LABEL_MOST} printable characters"))
        }
    }
}

/// Reads such a text if it is there. The outer value is `None` if it is invalid.
fn optional_label(table: &Table, key: &Key) -> Option<Option<String>> {
    if table.has(key) { label(table, key).map(Some) } else { Some(None) }
}

fn read_prior(table: &Table) -> Option<PriorRuns> {
    let (runs, enough_mm) = (table.texts(&prior::runs), table.number(&prior::enough_mm));
    let runs: Vec<String> = runs?.into_iter().map(str::to_owned).collect();
    if !(SENSORS_LEAST..=PRIOR_RUNS_MAX).contains(&runs.len()) {
        let problem = format!("`runs` names {} run folders, expected {SENSORS_LEAST} to {PRIOR_RUNS_MAX}", runs.len());
        return complain(
            table,
            &prior::runs,
            problem,
            "name a full calibration of each of some sensors; five are a good number",
        );
    }
    Some(PriorRuns { runs, enough_mm })
}

fn read_recipes(table: &Table) -> Option<Vec<String>> {
    let recipes = table.texts(&root::recipes)?;
    if recipes.is_empty() || recipes.len() > RECIPES_MAX || recipes.iter().any(|recipe| recipe.trim().is_empty()) {
        let problem = format!("`recipes` must name 1 to {RECIPES_MAX} files");
        return complain(table, &root::recipes, problem, "name at least the recipe that every sensor gets");
    }
    Some(recipes.into_iter().map(str::to_owned).collect())
}

fn read_listed(table: &Table) -> Option<Vec<String>> {
    let serials: Vec<String> = table.texts(&root::serials)?.into_iter().map(str::to_owned).collect();
    match check_serials(&serials) {
        Ok(()) => Some(serials),
        Err(problem) => {
            complain(table, &root::serials, problem, "list each sensor once, by the text that is typed for it")
        }
    }
}

fn read_counted(table: &Table) -> Option<Vec<String>> {
    let inner = table.table(&root::serials)?;
    let prefix = inner.text(&serials::prefix);
    let (first, last) = (inner.whole(&serials::first), inner.whole(&serials::last));
    let digits = inner.whole(&serials::digits);
    let (prefix, first, last, digits) = (prefix?, first?, last?, digits? as usize);
    if last < first || last - first >= SERIALS_MAX as u64 {
        let problem = format!("`serials` counts from {first} to {last}: expected 1 to {SERIALS_MAX} sensors");
        return complain(table, &root::serials, problem, "`last` is the number of the last sensor");
    }
    let serials: Vec<String> = (first..=last).map(|number| format!("{prefix}{number:0digits$}")).collect();
    match check_serials(&serials) {
        Ok(()) => Some(serials),
        Err(problem) => complain(table, &root::serials, problem, "correct `prefix`"),
    }
}

/// Checks that all serial numbers are valid, and different even if capitals don't count, as in the names of some systems' folders.
fn check_serials(serials: &[String]) -> Result<(), String> {
    if serials.is_empty() || serials.len() > SERIALS_MAX {
        return Err(format!("`serials` has {} sensors, expected 1 to {SERIALS_MAX}", serials.len()));
    }
    let mut seen = HashSet::with_capacity(serials.len());
    for serial in serials {
        check_serial(serial).map_err(|problem| format!("`serials` has {serial:?}: {problem}"))?;
        if !seen.insert(serial.to_ascii_lowercase()) {
            return Err(format!("`serials` has {serial:?} twice; capitals make no difference"));
        }
    }
    Ok(())
}

fn read_reference(table: &Table, sensors: &Option<Vec<String>>) -> Option<ReferenceSensor> {
    let serial = read_name(table, &reference::serial);
    let every = table.whole(&reference::every);
    let serial = serial?;
    let is_it = |sensor: &String| sensor.eq_ignore_ascii_case(&serial);
    if sensors.as_ref().is_some_and(|sensors| sensors.iter().any(is_it)) {
        let problem = format!("the reference sensor {serial:?} is also in `serials`");
        return complain(table, &reference::serial, problem, "remove it from `serials`: it isn't judged");
    }
    Some(ReferenceSensor { serial, every: every? })
}

fn read_nests(table: &Table) -> Option<Vec<Nest>> {
    let tables = table.tables(&root::nest);
    if tables.len() > NESTS_MAX {
        let problem = format!("there are {} nests, at most {NESTS_MAX} are allowed", tables.len());
        return complain(table, &root::nest, problem, "state the places of one tray");
    }
    let mut names = HashSet::new();
    let nests = document::all(tables.iter().map(|table| {
        let name = read_name(table, &nest::name);
        let offset = table.table(&nest::offset_mm).and_then(|offset| {
            let (x, y) = (offset.number(&offset_mm::x), offset.number(&offset_mm::y));
            Some(Place::new(x?, y?))
        });
        let name = name?;
        if !names.insert(name.clone()) {
            return complain(table, &nest::name, format!("there are two nests {name:?}"), "give each its own name");
        }
        Some(Nest { name, offset: offset? })
    }));
    if tables.is_empty() && table.has(&root::nest) { None } else { nests }
}

fn complain<T>(table: &Table, key: &Key, problem: String, help: &str) -> Option<T> {
    table.complain(Problem::new(table.span_of(key), problem).help(help));
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_document::sample::assert_read_is_listed;

    const BATCH: &str = r#"
name = "day"
design = "skin"
rig = "rig.toml"
recipes = ["a.toml"]
serials = { prefix = "A-", first = 9, last = 11, digits = 2 }
"#;

    fn lines(text: &str) -> Vec<String> {
        parse("b.toml", text).err().map(|problems| problems.lines()).unwrap_or_default()
    }

    fn with(from: &str, to: &str) -> Vec<String> {
        assert!(BATCH.contains(from), "{from}");
        lines(&BATCH.replacen(from, to, 1))
    }

    #[test]
    fn batch_reader_reads_exactly_the_listed_keys() {
        assert_read_is_listed(&KEYS, |text| drop(parse("batch.toml", text)));
    }

    #[test]
    fn a_batch_file_is_read_with_its_defaults() {
        let batch = parse("b.toml", BATCH).unwrap();
        assert_eq!(batch.serials, ["A-09", "A-10", "A-11"]);
        assert_eq!((batch.seed, batch.warm_up_s, batch.reference, batch.nests.len()), (1, 0.0, None, 0));
        let more = format!(
            "{BATCH}operator = \"Ada\"\n[reference]\nserial = \"REF\"\n[[nest]]\nname = \"l\"\noffset_mm = {{ x = 1, y = 2 }}\n\
             [notify]\ncommand = [\"a\"]\n"
        );
        let batch = parse("b.toml", &more).unwrap();
        assert_eq!(batch.reference, Some(ReferenceSensor { serial: "REF".to_owned(), every: 2 }));
        assert_eq!(batch.nests, [Nest { name: "l".to_owned(), offset: Place::new(1.0, 2.0) }]);
        assert_eq!((batch.operator.as_deref(), batch.notify.len()), (Some("Ada"), 1));
        let listed = BATCH.replace("{ prefix = \"A-\", first = 9, last = 11, digits = 2 }", "[\"x\", \"y\"]");
        assert_eq!(parse("b.toml", &listed).unwrap().serials, ["x", "y"]);
    }

    #[test]
    fn wrong_batch_files_are_refused() {
        assert_eq!(lines(BATCH), [""; 0]);
        let mut others = Vec::new();
        for (from, to, problem) in [
            ("\"day\"", "\"a/b\"", "b.toml:2:8: `name` is \"a/b\", which isn't a valid folder name"),
            ("\"skin\"", "\"\"", "b.toml:3:10: `design` has no, too many or unprintable characters"),
            (
                "rig = \"rig.toml\"",
                "",
                "b.toml:1:1: `rig` is missing: rig file: a path relative to this file, or the name of a shipped rig",
            ),
            ("[\"a.toml\"]", "[]", "b.toml:5:11: `recipes` must name 1 to 10 files"),
            ("last = 11", "last = 8", "b.toml:6:11: `serials` counts from 9 to 8: expected 1 to 100000 sensors"),
            (
                "last = 11",
                "last = 100009",
                "b.toml:6:11: `serials` counts from 9 to 100009: expected 1 to 100000 sensors",
            ),
            (
                "\"A-\"",
                "\"A/\"",
                "b.toml:6:11: `serials` has \"A/09\": not a serial number: expected 1 to 64 letters, digits, '-', '_' and '.', and \
                 no '.' at the beginning",
            ),
            ("digits = 2", "digits = 10", "b.toml:6:59: `digits` is 10, must be 1 to 9"),
            ("serials =", "serial =", "b.toml:6:1: unknown key `serial`"),
            (
                "{ prefix = \"A-\", first = 9, last = 11, digits = 2 }",
                "[\"a\", \"b\", \"A\"]",
                "b.toml:6:11: `serials` has \"A\" twice; capitals make no difference",
            ),
            (
                "\nname",
                "\nreference = { serial = \"A-10\" }\nname",
                "b.toml:2:24: the reference sensor \"A-10\" is also in `serials`",
            ),
            ("\nname", "\nwarm_up_s = 4000\nname", "b.toml:2:13: `warm_up_s` is 4000, must be 0 to 3600 s"),
            (
                "\nname",
                "\nnotify = { command = [] }\nname",
                "b.toml:2:22: `command` must have 1 to 100 words, the first of which is the program",
            ),
            (
                "\nname",
                "\nnest = [{ name = \"a\" }]\nname",
                "b.toml:2:9: `offset_mm` is missing in `nest`: a table with `x`, `y`",
            ),
        ] {
            let found = with(from, to);
            if found.first().map(String::as_str) != Some(problem) {
                others.push((found, problem));
            }
        }
        assert!(others.is_empty(), "{others:#?}");
        let all = with("\"day\"", "\"\"\nseed = -1\nwarm_up_s = \"1 min\"");
        assert_eq!(all.len(), 3, "all problems at once: {all:?}");
        assert_eq!(lines("name = \"a\"\n[[step]]\n"), ["b.toml:1:1: this is a recipe, not a batch file"]);
    }
}
