//! Origin of a run and the programs that measured it, as recorded in its journal.

use super::{Fingerprint, RunColumns, SeriesMark};
use crate::recipe::Plan;
use palpate_control::{Glitches, SafetyRule, Strategy};
use palpate_core::quantity::shown;
use serde::{Deserialize, Deserializer, Serialize};

/// Format of the journals that this program writes and reads. Format 1 had no number, no texts, and rows for levels.
pub const FORMAT: u32 = 2;

/// Properties of a run that are the same in every continuation: its first record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunFacts {
    /// Format of the journal: [`FORMAT`].
    pub format: u32,
    /// Name of the recipe.
    #[serde(deserialize_with = "shown_text")]
    pub recipe: String,
    /// Labels of the pressed sensor and the operator, if a person gave them.
    #[serde(flatten)]
    pub labels: Labels,
    /// Number of entries of the plan.
    pub presses_planned: u64,
    /// Random seed for places, forces and simulated noise.
    pub seed: u64,
    /// Random seed of the simulated specimen, if it isn't that of the run: a batch presses the same specimen again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub specimen: Option<u64>,
    /// Strategy of every press, if it was given instead of the recipe's strategy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strategy: Option<Strategy>,
    /// Largest allowed number of presses of the plan, if it was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub presses_max: Option<usize>,
    /// Whether presses of the plan are by depth.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub by_depth: bool,
    /// Whether the rig has no load cell, so that no force is known.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub without_load_cell: bool,
    /// Uncertainty of the surface that a person confirmed, mm; `None` if load cell or array found it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confirmed_within_mm: Option<f64>,
    /// Whether the rig's load cell has three axes.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub three_axes: bool,
    /// Whether the presses have groups.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub grouped: bool,
    /// Whether this program's emulators were at the other ends of the links.
    pub simulated: bool,
    /// Tables from which the presses were imported; `None` for a run that this program made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imported: Option<Imported>,
}

/// Source of imported presses.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Imported {
    /// Table of the calibration presses, and table of the test presses if there was one.
    pub tables: Vec<Fingerprint>,
    /// Columns file, if one was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<Fingerprint>,
    /// Number of outputs of each press.
    pub outputs: u64,
    /// Description of what was detected and what was excluded.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Date of the measurement, as year-month-day, if a person stated it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured: Option<String>,
}

/// Labels of the pressed sensor and the operator, in a person's own words; each is optional.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Labels {
    /// ID of the sensor, such as its serial number.
    #[serde(default, deserialize_with = "shown_label", skip_serializing_if = "Option::is_none")]
    pub sensor: Option<String>,
    /// Design of the sensor.
    #[serde(default, deserialize_with = "shown_label", skip_serializing_if = "Option::is_none")]
    pub design: Option<String>,
    /// Production batch of the sensor.
    #[serde(default, deserialize_with = "shown_label", skip_serializing_if = "Option::is_none")]
    pub batch: Option<String>,
    /// Number or manner of the mounting. Runs of one mounting have the same position of the sensor on the bench.
    #[serde(default, deserialize_with = "shown_label", skip_serializing_if = "Option::is_none")]
    pub mounting: Option<String>,
    /// Person who made the run.
    #[serde(default, deserialize_with = "shown_label", skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
    /// Any other note.
    #[serde(default, deserialize_with = "shown_label", skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Reads a text of a file from elsewhere, without characters that control a terminal.
pub(super) fn shown_text<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    String::deserialize(from).map(|text| shown(&text))
}

/// Reads a label in the same way.
pub(super) fn shown_label<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    Option::<String>::deserialize(from).map(|label| label.map(|text| shown(&text)))
}

/// Largest number of characters of a label, which is shown in tables and titles.
pub const LABEL_MOST: usize = 200;

/// Whether a text can be a label: it isn't empty or too long, and can be printed anywhere.
pub fn is_label(text: &str) -> bool {
    !text.trim().is_empty() && text.chars().count() <= LABEL_MOST && !text.chars().any(char::is_control)
}

/// Ending of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Every entry of the plan is on disk.
    Complete,
    /// A person or a monitored value stopped the run, or it is still in progress.
    #[default]
    Stopped,
    /// A safety rule was broken.
    Tripped,
    /// A device failed, or recording failed.
    Failed,
}

impl Default for RunFacts {
    fn default() -> Self {
        RunFacts {
            format: FORMAT,
            recipe: String::new(),
            labels: Labels::default(),
            presses_planned: 0,
            seed: 0,
            specimen: None,
            strategy: None,
            presses_max: None,
            by_depth: false,
            without_load_cell: false,
            confirmed_within_mm: None,
            three_axes: false,
            grouped: false,
            simulated: false,
            imported: None,
        }
    }
}

impl Imported {
    /// Returns the names of the tables.
    pub fn names(&self) -> String {
        let names: Vec<&str> = self.tables.iter().map(|table| table.name.as_str()).collect();
        names.join(" and ")
    }

    /// Returns each file with its SHA-256: the tables, then the columns file.
    pub fn files(&self) -> impl Iterator<Item = &Fingerprint> {
        self.tables.iter().chain(&self.columns)
    }
}

impl Labels {
    /// Returns the labels that were given, each with its name.
    pub fn given(&self) -> impl Iterator<Item = (&'static str, &str)> {
        let Labels { sensor, design, batch, mounting, operator, note } = self;
        let all = [
            ("sensor", sensor),
            ("design", design),
            ("batch", batch),
            ("mounting", mounting),
            ("operator", operator),
            ("note", note),
        ];
        all.into_iter().filter_map(|(name, label)| Some((name, label.as_deref()?)))
    }
}

impl RunFacts {
    /// Returns the executed recipe, or an import, as words for a sentence.
    pub fn text(&self) -> String {
        match &self.imported {
            None => format!("the recipe {}", self.recipe),
            Some(imported) => format!("the import of {}", imported.names()),
        }
    }

    /// Returns which columns its table has.
    pub fn columns(&self) -> RunColumns {
        let RunFacts { by_depth, without_load_cell, three_axes, grouped, .. } = *self;
        RunColumns { by_depth, has_load_cell: !without_load_cell, three_axes, grouped }
    }

    /// Returns the facts of a plan.
    pub fn new(plan: &Plan, simulated: bool) -> RunFacts {
        RunFacts {
            recipe: plan.name.clone(),
            presses_planned: plan.entries.len() as u64,
            seed: plan.seed,
            by_depth: plan.most_mm() > 0.0,
            simulated,
            ..RunFacts::default()
        }
    }
}

/// A program that measures: its version, machine and start time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of the program.
    pub palpate: String,
    /// Commit from which the program was built, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
    /// Name of the machine.
    pub host: String,
    /// Operating system and processor type of the machine, such as `linux x86_64`.
    pub system: String,
    /// Start time, with its time zone.
    pub started: String,
    /// Events that an acknowledged press survives.
    pub durability: Durability,
    /// Texts that the program uses: recipe, rig, and the files that these name. The folder that stores them sets this field.
    #[serde(default)]
    pub texts: Vec<Fingerprint>,
    /// The keys of the rig that differ from those with which the run began.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<RigChange>,
    /// What a person called sound, after a safety rule had ended the session before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sound: Option<CalledSound>,
}

/// A press that a safety rule stopped, and that a person calls sound.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CalledSound {
    /// The rule.
    pub rule: SafetyRule,
    /// Number of the press in the plan.
    pub press: u64,
    /// Whether the rule compares no press from this one on.
    pub from_here: bool,
}

impl CalledSound {
    /// Whether a trip by a rule at a press of this or a later session is ignored.
    pub fn covers(&self, rule: SafetyRule, press: u64) -> bool {
        rule == self.rule && (self.from_here || press == self.press)
    }

    /// Returns the statement in one line.
    pub fn line(&self) -> String {
        let from_here = if self.from_here { ", and all later ones" } else { "" };
        format!("a person called press {}{from_here} sound, which {} had stopped", self.press, self.rule.name())
    }
}

/// A key of the rig that changed between two sessions.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RigChange {
    /// Key with its tables, such as `stage.link`.
    pub key: String,
    /// Value when the run began.
    pub before: String,
    /// Present value.
    pub now: String,
}

/// A text that a run uses, unchanged: its recipe, its rig, a register map.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedText {
    /// Name of its file in the run folder.
    pub name: String,
    /// The text.
    pub text: String,
}

/// A journal that a person accepted although the other files of the folder contradict it: it has lost presses, or is another one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Loss {
    /// Time of acceptance, with its time zone.
    pub accepted: String,
    /// Statements of the other files of the folder about the lost presses.
    pub lost: Vec<String>,
    /// Differences from the journal that the manifest described.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub journal: Vec<String>,
}

/// Ending of a program that could still record it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SessionEnd {
    /// Status at the end.
    pub status: Status,
    /// Time, s since the run's start.
    pub t_s: f64,
    /// Date and time, with time zone.
    pub ended: String,
    /// Duration in real time, s.
    pub wall_s: f64,
    /// Cause of failure in a failed run, or monitored value that stopped the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
    /// Whether the rig knows a weight for its load cell, and the load cell wasn't checked with it after the run.
    #[serde(default, skip_serializing_if = "is_false")]
    pub cell_unchecked: bool,
    /// Error of the load cell that a weight showed after the run, in one line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell_off: Option<String>,
    /// Readings of the load cell that were left out; absent if none were.
    #[serde(default, skip_serializing_if = "Glitches::are_none")]
    pub glitches: Glitches,
    /// File of readings at the end; `None` if none are kept. The folder sets this field.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub series: Option<SeriesMark>,
}

/// Whether a value is false. Serde requires the reference.
pub(super) fn is_false(value: &bool) -> bool {
    !*value
}

/// Events that an acknowledged press survives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Durability {
    /// A power cut, because the press is flushed to the disk before the next one begins.
    #[default]
    Full,
    /// The end of the program, but not a power cut.
    Fast,
}

impl Status {
    /// Returns the name of the status in files.
    pub fn name(self) -> &'static str {
        match self {
            Status::Complete => "complete",
            Status::Stopped => "stopped",
            Status::Tripped => "tripped",
            Status::Failed => "failed",
        }
    }
}
