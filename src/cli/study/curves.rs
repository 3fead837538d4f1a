//! `palpate study curves`: the paper's numerical study, and any array put through the same.

use super::begun::{Output, StudyOutput, ended};
use crate::api::Failure;
use crate::api::sources::read_rig;
use crate::cli::summary::beside;
use palpate_core::mechanics::{Medium, Passage};
use palpate_document as document;
use palpate_sim::scene::{Elastomer, SkinSpec};
use palpate_study::curves::{
    ASSUMED_SD, ContactArea, Curves, DesignError, DesignFindings, MeanBound, NEAR_R, NominalArray, PaperClaim, Turning,
    curves, design_figures, figures,
};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate study curves
  palpate study curves --rig rigs/sim.toml
  palpate study curves --rig mine.toml --depth-mm 4 --area-mm -5 5 -5 5

Without a rig: the paper's rows of units; the paper's claims are compared with computed values.
With a rig: its array and elastomer; nothing is moved or opened.";

#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct CurvesArgs {
    /// Study this rig's array instead of the paper's lines
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    /// Use a half-space of this depth, mm; for a rig without an elastomer, or instead of its elastomer
    #[arg(long, value_name = "MM", value_parser = depth, requires = "rig")]
    depth_mm: Option<f64>,
    /// Area of contacts [default: the units' bounding box and a third of the pitch around it]
    #[arg(long, num_args = 4, value_names = ["X0", "X1", "Y0", "Y1"], value_parser = coordinate,
        allow_negative_numbers = true, requires = "rig")]
    area_mm: Option<Vec<f64>>,
    #[command(flatten)]
    output: Output,
}

/// Width of the first printed column.
const FIRST: usize = 20;
/// Largest depth and coordinate, mm, the same as in a rig file.
const DEPTH_MAX_MM: f64 = 1000.0;
const COORDINATE_MAX_MM: f64 = 10_000.0;

/// Executes the study, writes its figures and prints the results.
pub(super) fn study(args: &CurvesArgs) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.output, "curves")?;
    match &args.rig {
        None => {
            let found = curves();
            begun.end(figures(&found), found.ndjson(), |out| summary(&found) + &ended(out))
        }
        Some(rig) => {
            let found = design(rig, args)?.study();
            begun.end(design_figures(&found), found.ndjson(), |out| design_summary(&found) + &ended(out))
        }
    }
}

fn design(path: &Path, args: &CurvesArgs) -> Result<NominalArray, Failure> {
    let (text, rig) = read_rig(path)?;
    // a rig without a scene is simulated with that of the paper, which isn't its own array
    let mut skin = if document::has_key(&text, "scene") { rig.scene.skin } else { SkinSpec::default() };
    if let Some(depth_mm) = args.depth_mm {
        skin.elastomer = Some(Elastomer::half_space(depth_mm));
    }
    let area = args.area_mm.as_deref().map(area).transpose()?;
    NominalArray::new(&rig.array.layout.one_per_unit(), &skin, rig.limits.force_n, area).map_err(|error| {
        let help = match error {
            DesignError::NoDepth => "add it: --depth-mm 5",
            DesignError::OneUnit | DesignError::SamePlace(..) => "see [array] of the rig: grid or places_mm",
            DesignError::Radius { .. } => "see indenter and taxels in the rig's [scene]",
        };
        Failure::usage(miette::miette!(help = help, "{}: {error}", path.display()))
    })
}

fn area(ends: &[f64]) -> Result<ContactArea, Failure> {
    match *ends {
        [x0, x1, y0, y1] if x0 < x1 && y0 < y1 => Ok(ContactArea { x_mm: (x0, x1), y_mm: (y0, y1) }),
        _ => {
            let help = "expected smallest and largest x, then y: --area-mm -6 6 -6 6";
            Err(Failure::usage(miette::miette!(help = help, "--area-mm: the area is empty")))
        }
    }
}

fn depth(text: &str) -> Result<f64, String> {
    let within = |mm: &f64| *mm > 0.0 && *mm <= DEPTH_MAX_MM;
    text.parse().ok().filter(within).ok_or_else(|| format!("expected a number in mm, above 0, at most {DEPTH_MAX_MM}"))
}

fn coordinate(text: &str) -> Result<f64, String> {
    let within = |mm: &f64| mm.abs() <= COORDINATE_MAX_MM;
    text.parse().ok().filter(within).ok_or_else(|| format!("expected a number in mm, up to {COORDINATE_MAX_MM}"))
}

/// Returns the verdict on each claim.
fn summary(found: &Curves) -> String {
    let mut text = "the paper's numerical study; distances in depths H unless in mm\n\n".to_owned();
    for PaperClaim { text: claim, verdict, found, .. } in &found.claims {
        text += &beside(verdict, FIRST, claim);
        text += &beside("", FIRST, found);
    }
    text + "\n"
}

/// Returns a summary of the results for an array.
fn design_summary(found: &DesignFindings) -> String {
    let DesignFindings { passage, area, survey, .. } = found;
    let mut text = String::new();
    let mut line = |name: &str, words: String| text += &beside(name, FIRST, &words);
    line("array", format!("{} units, pitch {:.3} mm, {}", found.units, found.pitch_mm, under(passage)));
    let ((x0, x1), (y0, y1)) = (area.x_mm, area.y_mm);
    line("area", format!("x {x0:.2} to {x1:.2}, y {y0:.2} to {y1:.2} mm"));
    let depths = |mm: f64| mm / passage.depth_mm;
    line(
        "receptive field",
        format!(
            "half its peak at {:.3} mm = {:.2} H, under 1 % from {:.2} mm = {:.2} H on; {:.2} % at 2 H",
            found.half_peak_mm,
            depths(found.half_peak_mm),
            found.hundredth_mm,
            depths(found.hundredth_mm),
            100.0 * found.share_at_two_depths
        ),
    );
    let (enough, near_enough) = found.keeps_rule();
    let word = |kept: bool| if kept { "kept" } else { "not kept" };
    let through = if found.row_is_column { "column" } else { "row" };
    let units = format!("n >= 5: {}, n = {} on the {through} through the middle", word(enough), found.row_units);
    line("the paper's rule", units);
    line("", format!("s <= 1: {}, s = {:.3}", word(near_enough), found.spacing));
    line(
        "r turns",
        match &survey.first {
            None => format!("no reversal on any of {} paths", survey.rays),
            Some(first) => format!(
                "from {:.2} mm = {:.2} H on: {}; {:.1} % of {} ways over the area turn",
                first.distance_mm,
                depths(first.distance_mm),
                way(first),
                100.0 * survey.share_turned(),
                survey.rays
            ),
        },
    );
    line(
        &format!("r = {NEAR_R} at"),
        match survey.near_median_and_worst() {
            None => "nowhere in the area".to_owned(),
            Some((median_mm, worst)) => {
                format!("{median_mm:.3} mm, median; {:.3} mm at worst, {}", worst.distance_mm, way(&worst))
            }
        },
    );
    let noise = if found.noise_is_assumed {
        format!(
            "the rig states no noise, so an sd of {ASSUMED_SD} of the reading for 1 N (the mean of the paper's Table 1)"
        )
    } else {
        "with the rig's own noise".to_owned()
    };
    line(
        "least error",
        match &found.least {
            None => "unbounded: for some contacts the units don't determine location and force".to_owned(),
            Some(MeanBound { location_mm, force_n }) => {
                format!(
                    "{location_mm:.4} mm and {force_n:.4} N, mean over the area and 0.1 to 1 N (Cramér-Rao); {noise}"
                )
            }
        },
    );
    text + "\n"
}

/// Describes the cover of the units, and the sizes of indenter and taxel.
fn under(passage: &Passage) -> String {
    let Passage { medium, depth_mm, indenter_radius_mm, taxel_radius_mm } = passage;
    let mut text = match medium {
        Medium::HalfSpace => format!("{depth_mm} mm deep in a half-space"),
        Medium::BondedLayer { poisson_ratio } => {
            format!("under a bonded layer of {depth_mm} mm, Poisson's ratio {poisson_ratio}")
        }
    };
    for (what, radius_mm) in [("indenter", indenter_radius_mm), ("taxels", taxel_radius_mm)] {
        if *radius_mm > 0.0 {
            let _ = write!(text, ", {what} of radius {radius_mm} mm");
        }
    }
    text
}

fn way(turning: &Turning) -> String {
    let Turning { from, direction_rad, .. } = turning;
    format!("from ({:.2}, {:.2}) mm at {:.3} rad", from.x_mm, from.y_mm, direction_rad)
}
