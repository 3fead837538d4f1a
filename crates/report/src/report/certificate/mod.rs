//! A calibration certificate: results of one sensor's runs with all required content. It is written as HTML that prints on A4,
//! and as the PTB's Digital Calibration Certificate.
//!
//! Data that a run doesn't contain is in `certificate.toml` ([`CertificateData`]). The program doesn't sign. The document is based on the
//! journals whose SHA-256 it states.

mod given;
mod html;
mod results;
mod xml;

pub use given::{CERTIFICATE_KEYS, CertificateData, NamedAddress, parse};

use super::frame::capital;
use super::{SensorResults, Subject};
use miette::Diagnostic;
use palpate_data::acceptance::{Decision, Judgement, LimitCheck};
use palpate_data::dataset::{DatasetError, Imported, Status, journal_sha256};
use palpate_data::recipe::Phase;
use palpate_run::rig::RigSpec;
use palpate_solver::Evaluation;
use results::{ResultTable, results};
use thiserror::Error;

/// Statement about signatures in every certificate.
pub(crate) const NOT_SIGNED: &str = "This document is not signed by the program that wrote it. It is based on the journals whose SHA-256 \
                              it states; `palpate verify RUN --certificate FILE` compares them.";

/// A certificate, ready for writing.
pub struct Certificate<'a> {
    given: &'a CertificateData,
    /// ID of the sensor.
    sensor: String,
    /// Other labels of the runs, each once.
    labels: Vec<(&'static str, String)>,
    /// First and last date of the runs, as year-month-day.
    began: String,
    ended: String,
    /// Version of the program that wrote the certificate.
    release: &'static str,
    /// Executed recipes and imports.
    runs: Vec<String>,
    imported: Vec<Imported>,
    instruments: Vec<UsedInstrument>,
    results: Vec<ResultTable>,
    judgement: Option<&'a Judgement>,
    journals: Vec<JournalHash>,
    not_measured: Vec<String>,
    /// Whether any run was made on a simulated rig.
    simulated: bool,
}

/// Instrument that was used for the measurement.
struct UsedInstrument {
    role: &'static str,
    /// Identity reported by the instrument.
    identity: String,
    /// Certificate of the instrument, or a statement that none is known.
    certificate: String,
}

/// Journal of a run.
struct JournalHash {
    run: String,
    sha256: String,
}

/// Reason why there is no certificate.
#[derive(Debug, Error, Diagnostic)]
pub enum CertificateError {
    /// The run has no sensor ID.
    #[error("{run} has no sensor ID: a certificate needs the sensor's serial number")]
    #[diagnostic(help(
        "the ID is given when a run is made: palpate run RECIPE --sensor ID, or palpate import TABLE --sensor ID"
    ))]
    NoSensor {
        /// Name of the run.
        run: String,
    },
    /// The run isn't complete, so it may still change.
    #[error("{run} is {status}: a certificate needs complete runs")]
    #[diagnostic(help("`palpate resume` continues it"))]
    Incomplete {
        /// Name of the run.
        run: String,
        /// Ending of the run, or that it is in progress.
        status: &'static str,
    },
    /// The rig has no load cell, so no force is known.
    #[error("{run} was made without a load cell: no force is known, so there is nothing to certify")]
    #[diagnostic(help("`palpate report` shows the run; for a certificate, press with a load cell"))]
    NoLoadCell {
        /// Name of the run.
        run: String,
    },
    /// The presses are known by depth, without forces.
    #[error("{run} has depths and no forces: a certificate states errors of forces")]
    #[diagnostic(help("`palpate report` shows the errors of the depths"))]
    ByDepth {
        /// Name of the run.
        run: String,
    },
    /// The date of an imported measurement is unknown.
    #[error("{run} was imported, and its columns file doesn't state the day of the measurement")]
    #[diagnostic(help("add `measured = \"2026-05-04\"` to the columns file, and import the tables again"))]
    NoDay {
        /// Name of the run.
        run: String,
    },
    /// There is nothing to certify.
    #[error("{run}: a certificate requires an evaluated test or a characterisation{}", why.as_deref().map(|why| format!(" ({why})")).unwrap_or_default())]
    Nothing {
        /// Name of the first run.
        run: String,
        /// Reason why there is no evaluation.
        why: Option<String>,
    },
    /// A journal can't be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Dataset(#[from] DatasetError),
}

impl<'a> Certificate<'a> {
    /// Creates the certificate of a sensor.
    ///
    /// # Errors
    /// There is no sensor ID or no measurement, or a journal can't be read.
    pub fn of(
        subject: &Subject,
        judged: &'a SensorResults,
        given: &'a CertificateData,
    ) -> Result<Certificate<'a>, CertificateError> {
        let first = || subject.runs[0].name();
        let sensor = subject.runs.iter().find_map(|run| run.manifest.facts.labels.sensor.clone());
        let sensor = sensor.ok_or_else(|| CertificateError::NoSensor { run: first() })?;
        if let Some(run) = subject.runs.iter().find(|run| run.manifest.status != Status::Complete) {
            let (run, status) = (run.name(), run.manifest.status.name());
            return Err(CertificateError::Incomplete { run, status });
        }
        if let Some(run) = subject.runs.iter().find(|run| run.manifest.facts.without_load_cell) {
            return Err(CertificateError::NoLoadCell { run: run.name() });
        }
        let by_depth = |evaluation: &Evaluation| evaluation.depth_error_mm.is_some();
        if judged.evaluations.iter().any(by_depth) {
            return Err(CertificateError::ByDepth { run: first() });
        }
        let results = results(subject, judged);
        if results.iter().all(|results| results.rows.is_empty()) {
            return Err(CertificateError::Nothing { run: first(), why: judged.why_not.clone() });
        }
        let mut labels: Vec<(&'static str, String)> = Vec::new();
        for (name, label) in subject.runs.iter().flat_map(|run| run.manifest.facts.labels.given()) {
            let label = (name, label.to_owned());
            if name != "sensor" && !labels.contains(&label) {
                labels.push(label);
            }
        }
        let journals =
            subject.runs.iter().map(|run| Ok(JournalHash { run: run.name(), sha256: journal_sha256(&run.path)? }));
        let journals = journals.collect::<Result<Vec<JournalHash>, DatasetError>>()?;
        let day = |time: &str| time.chars().take("2026-01-01".len()).collect::<String>();
        let mut days: Vec<String> = Vec::new();
        for run in &subject.runs {
            match &run.manifest.facts.imported {
                Some(imported) => {
                    let no_day = || CertificateError::NoDay { run: run.name() };
                    days.push(imported.measured.clone().ok_or_else(no_day)?);
                }
                None => {
                    let started = run.manifest.sessions.iter().map(|session| session.started.as_str());
                    days.extend(started.chain(run.manifest.ended.as_deref()).map(day));
                }
            }
        }
        days.sort();
        let (began, ended) = (days.first().cloned().unwrap_or_default(), days.last().cloned().unwrap_or_default());
        Ok(Certificate {
            given,
            sensor,
            labels,
            began,
            ended,
            release: env!("CARGO_PKG_VERSION"),
            runs: subject.runs.iter().map(|run| run.manifest.facts.text()).collect(),
            imported: subject.runs.iter().filter_map(|run| run.manifest.facts.imported.clone()).collect(),
            instruments: instruments(subject),
            judgement: judged.judgement.as_ref(),
            not_measured: not_measured(subject, judged, given),
            results,
            journals,
            simulated: subject.runs.iter().any(|run| run.manifest.facts.simulated),
        })
    }

    /// Returns the result in one line.
    pub fn text(&self) -> String {
        let verdict = self.judgement.map_or("no statement of conformity", |judgement| judgement.verdict.text());
        let rows: usize = self.results.iter().map(|results| results.rows.len()).sum();
        let simulated = if self.simulated { "; simulated: it certifies no sensor" } else { "" };
        format!("certificate {} of sensor {}: {verdict}, {rows} results{simulated}", self.given.identifier, self.sensor)
    }

    /// Returns the certificate as a page that prints on A4.
    pub fn html(&self) -> String {
        html::document(self)
    }

    /// Returns the certificate as a Digital Calibration Certificate, schema 3.2.0.
    pub fn xml(&self) -> String {
        xml::document(self)
    }

    /// Returns a description of the procedure in one sentence.
    fn procedure(&self) -> String {
        let simulated = if self.simulated { " on a simulated rig: it certifies no sensor" } else { "" };
        let imported = self.imported.iter().flat_map(Imported::files);
        let files: String = imported.map(|file| format!("; {} has SHA-256 {}", file.name, file.sha256)).collect();
        let notes: String =
            self.imported.iter().flat_map(|imported| &imported.notes).map(|note| format!("; {note}")).collect();
        let imported = match files.is_empty() {
            true => String::new(),
            false => format!(". The presses were imported from tables of another program{files}{notes}"),
        };
        format!("{}, {}{simulated}{imported}", self.given.procedure, self.runs.join(", "))
    }

    /// Returns the decision rule and its result.
    fn conformity(&self) -> String {
        let Some(judgement) = self.judgement else {
            return "No acceptance rule was given: no statement of conformity.".to_owned();
        };
        let rule = if judgement.rule == Decision::Guarded.word() {
            "Guarded acceptance (ILAC-G8): the one-sided 95 % bound of each figure is within its limit; about 5 % of sensors at a \
             limit are falsely accepted at most"
        } else {
            "Simple acceptance (ILAC-G8): each figure is within its limit; about half of the sensors at a limit are accepted"
        };
        let reasons: Vec<String> = judgement.all_reasons().collect();
        let why = if reasons.is_empty() { String::new() } else { format!(": {}", reasons.join("; ")) };
        let limits: Vec<String> = judgement.checks.iter().map(limit).collect();
        let notes: String = judgement.notes.iter().map(|note| format!(" {}.", capital(note))).collect();
        let afterwards = judgement.judged_afterwards_by.as_ref();
        let afterwards = afterwards.map(|file| format!(", judged afterwards by {file}")).unwrap_or_default();
        let (method, verdict) = (&judgement.method, judgement.verdict.text());
        format!("{rule}. Method {method}{afterwards}. Limits: {}.{notes} Result: {verdict}{why}.", limits.join("; "))
    }
}

/// Returns a limit together with the measured value.
fn limit(check: &LimitCheck) -> String {
    let bound = check.bound.map(|bound| format!(", bound {}", check.shown(Some(bound)))).unwrap_or_default();
    let (name, found) = (check.kind.full_name(check.reach), check.shown(check.value));
    let limit = check.shown(Some(check.limit));
    format!("{name} {found}{bound}, limit {limit} {}", check.kind.unit()).trim_end().to_owned()
}

/// Returns stage and load cell with their own certificates, each once.
fn instruments(subject: &Subject) -> Vec<UsedInstrument> {
    let mut all: Vec<UsedInstrument> = Vec::new();
    for (run, bench) in subject.runs.iter().zip(&subject.benches) {
        for (role, name) in
            [("stage", "stage"), ("load_cell", "load cell"), ("array", "converter of the sensor's outputs")]
        {
            let device = run.manifest.devices.iter().find(|device| device.role == role);
            let identity = device.map_or_else(|| "not identified".to_owned(), |device| device.identity.clone());
            let certificate = certificate_of(role, bench.rig.as_ref());
            if !all
                .iter()
                .any(|known| known.role == name && known.identity == identity && known.certificate == certificate)
            {
                all.push(UsedInstrument { role: name, identity, certificate });
            }
        }
    }
    all
}

fn certificate_of(role: &str, rig: Option<&RigSpec>) -> String {
    let known = match (role, rig) {
        ("stage", Some(rig)) => {
            rig.stage.certificate.as_ref().map(|own| format!("certificate {} of {}", own.number, own.date))
        }
        ("load_cell", Some(rig)) => {
            let cell = &rig.load_cell;
            let own = cell.certificate.as_ref().map(|own| format!("certificate {} of {}", own.number, own.date));
            let check = cell.check.as_ref().map(|check| {
                let adjusted = if check.adjusted { ", adjusted by it" } else { "" };
                format!("checked with a weight of {} N on {}{adjusted}", check.weight_n, check.date)
            });
            let all: Vec<String> = own.into_iter().chain(check).collect();
            (!all.is_empty()).then(|| all.join("; "))
        }
        ("array", _) => return "part of the sensor's readings".to_owned(),
        _ => None,
    };
    known.unwrap_or_else(|| "no known certificate: not traceable".to_owned())
}

/// Returns quantities that a reader may expect on a certificate, but that weren't measured.
fn not_measured(subject: &Subject, judged: &SensorResults, given: &CertificateData) -> Vec<String> {
    let has = |phase| subject.presses.sound(phase).next().is_some();
    let missing = [
        (judged.evaluations.is_empty(), "Errors of location and force: no test was evaluated."),
        (!has(Phase::Characterisation), "Repeatability, hysteresis, linearity and zero return of the units."),
        (subject.u_place_mm().is_none(), "The uncertainty of the pressed positions: the stage has no certificate."),
        (judged.u_force_n.is_none(), "The uncertainty of the forces: the load cell has neither certificate nor check."),
        (given.temperature_c.is_none(), "The air temperature."),
        (given.humidity_percent.is_none(), "The relative humidity."),
        (true, "Drift over time, dependence on temperature, reproducibility from mounting to mounting."),
    ];
    missing.into_iter().filter(|(is_missing, _)| *is_missing).map(|(_, text)| text.to_owned()).collect()
}
