//! A run of few presses, understood with the prior of its design, as the batch understood it.

use super::folder::{BatchError, RUNS, read_events};
use super::{BatchEvent, Ended};
use palpate_data::acceptance::{AcceptanceRule, Judgement, SensorVerdict};
use palpate_data::dataset::evaluate::{EvaluateError, Trial};
use palpate_data::dataset::sensor_file::{SensorFileError, read_sensor_file};
use palpate_data::dataset::{Evidence, JOURNAL};
use palpate_solver::{Evaluation, Fitted, Model, Solver as _};
use std::fs;
use std::path::{Path, PathBuf};

/// What a batch concluded about a sensor by the prior of its design.
pub struct ByDesign {
    /// The calibrated sensor; `None` for a sensor that is refused, or calibrated without the prior.
    pub model: Option<Model>,
    /// Sensor file, beginning with the name of the batch folder; without a sensor file, this name.
    pub source: PathBuf,
    /// Reasons for which the sensor was refused.
    refused: Option<Vec<String>>,
}

impl ByDesign {
    /// Returns the conclusion about the sensor of some runs. `None` if they aren't in a batch folder, if the batch has no prior, or
    /// if the last conclusion is about other runs.
    ///
    /// # Errors
    /// The sensor file can't be read.
    pub fn of_runs(runs: &[&Path]) -> Result<Option<Self>, SensorFileError> {
        let Some((batch, ended)) = ended(runs) else { return Ok(None) };
        if ended.change.is_empty() {
            return Ok(None);
        }
        let refused = ended.refused.then_some(ended.reasons);
        let file = ended.model.map(|file| batch.join(file));
        // its half-widths come from the test presses that are evaluated
        let model = file.as_deref().map(read_sensor_file).transpose()?.map(|(_, model)| model.without_half_widths());
        let is_known = model.is_some() || refused.is_some();
        let source = file.as_ref().unwrap_or(&batch);
        let source = batch.parent().and_then(|above| source.strip_prefix(above).ok()).unwrap_or(source).to_owned();
        Ok(is_known.then_some(ByDesign { model, source, refused }))
    }

    /// Returns the verdict by a rule. `known` are the existing evaluations, that of the model among them.
    pub fn judge(
        &self,
        rule: &AcceptanceRule,
        evidence: &Evidence<'_>,
        trial: &Result<Trial<'_>, EvaluateError>,
        known: &[Evaluation],
    ) -> Judgement {
        let mut judgement = match &self.model {
            Some(model) => judge_by(rule, evidence, trial, model.fitted(), known),
            None => evidence.judge(rule, trial, known),
        };
        if let Some(refused) = &self.refused {
            judgement = Judgement { verdict: SensorVerdict::NotAccepted, reasons: refused.clone(), ..judgement };
        }
        judgement.notes.push(self.note());
        judgement
    }

    /// Describes where the conclusion comes from.
    pub fn note(&self) -> String {
        let does = if self.model.is_some() { "calibrated with" } else { "compared with" };
        format!("{does} the prior of its design: {}", self.source.display())
    }
}

/// Returns the verdict of a sensor that a method solves which was fitted to more than its own presses.
pub(super) fn judge_by(
    rule: &AcceptanceRule,
    evidence: &Evidence<'_>,
    trial: &Result<Trial<'_>, EvaluateError>,
    fitted: &Fitted,
    known: &[Evaluation],
) -> Judgement {
    let rule = AcceptanceRule { method: fitted.name().to_owned(), ..rule.clone() };
    evidence.judge(&rule, trial, known)
}

/// Returns the folder of the batch that some runs belong to, and the last event about exactly these runs.
fn ended(runs: &[&Path]) -> Option<(PathBuf, Ended)> {
    let paths: Vec<PathBuf> = runs.iter().map(fs::canonicalize).collect::<Result<_, _>>().ok()?;
    let folder = paths.first()?.parent().filter(|folder| folder.file_name().is_some_and(|name| name == RUNS))?;
    let batch = folder.parent().filter(|batch| batch.join(JOURNAL).is_file())?;
    let mut last = None;
    let read: Result<(), BatchError> = read_events(batch, |event| {
        if let BatchEvent::Ended(ended) = event
            && !ended.reference
            && ended.runs.iter().map(|run| batch.join(run)).eq(paths.iter().cloned())
        {
            last = Some(ended.clone());
        }
        Ok(())
    });
    // the folder above may be something else
    read.ok()?;
    Some((batch.to_owned(), last?))
}
