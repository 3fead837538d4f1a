//! `palpate study few`: few presses of new sensors with the prior of their design.

use super::begun::{Common, StudyOutput, ended, number};
use crate::api::Failure;
use crate::cli::text_table::{TextTable, cells};
use palpate_study::few::{
    FewRow, FewSize, ForeignSensorRow, VerdictRow, few_figures, foreign_sensors, presses, verdicts,
};
use palpate_study::ndjson;
use std::process::ExitCode;

/// Carries the study out, writes its figures and prints its tables.
pub(super) fn study(args: &Common) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.output, "few")?;
    let size = if args.quick { FewSize::QUICK } else { FewSize::WHOLE };
    let few = begun.carried(presses(size, &begun.text()))?;
    let strange = begun.carried(foreign_sensors(size, &begun.text()))?;
    let judged = begun.carried(verdicts(size, &begun.text()))?;
    let rows = ndjson(&few) + &ndjson(&strange) + &ndjson(&judged);
    begun.end(few_figures(&few), rows, |out| errors(&few) + &found(&strange) + &decided(&judged) + &ended(out))
}

fn errors(few: &[FewRow]) -> String {
    let head = ["noise", "way", "presses", "minutes", "mean mm", "+-", "force N", "typical %"];
    let mut table = TextTable::new(2, head);
    for row in few {
        let way =
            serde_json::to_value(row.way).ok().and_then(|way| way.as_str().map(str::to_owned)).unwrap_or_default();
        table.row(cells![
            row.scene,
            way,
            row.presses,
            number(row.minutes, 1),
            number(Some(row.location_error_mm), 3),
            number(Some(row.within_mm), 3),
            number(Some(row.force_error_n), 4),
            number(row.typical.map(|typical| 100.0 * typical), 0),
        ]);
    }
    format!("{table}\n")
}

fn found(strange: &[ForeignSensorRow]) -> String {
    let mut table = TextTable::new(2, ["noise", "9 presses of", "sensors", "refused", "full grid", "typical"]);
    for row in strange {
        let ForeignSensorRow { scene, sensors, refused, beyond, typical, .. } = row;
        table.row(cells![scene, row.kind.text(), sensors, refused, beyond, typical]);
    }
    format!("{table}\n")
}

fn decided(judged: &[VerdictRow]) -> String {
    let head = ["noise", "rule", "presses", "sensors", "bad", "accepted", "rejected", "refused", "undecided"];
    let mut table = TextTable::new(2, head);
    for row in judged {
        let VerdictRow { scene, rule, presses, sensors, bad, .. } = row;
        let wrong = [row.accepted_wrongly, row.rejected_wrongly, row.refused_wrongly, row.not_decided];
        let [accepted, rejected, refused, undecided] = wrong;
        table.row(cells![scene, rule, presses, sensors, bad, accepted, rejected, refused, undecided]);
    }
    format!("{table}accepted: though bad; rejected, refused: though good\n\n")
}
