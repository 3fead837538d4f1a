//! `palpate study few`: few presses of new sensors with the prior of their design.

use super::begun::{Begun, Common, ended, number};
use crate::api::Failure;
use palpate_study::few::{FewRow, FewSize, StrangerRow, VerdictRow, few_figures, presses, strangers, verdicts};
use palpate_study::ndjson;
use std::fmt::Write as _;
use std::process::ExitCode;

/// Carries the study out, writes its figures and prints its tables.
pub(super) fn study(args: &Common) -> Result<ExitCode, Failure> {
    let begun = Begun::new(&args.output, "few")?;
    let size = if args.quick { FewSize::QUICK } else { FewSize::WHOLE };
    let few = begun.carried(presses(size, &begun.told()))?;
    let strange = begun.carried(strangers(size, &begun.told()))?;
    let judged = begun.carried(verdicts(size, &begun.told()))?;
    let rows = ndjson(&few) + &ndjson(&strange) + &ndjson(&judged);
    begun.end(few_figures(&few), rows, |out| errors(&few) + &found(&strange) + &decided(&judged) + &ended(out))
}

fn errors(few: &[FewRow]) -> String {
    let mut text = format!(
        "{:<7}{:<14}{:>8}{:>9}{:>9}{:>8}{:>9}{:>10}\n",
        "noise", "way", "presses", "minutes", "mean mm", "+-", "force N", "typical %"
    );
    for row in few {
        let way =
            serde_json::to_value(row.way).ok().and_then(|way| way.as_str().map(str::to_owned)).unwrap_or_default();
        let _ = writeln!(
            text,
            "{:<7}{way:<14}{:>8}{:>9}{:>9.3}{:>8.3}{:>9.4}{:>10}",
            row.scene,
            row.presses,
            number(row.minutes, 1),
            row.location_error_mm,
            row.within_mm,
            row.force_error_n,
            number(row.typical.map(|typical| 100.0 * typical), 0),
        );
    }
    text + "\n"
}

fn found(strange: &[StrangerRow]) -> String {
    let mut text = format!(
        "{:<7}{:<24}{:>9}{:>9}{:>12}{:>9}\n",
        "noise", "9 presses of", "sensors", "refused", "full grid", "typical"
    );
    for row in strange {
        let StrangerRow { scene, sensors, refused, beyond, typical, .. } = row;
        let _ = writeln!(text, "{scene:<7}{:<24}{sensors:>9}{refused:>9}{beyond:>12}{typical:>9}", row.kind.told());
    }
    text + "\n"
}

fn decided(judged: &[VerdictRow]) -> String {
    let mut text = format!(
        "{:<7}{:<9}{:>8}{:>9}{:>6}{:>10}{:>12}{:>9}{:>10}\n",
        "noise", "rule", "presses", "sensors", "bad", "accepted", "rejected", "refused", "undecided"
    );
    for row in judged {
        let VerdictRow { scene, rule, presses, sensors, bad, .. } = row;
        let _ = writeln!(
            text,
            "{scene:<7}{rule:<9}{presses:>8}{sensors:>9}{bad:>6}{:>10}{:>12}{:>9}{:>10}",
            row.accepted_wrongly, row.rejected_wrongly, row.refused_wrongly, row.not_decided
        );
    }
    text + "accepted: though bad; rejected, refused: though good\n\n"
}
