//! The paper's claims about its curves, each compared with computed results.

use super::array::StudiedArray;
use super::line::{FIGURE_4_TO, FIGURE_5_TO, UNITS, follow_left, follow_right, on_line};
use super::turning::{ContactArea, NEAR_R, Survey, descend, last};
use palpate_core::mechanics::{Medium, Passage, TaxelResponse, lambda};
use palpate_core::quantity::ArrayLayout;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::fmt::Write as _;

/// Receptive field, in depths (paper section 2).
const FIELD: f64 = 2.0;
/// Fraction of a peak below which a value is near 0. Above the second value it isn't near 0.
const NEAR_ZERO: (f64, f64) = (0.01, 0.05);
/// Difference below which two curves are very close. Above the second value they aren't.
const CLOSE: (f64, f64) = (0.01, 0.1);
/// Array of the paper: units along a side, pitch and depth, and half the side of the loading area, mm.
const SIDE: usize = 3;
const PITCH_MM: f64 = 4.5;
const DEPTH_MM: f64 = 5.0;
const HALF_MM: f64 = 6.0;
/// Distance of a place that is well away from a load, mm. It is slightly more than the distance of the corners from the centre.
const OFF_MM: f64 = 7.5;
/// Number of paths that are followed over the paper's array.
const RAYS: usize = 6000;
/// Poisson's ratio of silicone rubber.
const POISSON_RATIO: f64 = 0.49;
/// Largest relative error at which a half-space still predicts the behaviour of a bonded layer.
const ALIKE: f64 = 0.1;

/// Distance that counts as small, depths.
const SMALL: f64 = 0.01;

/// Verdict on a claim: it holds as in the paper, it holds within a bound that the paper doesn't give, or it fails.
fn verdict(holds: bool, bounded: bool) -> &'static str {
    match (holds, bounded) {
        (true, _) => "holds",
        (false, true) => "holds with a bound",
        (false, false) => "fails",
    }
}

/// A claim of the paper, and the computed result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PaperClaim {
    /// Name of the claim in rows.
    pub claim: &'static str,
    /// The paper's claim, in other words.
    pub text: &'static str,
    /// Verdict on the claim.
    pub verdict: &'static str,
    /// The numbers in a sentence.
    pub found: String,
    /// The same numbers by name; distances in depths H unless a name contains mm.
    #[serde(flatten)]
    pub numbers: Value,
}

/// Returns every claim, in the order of the paper.
pub(super) fn claims() -> Vec<PaperClaim> {
    vec![
        receptive_field(),
        two_units(),
        few_units(),
        many_units(),
        wide_spacing(),
        narrow_spacing(),
        rule(),
        figure_5(),
        always(),
        papers_array(),
        half_space(),
    ]
}

fn receptive_field() -> PaperClaim {
    let there = lambda(FIELD);
    let percent_at = last(0.0, 10.0, |k| lambda(k) > 0.01);
    // the load beyond k is the integral of 3 lambda k dk, which is (k^2 + 1) lambda
    let beyond = (FIELD * FIELD + 1.0) * there;
    PaperClaim {
        claim: "receptive-field",
        text: "lambda nears 0 beyond k = 2",
        verdict: verdict(there < NEAR_ZERO.0, there < NEAR_ZERO.1),
        found: format!(
            "{:.2} % of the peak at k = 2, 1 % only at k = {percent_at:.3}; {:.2} % of the load is carried beyond k = 2",
            100.0 * there,
            100.0 * beyond
        ),
        numbers: json!({"lambda_at_2": there, "k_at_one_percent": percent_at, "load_beyond_2": beyond}),
    }
}

fn two_units() -> PaperClaim {
    let line = StudiedArray::line(2, 1.0);
    let r = |d: f64| line.r(on_line(0.0), on_line(d));
    let step_at = last(0.0, FIGURE_4_TO, |d| r(d).is_none_or(|r| r > 0.0));
    // a little to the right of the step, and on to the end
    let side = |from: f64, to: f64| {
        let points = (0..=100).map(move |index| from + (to - from) * f64::from(index) / 100.0);
        points.filter_map(r).fold((f64::MAX, f64::MIN), |(least, most), r| (least.min(r), most.max(r)))
    };
    let (before, beyond) = (side(0.0, step_at - 1e-6), side(step_at + 1e-6, FIGURE_4_TO));
    let is_step = before.0 > 1.0 - 1e-9 && beyond.1 < -1.0 + 1e-9;
    let undefined = r(0.5).is_none();
    PaperClaim {
        claim: "two-units",
        text: "r of n = 2 units is a step",
        verdict: verdict(is_step, false),
        found: format!(
            "{:+.3} before d = {step_at:.3}, {:+.3} beyond{}",
            before.0,
            beyond.1,
            if undefined { "; 0/0 at d = s/2" } else { "" }
        ),
        numbers: json!({"step_at": step_at, "r_before": before.0, "r_beyond": beyond.1}),
    }
}

/// Turning of r on a line as in Figure 4, and r at the turning.
fn figure_4_turning(n: usize, s: f64) -> Option<(f64, f64)> {
    let line = StudiedArray::line(n, s);
    let d = follow_right(&line, 0.0, FIGURE_4_TO).turning_mm?;
    Some((d, line.r(on_line(0.0), on_line(d))?))
}

fn few_units() -> PaperClaim {
    let turnings: Vec<(usize, Option<(f64, f64)>)> = (3..=15).map(|n| (n, figure_4_turning(n, 1.0))).collect();
    let (few, enough): (Vec<_>, Vec<_>) = turnings.iter().partition(|(n, _)| *n < 5);
    let is_flat = |n: usize| {
        let line = StudiedArray::line(n, 1.0);
        let r = |d: f64| line.r(on_line(0.0), on_line(d));
        r(1.5).zip(r(FIGURE_4_TO)).is_some_and(|(a, b)| (a - b).abs() < 1e-9)
    };
    let few_turn = few.iter().all(|(_, turning)| turning.is_some_and(|(d, _)| d > 1.5));
    let enough_fall = enough.iter().all(|(_, turning)| turning.is_none());
    let mut found = "n = 2 is flat".to_owned();
    for (n, turning) in &few {
        let _ = match turning {
            Some((d, r)) => write!(found, "; n = {n} turns at {d:.4}, r {r:.5}"),
            None => write!(found, "; n = {n} falls all the way"),
        };
    }
    found += if enough_fall { "; n = 5 to 15 fall all the way to 2" } else { "; some of n = 5 to 15 turn too" };
    let mut numbers = Map::new();
    for (n, turning) in &turnings {
        numbers.insert(format!("turns_at_n{n}"), turning.map(|(d, _)| d).into());
        numbers.insert(format!("r_there_n{n}"), turning.map(|(_, r)| r).into());
    }
    PaperClaim {
        claim: "few-units",
        text: "below n = 5 r is flat or turns beyond d = 1.5",
        verdict: verdict(is_flat(2) && few_turn && enough_fall, is_flat(2) && few_turn),
        found,
        numbers: numbers.into(),
    }
}

fn many_units() -> PaperClaim {
    let r = |n: usize, d: f64| StudiedArray::line(n, 1.0).r(on_line(0.0), on_line(d)).unwrap_or(f64::NAN);
    let most = |n: usize| {
        let points = (0..=400).map(|index| FIGURE_4_TO * f64::from(index) / 400.0);
        points.map(|d| (r(UNITS, d) - r(n, d)).abs()).fold(0.0, f64::max)
    };
    let (to_10, to_15) = (most(10), most(15));
    let (nine, fifteen) = (r(UNITS, FIGURE_4_TO), r(15, FIGURE_4_TO));
    PaperClaim {
        claim: "many-units",
        text: "the curves are very close for n above 9",
        verdict: verdict(to_15 < CLOSE.0, to_15 < CLOSE.1),
        found: format!(
            "n = 9 and 10 differ by up to {to_10:.4}, n = 9 and 15 by up to {to_15:.4}; r at d = 2: {nine:.4} and \
             {fifteen:.4}"
        ),
        numbers: json!({"most_apart_9_10": to_10, "most_apart_9_15": to_15, "r_at_2_n9": nine, "r_at_2_n15": fifteen}),
    }
}

fn wide_spacing() -> PaperClaim {
    let (mut found, mut numbers, mut bends) = (Vec::new(), Map::new(), Vec::new());
    for s in [0.8, 1.0, 1.2, 1.4, 2.0] {
        let line = StudiedArray::line(UNITS, s);
        let fall = line.r(on_line(0.0), on_line(SMALL)).map(|r| (1.0 - r) / (SMALL * SMALL));
        let near = follow_right(&line, 0.0, FIGURE_4_TO).near_mm;
        let [above, midway] = [0.0, s / 2.0].map(|d1| line.bend(on_line(d1), 0.0));
        let text =
            |value: Option<f64>, digits: usize| value.map_or("-".to_owned(), |value| format!("{value:.digits$}"));
        found.push(format!("{} and {} ({s:.1})", text(fall, 4), text(near, 3)));
        let name = format!("{s:.1}").replace('.', "_");
        for (what, value) in
            [("fall", fall), ("fall_limit", above), ("fall_limit_midway", midway), ("d_at_r_0_99", near)]
        {
            numbers.insert(format!("{what}_s{name}"), value.into());
        }
        bends.push((above.unwrap_or(f64::NAN), midway.unwrap_or(f64::NAN)));
    }
    let is_flatter = bends.windows(2).all(|pair| pair[1].0 < pair[0].0 / 2.0);
    let is_flatter_midway = bends.windows(2).all(|pair| pair[1].1 < pair[0].1);
    PaperClaim {
        claim: "wide-spacing",
        text: "s > 1: r is flat at small d",
        verdict: verdict(is_flatter && is_flatter_midway, is_flatter),
        found: format!(
            "above a unit, (1 - r) / d^2 at d = {SMALL} and the d at which r = {NEAR_R}, by s: {}; half-way between two \
             units it isn't: (1 - r) / d^2 is {:.2} (1.0) and {:.2} (2.0)",
            found.join(", "),
            bends[1].1,
            bends[4].1
        ),
        numbers: numbers.into(),
    }
}

fn narrow_spacing() -> PaperClaim {
    let turning = figure_4_turning(UNITS, 0.2);
    PaperClaim {
        claim: "narrow-spacing",
        text: "s = 0.2: r turns and rises again",
        verdict: verdict(turning.is_some(), false),
        found: turning.map_or("it falls all the way".to_owned(), |(d, r)| format!("it turns at d = {d:.4}, r {r:.5}")),
        numbers: json!({"turns_at": turning.map(|(d, _)| d), "r_there": turning.map(|(_, r)| r)}),
    }
}

fn rule() -> PaperClaim {
    let turns = |s: f64| figure_4_turning(UNITS, s).is_some();
    let spacings: Vec<(f64, bool)> =
        (10..=100).map(|hundredths| f64::from(hundredths) / 100.0).map(|s| (s, turns(s))).collect();
    let of = |turning: bool| spacings.iter().filter(move |(_, turns)| *turns == turning).map(|(s, _)| *s);
    let (least, last_turning, first_falling) = (of(true).next(), of(true).next_back(), of(false).next());
    // all that turn are below all that don't
    let is_one_range = last_turning.zip(first_falling).is_none_or(|(last, first)| last < first);
    let edge = last_turning.zip(first_falling).map(|(turning, falling)| last(turning, falling, turns));
    let five_fall = (5..=15).all(|n| figure_4_turning(n, 1.0).is_none());
    let found = match (least, last_turning, first_falling) {
        (Some(least), Some(last), Some(first)) if is_one_range => format!(
            "n = 9: every s of {least:.2} to {last:.2} turns within d = 2, from {first:.2} on none: so s has a least \
             value too"
        ),
        (None, ..) => "no s of 0.10 to 1.00 turns".to_owned(),
        _ => "s that turn and s that don't are mixed".to_owned(),
    };
    PaperClaim {
        claim: "rule",
        text: "so n >= 5 and s <= 1",
        verdict: verdict(five_fall && least.is_none(), five_fall && is_one_range),
        found,
        numbers: json!({
            "s_turning_least": least,
            "s_turning_most": last_turning,
            "s_falling_least": first_falling,
            "s_between": edge,
        }),
    }
}

fn figure_5() -> PaperClaim {
    let line = StudiedArray::line(UNITS, 1.0);
    let (mut found, mut numbers, mut least) = (Vec::new(), Map::new(), f64::INFINITY);
    for k in 0..6 {
        let d1 = 1.5 * f64::from(k);
        let paths = [("left", follow_left(&line, d1)), ("right", follow_right(&line, d1, FIGURE_5_TO))];
        for (side, follow) in paths {
            let name = format!("turns_{side}_of_{}", format!("{d1:.1}").replace('.', "_"));
            numbers.insert(name, follow.turning_mm.into());
            if let Some(d) = follow.turning_mm {
                found.push(format!("{d1:.1} {side} {d:.4}"));
                least = least.min(d);
            }
        }
    }
    PaperClaim {
        claim: "figure-5",
        text: "r falls up to a relative distance of 2 wherever F1 is",
        verdict: verdict(least > FIELD, false),
        found: format!("first turnings, by d1: {}", found.join(", ")),
        numbers: numbers.into(),
    }
}

fn always() -> PaperClaim {
    let line = StudiedArray::line(UNITS, 1.0);
    let first = |d1: f64| {
        let paths = [follow_left(&line, d1), follow_right(&line, d1, FIGURE_5_TO)];
        paths.iter().filter_map(|follow| follow.turning_mm).fold(f64::INFINITY, f64::min)
    };
    // either half alone: the line looks the same from both ends
    let least =
        |from: i32, to: i32| {
            let points = (from..=to).map(|index| f64::from(index) / 50.0);
            let start = points.min_by(|a, b| first(*a).total_cmp(&first(*b))).unwrap_or(0.0);
            let ([d1], d) = descend([start], [0.02], 100, |[d1]| {
                if (0.0..=FIGURE_5_TO).contains(d1) { first(*d1) } else { f64::INFINITY }
            });
            (d1, d)
        };
    let ((left, d), (right, d_right)) = (least(0, 200), least(200, 400));
    let least = d.min(d_right);
    PaperClaim {
        claim: "always",
        text: "r always falls with distance, wherever the loads are",
        verdict: verdict(least.is_infinite(), false),
        found: format!("over all d1 of 0 to 8 it turns from d = {least:.4} on: from d1 = {left:.2}, and {right:.2}"),
        numbers: json!({"turns_from": least, "d1": left, "d1_mirrored": right}),
    }
}

fn papers_array() -> PaperClaim {
    let array =
        StudiedArray::new(&ArrayLayout::grid(SIDE, SIDE, PITCH_MM), TaxelResponse::new(Passage::half_space(DEPTH_MM)));
    let area = ContactArea { x_mm: (-HALF_MM, HALF_MM), y_mm: (-HALF_MM, HALF_MM) };
    let survey = Survey::new(&array, &area, PITCH_MM, RAYS);
    let share = survey.share_turned();
    let early = survey.turned_mm.iter().filter(|mm| **mm < DEPTH_MM).count();
    let found = match survey.first {
        None => format!("none of {RAYS} ways over +-6 mm turns"),
        Some(first) => format!(
            "it turns from {:.2} mm = {:.2} H on: from ({:.2}, {:.2}) mm at {:.3} rad and as symmetry has it; {:.1} % \
             of {RAYS} ways over +-6 mm turn, {} within {DEPTH_MM} mm",
            first.distance_mm,
            first.distance_mm / DEPTH_MM,
            first.from.x_mm,
            first.from.y_mm,
            first.direction_rad,
            100.0 * share,
            if early == 0 { "none".to_owned() } else { early.to_string() },
        ),
    };
    PaperClaim {
        claim: "papers-array",
        text: "the same of the paper's own 3 x 3 array, s = 0.9",
        verdict: verdict(survey.first.is_none(), false),
        found,
        numbers: json!({
            "share_of_rays_turned": share,
            "rays": RAYS,
            "turns_from_mm": survey.first.map(|first| first.distance_mm),
            "x_mm": survey.first.map(|first| first.from.x_mm),
            "y_mm": survey.first.map(|first| first.from.y_mm),
            "direction_rad": survey.first.map(|first| first.direction_rad),
            "rays_turned_within_5_mm": early,
        }),
    }
}

fn half_space() -> PaperClaim {
    let response = |medium| TaxelResponse::new(Passage { medium, ..Passage::half_space(DEPTH_MM) });
    let space = response(Medium::HalfSpace);
    let layer = response(Medium::BondedLayer { poisson_ratio: POISSON_RATIO });
    let share = |response: &TaxelResponse, mm: f64| response.at(mm) / response.at(0.0);
    let half_mm = |response: &TaxelResponse| last(0.0, 2.0 * DEPTH_MM, |mm| share(response, mm) > 0.5);
    let peak = layer.at(0.0) / space.at(0.0);
    let (half_layer_mm, half_space_mm) = (half_mm(&layer), half_mm(&space));
    let (off_layer, off_space) = (share(&layer, OFF_MM), share(&space, OFF_MM));
    let is_alike = |a: f64, b: f64| (a / b - 1.0).abs() < ALIKE;
    let is_near = is_alike(half_layer_mm, half_space_mm);
    PaperClaim {
        claim: "half-space",
        text: "a half-space is used for a 5 mm cover on a rigid base",
        verdict: verdict(is_near && is_alike(peak, 1.0) && is_alike(off_layer, off_space), is_near),
        found: format!(
            "bonded, Poisson's ratio {POISSON_RATIO}: peak {peak:.3} times as high, half of it at {half_layer_mm:.3} mm \
             (half-space {half_space_mm:.3}), at {OFF_MM} mm {off_layer:.4} of it (half-space {off_space:.4})"
        ),
        numbers: json!({"peak_over_half_space": peak, "half_peak_layer_mm": half_layer_mm, "half_peak_half_space_mm": half_space_mm, "share_at_7_5_mm_layer": off_layer, "share_at_7_5_mm_half_space": off_space}),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_claim_is_one_row_with_its_numbers_beside_it() {
        let row = serde_json::to_value(receptive_field()).unwrap();
        assert_eq!(row["verdict"], "holds with a bound");
        assert!((row["lambda_at_2"].as_f64().unwrap() - 0.01788854381999832).abs() < 1e-15);
    }
}
