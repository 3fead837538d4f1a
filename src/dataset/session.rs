//! What a run was made from and by whom, as its journal keeps it.

use super::Fingerprint;
use crate::control::Strategy;
use crate::recipe::Plan;
use serde::{Deserialize, Serialize};

/// The format of the journals that this program writes and reads. Format 1 had no number, no texts, and rows for levels.
pub const FORMAT: u32 = 2;

/// What a run is, in every continuation: its first record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunFacts {
    /// The journal's format: [`FORMAT`].
    pub format: u32,
    /// The recipe's name.
    pub recipe: String,
    /// What was pressed and by whom, as far as a person said.
    #[serde(flatten)]
    pub labels: Labels,
    /// Entries of the plan.
    pub presses_planned: u64,
    /// The random seed for places, forces and simulated noise.
    pub seed: u64,
    /// The strategy of every press, if it was given instead of the recipe's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strategy: Option<Strategy>,
    /// The most presses that its plan may have, if that was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub presses_max: Option<usize>,
    /// Whether our emulators were at the far ends of the links.
    pub simulated: bool,
    /// The tables that the presses were imported from; none of a run that this program made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imported: Option<Imported>,
}

/// Where imported presses come from.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Imported {
    /// The table of the calibration presses, and that of the test presses where there was one.
    pub tables: Vec<Fingerprint>,
    /// The columns file, where one was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<Fingerprint>,
    /// How many outputs each press has.
    pub outputs: u64,
    /// What was detected and what was excluded, in words.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// The day of the measurement, as year-month-day, where a person stated it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured: Option<String>,
}

/// What a run pressed and who made it, in a person's own words; each is optional.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Labels {
    /// The sensor's ID, such as its serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<String>,
    /// The design that the sensor is built to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub design: Option<String>,
    /// The batch that it comes from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub batch: Option<String>,
    /// How often, or how, it has been mounted: runs of one mounting share the sensor's place on the bench.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mounting: Option<String>,
    /// Who made the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
    /// Anything else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Every entry of the plan is on disk.
    Complete,
    /// A person stopped it, or it is still under way.
    #[default]
    Stopped,
    /// A safety rule was broken.
    Tripped,
    /// A device failed or the record couldn't be kept.
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
            strategy: None,
            presses_max: None,
            simulated: false,
            imported: None,
        }
    }
}

impl Imported {
    /// The tables, by name.
    pub fn names(&self) -> String {
        let names: Vec<&str> = self.tables.iter().map(|table| table.name.as_str()).collect();
        names.join(" and ")
    }

    /// Each file with its SHA-256: the tables, then the columns file.
    pub fn files(&self) -> impl Iterator<Item = &Fingerprint> {
        self.tables.iter().chain(&self.columns)
    }
}

impl Labels {
    /// Those that were given, each with its name.
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
    /// What was carried out, for a sentence: the recipe, or an import.
    pub fn told(&self) -> String {
        match &self.imported {
            None => format!("the recipe {}", self.recipe),
            Some(imported) => format!("the import of {}", imported.names()),
        }
    }

    /// The facts of a plan.
    pub fn new(plan: &Plan, simulated: bool) -> RunFacts {
        RunFacts {
            recipe: plan.name.clone(),
            presses_planned: plan.entries.len() as u64,
            seed: plan.seed,
            simulated,
            ..RunFacts::default()
        }
    }
}

/// A program that measures: which one, where, and since when.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// The program's version.
    pub palpate: String,
    /// The commit it was built from, where that was known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
    /// The machine's name.
    pub host: String,
    /// Its operating system and kind of processor, such as `linux x86_64`.
    pub system: String,
    /// When it began, with its time zone.
    pub started: String,
    /// What an acknowledged press survives.
    pub durability: Durability,
    /// The texts it goes by: recipe, rig, and the files that these name. The folder that keeps them adds this.
    #[serde(default)]
    pub texts: Vec<Fingerprint>,
    /// The keys of the rig that differ from those with which the run began.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<RigChange>,
}

/// A key of the rig that was changed between two sessions.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RigChange {
    /// The key with the tables it stands in, such as `stage.link`.
    pub key: String,
    /// Its value when the run began.
    pub before: String,
    /// Its value now.
    pub now: String,
}

/// A text that a run goes by, as given: its recipe, its rig, a register map.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Text {
    /// Its file's name in the run folder.
    pub name: String,
    /// The text.
    pub text: String,
}

/// Presses that were recorded once and lost with a part of the journal, which a person accepted.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Loss {
    /// When it was accepted, with its time zone.
    pub accepted: String,
    /// What the other files of the folder said of it.
    pub lost: Vec<String>,
}

/// How a program ended that could still say so.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct End {
    /// How it ended.
    pub status: Status,
    /// When, s since the run's start.
    pub t_s: f64,
    /// When, with its time zone.
    pub ended: String,
    /// How long it took by the clock outside, s.
    pub wall_s: f64,
    /// What went wrong, in a run that failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
}

/// What an acknowledged press survives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Durability {
    /// A power cut: it is flushed to the disk before the next one begins.
    #[default]
    Full,
    /// The end of the program, but no power cut.
    Fast,
}

impl Status {
    /// The status as it stands in files.
    pub fn name(self) -> &'static str {
        match self {
            Status::Complete => "complete",
            Status::Stopped => "stopped",
            Status::Tripped => "tripped",
            Status::Failed => "failed",
        }
    }
}
