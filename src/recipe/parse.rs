use super::{Load, Manner, Order, PRESSES_CEILING, PRESSES_MAX, Phase, Places, Recipe, Step, UnitChoice};
use crate::control::Strategy;
use crate::document::{self, Bounds, Problem, Problems, Table};
use crate::quantity::Place;
use crate::solver::{BEST, SOLVERS};

const DAY_S: f64 = 86_400.0;
const PLACE: Bounds = Bounds::within(-1000.0, 1000.0, "mm");
const FORCE: Bounds = Bounds::above(0.0, 100.0, "N");
const DWELL: Bounds = Bounds::within(0.0, DAY_S, "s");
/// Shorter windows hold less than two conversions of a common load cell.
const WINDOW: Bounds = Bounds::within(0.01, DAY_S, "s");
const SPACING: Bounds = Bounds::above(0.0, 1000.0, "mm");
const UNITS_MAX: u64 = 4096;

/// Largest departure from a whole number of spacings that counts as rounding.
const WHOLE: f64 = 1e-6;

/// Reads a recipe's text; `file` is its name in messages.
///
/// # Errors
/// Every problem of the text, each at its line.
pub fn parse(file: &str, text: &str) -> Result<Recipe, Problems> {
    document::read(file, text, |root| {
        if root.has("stage") && !root.has("step") {
            root.leave_the_rest();
            root.complain(Problem::new(root.span(), "this is a rig, not a recipe").help("give it with --rig"));
            return None;
        }
        let name = root.require_text("name", "what the run folder is named after");
        if let Some(name) = name.filter(|name| !is_folder_name(name)) {
            let help = "use letters, digits, '-', '_' and '.', not a '.' in front";
            root.complain(
                Problem::new(root.span_of("name"), format!("`name` is {name:?}, no name for a folder")).help(help),
            );
        }
        let mut manner = Manner::default();
        if let Some(mut press) = root.table("press") {
            manner = read_manner(&mut press, manner);
            press.finish();
        }
        let mut solvers = Vec::new();
        if let Some(mut evaluate) = root.table("evaluate") {
            let known = [&[BEST], &SOLVERS[..]].concat();
            let names = evaluate.choices("solvers", &known).unwrap_or_else(|| vec![SOLVERS[0]]);
            solvers = names.into_iter().map(str::to_owned).collect();
            evaluate.finish();
        }
        let tables = root.tables("step");
        if tables.is_empty() {
            root.complain(
                Problem::new(root.span(), "there is no [[step]]: nothing to press")
                    .help("add a [[step]] with a phase, a place (grid, list, random or units) and a force"),
            );
        }
        let steps = document::all(tables.into_iter().map(|table| read_step(table, manner)));
        if let Some(steps) = steps.as_ref().filter(|_| !solvers.is_empty()) {
            for phase in [Phase::Calibration, Phase::Test] {
                if !steps.iter().any(|step| step.phase == phase) {
                    let told = format!("there is nothing to evaluate: no step has the phase \"{}\"", phase.name());
                    let help = "add such a step, or leave [evaluate] out and evaluate two runs' tables together";
                    root.complain(Problem::new(root.span_of("evaluate"), told).help(help));
                }
            }
        }
        let (name, file, text) = (name?.to_owned(), file.to_owned(), text.to_owned());
        Some(Recipe { name, steps: steps?, solvers, presses_max: PRESSES_MAX, file, text })
    })
}

fn is_folder_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    !name.is_empty() && name.len() <= 100 && !name.starts_with('.') && name.chars().all(allowed)
}

fn read_manner(table: &mut Table, base: Manner) -> Manner {
    Manner {
        force_tolerance_n: table.number("force_tolerance_n", FORCE).unwrap_or(base.force_tolerance_n),
        hold_s: table.number("hold_s", DWELL).unwrap_or(base.hold_s),
        sample_s: table.number("sample_s", WINDOW).unwrap_or(base.sample_s),
        strategy: table
            .choice("strategy", &Strategy::ALL.map(|strategy| (strategy.name(), strategy)))
            .unwrap_or(base.strategy),
        sample_after_s: table.number("sample_after_s", DWELL).or(base.sample_after_s),
    }
}

fn read_step(mut table: Table, base: Manner) -> Option<Step> {
    let phases = [Phase::Characterisation, Phase::Calibration, Phase::Test].map(|phase| (phase.name(), phase));
    let phase = table.require_choice("phase", &phases);
    let manner = read_manner(&mut table, base);
    let places_key = one_of(&mut table, "where to press", &["grid", "list", "random", "units"]);
    let (places, random_force) = match places_key {
        Some("grid") => (read_grid(&mut table), None),
        Some("list") => (read_list(&mut table), None),
        Some("random") => read_random(&mut table),
        Some("units") => (read_units(&mut table), None),
        _ => (None, None),
    };
    let inner_force = random_force.is_some();
    let force = table.number("force_n", FORCE).map(Load::Force);
    let staircase = read_staircase(&mut table);
    let loads = usize::from(inner_force) + usize::from(table.has("force_n")) + usize::from(table.has("staircase"));
    if loads != 1 {
        let found = if loads == 0 { "no force" } else { "more than one force" };
        let help = "a step has one of `force_n`, `staircase`, or a `force_n` range inside `random`";
        table.complain(Problem::new(table.span(), format!("this step has {found}")).help(help));
    }
    let load_key = ["force_n", "staircase", "random"].into_iter().find(|key| table.has(key)).unwrap_or("phase");
    let load_span = table.span_of(load_key);
    let load = random_force.or(force).or(staircase);
    if let Some(least_n) = load.as_ref().map(Load::least_n)
        && manner.force_tolerance_n >= least_n
    {
        let told =
            format!("the force tolerance of {} N isn't under the force of {least_n} N", manner.force_tolerance_n);
        let help = "a press that may miss by its whole force is none: lower `force_tolerance_n`";
        table.complain(Problem::new(load_span.clone(), told).help(help));
    }
    let places_span = places_key.map_or(table.span(), |key| table.span_of(key));
    table.finish();
    Some(Step { phase: phase?, places: places?, load: load?, manner, places_span, load_span })
}

/// The one key of some that is there; a problem where there is none or more than one.
fn one_of(table: &mut Table, what: &str, keys: &[&'static str]) -> Option<&'static str> {
    let there: Vec<&'static str> = keys.iter().copied().filter(|key| table.has(key)).collect();
    match there[..] {
        [key] => Some(key),
        [] => {
            let help = format!("add one of {}", keys.join(", "));
            table.complain(Problem::new(table.span(), format!("this step doesn't say {what}")).help(help));
            None
        }
        [first, second, ..] => {
            let told = format!("this step says {what} twice: `{first}` and `{second}`");
            table.complain(Problem::new(table.span_of(second), told).help("make two steps of it"));
            None
        }
    }
}

fn read_grid(step: &mut Table) -> Option<Places> {
    let mut grid = step.table("grid")?;
    let x_mm = grid.require_range("x_mm", PLACE);
    let y_mm = grid.require_range("y_mm", PLACE);
    let spacing_mm = grid.require_number("spacing_mm", SPACING);
    let order = grid.choice("order", &Order::ALL.map(|order| (order.name(), order))).unwrap_or_default();
    if let (Some(x), Some(y), Some(spacing)) = (x_mm, y_mm, spacing_mm) {
        for (name, width) in [("x_mm", x.width()), ("y_mm", y.width())] {
            let spaces = width / spacing;
            if width > 0.0 && spacing > width {
                let told = format!("`spacing_mm` is {spacing}, more than the {width} mm of `{name}`");
                grid.complain(Problem::new(grid.span_of("spacing_mm"), told).help("make it smaller than the extent"));
            } else if (spaces - spaces.round()).abs() > WHOLE * spaces.max(1.0) {
                let (few, many) = (width / spaces.floor().max(1.0), width / spaces.ceil());
                let told = format!("`spacing_mm` {spacing} doesn't divide the {width} mm of `{name}`");
                let help = format!("the nearest that do: {many:.4} and {few:.4}");
                grid.complain(Problem::new(grid.span_of("spacing_mm"), told).help(help));
            }
        }
    }
    grid.finish();
    Some(Places::Grid { x_mm: x_mm?, y_mm: y_mm?, spacing_mm: spacing_mm?, order })
}

fn read_list(step: &mut Table) -> Option<Places> {
    let mut list = step.table("list")?;
    if !list.has("places_mm") {
        list.complain(Problem::new(list.span(), "`places_mm` is missing in `list`: [[x, y], ...]"));
    }
    let tuples = list.tuples("places_mm", 2, &[PLACE, PLACE]);
    if tuples.as_ref().is_some_and(Vec::is_empty) {
        list.complain(Problem::new(list.span_of("places_mm"), "`places_mm` is empty: nothing to press"));
    }
    list.finish();
    Some(Places::List(tuples?.into_iter().map(|(xy, span)| (Place::new(xy[0], xy[1]), span)).collect()))
}

fn read_random(step: &mut Table) -> (Option<Places>, Option<Load>) {
    let Some(mut random) = step.table("random") else { return (None, None) };
    let count = random.require_integer("count", 1, PRESSES_CEILING as u64);
    let x_mm = random.require_range("x_mm", PLACE);
    let y_mm = random.require_range("y_mm", PLACE);
    let force = random.range("force_n", FORCE).map(Load::RandomForce);
    random.finish();
    let places = match (count, x_mm, y_mm) {
        (Some(count), Some(x_mm), Some(y_mm)) => Some(Places::Random { count, x_mm, y_mm }),
        _ => None,
    };
    (places, force)
}

fn read_units(step: &mut Table) -> Option<Places> {
    let span = step.span_of("units");
    if step.is_text("units") {
        return step.choice("units", &[("all", ())]).map(|()| Places::Units(UnitChoice::All));
    }
    let units = step.integers("units", 1, UNITS_MAX)?;
    if units.is_empty() {
        step.complain(Problem::new(span.clone(), "`units` is empty: nothing to press").help("write \"all\" or [1, 2]"));
    }
    Some(Places::Units(UnitChoice::Some(units.iter().map(|&unit| (unit as usize, span.clone())).collect())))
}

fn read_staircase(step: &mut Table) -> Option<Load> {
    let mut table = step.table("staircase")?;
    let to_n = table.require_number("to_n", FORCE);
    let step_n = table.require_number("step_n", FORCE);
    let repeats = table.integer("repeats", 1, 1000).unwrap_or(1);
    let rest_s = table.number("rest_s", DWELL).unwrap_or(0.0);
    if let (Some(to), Some(step)) = (to_n, step_n) {
        let steps = to / step;
        if (steps - steps.round()).abs() > WHOLE * steps.max(1.0) || steps < 0.5 {
            let told = format!("`step_n` {step} doesn't divide `to_n` {to}");
            table
                .complain(Problem::new(table.span_of("step_n"), told).help("levels are equal steps from 0 to the top"));
        } else if steps > 1000.0 {
            table.complain(Problem::new(table.span_of("step_n"), format!("{steps:.0} levels, over 1000 levels")));
        }
    }
    table.finish();
    Some(Load::Staircase { to_n: to_n?, step_n: step_n?, repeats, rest_s })
}

impl Load {
    /// The smallest force above zero that it asks for, N.
    fn least_n(&self) -> f64 {
        match self {
            Load::Force(force_n) => *force_n,
            Load::RandomForce(range) => range.min,
            Load::Staircase { step_n, .. } => *step_n,
        }
    }

    /// How many entries it makes of a place.
    pub(super) fn repeats(&self) -> usize {
        match self {
            Load::Staircase { repeats, .. } => *repeats as usize,
            _ => 1,
        }
    }

    /// The largest force that it asks for, N.
    pub fn most_n(&self) -> f64 {
        match self {
            Load::Force(force_n) => *force_n,
            Load::RandomForce(range) => range.max,
            Load::Staircase { to_n, .. } => *to_n,
        }
    }
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
    fn the_failure_twins_of_a_good_grid() {
        let good = "grid = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 0.5 }\nforce_n = 1.0";
        assert_eq!(step(good), [""; 0]);
        for (from, to, told) in [
            ("spacing_mm = 0.5", "spacing_mm = 13", "r.toml:4:63: `spacing_mm` is 13, more than the 12 mm of `x_mm`"),
            (
                "spacing_mm = 0.5",
                "spacing_mm = 0.7",
                "r.toml:4:63: `spacing_mm` 0.7 doesn't divide the 12 mm of `x_mm`",
            ),
            ("spacing_mm = 0.5", "spacing_mm = 0", "r.toml:4:63: `spacing_mm` is 0, must be over 0, at most 1000 mm"),
            (
                "spacing_mm = 0.5",
                "spacing = 0.5",
                "r.toml:4:8: `spacing_mm` is missing in `step.grid`: a number in mm, over 0, at most 1000",
            ),
            ("[-6.0, 6.0], y", "[6.0, -6.0], y", "r.toml:4:17: `x_mm` runs backward, from 6 to -6"),
            ("force_n = 1.0", "force_n = nan", "r.toml:5:11: `force_n` is not a finite number"),
            (
                "force_n = 1.0",
                "force_n = 0.05",
                "r.toml:5:11: the force tolerance of 0.05 N isn't under the force of 0.05 N",
            ),
            ("force_n = 1.0", "force_mn = 1.0", "r.toml:2:1: this step has no force"),
        ] {
            assert_eq!(step(&good.replacen(from, to, 1))[0], told);
        }
    }

    #[test]
    fn an_order_and_a_strategy_are_known_by_their_names_alone() {
        let good = "grid = { x_mm = [-6, 6], y_mm = [-6, 6], spacing_mm = 0.5, order = \"interleaved\" }\n\
                    force_n = 1.0\nstrategy = \"map\"";
        assert_eq!(step(good), [""; 0]);
        for (from, to, told) in [
            (
                "interleaved",
                "interlaced",
                "r.toml:4:68: `order` is \"interlaced\", expected one of raster, interleaved",
            ),
            ("map", "mapped", "r.toml:6:12: `strategy` is \"mapped\", expected one of guarded, velocity, map"),
        ] {
            assert_eq!(step(&good.replacen(from, to, 1)), [told]);
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
        assert_eq!(none, ["r.toml:4:20: `count` must be 1 to 10000000"]);
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
                "r.toml:6:9: `phase` is \"tset\", expected one of characterisation, calibration, test",
            ]
        );
    }
}
