//! Parsing of a recipe's text into a [`Recipe`].

use super::accept::{Accept, read_rule};
use super::keys::{self, cells, drag, evaluate, grid, list, press, random, record, root, step};
use super::load::{ReadLoad, read_load};
use super::over_time::read_over_time;
use super::{
    Checks, KEYS, Manner, OnMiss, PRESSES_MAX, Phase, Places, Recipe, SeriesScope, Step, StepLoad, UnitChoice,
};
use palpate_control::Drag;
use palpate_core::quantity::round;
use palpate_document::{self as document, Key, Problem, Problems, Table};

/// Files of a run folder that an acceptance file would overwrite.
const RUNS_OWN: [&str; 2] = ["recipe.toml", "rig.toml"];

/// Largest departure from a whole number of spacings that counts as rounding.
pub(super) const WHOLE: f64 = 1e-6;

/// Reads a recipe's text; `file` is its name in messages.
///
/// # Errors
/// All problems of the text, each with its line.
pub fn parse(file: &str, text: &str) -> Result<Recipe, Problems> {
    if document::has_key(text, "stage") && !document::has_key(text, root::step.name) {
        let problem = Problem::new(0..0, "this is a rig, not a recipe").help("give it with --rig");
        return Err(Problems::new(file, text, vec![problem]));
    }
    document::read(file, text, &KEYS, |table| {
        let name = table.text(&root::name);
        if let Some(name) = name.filter(|name| !is_folder_name(name)) {
            let problem = Problem::new(
                table.span_of(&root::name),
                format!("`name` is {name:?}, which isn't a valid folder name"),
            );
            table.complain(problem.help("use letters, digits, '-', '_' and '.'; the first character can't be '.'"));
        }
        let manner = match table.table(&root::press) {
            Some(press) => read_manner(&press, Manner::default()),
            None => Some(Manner::default()),
        };
        let solvers = table.table(&root::evaluate).and_then(|table| table.words(&evaluate::solvers));
        let solvers: Vec<String> = solvers.unwrap_or_default().into_iter().map(str::to_owned).collect();
        let rig = table.text(&root::rig).map(str::to_owned);
        let checks = table.word_or(&root::checks, &keys::CHECKS, Checks::default());
        let on_miss = table.word_or(&root::on_miss, &keys::ON_MISS, OnMiss::default());
        let series = table
            .table(&root::record)
            .map_or(Some(SeriesScope::None), |table| table.word_or(&record::series, &keys::SCOPES, SeriesScope::None));
        let accept = read_accept(table);
        let tables = table.tables(&root::step);
        if tables.is_empty() && !table.is_table(&root::step) {
            table.complain(
                Problem::new(table.span(), "there is no [[step]]: nothing to press")
                    .help("add a [[step]] with a phase, a place (grid, list, random or units) and a force or a depth"),
            );
        }
        // a wrong [press] has been reported: the steps are checked with the paper's
        let manner = manner.unwrap_or_default();
        let steps = document::all(tables.iter().map(|table| read_step(table, manner)));
        if let Some(steps) = steps.as_ref().filter(|_| !solvers.is_empty()) {
            for phase in [Phase::Calibration, Phase::Test] {
                if !steps.iter().any(|step| step.phase == phase) {
                    let shown = format!("[evaluate] requires a step with the phase \"{}\"", phase.name());
                    let help = "add such a step, or remove [evaluate] and evaluate the tables of two runs together";
                    table.complain(Problem::new(table.span_of(&root::evaluate), shown).help(help));
                }
            }
        }
        let (name, file, text) = (name?.to_owned(), file.to_owned(), text.to_owned());
        let (checks, on_miss, series, accept, presses_max) = (checks?, on_miss?, series?, accept?, PRESSES_MAX);
        Some(Recipe {
            name,
            steps: steps?,
            solvers,
            rig,
            checks,
            on_miss,
            series,
            accept,
            presses_max,
            file,
            text,
            rule_file: None,
        })
    })
}

/// Reads the acceptance rule, if there is one. The outer value is `None` if the rule is invalid.
fn read_accept(table: &Table) -> Option<Option<Accept>> {
    if !table.has(&root::accept) {
        return Some(None);
    }
    if table.is_text(&root::accept) {
        let name = table.text(&root::accept)?;
        if !name.ends_with(".toml") || name.contains(['/', '\\']) || !is_folder_name(name) {
            let problem = Problem::new(
                table.span_of(&root::accept),
                format!("`accept` is {name:?}, which isn't the name of a .toml file in the recipe's folder"),
            );
            table.complain(problem.help("write a file name without a folder, such as \"accept.toml\""));
            return None;
        }
        if RUNS_OWN.contains(&name) {
            let problem = Problem::new(
                table.span_of(&root::accept),
                format!("`accept` is {name:?}: a run uses this name for its own file"),
            );
            table.complain(problem.help("give the acceptance file another name"));
            return None;
        }
        return Some(Some(Accept::File(name.to_owned())));
    }
    let rule = table.table(&root::accept).and_then(|table| read_rule(&table))?;
    Some(Some(Accept::Rule(rule)))
}

fn is_folder_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    !name.is_empty() && name.len() <= 100 && !name.starts_with('.') && name.chars().all(allowed)
}

/// Reads how presses are made: `base`, changed by the table's keys. `[press]` and a step have the same keys for it.
fn read_manner(table: &Table, base: Manner) -> Option<Manner> {
    let force_tolerance_n = table.number_or(&press::force_tolerance_n, base.force_tolerance_n);
    let depth_tolerance_mm = table.number_or(&press::depth_tolerance_mm, base.depth_tolerance_mm);
    let hold_s = table.number_or(&press::hold_s, base.hold_s);
    let sample_s = table.number_or(&press::sample_s, base.sample_s);
    let strategy = table.word_or(&press::strategy, &keys::STRATEGIES, base.strategy);
    let sample_after_s = table.number(&press::sample_after_s).or(base.sample_after_s);
    let follow_s = table.number(&press::follow_s).unwrap_or(base.follow_s);
    Some(Manner {
        force_tolerance_n: force_tolerance_n?,
        depth_tolerance_mm: depth_tolerance_mm?,
        hold_s: hold_s?,
        sample_s: sample_s?,
        strategy: strategy?,
        sample_after_s,
        follow_s,
    })
}

fn read_step(table: &Table, base: Manner) -> Option<Step> {
    let phase = table.word(&step::phase, &keys::PHASES);
    let manner = read_manner(table, base);
    let places_key = places_key(table);
    let (places, random_load) = match places_key.map(|key| key.name) {
        Some("grid") => (read_grid(table), None),
        Some("cells") => (read_cells(table), None),
        Some("list") => (read_list(table), None),
        Some("random") => read_random(table),
        Some("units") => (read_units(table), None),
        _ => (None, None),
    };
    // an invalid range has its own problem
    let is_random = places_key.is_some_and(|key| key.name == step::random.name);
    let inner = [&random::force_n, &random::depth_mm].map(|key| is_random && table.inner_has(&step::random, key));
    let ReadLoad { load, span: load_span } = read_load(table, phase, random_load, inner)?;
    let places_span = places_key.map_or(table.span(), |key| table.span_of(&key));
    let manner = manner?;
    if let Some((what, unit, key, tolerance, least)) = load.as_ref().map(|load| load.least(&manner))
        && tolerance >= least
    {
        let text =
            format!("the {what} tolerance of {tolerance} {unit} is not smaller than the {what} of {least} {unit}");
        let help = format!("the tolerance must be smaller than the {what}: lower `{key}`");
        table.complain(Problem::new(load_span.clone(), text).help(help));
    }
    if let (Some(StepLoad::Depths(_) | StepLoad::RandomDepth(_)), Some(Phase::Characterisation)) = (&load, phase) {
        let text = "a characterisation needs forces: its figures are over the force";
        let help = "use `staircase` or `force_n`, or the phase \"calibration\"";
        table.complain(Problem::new(load_span.clone(), text).help(help));
    }
    let over_time = read_over_time(table, phase, &manner, load.as_ref());
    let drags = read_drags(table, load.as_ref(), phase);
    let (phase, places, load, drag_span) = (phase?, places?, load?, table.span_of(&step::drag));
    Some(Step { phase, places, load, drags: drags?, over_time, manner, places_span, load_span, drag_span })
}

/// Reads the drags of a step, one for each direction; none if it has no `drag`.
fn read_drags(step_table: &Table, load: Option<&StepLoad>, phase: Option<Phase>) -> Option<Vec<Drag>> {
    if !step_table.has(&step::drag) {
        return Some(Vec::new());
    }
    let table = step_table.table(&step::drag)?;
    let [mm, speed_mm_s] = table.numbers([drag::mm, drag::speed_mm_s])?;
    let directions = table.number_or_list(&drag::directions_deg)?;
    let (shear_n, ends_at_slip) = (table.number(&drag::shear_n), table.word(&drag::slip, &keys::SLIPS)?);
    let is_plain = matches!(load, None | Some(StepLoad::Force(_) | StepLoad::RandomForce(_)));
    if directions.is_empty() || !is_plain || phase == Some(Phase::Characterisation) {
        let text = "a drag needs a press by force and at least one direction, in a calibration or a test";
        step_table
            .complain(Problem::new(table.span(), text).help("use `force_n`, and directions_deg = [0, 90, 180, 270]"));
        return None;
    }
    let along = |degrees: &f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        // toward 0, so that no way is longer than `mm`
        let [x_mm, y_mm] = [cos, sin].map(|share| (mm * round(share, 9) * 1e6).trunc() / 1e6);
        Drag { x_mm, y_mm, speed_mm_s, shear_n, ends_at_slip }
    };
    Some(directions.iter().map(along).collect())
}

/// Returns the single key that states where to press. Reports a problem if there is no such key, or more than one.
fn places_key(table: &Table) -> Option<Key> {
    let keys = step::KEYS.cases.iter().flat_map(|case| case.keys);
    let there: Vec<Key> = keys.clone().copied().filter(|key| table.has(key)).collect();
    match there[..] {
        [key] => Some(key),
        [] => {
            let help = format!("add one of {}", keys.map(|key| key.name).collect::<Vec<_>>().join(", "));
            table.complain(Problem::new(table.span(), "this step has no places").help(help));
            None
        }
        [first, second, ..] => {
            let text = format!("this step gives its places twice: `{}` and `{}`", first.name, second.name);
            table.complain(Problem::new(table.span_of(&second), text).help("split it into two steps"));
            None
        }
    }
}

fn read_grid(step: &Table) -> Option<Places> {
    let table = step.table(&step::grid)?;
    let x_mm = table.range(&grid::x_mm);
    let y_mm = table.range(&grid::y_mm);
    let spacing_mm = table.number(&grid::spacing_mm);
    let order = table.word(&grid::order, &keys::ORDERS);
    if let (Some(x), Some(y), Some(spacing)) = (x_mm, y_mm, spacing_mm) {
        for (key, width) in [(grid::x_mm, x.width()), (grid::y_mm, y.width())] {
            let name = key.name;
            if width > 0.0 && spacing > width {
                let text = format!("`spacing_mm` is {spacing}, more than the {width} mm of `{name}`");
                let problem = Problem::new(table.span_of(&grid::spacing_mm), text);
                table.complain(problem.help("use a spacing smaller than the extent"));
            } else if !divides(spacing, width) {
                let text = format!("`spacing_mm` {spacing} doesn't divide the {width} mm of `{name}`");
                let problem = Problem::new(table.span_of(&grid::spacing_mm), text);
                table.complain(match nearest_spacings(spacing, width) {
                    nearest if nearest.is_empty() => problem,
                    nearest => problem.help(format!("the nearest spacings that do: {nearest}")),
                });
            }
        }
    }
    Some(Places::Grid { x_mm: x_mm?, y_mm: y_mm?, spacing_mm: spacing_mm?, order: order? })
}

fn read_cells(step: &Table) -> Option<Places> {
    let table = step.table(&step::cells)?;
    let (x_mm, y_mm) = (table.range(&cells::x_mm), table.range(&cells::y_mm));
    let (columns, rows) = (table.whole(&cells::columns), table.whole(&cells::rows));
    Some(Places::Cells { x_mm: x_mm?, y_mm: y_mm?, columns: columns? as usize, rows: rows? as usize })
}

/// Largest number of spaces along a side for which other spacings are suggested. The second constant is the number of trials in
/// each direction.
const MOST_SPACES: f64 = 10_000.0;
const SPACINGS_TRIED: u64 = 1000;

/// Whether a width is an integer number of spaces, except for rounding.
fn divides(spacing: f64, width: f64) -> bool {
    let spaces = width / spacing;
    // spaces without number are too many, which the plan reports
    spaces.is_infinite() || (spaces - spaces.round()).abs() <= WHOLE * spaces.max(1.0)
}

/// Returns the next smaller and the next larger spacing that divide a width and can be written with four decimals.
fn nearest_spacings(spacing: f64, width: f64) -> String {
    let few = (width / spacing).clamp(1.0, MOST_SPACES) as u64;
    let written = |spaces: u64| (1e4 * width / spaces as f64).round() / 1e4;
    let is_exact = |spaces: &u64| written(*spaces) > 0.0 && divides(written(*spaces), width);
    let smaller = (few + 1..=few + SPACINGS_TRIED).find(is_exact);
    let larger = (1..=few).rev().take(SPACINGS_TRIED as usize).find(is_exact);
    let found: Vec<String> = smaller.into_iter().chain(larger).map(|spaces| written(spaces).to_string()).collect();
    found.join(" and ")
}

fn read_list(step: &Table) -> Option<Places> {
    let table = step.table(&step::list)?;
    let places = table.places(&list::places_mm)?;
    if places.is_empty() {
        table.complain(Problem::new(table.span_of(&list::places_mm), "`places_mm` is empty: nothing to press"));
    }
    Some(Places::List(places))
}

fn read_random(step: &Table) -> (Option<Places>, Option<StepLoad>) {
    let Some(table) = step.table(&step::random) else { return (None, None) };
    let count = table.whole(&random::count);
    let x_mm = table.range(&random::x_mm);
    let y_mm = table.range(&random::y_mm);
    let force = table.range(&random::force_n).map(StepLoad::RandomForce);
    let depth = table.range(&random::depth_mm).map(StepLoad::RandomDepth);
    let places = match (count, x_mm, y_mm) {
        (Some(count), Some(x_mm), Some(y_mm)) => Some(Places::Random { count, x_mm, y_mm }),
        _ => None,
    };
    (places, force.or(depth))
}

fn read_units(step: &Table) -> Option<Places> {
    if step.is_text(&step::units) {
        return step.word(&step::units, &keys::ALL_UNITS).map(|()| Places::Units(UnitChoice::All));
    }
    let span = step.span_of(&step::units);
    let units = step.wholes(&step::units)?;
    if units.is_empty() {
        step.complain(Problem::new(span.clone(), "`units` is empty: nothing to press").help("write \"all\" or [1, 2]"));
    }
    Some(Places::Units(UnitChoice::Some(units.iter().map(|&unit| (unit as usize, span.clone())).collect())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems(text: &str) -> Vec<String> {
        parse("r.toml", text).map_or_else(|problems| problems.lines(), |_| Vec::new())
    }

    fn step(body: &str) -> Vec<String> {
        problems(&format!("name = \"r\"\n[[step]]\nphase = \"test\"\n{body}\n"))
    }

    #[test]
    fn a_spacing_that_is_suggested_is_accepted() {
        for (spacing, width) in [(0.7, 12.0), (0.65, 12.0), (0.3, 10.0), (7.0, 12.0), (0.9, 1.0), (1.3, 3.3)] {
            let text = nearest_spacings(spacing, width);
            assert!(!text.is_empty(), "{spacing} {width}");
            for suggested in text.split(" and ") {
                assert!(divides(suggested.parse().unwrap(), width), "{spacing} of {width}: {suggested}");
            }
        }
        assert_eq!(nearest_spacings(0.7, 12.0), "0.6 and 0.75");
    }

    #[test]
    fn variants_of_a_good_grid_are_refused() {
        let good = "grid = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 0.5 }\nforce_n = 1.0";
        assert_eq!(step(good), [""; 0]);
        for (from, to, text) in [
            ("spacing_mm = 0.5", "spacing_mm = 13", "r.toml:4:63: `spacing_mm` is 13, more than the 12 mm of `x_mm`"),
            (
                "spacing_mm = 0.5",
                "spacing_mm = 0.7",
                "r.toml:4:63: `spacing_mm` 0.7 doesn't divide the 12 mm of `x_mm`",
            ),
            ("spacing_mm = 0.5", "spacing_mm = 0", "r.toml:4:63: `spacing_mm` is 0, must be over 0, at most 1000 mm"),
            ("spacing_mm = 0.5", "spacing = 0.5", "r.toml:4:50: unknown key `spacing` in `step.grid`"),
            ("[-6.0, 6.0], y", "[6.0, -6.0], y", "r.toml:4:17: `x_mm` has its first number above the second: 6 to -6"),
            ("force_n = 1.0", "force_n = nan", "r.toml:5:11: `force_n` is not a finite number"),
            (
                "force_n = 1.0",
                "force_n = 0.05",
                "r.toml:5:11: the force tolerance of 0.05 N is not smaller than the force of 0.05 N",
            ),
            ("force_n = 1.0", "force_mn = 1.0", "r.toml:2:1: this step has no force and no depth"),
        ] {
            assert_eq!(step(&good.replacen(from, to, 1))[0], text);
        }
    }

    #[test]
    fn an_order_and_a_strategy_are_known_by_their_names_alone() {
        let good = "grid = { x_mm = [-6, 6], y_mm = [-6, 6], spacing_mm = 0.5, order = \"interleaved\" }\n\
                    force_n = 1.0\nstrategy = \"map\"";
        assert_eq!(step(good), [""; 0]);
        for (from, to, text) in [
            (
                "interleaved",
                "interlaced",
                "r.toml:4:68: `order` is \"interlaced\", expected one of raster, interleaved",
            ),
            ("map", "mapped", "r.toml:6:12: `strategy` is \"mapped\", expected one of guarded, velocity, map"),
        ] {
            assert_eq!(step(&good.replacen(from, to, 1)), [text]);
        }
    }

    #[test]
    fn an_empty_grid_or_list_or_set_is_refused() {
        assert_eq!(step("grid = {}\nforce_n = 1.0").len(), 3);
        assert_eq!(
            step("list = { places_mm = [] }\nforce_n = 1.0"),
            ["r.toml:4:22: `places_mm` is empty: nothing to press"]
        );
        let none = step("random = { count = 0, x_mm = [0, 1], y_mm = [0, 1], force_n = [0.1, 1] }");
        assert_eq!(none, ["r.toml:4:20: `count` is 0, must be 1 to 10000000"]);
        assert_eq!(problems("name = \"r\"\n"), ["r.toml:1:1: there is no [[step]]: nothing to press"]);
    }

    #[test]
    fn times_over_a_day_and_words_for_numbers_are_refused() {
        let text = "name = \"r\"\n[press]\nhold_s = 86401\nsample_s = \"100 ms\"\n[[step]]\nphase = \"tset\"\nunits = \"all\"\nforce_n = 1\n";
        assert_eq!(
            problems(text),
            [
                "r.toml:3:10: `hold_s` is 86401, must be 0 to 86400 s",
                "r.toml:4:12: `sample_s` is a string, expected a number in s",
                "r.toml:6:9: `phase` is \"tset\", expected one of characterisation, calibration, test, creep, ramp, rest, cycles, wave",
            ]
        );
    }
}
