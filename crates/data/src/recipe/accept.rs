//! `[accept]`: the acceptance rule of a recipe, or of a file that a recipe names.

use super::PRESSES_CEILING;
use super::keys::CHOOSABLE;
use crate::acceptance::{AcceptanceRule, Decision, Limit, LimitedFigure};
use palpate_document::{self as document, Bounds, Key, Keys, Problem, Problems, Table, keys, positions, words};
use palpate_solver::BEST;

const LENGTH: Bounds = Bounds::above(0.0, 1000.0, "mm");
const FORCE: Bounds = Bounds::above(0.0, 100.0, "N");
const PERCENT: Bounds = Bounds::above(0.0, 100.0, "%");
const SHARE: Bounds = Bounds::above(0.0, 1.0, "");
/// Largest number of channels of an array.
const CHANNELS_MAX: u64 = 4096;

const DECISIONS: [(&str, Decision); 2] =
    [(Decision::Simple.word(), Decision::Simple), (Decision::Guarded.word(), Decision::Guarded)];

/// Content of `accept` in a recipe.
#[derive(Clone, Debug, PartialEq)]
pub enum Accept {
    /// A rule in the recipe itself.
    Rule(AcceptanceRule),
    /// Name of a file next to the recipe that contains the rule.
    File(String),
}

keys! {
    /// `[accept]`, and an acceptance file.
    accept {
        rule: Word(&words(&DECISIONS)), or_word(Decision::Simple.word()),
            "simple: each figure is within its limit; guarded: its one-sided 95 % bound is", "\"guarded\"";
        method: Word(&CHOOSABLE), or_word(BEST), "the solver whose results are judged", "\"pearson\"";
        calibration_presses_least: Whole(1, PRESSES_CEILING as u64), or_whole(1),
            "smallest number of calibration presses, without flagged ones", "500";
        test_presses_least: Whole(1, PRESSES_CEILING as u64), or_whole(1),
            "smallest number of test presses, without flagged ones", "100";
        holdout: Flag, or_flag(false),
            "whether test presses that were held out of the calibration's own presses give a verdict", "true";
        called_sound: Flag, or_flag(false),
            "whether a run gets a verdict in which a person called presses sound that a safety rule had stopped", "true";
        location_mean_mm: Number(LENGTH), Allowed, "limit of the mean location error", "1.0";
        location_p95_mm: Number(LENGTH), Allowed, "limit of the 95th percentile of the location errors", "2.0";
        location_within: Table(&location_within::KEYS), Allowed, "limit of the share of presses with a small location error";
        force_mean_n: Number(FORCE), Allowed, "limit of the mean force error", "0.1";
        force_p95_n: Number(FORCE), Allowed, "limit of the 95th percentile of the force errors", "0.2";
        force_within: Table(&force_within::KEYS), Allowed, "limit of the share of presses with a small force error";
        depth_mean_mm: Number(LENGTH), Allowed, "limit of the mean depth error", "0.1";
        depth_p95_mm: Number(LENGTH), Allowed, "limit of the 95th percentile of the depth errors", "0.2";
        depth_within: Table(&depth_within::KEYS), Allowed, "limit of the share of presses with a small depth error";
        repeatability_percent: Number(PERCENT), Allowed,
            "limit of the loading repeatability of every unit, % of full scale", "4.0";
        hysteresis_percent: Number(PERCENT), Allowed, "limit of the hysteresis of every unit, % of full scale", "6.0";
        hysteresis_of_reading_percent: Number(PERCENT), Allowed,
            "limit of the hysteresis of every unit, % of reading", "15.0";
        linearity_percent: Number(PERCENT), Allowed, "limit of the nonlinearity of every unit, % of full scale", "5.0";
        zero_return_percent: Number(PERCENT), Allowed, "limit of the zero return of every unit, % of full scale", "1.0";
        noise_percent: Number(PERCENT), Allowed,
            "limit of the noise of every channel without load, % of its largest output in the calibration", "0.5";
        broken_channels_most: Whole(0, CHANNELS_MAX), Allowed, "largest number of channels that are dead or saturated in calibration and test", "0";
        flagged_presses_most: Whole(0, PRESSES_CEILING as u64), Allowed,
            "largest number of flagged presses in calibration and test together", "5";
    }
}

keys! {
    /// `location_within` of `[accept]`.
    location_within {
        mm: Number(LENGTH), Refused, "the location error up to which a press counts", "1.0";
        share: Number(SHARE), Refused, "smallest share of the test presses, 0 to 1", "0.9";
    }
}

keys! {
    /// `force_within` of `[accept]`.
    force_within {
        n: Number(FORCE), Refused, "the force error up to which a press counts", "0.1";
        share: Number(SHARE), Refused, "smallest share of the test presses, 0 to 1", "0.9";
    }
}

keys! {
    /// `depth_within` of `[accept]`.
    depth_within {
        mm: Number(LENGTH), Refused, "the depth error up to which a press counts", "0.1";
        share: Number(SHARE), Refused, "smallest share of the test presses, 0 to 1", "0.9";
    }
}

/// Reads an acceptance file: the keys of `[accept]`, without the heading.
///
/// # Errors
/// All problems of the text, each with its line.
pub fn parse_rule(file: &str, text: &str) -> Result<AcceptanceRule, Problems> {
    if document::has_key(text, "accept") {
        let at = text.find("accept").unwrap_or_default();
        let problem = Problem::new(at..at + "accept".len(), "an acceptance file has its keys without a heading");
        return Err(Problems::new(file, text, vec![problem.help("remove the line [accept]")]));
    }
    document::read(file, text, &accept::KEYS, read_rule)
}

/// Returns the rule in a table.
pub(super) fn read_rule(table: &Table) -> Option<AcceptanceRule> {
    let decision = table.word(&accept::rule, &DECISIONS);
    let method = table.word(&accept::method, &CHOOSABLE.map(|name| (name, name)));
    let least = |key: &Key| table.whole(key).map(|least| least as usize);
    let (calibration, test) = (least(&accept::calibration_presses_least), least(&accept::test_presses_least));
    // a wrong limit has been reported; the others are read all the same
    let limits: Vec<Limit> = LimitedFigure::ALL.into_iter().filter_map(|figure| limit(table, figure)).collect();
    let (holdout, called_sound) = (table.flag(&accept::holdout), table.flag(&accept::called_sound));
    let (known, keys) = (accept::KEYS.always, || LimitedFigure::ALL.map(LimitedFigure::key));
    if !known.iter().any(|key| keys().contains(&key.name) && table.has(key)) {
        let help = format!("add one of {}", keys().join(", "));
        table.complain(Problem::new(table.span(), "this rule has no limit").help(help));
    }
    Some(AcceptanceRule {
        decision: decision?,
        method: method?.to_owned(),
        calibration_presses_least: calibration?,
        test_presses_least: test?,
        holdout: holdout?,
        limits,
        called_sound: called_sound?,
        afterwards_by: None,
    })
}

/// Returns a problem for each limit of a force error in a text, whose rule is in the table of this name; `None`: outside tables.
/// They can't be met on a rig without a load cell.
pub(super) fn force_limits(text: &str, table: Option<&str>) -> Vec<Problem> {
    /// Limits of the force error, and those of the depth error that replace them.
    const REPLACED: [(Key, Key); 3] = [
        (accept::force_mean_n, accept::depth_mean_mm),
        (accept::force_p95_n, accept::depth_p95_mm),
        (accept::force_within, accept::depth_within),
    ];
    let problems = REPLACED.iter().flat_map(|(force, depth)| {
        let path: Vec<&str> = table.into_iter().chain([force.name]).collect();
        let words = format!("the rig has no load cell, so no force error is known: `{}` can't be met", force.name);
        let help = format!("use `{}`", depth.name);
        positions(text, &path).into_iter().map(move |place| Problem::new(place, words.clone()).help(help.clone()))
    });
    problems.collect()
}

fn limit(table: &Table, figure: LimitedFigure) -> Option<Limit> {
    let plain = |limit: f64| Limit { figure, limit, reach: None };
    let within = |key: Key, parts: [Key; 2]| {
        let [reach, limit] = table.table(&key)?.numbers(parts)?;
        Some(Limit { figure, limit, reach: Some(reach) })
    };
    match figure {
        LimitedFigure::LocationWithin => within(accept::location_within, [location_within::mm, location_within::share]),
        LimitedFigure::ForceWithin => within(accept::force_within, [force_within::n, force_within::share]),
        LimitedFigure::DepthWithin => within(accept::depth_within, [depth_within::mm, depth_within::share]),
        LimitedFigure::BrokenChannels => table.whole(&accept::broken_channels_most).map(|most| plain(most as f64)),
        LimitedFigure::FlaggedPresses => table.whole(&accept::flagged_presses_most).map(|most| plain(most as f64)),
        LimitedFigure::LocationMean => table.number(&accept::location_mean_mm).map(plain),
        LimitedFigure::LocationP95 => table.number(&accept::location_p95_mm).map(plain),
        LimitedFigure::ForceMean => table.number(&accept::force_mean_n).map(plain),
        LimitedFigure::ForceP95 => table.number(&accept::force_p95_n).map(plain),
        LimitedFigure::DepthMean => table.number(&accept::depth_mean_mm).map(plain),
        LimitedFigure::DepthP95 => table.number(&accept::depth_p95_mm).map(plain),
        LimitedFigure::Repeatability => table.number(&accept::repeatability_percent).map(plain),
        LimitedFigure::Hysteresis => table.number(&accept::hysteresis_percent).map(plain),
        LimitedFigure::HysteresisOfReading => table.number(&accept::hysteresis_of_reading_percent).map(plain),
        LimitedFigure::Linearity => table.number(&accept::linearity_percent).map(plain),
        LimitedFigure::ZeroReturn => table.number(&accept::zero_return_percent).map(plain),
        LimitedFigure::Noise => table.number(&accept::noise_percent).map(plain),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_document::sample::assert_read_is_listed;

    #[test]
    fn acceptance_reader_reads_exactly_the_listed_keys() {
        assert_read_is_listed(&accept::KEYS, |text| drop(parse_rule("accept.toml", text)));
    }

    #[test]
    fn a_rule_is_read_with_its_defaults() {
        let text = "location_mean_mm = 0.5\nforce_within = { n = 0.1, share = 0.9 }\nbroken_channels_most = 0\n";
        let rule = parse_rule("accept.toml", text).unwrap();
        assert_eq!((rule.decision, rule.method.as_str(), rule.test_presses_least), (Decision::Simple, BEST, 1));
        let limits: Vec<(&str, f64, Option<f64>)> =
            rule.limits.iter().map(|limit| (limit.figure.key(), limit.limit, limit.reach)).collect();
        assert_eq!(
            limits,
            [("location_mean_mm", 0.5, None), ("force_within", 0.9, Some(0.1)), ("broken_channels_most", 0.0, None)]
        );
    }

    #[test]
    fn a_rule_without_a_limit_and_a_wrong_one_are_refused() {
        let lines = |text: &str| parse_rule("accept.toml", text).unwrap_err().lines();
        assert_eq!(lines("rule = \"guarded\"\n"), ["accept.toml:1:1: this rule has no limit"]);
        assert_eq!(
            lines("location_mean = 1.0\nforce_within = { n = 0.1, share = 90 }\n"),
            [
                "accept.toml:1:1: unknown key `location_mean`",
                "accept.toml:2:35: `share` is 90, must be over 0, at most 1",
            ]
        );
    }
}
