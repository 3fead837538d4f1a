//! The rig of a command that needs no recipe.

use super::which_way::asked_at;
use crate::api::sources::{as_asked, read_rig, seed};
use crate::api::{ConfirmOptions, Failure};
use palpate_run::rig::RigSpec;
use std::path::PathBuf;

/// The rig that is looked at, without a recipe.
#[derive(Debug, clap::Args)]
pub(super) struct OneRigArgs {
    /// The rig
    pub rig: PathBuf,
    /// Simulate: replace the rig's links by emulators, in virtual time
    #[arg(long)]
    pub simulate: bool,
    /// Random seed for the simulated specimen and all noise
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed, allow_negative_numbers = true)]
    pub seed: u64,
    #[command(flatten)]
    confirm: ConfirmOptions,
}

impl OneRigArgs {
    /// Returns the rig's text, its content, and whether emulators replace real links.
    pub(super) fn read(&self) -> Result<(String, RigSpec, bool), Failure> {
        let (text, spec) = read_rig(&self.rig)?;
        let invented = self.simulate && !spec.is_simulated();
        Ok((text, asked_at(&self.confirm, as_asked(spec, self.simulate, self.seed)?), invented))
    }
}
