//! The numbers of the pages about the force loop and the drivers: each follows from a constant, from a line of the source, or from a
//! table that a campaign measures.

use std::fs;
use std::path::Path;

const FORCE_LOOP: &str = "docs/explanation/force-loop.md";
const DRIVERS: &str = "docs/reference/drivers.md";
const PROCESS: &str = "docs/reference/process.md";

/// The table that `PALPATE_TESTS=full cargo test --release --test control false_trips::` compares with what it measures.
const MEASURED: &str = "tests/control/force_loop.md";

/// A phrase of a page, with `{}` for each value.
struct Stated {
    page: &'static str,
    phrase: &'static str,
    from: &'static [Source],
}

/// Where a value is in the source.
enum Source {
    /// A constant of a file, and how the page writes it.
    Value(&'static str, &'static str, fn(f64) -> String),
    /// A text that a file has, from which the numbers of the phrase follow. It fills no `{}`.
    Text(&'static str, &'static str),
}

use Source::{Text, Value};

const fn stated(page: &'static str, phrase: &'static str, from: &'static [Source]) -> Stated {
    Stated { page, phrase, from }
}

const PERMITTED: Source = Text("crates/control/src/permit.rs", "self.limits.force_n - force_n - 3.0 * sigma_n");
const CALIBRATION: Source =
    Text("recipes/bench.toml", "grid = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 0.5 }\nforce_n = 1.0");
const STALE: Source = Value("crates/control/src/zero.rs", "STALE_S", plain);
const STALE_GAPS: Source = Value("crates/control/src/zero.rs", "STALE_GAPS", word);
const STALE_MOST: Source = Value("crates/control/src/zero.rs", "STALE_MOST_S", plain);

/// Every number of the page of the force loop, and every time of the pages of the drivers.
const STATED: [Stated; 42] = [
    stated(FORCE_LOOP, "F + 3 sigma + k (z - max(z_now, z_first)) <= force limit", &[PERMITTED]),
    stated(
        FORCE_LOOP,
        "from {} mN/s on, it corrects",
        &[Value("crates/control/src/drift.rs", "USED_N_S", thousandths)],
    ),
    stated(FORCE_LOOP, "force limit in {} s ends the run", &[Value("crates/control/src/drift.rs", "PRESS_S", plain)]),
    stated(
        FORCE_LOOP,
        "with {} times the limit, from the last point",
        &[Value("crates/control/src/press/follows.rs", "UNPROVEN", plain)],
    ),
    stated(
        FORCE_LOOP,
        "a time constant of {} s would",
        &[Value("crates/control/src/press/follows.rs", "SLOWEST_S", plain)],
    ),
    stated(
        FORCE_LOOP,
        "or from {} places, palpate predicts",
        &[Value("crates/control/src/neighbours.rs", "LEARNED", word)],
    ),
    stated(
        FORCE_LOOP,
        "or 5 % over the set force",
        &[Text("crates/control/src/learned_curve.rs", "const OVER: (f64, f64) = (0.02, 0.05);")],
    ),
    stated(
        FORCE_LOOP,
        "are {} sd of the prediction, and at least {}.",
        &[
            Value("crates/control/src/neighbours.rs", "SIGMAS", word),
            Value("crates/control/src/neighbours.rs", "LEAST", percent),
        ],
    ),
    stated(
        FORCE_LOOP,
        "above {} times the limit after a stop",
        &[Value("crates/run/src/run/last_resort.rs", "LAST_RESORT_SHARE", plain)],
    ),
    stated(FORCE_LOOP, "the way up and {} s", &[Value("crates/run/src/run/retraction.rs", "END_DEADLINE", plain)]),
    stated(
        FORCE_LOOP,
        "rises by more than {} of the limit",
        &[Value("crates/control/src/watch.rs", "RISE_SHARE", percent)],
    ),
    stated(FORCE_LOOP, "z moves {} mm away", &[Value("crates/run/src/run/home.rs", "NUDGE_MM", plain)]),
    stated(FORCE_LOOP, "`(limit - 3 sigma) / stiffness`", &[PERMITTED]),
    stated(
        FORCE_LOOP,
        "a drift of {} of the force limit",
        &[Value("crates/run/src/run/execute.rs", "NEW_ZERO_SHARE", percent)],
    ),
    stated(
        FORCE_LOOP,
        "at most {} mN above the set force",
        &[Value("crates/study/src/control.rs", "HARD_OVER_MN", plain)],
    ),
    stated(FORCE_LOOP, "at most {} mN above the set force", &[Value("tests/pages/study.rs", "HARD_OVER_MN", plain)]),
    stated(FORCE_LOOP, "up to {} N/mm", &[Value("crates/study/src/scenes.rs", "HARD_N_MM", plain)]),
    stated(
        FORCE_LOOP,
        "On steel ({} N/mm) it is at most {} mN",
        &[
            Value("crates/study/src/scenes.rs", "STEEL_N_MM", plain),
            Value("crates/study/src/control.rs", "STEEL_OVER_MN", plain),
        ],
    ),
    stated(
        FORCE_LOOP,
        "from {} presses it learns",
        &[Value("crates/data/src/recipe/training.rs", "TRAINING_PRESSES", word)],
    ),
    stated(FORCE_LOOP, "1 N at 625 places 0.5 mm apart", &[CALIBRATION]),
    stated(FORCE_LOOP, "a cell with {} mN of noise", &[Value("tests/control/false_trips.rs", "NOISE_N", thousandths)]),
    stated(
        FORCE_LOOP,
        "`map` ran with seeds 1 to 10, the others with 1 and 2",
        &[
            Text("tests/control/false_trips.rs", "seeds(10).map(|seed| whole(NOISE_N, seed))"),
            Text("tests/control/false_trips.rs", "&seeds(2).map(whole)"),
        ],
    ),
    stated(
        DRIVERS,
        "may be silent for 2 to 5 s. The driver waits {} s for an answer",
        &[
            Value("crates/drivers/src/esp301.rs", "ANSWER_DEADLINE", plain),
            Text("crates/drivers/src/esp301.rs", "silent for 2 to 5 s"),
        ],
    ),
    stated(
        DRIVERS,
        "or for {} s; then it asks for the status every {} s, for {} s in all",
        &[
            Value("crates/drivers/src/grbl/port.rs", "BOOT", plain),
            Value("crates/drivers/src/grbl/port.rs", "ASK_EVERY", plain),
            Value("crates/drivers/src/grbl/port.rs", "START_MAX", plain),
        ],
    ),
    stated(DRIVERS, "move in pieces of {} s", &[Value("crates/run/src/run/motion.rs", "PIECE_S", plain)]),
    stated(
        DRIVERS,
        "Each motion ends some {} s late",
        &[Value("crates/run/src/rig/family/klipper.rs", "LATE_S", plain)],
    ),
    stated(
        DRIVERS,
        "a slow link makes presses slow. Up to 200 ms work",
        &[Text("tests/control/slow_lines.rs", "[200.0, 200.0]")],
    ),
    stated(
        DRIVERS,
        "{} characters, or {} ms above 19,200 baud",
        &[
            Value("crates/drivers/src/modbus/request.rs", "SILENT_CHARACTERS", plain),
            Value("crates/drivers/src/modbus/request.rs", "FAST_SILENCE", thousandths),
            Text("crates/drivers/src/modbus/request.rs", "FAST_BAUD: u32 = 19_200"),
        ],
    ),
    stated(
        DRIVERS,
        "older than {} s; for a slow cell, {} gaps between readings, at most {} s",
        &[STALE, STALE_GAPS, STALE_MOST],
    ),
    stated(DRIVERS, "of 0.01 N, some 80 readings per second", &[]), // the device's manual
    stated(
        PROCESS,
        "An answer is due within {} s",
        &[Value("crates/drivers/src/process/port.rs", "ANSWER_DEADLINE", plain)],
    ),
    stated(PROCESS, "`prepare` {} s", &[Value("crates/drivers/src/process/port.rs", "PREPARE_DEADLINE", plain)]),
    stated(PROCESS, "`driver`, {} s by default", &[Value("crates/run/src/rig/family/process.rs", "START_S", plain)]),
    stated(
        PROCESS,
        "cell {} s plus one conversion",
        &[Value("crates/drivers/src/process/port.rs", "FORCE_DEADLINE", plain)],
    ),
    stated(PROCESS, "{} s for the first", &[Value("crates/drivers/src/process/port.rs", "ANSWER_DEADLINE", plain)]),
    stated(
        PROCESS,
        "older than {} s; for a slow cell, {} gaps between readings, at most {} s",
        &[STALE, STALE_GAPS, STALE_MOST],
    ),
    stated(
        PROCESS,
        "asked for `status` every {} ms",
        &[Value("crates/drivers/src/process/stage.rs", "STATUS_EVERY", thousandths)],
    ),
    stated(
        PROCESS,
        "{} s and a tenth after the due time",
        &[
            Value("crates/run/src/run/motion.rs", "SILENT_S", plain),
            Text("crates/run/src/run/motion.rs", "LATE_SHARE: f64 = 0.1;"),
        ],
    ),
    stated(PROCESS, "move in pieces of {} s", &[Value("crates/run/src/run/motion.rs", "PIECE_S", plain)]),
    stated(
        PROCESS,
        "After {} s its process group",
        &[Value("crates/link/src/wire/program.rs", "INPUT_ENDED_DEADLINE", plain)],
    ),
    stated(
        PROCESS,
        "After another {} s the group",
        &[Value("crates/link/src/wire/program.rs", "TERMINATED_DEADLINE", plain)],
    ),
    stated(
        PROCESS,
        "waits at most {} s for its answer",
        &[Value("crates/run/src/run/home.rs", "STOPPED_DEADLINE", plain)],
    ),
];

#[test]
fn every_number_of_the_force_loop_and_every_wait_of_the_drivers_has_its_source() {
    let mut wrong = Vec::new();
    for page in [FORCE_LOOP, DRIVERS, PROCESS] {
        let mut text = spaced(&read(page).replace(&read(MEASURED), ""));
        for Stated { phrase, from, .. } in STATED.iter().filter(|stated| stated.page == page) {
            match filled(phrase, from) {
                Ok(phrase) if spaced(&read(page)).contains(&phrase) => text = text.replace(&phrase, ""),
                Ok(phrase) => wrong.push(format!("{page} doesn't state, as the source does: {phrase}")),
                Err(why) => wrong.push(format!("{page}: {phrase}: {why}")),
            }
        }
        let numbers = if page == FORCE_LOOP { numbers(&text) } else { times(&text) };
        wrong.extend(numbers.into_iter().map(|around| format!("{page} has a number without a source: {around}")));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn measured_table_is_that_of_the_page_and_of_the_readme() {
    let (table, page) = (read(MEASURED), read(FORCE_LOOP));
    let missing: Vec<&str> = table.lines().filter(|row| !page.lines().any(|line| line == *row)).collect();
    assert!(missing.is_empty(), "{FORCE_LOOP} isn't {MEASURED}:\n{}", missing.join("\n"));
    let row = |name: &str| -> Vec<String> {
        let row = table.lines().find(|line| line.starts_with(&format!("| {name}"))).expect("a row");
        row.split('|').skip(2).take(2).map(|cell| cell.trim().to_owned()).collect()
    };
    let seconds = |cell: &String| cell.trim_end_matches(" s").parse::<f64>().expect("a time");
    let over_mn = row("`map`: largest force above the set force");
    let expected =
        format!("| {} for a press of 1 N; at most {} over the set force |", row("`map`: median time")[0], over_mn[0]);
    assert!(read("README.md").contains(&expected), "README.md doesn't state: {expected}");
    // "It isn't faster than guarded here"
    let (velocity, guarded) = (row("`velocity`: median time"), row("`guarded`: median time"));
    assert!(velocity.iter().zip(&guarded).all(|(velocity, guarded)| seconds(velocity) >= seconds(guarded)));
}

#[test]
fn numbers_are_found() {
    assert_eq!(numbers("ESP301 and M410 at 5 % (0.5 mm), v2"), ["at 5 %", "% (0.5 mm),"]);
    assert_eq!(
        times("waits 6 s, 3 times, `$1=255`, 2.5 ms; 7 seconds"),
        ["waits 6 s,", "`$1=255`, 2.5 ms;", "ms; 7 seconds"]
    );
    assert_eq!(filled("{} a {}", &[STALE, STALE_GAPS]).as_deref(), Ok("0.25 a three"));
    assert!(filled("{}", &[Value("README.md", "NOTHING", plain)]).is_err());
}

/// Returns a phrase with its values, or what the source doesn't have.
fn filled(phrase: &str, from: &[Source]) -> Result<String, String> {
    let mut phrase = phrase.to_owned();
    for source in from {
        match source {
            Text(file, text) if !read(file).contains(text) => return Err(format!("{file} hasn't `{text}` any more")),
            Text(..) => {}
            Value(file, name, written) => {
                let value = constant(&read(file), name).ok_or_else(|| format!("{file} hasn't {name} any more"))?;
                phrase = phrase.replacen("{}", &written(value), 1);
            }
        }
    }
    Ok(phrase)
}

/// Returns the value of a constant, a duration in seconds.
fn constant(source: &str, name: &str) -> Option<f64> {
    let (_, rest) = source.split_once(&format!("const {name}: "))?;
    let value = rest.split_once('=')?.1.split_once(';')?.0.trim();
    let durations = [("Duration::from_secs(", 1.0), ("Duration::from_millis(", 1e3), ("Duration::from_micros(", 1e6)];
    let (text, parts) = durations
        .into_iter()
        .find_map(|(start, parts)| Some((value.strip_prefix(start)?.strip_suffix(')')?, parts)))
        .unwrap_or((value, 1.0));
    Some(text.replace('_', "").parse::<f64>().ok()? / parts)
}

fn plain(value: f64) -> String {
    format!("{value}")
}

fn thousandths(value: f64) -> String {
    format!("{}", (1e6 * value).round() / 1e3)
}

fn percent(value: f64) -> String {
    format!("{} %", (1e4 * value).round() / 1e2)
}

fn word(value: f64) -> String {
    const WORDS: [&str; 11] = ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"];
    WORDS.iter().enumerate().find(|(n, _)| *n as f64 == value).map_or(plain(value), |(_, word)| (*word).to_owned())
}

/// The numbers of a text, each with the words around it. `ESP301` is a name.
fn numbers(text: &str) -> Vec<String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let is_number =
        |word: &str| word.trim_start_matches(|c: char| !c.is_alphanumeric()).starts_with(|c: char| c.is_ascii_digit());
    (0..words.len()).filter(|&n| is_number(words[n])).map(|n| around(&words, n)).collect()
}

/// The numbers of a text before a unit of time.
fn times(text: &str) -> Vec<String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let is_time =
        |word: &&str| ["s", "ms", "second", "seconds"].contains(&word.trim_matches(|c: char| !c.is_alphanumeric()));
    let is_number = |word: &str| word.ends_with(|c: char| c.is_ascii_digit());
    (0..words.len())
        .filter(|&n| is_number(words[n]) && words.get(n + 1).is_some_and(is_time))
        .map(|n| around(&words, n))
        .collect()
}

fn around(words: &[&str], n: usize) -> String {
    words[n.saturating_sub(1)..words.len().min(n + 2)].join(" ")
}

/// A text with single spaces, without the targets of its links.
fn spaced(text: &str) -> String {
    let mut left = String::new();
    for (nth, part) in text.split("](").enumerate() {
        left += if nth == 0 { part } else { part.split_once(')').map_or(part, |(_, rest)| rest) };
    }
    left.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn read(file: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{file}: {error}"))
}
