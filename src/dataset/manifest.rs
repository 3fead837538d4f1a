use crate::control::{Strategy, Trip};
use crate::device::Identity;
use crate::recipe::Plan;
use serde::{Deserialize, Serialize};

/// `manifest.json`: what a run was and how it ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The program's version.
    pub palpate: String,
    /// How it ended. While a run is under way it says `stopped`, which is what it is if nobody says otherwise later.
    pub status: Status,
    /// The recipe's name.
    pub recipe: String,
    /// Who was pressed, if somebody said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<String>,
    /// Entries of the plan.
    pub presses_planned: u64,
    /// Entries on disk.
    pub presses_done: u64,
    /// What random points, and all simulated noise, were drawn from.
    pub seed: u64,
    /// The strategy of every press, if it was given in place of the recipe's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strategy: Option<Strategy>,
    /// Whether our emulators were at the far ends of the links.
    pub simulated: bool,
    /// Time that passed in the run, s: in a simulated one that of the simulation.
    pub virtual_s: f64,
    /// Time that passed outside, s.
    pub wall_s: f64,
    /// When it began, with its time zone.
    pub started: String,
    /// When it ended, with its time zone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended: Option<String>,
    /// What the devices said they are.
    pub devices: Vec<Identity>,
    /// The rule that was broken, in a run that was tripped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trip: Option<Trip>,
    /// What went wrong, in a run that failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
}

impl Manifest {
    /// The manifest of a run that begins.
    pub fn new(plan: &Plan, simulated: bool, sensor: Option<String>, started: String) -> Self {
        Manifest {
            palpate: env!("CARGO_PKG_VERSION").to_owned(),
            status: Status::Stopped,
            recipe: plan.name.clone(),
            sensor,
            presses_planned: plan.entries.len() as u64,
            presses_done: 0,
            seed: plan.seed,
            strategy: None,
            simulated,
            virtual_s: 0.0,
            wall_s: 0.0,
            started,
            ended: None,
            devices: Vec::new(),
            trip: None,
            failure: None,
        }
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Every entry of the plan is on disk.
    Complete,
    /// A person stopped it, or it is still under way.
    Stopped,
    /// A safety rule was broken.
    Tripped,
    /// A device failed or the record couldn't be kept.
    Failed,
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
