//! Terms of a `[scene]` that determine the readings of the taxels.

use super::scene_keys::{
    NOISE_OF, NamedFault, TAXEL_FAULTS, converter, elastomer, hysteresis, indenter, scene, taxel_fault, taxel_noise,
    taxels,
};
use palpate_core::mechanics::{MOST_RADIUS_DEPTHS, Medium};
use palpate_document::{self as document, Key, Problem, Table};
use palpate_sim::scene::{Converter, Elastomer, SkinSpec, TaxelFault, TaxelFaultKind, TaxelNoise, Taxels};

/// Reads the scene's description of its taxels. `units` is the number of units in the rig's array, if known.
pub(super) fn read_skin(table: &Table, units: Option<usize>) -> Option<SkinSpec> {
    let elastomer = table.table(&scene::elastomer).and_then(|table| read_elastomer(&table));
    let under = |key: &Key| {
        let inner = table.table(key)?;
        if !table.has(&scene::elastomer) {
            let text = format!("`{}` without `elastomer`: the taxels read nothing", key.name);
            table.complain(Problem::new(inner.span(), text).help("add elastomer = { depth_mm = 5.0 }"));
        }
        Some(inner)
    };
    let radius_mm = under(&scene::indenter).map(|table| read_radius(&table, &indenter::radius_mm, elastomer));
    let indenter_radius_mm = radius_mm.map_or(Some(0.0), |radius_mm| radius_mm);
    let taxels = under(&scene::taxels).map(|table| read_taxels(&table, elastomer, indenter_radius_mm));
    let noise = table.table(&scene::taxel_noise).map(|table| read_noise(&table, units));
    let hysteresis_percent =
        table.table(&scene::hysteresis).map(|table| read_percents(&table, &hysteresis::hysteresis_percent, units));
    let faults = document::all(table.tables(&scene::taxel_fault).iter().map(|table| read_fault(table, units)));
    let converter = table.table(&scene::converter).map(|table| {
        let (bits, range) = (table.whole(&converter::bits), table.number(&converter::range));
        Some(Converter { bits: u32::try_from(bits?).ok()?, range: range? })
    });
    Some(SkinSpec {
        elastomer,
        // a wrong term has been reported
        indenter_radius_mm: radius_mm.flatten().unwrap_or(0.0),
        taxels: taxels.flatten().unwrap_or_default(),
        noise: noise.flatten(),
        hysteresis_percent: hysteresis_percent.flatten(),
        faults: faults?,
        converter: converter.flatten(),
    })
}

fn read_elastomer(table: &Table) -> Option<Elastomer> {
    let depth_mm = table.number(&elastomer::depth_mm);
    let bonded = table.number(&elastomer::bonded_poisson_ratio);
    let medium = bonded.map_or(Medium::HalfSpace, |poisson_ratio| Medium::BondedLayer { poisson_ratio });
    Some(Elastomer { depth_mm: depth_mm?, medium })
}

fn read_taxels(table: &Table, elastomer: Option<Elastomer>, indenter_radius_mm: Option<f64>) -> Option<Taxels> {
    let radius_mm = read_radius(table, &taxels::radius_mm, elastomer);
    let [gain_spread_percent, place_spread_mm, depth_spread_percent, baseline] = table.numbers([
        taxels::gain_spread_percent,
        taxels::place_spread_mm,
        taxels::depth_spread_percent,
        taxels::baseline,
    ])?;
    let shear = table.flag(&taxels::shear)?;
    let is_layer = elastomer.is_some_and(|elastomer| elastomer.medium != Medium::HalfSpace);
    if shear && (radius_mm != Some(0.0) || indenter_radius_mm != Some(0.0) || is_layer) {
        let text = "`shear` is modelled for a point load on points in a half-space";
        let help = "remove `shear`, or `radius_mm` of taxels and indenter and `bonded_poisson_ratio`";
        table.complain(Problem::new(table.span_of(&taxels::shear), text).help(help));
    }
    Some(Taxels { radius_mm: radius_mm?, gain_spread_percent, place_spread_mm, depth_spread_percent, baseline, shear })
}

/// Reads the radius of an indenter or a taxel, mm.
fn read_radius(table: &Table, key: &Key, elastomer: Option<Elastomer>) -> Option<f64> {
    let radius_mm = table.number(key)?;
    if let Some(Elastomer { depth_mm, .. }) = elastomer
        && radius_mm > MOST_RADIUS_DEPTHS * depth_mm
    {
        let text = format!("`radius_mm` is {radius_mm}, over {MOST_RADIUS_DEPTHS} times the elastomer's {depth_mm} mm");
        table.complain(Problem::new(table.span_of(key), text));
    }
    Some(radius_mm)
}

fn read_noise(table: &Table, units: Option<usize>) -> Option<TaxelNoise> {
    let repeatability_percent = read_percents(table, &taxel_noise::repeatability_percent, units);
    let (of, floor) = (table.word(&taxel_noise::of, &NOISE_OF), table.number(&taxel_noise::floor));
    Some(TaxelNoise { repeatability_percent: repeatability_percent?, of: of?, floor: floor? })
}

fn read_fault(table: &Table, units: Option<usize>) -> Option<TaxelFault> {
    let unit = table.whole(&taxel_fault::unit).map(|unit| unit as usize);
    if let (Some(unit), Some(units)) = (unit, units)
        && unit > units
    {
        let text = format!("there is no unit {unit}: the rig's array has {units}");
        table.complain(Problem::new(table.span_of(&taxel_fault::unit), text));
    }
    let kind = table.word(&taxel_fault::kind, &TAXEL_FAULTS).and_then(|kind| {
        Some(match kind {
            NamedFault::Dead => TaxelFaultKind::Dead,
            NamedFault::Stuck => TaxelFaultKind::Stuck(table.number(&taxel_fault::stuck::reading)?),
            NamedFault::Clipped => TaxelFaultKind::Clipped(table.number(&taxel_fault::clipped::reading)?),
            NamedFault::Drifted => TaxelFaultKind::Drifted(table.number(&taxel_fault::drifted::gain_percent)?),
        })
    });
    Some(TaxelFault { unit: unit?, kind: kind? })
}

/// Reads one percentage for each unit.
fn read_percents(table: &Table, key: &Key, units: Option<usize>) -> Option<Vec<f64>> {
    let percents = table.per_unit(key, units)?;
    if let Some(units) = units
        && percents.len() != units
    {
        let text = format!("`{}` has {} values for {units} units", key.name, percents.len());
        let help = format!("give one value for each of the {units} units, in their order");
        table.complain(Problem::new(table.span_of(key), text).help(help));
    }
    Some(percents)
}

#[cfg(test)]
mod tests {
    use super::super::SIM_RIG;
    use super::*;
    use crate::rig;
    use palpate_sim::scene::NoiseOf;

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
    fn shear_is_read_and_refused_where_it_is_not_modelled() {
        assert!(with("taxels = { shear = true }").unwrap().taxels.shear);
        for more in
            ["taxels = { shear = true, radius_mm = 0.5 }", "taxels = { shear = true }\nindenter = { radius_mm = 1.0 }"]
        {
            let lines = with(more).unwrap_err();
            assert!(lines[0].contains("`shear` is modelled for a point load on points in a half-space"), "{lines:?}");
        }
    }

    #[test]
    fn unnamed_scene_term_is_absent() {
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
            shear: false,
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
    fn skin_error_is_reported_at_its_place() {
        let elastomer = |depth: &str| changed(ELASTOMER, &format!("elastomer = {{ {depth} }}"));
        for (found, text) in [
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
                vec!["39:17: unknown key `repeatabilty_percent` in `scene.taxel_noise`"],
            ),
            (
                with("converter = { bits = 0 }"),
                vec![
                    "36:13: `range` is missing in `scene.converter`: a number, over 0, at most 1000",
                    "36:22: `bits` is 0, must be 1 to 32",
                ],
            ),
            (with_fault("unit = 10\nkind = \"dead\""), vec!["43:8: there is no unit 10: the rig's array has 9"]),
            (
                with_fault("unit = 5\nkind = \"stuck\""),
                vec!["42:1: `reading` is missing in `scene.taxel_fault`: a number, -1000 to 1000"],
            ),
            (
                with_fault("unit = 5\nkind = \"dead\"\nreading = 1.0"),
                vec!["45:1: `reading` in `scene.taxel_fault` can't be used here"],
            ),
            (
                with_fault("unit = 5\nkind = \"deaf\""),
                vec!["44:8: `kind` is \"deaf\", expected one of dead, stuck, clipped, drifted"],
            ),
        ] {
            let text: Vec<String> = text.into_iter().map(|line| format!("rig.toml:{line}")).collect();
            assert_eq!(found.expect_err("it is wrong"), text);
        }
    }
}
