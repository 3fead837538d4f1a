//! `palpate verify`.

use super::output::OutputArgs;
use crate::api::Failure;
use crate::api::recorded::bench_of;
use crate::api::sources::read;
use palpate_data::dataset::{DatasetError, JournalError, Loss, Texts, Verified, journal_sha256, verify};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate verify runs/paper
  palpate verify runs/calibrate --certificate A-017.xml";

/// Compare a run's files with its journal and their SHA-256
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct VerifyArgs {
    /// The run folder
    run: PathBuf,
    /// Also compare the journal with the SHA-256 on this certificate
    #[arg(long, value_name = "FILE")]
    certificate: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
}

/// Reports each file that has changed since it was written.
pub(super) fn verify_run(args: &VerifyArgs) -> Result<ExitCode, Failure> {
    let layout = match Texts::read_accepting(&args.run, true) {
        Ok((manifest, texts)) if texts.rig().is_empty() && manifest.facts.imported.is_none() => None,
        Ok((manifest, texts)) => Some(bench_of(&args.run, &manifest.facts, &texts)?.layout),
        Err(DatasetError::Journal(JournalError::Damaged { .. })) => None,
        Err(error) => return Err(Failure::dataset(error)),
    };
    let verified = verify(&args.run, layout.as_ref()).map_err(Failure::dataset)?;
    let whole = format!("{} records in the journal, {} files unchanged", verified.records, verified.sound);
    if verified.problems.is_empty() {
        let state = match (verified.is_under_way, verified.has_ended) {
            (true, _) => "; the run is in progress: its tables weren't compared",
            (false, false) => "; the run isn't complete: `palpate resume` continues it",
            (false, true) => "",
        };
        let what = |loss: &Loss| if loss.lost.is_empty() { "its journal was exchanged" } else { "presses were lost" };
        let losses = |loss: &Loss| format!("{}: {}, accepted {}\n", args.run.display(), what(loss), loss.accepted);
        let losses: String = verified.losses.iter().map(losses).collect();
        let mut text = format!("{}: {whole}{state}\n{losses}", args.run.display());
        let checked = args.certificate.as_ref().map(|certificate| check_certificate(&args.run, certificate));
        if let Some(Ok(line)) = &checked {
            text += line;
        }
        let content = object(&args.run, &verified, checked.as_ref().map(Result::is_ok));
        args.output.print(&text, &content)?;
        return checked.map_or(Ok(ExitCode::SUCCESS), |checked| checked.map(|_| ExitCode::SUCCESS));
    }
    args.output.object(&object(&args.run, &verified, None))?;
    let help = match verified.damaged_at {
        Some(offset) => format!(
            "restore the journal from a copy. Without a copy, the records before byte {offset} can be kept: copy the run folder, cut \
             its journal there (`truncate --size {offset} journal.log`), and use `palpate rebuild --accept-loss`"
        ),
        None => "`palpate rebuild` regenerates tables and manifest. The journal has the original of a changed recipe or rig: move the \
                 changed file away, and `palpate rebuild` writes it again"
            .to_owned(),
    };
    let problems = verified.problems.join("\n");
    Err(Failure::not_accepted(miette::miette!(help = help, "{}: {whole}, but\n{problems}", args.run.display())))
}

fn object(run: &Path, verified: &Verified, certificate_matches: Option<bool>) -> Value {
    let Verified { records, sound, has_ended, is_under_way, losses, problems, damaged_at } = verified;
    json!({
        "run": run, "records": records, "files_unchanged": sound, "has_ended": has_ended, "is_in_progress": is_under_way,
        "losses": losses, "problems": problems, "damaged_at": damaged_at, "certificate_matches": certificate_matches,
    })
}

/// Checks that a certificate is based on the present journal of this run, and returns a line that states it.
fn check_certificate(run: &Path, certificate: &Path) -> Result<String, Failure> {
    let sha256 = journal_sha256(run).map_err(Failure::dataset)?;
    let text = read(certificate)?;
    let stated = [("SHA-256 ", "</dcc:content>"), ("<code>", "</code>")].map(|(before, after)| {
        let is_hash = |word: &&str| word.len() == sha256.len() && word.chars().all(|c| c.is_ascii_hexdigit());
        text.split(before).skip(1).filter_map(|rest| rest.split(after).next()).filter(is_hash).collect::<Vec<&str>>()
    });
    let stated = stated.concat();
    let file = certificate.display();
    if stated.is_empty() {
        return Err(Failure::usage(miette::miette!(
            "{file} states no SHA-256 of a journal: check that it is a certificate"
        )));
    }
    if !stated.contains(&sha256.as_str()) {
        let help =
            "the run was continued or changed after the certificate was written, or the certificate is of another run";
        let words = format!("{file} doesn't match the journal of {}", run.display());
        return Err(Failure::not_accepted(miette::miette!(help = help, "{words}: its SHA-256 is {sha256}")));
    }
    let others = match stated.len() - 1 {
        0 => String::new(),
        others => format!(", and of {others} others"),
    };
    Ok(format!("{file} states the SHA-256 of this journal{others}\n  {sha256}; nothing else on it was checked\n"))
}
