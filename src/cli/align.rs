//! `palpate align`.

use super::one_rig::OneRigArgs;
use super::output::OutputArgs;
use super::progress::Progress;
use super::rig_file::{check_text, replace};
use super::signals::{First, heed};
use crate::api::Failure;
use crate::api::run::block_on;
use miette::{IntoDiagnostic, WrapErr};
use palpate_core::quantity::Frame;
use palpate_core::quantity::round;
use palpate_run::run::{AlignError, Alignment, align, align_plan};
use palpate_solver::Placement;
use serde_json::json;
use std::process::ExitCode;
use toml_edit::{DocumentMut, InlineTable, Item, Value, value};

const EXAMPLES: &str = "\
Examples:
  palpate align rigs/esp301.toml
  palpate align rigs/sim.toml --dry-run

Presses 5 x 5 places around the expected position of the array, with half of the force limit, and writes the result into
[frame] of the rig file; the rest of the file doesn't change.
A poor fit and a tilt of more than 5 degrees are refused, and nothing is written.
With --simulate, the frame of a real rig is not written either.";

/// Locate the specimen by pressing it, and write the rig's [frame]
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct AlignArgs {
    #[command(flatten)]
    rig: OneRigArgs,
    /// Print the result, and write nothing
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    output: OutputArgs,
}

/// Least uncertainty of the origin that is written, mm.
const LEAST_MM: f64 = 1e-4;

/// Presses, fits, reports, and writes.
pub(super) fn align_rig(args: &AlignArgs) -> Result<ExitCode, Failure> {
    let (text, spec, invented) = args.rig.read()?;
    let (file, seed) = (&args.rig.rig, args.rig.seed);
    if !spec.has_load_cell() {
        let help = "lower z in steps until the tip touches, and state its position in `frame.surface_mm`";
        return Err(Failure::usage(miette::miette!(
            help = help,
            "`align` presses by force, and this rig has no load cell"
        )));
    }
    let plan = align_plan(&spec, seed).map_err(Failure::usage)?;
    let cancel = heed(First::Stop, Some("stopping: the stage is stopped and parked"))?;
    let mut progress = Progress::new(&plan, 0, false, cancel.clone());
    let found = block_on(spec.is_simulated(), align(&spec, seed, &cancel, &mut progress))?;
    progress.end();
    let found = found.map_err(|error| match error {
        AlignError::Halted(ending) => Failure::ended(*ending),
        AlignError::Plan(problems) => Failure::usage(problems),
        tilted @ AlignError::Tilted { .. } => Failure::not_accepted(
            Err::<(), _>(tilted).into_diagnostic().wrap_err("the rig file is unchanged").unwrap_err(),
        ),
        other => Failure::not_accepted(
            Err::<(), _>(other)
                .into_diagnostic()
                .wrap_err(
                    "the rig file is unchanged: check `array.grid`, the order of its channels, and `frame.origin_mm`",
                )
                .unwrap_err(),
        ),
    })?;
    args.output.text(&described(&found))?;
    let written = with_frame(&text, &found).into_diagnostic().map_err(Failure::usage)?;
    check_text(file, &written)?;
    if args.dry_run || invented {
        let why = if args.dry_run { "--dry-run" } else { "a simulated frame doesn't apply to a real rig" };
        args.output.print(&format!("\nnot written ({why})\n"), &object(&found, false))?;
        return Ok(ExitCode::SUCCESS);
    }
    replace(file, &text, &written)?;
    args.output.print(&format!("\nwritten: [frame] of {}\n", file.display()), &object(&found, true))?;
    Ok(ExitCode::SUCCESS)
}

fn described(found: &Alignment) -> String {
    let Alignment { frame, placement, surface_mm, tilt_mm, touch_sigma_mm, presses, .. } = found;
    let Placement { origin: at, rotation_deg: turned_deg, origin_sigma_mm, rotation_sigma_deg, misfit_mm } = placement;
    let Frame { origin, rotation_deg, surface_z_mm, uncertainty_mm, tilt, .. } = frame;
    let lies = if *surface_mm < 0.0 { "higher" } else { "deeper" };
    let indent = " ".repeat(12);
    format!(
        "from {presses} presses, relative to the current frame\n  \
         array     x {:+.3}, y {:+.3} mm, each +-{origin_sigma_mm:.3} mm\n\
         {indent}rotated by {turned_deg:+.2} degrees, +-{rotation_sigma_deg:.2}\n\
         {indent}its units are {misfit_mm:.3} mm off the layout (rms)\n  \
         surface   {:.3} mm {lies} than in the current frame\n\
         {indent}its plane rises {tilt_mm:.3} mm to the edge; one touch: +-{touch_sigma_mm:.4} mm\n  \
         tilt      {:.2} degrees, +-{:.2}, deeper toward {:.0} degrees from x toward y\n\
         {indent}a press travels {:.1} um sideways over the surface per mm of depth\n\n\
         [frame]\n\
         surface_mm = {{ z = {surface_z_mm:.3}, uncertainty = {uncertainty_mm:.3} }}\n\
         origin_mm = {{ x = {:.3}, y = {:.3} }}\n\
         u_origin_mm = {:.4}\n\
         rotation_deg = {rotation_deg:.2}\n\
         tilt_mm_per_mm = {{ x = {:.5}, y = {:.5} }}\n",
        at.x_mm,
        at.y_mm,
        surface_mm.abs(),
        tilt.degrees(),
        found.tilt_sigma_deg(),
        tilt.direction_deg(),
        1000.0 * tilt.tangent(),
        origin.x_mm,
        origin.y_mm,
        origin_sigma_mm.max(LEAST_MM),
        tilt.per_x,
        tilt.per_y
    )
}

fn object(found: &Alignment, is_written: bool) -> serde_json::Value {
    let Alignment { frame, placement, surface_mm, tilt_mm, touch_sigma_mm, presses, .. } = found;
    json!({
        "presses": presses, "is_written": is_written,
        "origin_mm": { "x": frame.origin.x_mm, "y": frame.origin.y_mm }, "u_origin_mm": placement.origin_sigma_mm,
        "rotation_deg": frame.rotation_deg, "u_rotation_deg": placement.rotation_sigma_deg,
        "surface_mm": { "z": frame.surface_z_mm, "uncertainty": frame.uncertainty_mm },
        "tilt_mm_per_mm": { "x": frame.tilt.per_x, "y": frame.tilt.per_y }, "u_tilt_mm_per_mm": found.tilt_sigma,
        "moved": {
            "x_mm": placement.origin.x_mm, "y_mm": placement.origin.y_mm,
            "rotation_deg": placement.rotation_deg, "surface_mm": surface_mm,
        },
        "misfit_mm": placement.misfit_mm, "rise_mm": tilt_mm, "u_touch_mm": touch_sigma_mm,
    })
}

/// Returns the rig's text with the frame that was found. Everything else, including comments, is unchanged.
fn with_frame(text: &str, found: &Alignment) -> Result<String, toml_edit::TomlError> {
    let mut document: DocumentMut = text.parse()?;
    let Alignment { frame, placement, .. } = found;
    let table = |entries: [(&str, f64); 2], digits| {
        let mut table = InlineTable::new();
        table.extend(entries.map(|(key, mm)| (key, Value::from(round(mm, digits)))));
        table.fmt();
        value(table)
    };
    let surface = table([("z", frame.surface_z_mm), ("uncertainty", frame.uncertainty_mm)], 3);
    let origin = table([("x", frame.origin.x_mm), ("y", frame.origin.y_mm)], 3);
    let tilt = table([("x", frame.tilt.per_x), ("y", frame.tilt.per_y)], 5);
    let turned = value(round(frame.rotation_deg, 2));
    document["frame"]["u_origin_mm"] = value(round(placement.origin_sigma_mm, 4).max(LEAST_MM));
    let known = |sigma: f64, unit: &str| format!("  # aligned, +-{sigma:.3} {unit} (1 sd)");
    let of_tilt = format!("  # aligned, +-{:.5} (1 sd)", found.tilt_sigma);
    for (key, mut new, comment) in [
        ("surface_mm", surface, None),
        ("origin_mm", origin, None),
        ("rotation_deg", turned, Some(known(placement.rotation_sigma_deg, "degrees"))),
        ("tilt_mm_per_mm", tilt, Some(of_tilt)),
    ] {
        if let (Some(comment), Item::Value(new)) = (comment, &mut new) {
            new.decor_mut().set_suffix(comment);
        }
        document["frame"][key] = new;
    }
    Ok(document.to_string())
}
