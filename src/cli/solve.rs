//! `palpate solve`: reads readings of the array and prints contacts, one line for each line.

use super::method::tell_sensor;
use super::summary::{note, tell};
use crate::api::{self, Failure, SolveOptions};
use std::fs::File;
use std::io::{self, IsTerminal as _};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate solve --calibration runs/paper < readings.csv > contacts.csv
  palpate solve --calibration grid.csv --json < readings.ndjson
  palpate solve --model sensor.palpate < readings.csv

Each line is a reading: CSV with a header that has out_1..out_n, or numbers
only; or NDJSON {\"outputs\": [0.1, 0.2, ...]}, or only the array. The columns id
and t_s, if present, are copied to the answer.

An answer has x_mm, y_mm, force_n, their standard deviations sd_..., the
half-widths half68_... and half95_... that contain 68 and 95 % of the errors,
other_x_mm and other_y_mm if another place fits nearly as well, misfit
(above 1: not a single contact) and verdict: ok, weak-signal,
outside-area, not-one-contact, channel-fault (unit: which output), or unsolved
if the reading has no answer. With a table without force_n, force_n is blank, and
relative_force is relative to the typical press of the table. With a calibration
by depth, depth_mm to half95_depth_mm replace those of the force. If a second method is fitted, load shows
which one answered: calibrated (it assumes the load of the calibration), or any.

Force vectors (--vector, or a sensor file of them) add force_x_n, force_y_n.
Where the outputs can't show them, the verdict is shear-unknown, and
shear_bound_n is their expected error. Other verdicts: two-contacts (second_...),
two-not-separable, unit-fault (unit: which taxel), or two causes.

A series (--history, or its file) needs t_s, in s, and all outputs with
each reading. The answer is force_n.

A missing channel is null or NaN, in CSV nan or an empty cell. Such a reading is
solved without that channel.

If too many contacts don't fit, standard error asks once to calibrate again. It
and left_out name outputs that break.

An invalid line ends the program. With --keep-going, its answer is unsolved, with
line and error. An invalid header still ends it.";

/// Read outputs of the array line by line and print the contact for each
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct SolveArgs {
    #[command(flatten)]
    options: SolveOptions,
}

/// Fits the method or reads it, then answers each reading when it arrives.
pub(super) fn solve(args: &SolveArgs) -> Result<ExitCode, Failure> {
    let options = &args.options;
    let sensor = options.sensor(&note)?;
    if !options.quiet {
        tell_sensor(&sensor, options.model.is_none())?;
        if io::stdin().is_terminal() {
            tell("one reading a line; Ctrl-D ends\n")?;
        }
    }
    let options = SolveOptions { is_live: !is_file(), ..options.clone() };
    api::solve(sensor.model, &options, io::stdin().lock(), io::stdout().lock(), &note)?;
    Ok(ExitCode::SUCCESS)
}

/// Whether standard input is a file, whose readings don't wait for their answers.
#[cfg(unix)]
fn is_file() -> bool {
    use std::os::fd::AsFd as _;
    let file = io::stdin().as_fd().try_clone_to_owned().map(File::from);
    file.and_then(|file| file.metadata()).is_ok_and(|metadata| metadata.is_file())
}

#[cfg(not(unix))]
fn is_file() -> bool {
    use std::os::windows::io::AsHandle as _;
    let file = io::stdin().as_handle().try_clone_to_owned().map(File::from);
    file.and_then(|file| file.metadata()).is_ok_and(|metadata| metadata.is_file())
}
