//! The validation as a page of Markdown.

use super::{Validation, ValidationOutcome};
use crate::dataset::characteristics::UnitCharacteristics;
use crate::paper;
use crate::solver::Evaluation;
use std::fmt::Write as _;

/// What of the paper is done by what.
const PROTOCOL: &str = "\
| in the paper | here | seen by |
|---|---|---|
| 3 x 3 units, pitch 4.5 mm, under 5 mm of elastomer | `[array] grid`, `[scene] elastomer` | `rigs/paper.toml` |
| forward model: a point load on an elastic half-space | `mechanics::lambda` | `cargo test --release --lib mechanics` |
| numerical study, Figures 3 to 5 | `study::curves` | `palpate study curves` |
| three VP-25XL axes, load cell and array on one USB-6343 | drivers `xps`, `daqmx` | `palpate doctor rigs/paper.toml` |
| force held within 0.05 N by the load cell | `control::ForceLoop`, `[press] force_tolerance_n` | `palpate study control` |
| loading area of 12 x 12 mm, at most 2 N, some 1.5 mm deep | `[limits]`, held by `control::Permit` | `palpate check recipes/paper.toml` |
| 0 to 2 N and back in steps of 0.5 N, five times, 5 min apart, at each unit | phase `characterisation` | `palpate run recipes/characterise.toml` |
| 1 N at 625 places: a matrix of 9 x 625 | phase `calibration`, `calibration_matrix.csv` | `palpate run recipes/calibrate.toml` |
| 100 places and forces of 0.1 to 1 N at random | phase `test` | `palpate run recipes/test.toml` |
| location: the largest Pearson correlation; force: by the closest unit | solver `pearson` | `palpate evaluate runs/paper --solver pearson` |
| errors, their distribution, and the share under 1 mm, 0.1 N and both | `solver::Evaluation` | `palpate report runs/paper` |
| shear, and several loads at once (its future work) | told from one contact (`not-one-contact`), not solved | `palpate study failures` |
";

impl Validation {
    /// The page; the same seeds give the same bytes.
    pub fn markdown(&self) -> String {
        let mut text = String::new();
        let _ = self.write(&mut text); // writing to a string can't fail
        text
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        let Validation { seed, outcomes, claims } = self;
        let last = seed + outcomes.len().saturating_sub(1) as u64;
        let presses = outcomes.first().map_or(0, |outcome| outcome.presses);
        writeln!(text, "# Validation\n")?;
        writeln!(
            text,
            "Written by `palpate study validation`, not by hand: a test holds it to what the program finds.\n"
        )?;
        writeln!(
            text,
            "The paper (Sensors 2018, 18, 351) calibrates one sensor and tests it with 100 presses. Here the same protocol is\n\
             carried out on `rigs/paper.toml`, its rig simulated at the level of the wire, with {} specimens (seeds {seed} to {last}):\n\
             {presses} presses and {:.1} h of virtual time each. The noise of the units is that of the paper's Table 1, read as\n\
             three standard deviations of full scale; nothing is fitted to the paper's results.\n",
            outcomes.len(),
            mean(outcomes.iter().map(|outcome| outcome.hours)),
        )?;
        writeln!(
            text,
            "## Its numbers\n\n    palpate run recipes/paper.toml --rig rigs/paper.toml --seed {seed} --out runs/paper"
        )?;
        writeln!(text, "    palpate evaluate runs/paper --solver all\n")?;
        writeln!(
            text,
            "| | paper | its method here, mean ± sd | paper's trial, in sd | best method here |\n|---|---|---|---|---|"
        )?;
        for number in NUMBERS {
            self.write_number(text, &number)?;
        }
        let best: Vec<&str> = outcomes.iter().map(|outcome| outcome.best.solver.as_str()).collect();
        writeln!(text, "\nBest is what cross-validation on the calibration picks: {}.", counted(&best))?;
        writeln!(
            text,
            "The paper's force errors are larger than ours, whose loop holds the force nearer than its tolerance asks; see the last\n\
             section.\n"
        )?;
        self.write_table_1(text)?;
        writeln!(
            text,
            "## Its numerical study\n\n    palpate study curves\n\n| claim | | what is found |\n|---|---|---|"
        )?;
        for claim in claims {
            writeln!(text, "| {} | {} | {} |", claim.told, claim.verdict, claim.found.replace('|', "\\|"))?;
        }
        writeln!(text, "\n## Its protocol, part by part\n\n{PROTOCOL}")?;
        text.push_str(
            "## What is assumed\n\n\
             - Table 1's definitions aren't in the paper. Repeatability is read as three standard deviations of full scale; `palpate\n\
             \x20 report` prints it by range and by t95 as well, and `palpate study ablation` says what the other reading (of the\n\
             \x20 reading, not of full scale) would change.\n\
             - The force is held within a tolerance, of which the loop uses a fifth. An error of ±0.05 N in every press would bring the\n\
             \x20 force numbers down to the paper's: `palpate study ablation`, force tolerance.\n\
             - 1 V a newton straight above a unit, 16 bits over ±10 V. The cover is a half-space, as in the paper's own model; the paper\n\
             \x20 doesn't say which unit has which number.\n",
        );
        Ok(())
    }

    fn write_number(&self, text: &mut String, number: &Number) -> std::fmt::Result {
        let Number { name, paper, digits, unit, of } = number;
        let values = |which: fn(&ValidationOutcome) -> &Evaluation| {
            let known: Option<Vec<f64>> = self.outcomes.iter().map(|outcome| of(which(outcome))).collect();
            known.unwrap_or_default()
        };
        let (papers, best) = (values(|outcome| &outcome.papers), values(|outcome| &outcome.best));
        let told =
            |values: &[f64]| format!("{:.digits$} ± {:.digits$} {unit}", mean(values.iter().copied()), sd(values));
        let away = (paper - mean(papers.iter().copied())) / sd(&papers);
        let away = if away.is_finite() { format!("{away:+.1}") } else { "-".to_owned() };
        let short = format!("{paper:.digits$}");
        let short = if *unit == "%" { format!("{paper:.0}") } else { short };
        writeln!(text, "| {name} | {short} {unit} | {} | {away} | {} |", told(&papers), told(&best))
    }

    fn write_table_1(&self, text: &mut String) -> std::fmt::Result {
        writeln!(text, "## Its Table 1\n\n    palpate report runs/paper\n")?;
        writeln!(
            text,
            "% of the output at 2 N; paper, then here: mean over the specimens of 3 sd of five repeats, and of hysteresis.\n"
        )?;
        writeln!(
            text,
            "| unit | loading | here | unloading | here | hysteresis | here |\n|---|---|---|---|---|---|---|"
        )?;
        for (unit, [loading, unloading, hysteresis]) in paper::TABLE_1_PERCENT.into_iter().enumerate() {
            let ours = |of: fn(&UnitCharacteristics) -> Option<f64>| {
                let known: Vec<f64> =
                    self.outcomes.iter().filter_map(|outcome| of(outcome.table_1.get(unit)?)).collect();
                mean(known.into_iter())
            };
            let (up, down) = (ours(|u| u.repeatability_loading_percent), ours(|u| u.repeatability_unloading_percent));
            let around = ours(|u| u.hysteresis_percent);
            writeln!(
                text,
                "| {} | {loading:.2} | {up:.2} | {unloading:.2} | {down:.2} | {hysteresis:.2} | {around:.2} |",
                unit + 1
            )?;
        }
        writeln!(
            text,
            "\nSimulated units draw one error a contact for both branches, by the loading column: unloading isn't modelled apart.\n"
        )
    }
}

/// A number of the paper, and where it stands in an evaluation.
struct Number {
    name: &'static str,
    paper: f64,
    digits: usize,
    unit: &'static str,
    of: fn(&Evaluation) -> Option<f64>,
}

const NUMBERS: [Number; 5] = [
    number("mean location error", paper::LOCATION_ERROR_MM, 3, "mm", |e| Some(e.location_error_mm.mean)),
    number("location error under 1 mm", 100.0 * paper::WITHIN_1MM, 1, "%", |e| Some(100.0 * e.within.location_1mm)),
    number("mean force error", paper::FORCE_ERROR_N, 4, "N", |e| Some(e.force_error_n?.mean)),
    number("force error under 0.1 N", 100.0 * paper::WITHIN_0_1N, 1, "%", |e| Some(100.0 * e.within.force_0_1n?)),
    number("both under", 100.0 * paper::WITHIN_BOTH, 1, "%", |e| Some(100.0 * e.within.both?)),
];

const fn number(
    name: &'static str,
    paper: f64,
    digits: usize,
    unit: &'static str,
    of: fn(&Evaluation) -> Option<f64>,
) -> Number {
    Number { name, paper, digits, unit, of }
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().sum::<f64>() / values.count() as f64
}

/// Standard deviation, n - 1.
fn sd(values: &[f64]) -> f64 {
    let mean = mean(values.iter().copied());
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)).sqrt()
}

/// How often each name stands there, the first one first.
fn counted(names: &[&str]) -> String {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for name in names {
        match counts.iter_mut().find(|(known, _)| known == name) {
            Some((_, count)) => *count += 1,
            None => counts.push((name, 1)),
        }
    }
    counts.iter().map(|(name, count)| format!("`{name}` {count} times")).collect::<Vec<_>>().join(", ")
}
