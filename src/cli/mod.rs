//! The command line, one file a subcommand; the only room that prints.
//!
//! Results go to standard output, progress and errors to standard error. Exit codes: 0 done (and, where a rule was given, accepted),
//! 1 not accepted by the rule or not decided, 2 bad recipe, rig or usage (nothing moved), 3 a device, 4 a safety trip, 5 could not record,
//! 130 cancelled (and parked).

mod adapt;
mod align;
mod batch;
mod brief;
mod certificate;
mod check;
mod check_weight;
mod commands_page;
mod demo;
mod design;
mod docs;
mod doctor;
mod drivers;
mod emulate;
mod evaluate;
mod exit;
mod export;
mod fit;
mod help;
mod import;
mod init;
mod list;
mod method;
mod notify;
mod one_rig;
mod output;
mod ports;
mod progress;
mod rebuild;
mod rehearsed;
mod report;
mod resume;
mod retract;
mod rig_file;
mod run;
mod serve;
mod session;
mod shell;
mod signals;
mod solve;
mod study;
mod summary;
mod tables;
mod text_table;
mod texts;
mod verdict;
mod verify;
mod which_way;

use crate::api::shipped::RECIPES;
use crate::api::stdin::DASH;
use crate::api::{Failure, built_from, provenance};
use clap::error::ErrorKind;
use clap::{FromArgMatches as _, Parser, Subcommand};
use std::io::{self, Write};
use std::path::Path;
use std::process::{ExitCode, exit};

const EXAMPLES: &str = "\
Examples:
  palpate demo
  palpate check recipes/paper.toml
  palpate run recipes/paper.toml
  palpate doctor rigs/esp301.toml
  palpate run recipes/calibrate.toml --rig rigs/esp301.toml --sensor A-017
  palpate evaluate runs/paper --solver all
  palpate report runs/paper
  palpate solve --calibration runs/paper < readings.csv";

/// Calibrates tactile sensors: presses a sensor at the places and forces of a recipe, records every press, and solves
/// location and force of unknown contacts.
#[derive(Debug, Parser)]
#[command(name = "palpate", version, after_help = EXAMPLES, max_term_width = 100)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::DemoArgs),
    Check(check::CheckArgs),
    Run(run::RunArgs),
    Resume(resume::ResumeArgs),
    Verify(verify::VerifyArgs),
    Rebuild(rebuild::RebuildArgs),
    Import(import::ImportArgs),
    Export(export::ExportArgs),
    Evaluate(evaluate::EvaluateArgs),
    Fit(fit::FitArgs),
    Adapt(adapt::AdaptArgs),
    Solve(solve::SolveArgs),
    Serve(serve::ServeArgs),
    Report(report::ReportArgs),
    Certificate(certificate::CertificateArgs),
    Batch(batch::BatchArgs),
    Study(study::StudyArgs),
    Doctor(doctor::DoctorArgs),
    Align(align::AlignArgs),
    #[command(alias = "withdraw")]
    Retract(retract::RetractArgs),
    Emulate(emulate::EmulateArgs),
    Ports(ports::PortsArgs),
    Drivers(drivers::DriversArgs),
    Docs(docs::DocsArgs),
    List(list::ListArgs),
    Init(init::InitArgs),
    Schema(texts::SchemaArgs),
    Reference(texts::ReferenceArgs),
    Completions(shell::CompletionsArgs),
    Man(shell::ManArgs),
}

/// Parses the command line, runs the command, and turns the outcome into an exit code. `commit` is the one that the program is
/// built from.
pub fn main(commit: Option<&'static str>) -> ExitCode {
    built_from(commit);
    let matches = help::command().version(&*provenance::version().leak()).try_get_matches();
    let matches = matches.unwrap_or_else(|error| refuse(&error));
    note_former_name(matches.subcommand_name());
    let command = CommandLine::from_arg_matches(&matches).unwrap_or_else(|error| refuse(&error)).command;
    // fails only if one is set already, which has the same effect
    let _ = miette::set_hook(Box::new(|_| Box::new(exit::handler())));
    let outcome = check_stdin(&command).and_then(|()| match &command {
        Command::Demo(args) => demo::demo(args),
        Command::Check(args) => check::check(args),
        Command::Run(args) => run::run(args),
        Command::Resume(args) => resume::resume(args),
        Command::Verify(args) => verify::verify_run(args),
        Command::Rebuild(args) => rebuild::rebuild(args),
        Command::Import(args) => import::import(args),
        Command::Export(args) => export::export(args),
        Command::Evaluate(args) => evaluate::evaluate(args),
        Command::Fit(args) => fit::fit(args),
        Command::Adapt(args) => adapt::adapt(args),
        Command::Solve(args) => solve::solve(args),
        Command::Serve(args) => serve::serve(args),
        Command::Report(args) => report::report(args),
        Command::Certificate(args) => certificate::certificate(args),
        Command::Batch(args) => batch::batch(args),
        Command::Study(args) => study::study(args),
        Command::Doctor(args) => doctor::doctor(args),
        Command::Align(args) => align::align_rig(args),
        Command::Retract(args) => retract::retract_rig(args),
        Command::Emulate(args) => emulate::emulate(args),
        Command::Ports(args) => ports::ports(args),
        Command::Drivers(args) => drivers::drivers(args),
        Command::Docs(args) => docs::docs(args),
        Command::List(args) => list::list(args),
        Command::Init(args) => init::init(args),
        Command::Schema(args) => texts::print_schema(args),
        Command::Reference(args) => texts::print_reference(args),
        Command::Completions(args) => shell::completions(args),
        Command::Man(args) => shell::man(args),
    });
    outcome.unwrap_or_else(exit::report)
}

/// Reports the present name of a command that was called by its former one, which is a hidden alias.
fn note_former_name(name: Option<&str>) {
    let given = std::env::args().nth(1);
    if let (Some(given), Some(name)) = (given, name)
        && given != name
    {
        summary::note(&format!("note: `palpate {given}` is now `palpate {name}`"));
    }
}

/// Checks that standard input is named once, and only by a command that doesn't read readings or serial numbers from it.
fn check_stdin(command: &Command) -> Result<(), Failure> {
    let names = std::env::args_os().skip(1).filter(|word| word == DASH).count();
    let help = "save it as a file, and name that";
    let refused = match command {
        _ if names == 0 => return Ok(()),
        Command::Solve(_) | Command::Serve(_) => "standard input has the readings: `-` can't be another file",
        Command::Batch(_) => "standard input has the serial numbers: `-` can't be another file",
        _ if names > 1 => "`-` is standard input, and is named twice",
        _ => return Ok(()),
    };
    Err(Failure::usage(miette::miette!(help = help, "{refused}")))
}

/// Prints a usage error, or the requested help, and exits. For an unknown command it lists the known ones.
fn refuse(error: &clap::Error) -> ! {
    if error.kind() == ErrorKind::InvalidSubcommand {
        let root = help::command();
        let first = std::env::args().nth(1).unwrap_or_default();
        if Path::new(&first).exists() {
            let _ = writeln!(io::stderr(), "error: {first} is a file. Write the command first: palpate run {first}\n");
        }
        if RECIPES.iter().any(|recipe| recipe.name == first) {
            let _ = writeln!(io::stderr(), "error: {first} is a recipe: palpate run {first}");
            exit(error.exit_code());
        }
        let within = root.find_subcommand(first).unwrap_or(&root);
        let names: Vec<&str> = within.get_subcommands().map(clap::Command::get_name).collect();
        let known = textwrap::fill(&format!("commands: {}", names.join(", ")), 80);
        // if nobody reads it, the exit code remains
        let _ = writeln!(io::stderr(), "{}\n{known}", error.render().to_string().trim_end());
        exit(error.exit_code());
    }
    error.exit()
}
