//! The terms of a `[scene]` that say what the taxels read.

use crate::document::{self, Bounds, Problem, Table};
use crate::mechanics::{MOST_POISSON_RATIO, MOST_RADIUS_DEPTHS, Medium};
use crate::scene::{Converter, Elastomer, NoiseOf, SkinSpec, TaxelFault, TaxelFaultKind, TaxelNoise, Taxels};

const DEPTH: Bounds = Bounds::above(0.0, 1000.0, "mm");
const POISSON_RATIO: Bounds = Bounds::within(0.0, MOST_POISSON_RATIO, "");
const RADIUS: Bounds = Bounds::within(0.0, 1000.0, "mm");
const PERCENT: Bounds = Bounds::within(0.0, 100.0, "%");
const GAIN_SPREAD: Bounds = Bounds::within(0.0, 90.0, "%");
const DEPTH_SPREAD: Bounds = Bounds::within(0.0, 30.0, "%");
const PLACE_SPREAD: Bounds = Bounds::within(0.0, 10.0, "mm");
/// Reading units: 1 is the reading for 1 N straight above.
const READING: Bounds = Bounds::within(-1000.0, 1000.0, "");
const FLOOR: Bounds = Bounds::within(0.0, 1000.0, "");
const RANGE: Bounds = Bounds::above(0.0, 1000.0, "");
const BITS: (u64, u64) = (1, 32);
const DRIFT: Bounds = Bounds::within(-100.0, 1000.0, "%");

const NOISE_OF: [(&str, NoiseOf); 2] = [("full-scale", NoiseOf::FullScale), ("reading", NoiseOf::Reading)];

/// How a unit's fault is named, before it is known how much of it there is.
#[derive(Clone, Copy)]
enum Kind {
    Dead,
    Stuck,
    Clipped,
    Drifted,
}

const KINDS: [(&str, Kind); 4] =
    [("dead", Kind::Dead), ("stuck", Kind::Stuck), ("clipped", Kind::Clipped), ("drifted", Kind::Drifted)];

/// Reads what the scene says of its taxels; `units` is how many the rig's array has, if that is known.
pub(super) fn read_skin(scene: &mut Table, units: Option<usize>) -> Option<SkinSpec> {
    let has_elastomer = scene.has("elastomer");
    let elastomer = scene.table("elastomer").and_then(read_elastomer);
    let mut under = |key| {
        let table = scene.table(key)?;
        if !has_elastomer {
            let told = format!("`{key}` without `elastomer`: the taxels read nothing");
            table.complain(Problem::new(table.span(), told).help("add elastomer = { depth_mm = 5.0 }"));
        }
        Some(table)
    };
    let indenter_radius_mm = under("indenter").map_or(0.0, |mut table| {
        let radius_mm = read_radius(&mut table, elastomer);
        table.finish();
        radius_mm
    });
    let taxels = under("taxels").map_or_else(Taxels::default, |table| read_taxels(table, elastomer));
    let noise = scene.table("taxel_noise").map(|table| read_noise(table, units));
    let hysteresis_percent = scene.table("hysteresis").map(|mut table| {
        let percents = read_percents(&mut table, "hysteresis", "hysteresis_percent", units);
        table.finish();
        percents
    });
    let faults = document::all(scene.tables("taxel_fault").into_iter().map(|table| read_fault(table, units)));
    let converter = scene.table("converter").map(|mut table| {
        let bits = table.require_integer("bits", BITS.0, BITS.1);
        let range = table.require_number("range", RANGE);
        table.finish();
        Some(Converter { bits: u32::try_from(bits?).ok()?, range: range? })
    });
    Some(SkinSpec {
        elastomer,
        indenter_radius_mm,
        taxels,
        // a term that is named and wrong has been told of
        noise: noise.flatten(),
        hysteresis_percent: hysteresis_percent.flatten(),
        faults: faults?,
        converter: converter.flatten(),
    })
}

fn read_elastomer(mut table: Table) -> Option<Elastomer> {
    let depth_mm = table.require_number("depth_mm", DEPTH);
    let bonded = table.number("bonded_poisson_ratio", POISSON_RATIO);
    table.finish();
    let medium = bonded.map_or(Medium::HalfSpace, |poisson_ratio| Medium::BondedLayer { poisson_ratio });
    Some(Elastomer { depth_mm: depth_mm?, medium })
}

fn read_taxels(mut table: Table, elastomer: Option<Elastomer>) -> Taxels {
    let taxels = Taxels {
        radius_mm: read_radius(&mut table, elastomer),
        gain_spread_percent: table.number("gain_spread_percent", GAIN_SPREAD).unwrap_or(0.0),
        place_spread_mm: table.number("place_spread_mm", PLACE_SPREAD).unwrap_or(0.0),
        depth_spread_percent: table.number("depth_spread_percent", DEPTH_SPREAD).unwrap_or(0.0),
        baseline: table.number("baseline", READING).unwrap_or(0.0),
    };
    table.finish();
    taxels
}

/// The radius of an indenter or a taxel, mm.
fn read_radius(table: &mut Table, elastomer: Option<Elastomer>) -> f64 {
    let radius_mm = table.number("radius_mm", RADIUS).unwrap_or(0.0);
    if let Some(Elastomer { depth_mm, .. }) = elastomer
        && radius_mm > MOST_RADIUS_DEPTHS * depth_mm
    {
        let told = format!("`radius_mm` is {radius_mm}, over {MOST_RADIUS_DEPTHS} times the elastomer's {depth_mm} mm");
        table.complain(Problem::new(table.span_of("radius_mm"), told));
    }
    radius_mm
}

fn read_noise(mut table: Table, units: Option<usize>) -> Option<TaxelNoise> {
    let repeatability_percent = read_percents(&mut table, "taxel_noise", "repeatability_percent", units);
    let of = table.choice("of", &NOISE_OF).unwrap_or_default();
    let floor = table.number("floor", FLOOR).unwrap_or(0.0);
    table.finish();
    Some(TaxelNoise { repeatability_percent: repeatability_percent?, of, floor })
}

fn read_fault(mut table: Table, units: Option<usize>) -> Option<TaxelFault> {
    let unit = table.require_integer("unit", 1, u64::from(u16::MAX)).map(|unit| unit as usize);
    if let (Some(unit), Some(units)) = (unit, units)
        && unit > units
    {
        let told = format!("there is no unit {unit}: the rig's array has {units}");
        table.complain(Problem::new(table.span_of("unit"), told));
    }
    let kind = table.require_choice("kind", &KINDS).and_then(|kind| {
        // a key that belongs to another kind is told of by finish()
        Some(match kind {
            Kind::Dead => TaxelFaultKind::Dead,
            Kind::Stuck => TaxelFaultKind::Stuck(table.require_number("reading", READING)?),
            Kind::Clipped => TaxelFaultKind::Clipped(table.require_number("reading", READING)?),
            Kind::Drifted => TaxelFaultKind::Drifted(table.require_number("gain_percent", DRIFT)?),
        })
    });
    table.finish();
    Some(TaxelFault { unit: unit?, kind: kind? })
}

/// One percentage a unit.
fn read_percents(table: &mut Table, term: &str, key: &'static str, units: Option<usize>) -> Option<Vec<f64>> {
    if !table.has(key) {
        let told = format!("`{key}` is missing in `scene.{term}`: a list, one % a unit");
        table.complain(Problem::new(table.span(), told));
    }
    let percents = table.numbers(key, PERCENT);
    if let (Some(percents), Some(units)) = (&percents, units)
        && percents.len() != units
    {
        let told = format!("`{key}` has {} values for {units} units", percents.len());
        table.complain(Problem::new(table.span_of(key), told));
    }
    percents
}

#[cfg(test)]
mod tests {
    use super::super::SIM_RIG;
    use super::*;
    use crate::rig;

    const ELASTOMER: &str = "elastomer = { depth_mm = 5.0 }";
    const LAST: &str = "array = [1.0, 2.0] }";

    fn changed(from: &str, to: &str) -> Result<SkinSpec, Vec<String>> {
        assert!(SIM_RIG.contains(from), "{from}");
        let rig = rig::parse("rig.toml", &SIM_RIG.replace(from, to), &|_| unreachable!());
        rig.map(|rig| rig.scene.skin).map_err(|problems| problems.lines())
    }

    /// The shipped rig with more said after its elastomer.
    fn with(more: &str) -> Result<SkinSpec, Vec<String>> {
        changed(ELASTOMER, &format!("{ELASTOMER}\n{more}"))
    }

    fn with_fault(fault: &str) -> Result<SkinSpec, Vec<String>> {
        changed(LAST, &format!("{LAST}\n[[scene.taxel_fault]]\n{fault}\n"))
    }

    #[test]
    fn what_isnt_named_isnt_there() {
        let shipped = changed("[scene]", "[scene]").unwrap();
        let SkinSpec { elastomer, indenter_radius_mm, taxels, noise, faults, converter, .. } = shipped;
        assert_eq!(elastomer, Some(Elastomer::half_space(5.0)));
        assert_eq!((indenter_radius_mm, taxels, faults, converter), (0.0, Taxels::default(), vec![], None));
        assert_eq!(noise.map(|noise| (noise.of, noise.floor)), Some((NoiseOf::FullScale, 0.0)));
        let bare = changed(ELASTOMER, "").unwrap();
        assert_eq!(bare.elastomer, None);
    }

    #[test]
    fn each_term_is_read() {
        let bonded = changed("depth_mm = 5.0 }", "depth_mm = 4.0, bonded_poisson_ratio = 0.49 }").unwrap();
        let medium = Medium::BondedLayer { poisson_ratio: 0.49 };
        assert_eq!(bonded.elastomer, Some(Elastomer { depth_mm: 4.0, medium }));
        assert_eq!(with("indenter = { radius_mm = 0.5 }").unwrap().indenter_radius_mm, 0.5);
        let taxels = "taxels = { radius_mm = 1.0, gain_spread_percent = 20.0, place_spread_mm = 0.1, \
                      depth_spread_percent = 5.0, baseline = 0.02 }";
        let read = Taxels {
            radius_mm: 1.0,
            gain_spread_percent: 20.0,
            place_spread_mm: 0.1,
            depth_spread_percent: 5.0,
            baseline: 0.02,
        };
        assert_eq!(with(taxels).unwrap().taxels, read);
        let noise =
            changed("taxel_noise = {", "taxel_noise = { of = \"reading\", floor = 0.001,").unwrap().noise.unwrap();
        assert_eq!((noise.of, noise.floor, noise.repeatability_percent[8]), (NoiseOf::Reading, 0.001, 3.97));
        let converter = with("converter = { bits = 16, range = 10.0 }").unwrap().converter;
        assert_eq!(converter, Some(Converter { bits: 16, range: 10.0 }));
        for (text, kind) in [
            ("kind = \"dead\"", TaxelFaultKind::Dead),
            ("kind = \"stuck\"\nreading = 3.0", TaxelFaultKind::Stuck(3.0)),
            ("kind = \"clipped\"\nreading = 0.3", TaxelFaultKind::Clipped(0.3)),
            ("kind = \"drifted\"\ngain_percent = -10.0", TaxelFaultKind::Drifted(-10.0)),
        ] {
            assert_eq!(with_fault(&format!("unit = 5\n{text}")).unwrap().faults, [TaxelFault { unit: 5, kind }]);
        }
    }

    #[test]
    fn what_is_wrong_with_a_skin_is_told_at_its_place() {
        let elastomer = |depth: &str| changed(ELASTOMER, &format!("elastomer = {{ {depth} }}"));
        for (found, told) in [
            (
                elastomer("depth_mm = 5.0, bonded_poisson_ratio = 0.5"),
                vec!["35:54: `bonded_poisson_ratio` is 0.5, must be 0 to 0.4999"],
            ),
            (
                elastomer("bonded_poisson_ratio = -0.1"),
                vec![
                    "35:13: `depth_mm` is missing in `scene.elastomer`: a number in mm, over 0, at most 1000",
                    "35:38: `bonded_poisson_ratio` is -0.1, must be 0 to 0.4999",
                ],
            ),
            (
                changed(ELASTOMER, "indenter = { radius_mm = 0.5 }"),
                vec!["35:12: `indenter` without `elastomer`: the taxels read nothing"],
            ),
            (
                changed(ELASTOMER, "taxels = { radius_mm = 0.5 }"),
                vec!["35:10: `taxels` without `elastomer`: the taxels read nothing"],
            ),
            (
                with("indenter = { radius_mm = 10.1 }"),
                vec!["36:26: `radius_mm` is 10.1, over 2 times the elastomer's 5 mm"],
            ),
            (
                with("taxels = { radius_mm = 11.0 }"),
                vec!["36:24: `radius_mm` is 11, over 2 times the elastomer's 5 mm"],
            ),
            (with("taxels = { gain_percent = 20.0 }"), vec!["36:12: unknown key `gain_percent` in `scene.taxels`"]),
            (
                with("taxels = { gain_spread_percent = 91.0, place_spread_mm = -0.1, depth_spread_percent = 31.0 }"),
                vec![
                    "36:34: `gain_spread_percent` is 91, must be 0 to 90 %",
                    "36:58: `place_spread_mm` is -0.1, must be 0 to 10 mm",
                    "36:87: `depth_spread_percent` is 31, must be 0 to 30 %",
                ],
            ),
            (
                changed("taxel_noise = {", "taxel_noise = { of = \"readings\", floor = -0.001,"),
                vec![
                    "39:22: `of` is \"readings\", expected one of full-scale, reading",
                    "39:42: `floor` is -0.001, must be 0 to 1000",
                ],
            ),
            (changed(", 3.97]", "]"), vec!["39:41: `repeatability_percent` has 8 values for 9 units"]),
            (
                changed("repeatability_percent", "repeatabilty_percent"),
                vec![
                    "39:15: `repeatability_percent` is missing in `scene.taxel_noise`: a list, one % a unit",
                    "39:17: unknown key `repeatabilty_percent` in `scene.taxel_noise`",
                ],
            ),
            (
                with("converter = { bits = 0 }"),
                vec![
                    "36:13: `range` is missing in `scene.converter`: a number, over 0, at most 1000",
                    "36:22: `bits` must be 1 to 32",
                ],
            ),
            (with_fault("unit = 10\nkind = \"dead\""), vec!["43:8: there is no unit 10: the rig's array has 9"]),
            (
                with_fault("unit = 5\nkind = \"stuck\""),
                vec!["42:1: `reading` is missing in `scene.taxel_fault`: a number, -1000 to 1000"],
            ),
            (
                with_fault("unit = 5\nkind = \"dead\"\nreading = 1.0"),
                vec!["45:1: unknown key `reading` in `scene.taxel_fault`"],
            ),
            (
                with_fault("unit = 5\nkind = \"deaf\""),
                vec!["44:8: `kind` is \"deaf\", expected one of dead, stuck, clipped, drifted"],
            ),
        ] {
            let told: Vec<String> = told.into_iter().map(|line| format!("rig.toml:{line}")).collect();
            assert_eq!(found.expect_err("it is wrong"), told);
        }
    }
}
