//! `palpate study`: measures the force loop, or the methods that solve, in simulation, or computes what an array can resolve, and
//! draws what was found.

mod ablation;
mod begun;
mod control;
mod curves;
mod few;
mod methods;
mod minutes;
mod validation;
mod vector;

use crate::api::Failure;
use begun::Common;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate study control
  palpate study speed-accuracy runs/paper
  palpate study budget --out budget-2 --json
  palpate study failures --quick
  palpate study curves --rig rigs/sim.toml";

/// Study force-control strategies, solving methods, or an array's design, and draw the results
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct StudyArgs {
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, clap::Subcommand)]
enum Study {
    /// Force control: every strategy under every condition; 1 to 2 minutes
    Control(Common),
    /// Accuracy of each method against its solving time, on a run or on the paper's array
    SpeedAccuracy(methods::SpeedAccuracyArgs),
    /// Accuracy of each method against the number of calibration presses, on a run or on the paper's array; a minute
    Budget(methods::BudgetArgs),
    /// Conditions where each method fails, and whether it reports that; 1 to 2 minutes
    Failures(Common),
    /// Accuracy of a calibration against the total minutes at the bench, by strategy, places and repeats; some minutes
    Minutes(Common),
    /// Accuracy of new sensors of a known design after few presses, and whether other sensors are refused; some minutes
    Few(Common),
    /// Similarity of the outputs of two contacts: the paper's claims, or an array's quality; under a second
    Curves(curves::CurvesArgs),
    /// Errors of place and force vector against noise, units and calibration places; some seconds
    Shear(Common),
    /// Two contacts at once: how often both are found, by separation, noise and taxels; half a minute
    TwoContacts(Common),
    /// Physical and measurement terms that a simulated scene needs, and the results that need them; a minute
    Ablation(Common),
    /// The paper's protocol with ten specimens, and its numerical study, as a page; half a minute
    Validation(Common),
}

/// Executes a study, writes its figures and prints the results.
pub(super) fn study(args: &StudyArgs) -> Result<ExitCode, Failure> {
    match &args.study {
        Study::Control(args) => control::study(args),
        Study::SpeedAccuracy(args) => methods::speed_accuracy(args),
        Study::Budget(args) => methods::budget(args),
        Study::Failures(args) => methods::failures(args),
        Study::Minutes(args) => minutes::study(args),
        Study::Few(args) => few::study(args),
        Study::Curves(args) => curves::study(args),
        Study::Shear(args) => vector::study_shear(args),
        Study::TwoContacts(args) => vector::study_two(args),
        Study::Ablation(args) => ablation::study(args),
        Study::Validation(args) => validation::study(args),
    }
}
