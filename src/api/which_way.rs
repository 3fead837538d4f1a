//! What a person has confirmed about a stage: which way z goes, where the zero of a stage without switches is, and that z may home
//! toward the specimen; and a store of earlier confirmations.

use palpate_core::quantity::{Down, hexadecimal};
use palpate_link::device::{HomeSearch, Identity};
use palpate_run::rig::{RigSpec, WhichWay};
use sha2::{Digest, Sha256};
use std::env;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::Arc;

/// Largest number of bytes that are read from the file of confirmed directions.
const KEPT_MAX_BYTES: u64 = 1 << 20;

/// What a person has made sure of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Confirmed {
    /// I have checked that z retracts from the specimen (`frame.down`)
    Down,
    /// A stage without switches is at the zero of `travel_mm` (`home` of the rig: by hand)
    Home,
    /// Nothing is in the way of z while it homes on the specimen's side (`home_side` of the rig: toward), and it stays so
    Clear,
    /// Without a load cell: I lowered z in steps until it touched this sensor in this mounting, and `frame.surface_mm` states where
    Touch,
}

/// What a person has made sure of before a rig that isn't simulated moves.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ConfirmOptions {
    /// Confirm without a terminal: that `frame.down` is right, that the stage is at its zero, or that it may home toward the specimen
    #[arg(long, value_name = "WHAT", value_enum)]
    pub confirmed: Vec<Confirmed>,
}

impl ConfirmOptions {
    /// Returns the rig, which asks no person: what isn't confirmed is refused.
    pub(crate) fn of(&self, spec: RigSpec) -> RigSpec {
        RigSpec { which_way: Some(Arc::new(NoPerson::new(self))), is_touched: self.is_touched(), ..spec }
    }

    /// Whether the surface was touched in steps.
    pub(crate) fn is_touched(&self) -> bool {
        self.confirmed.contains(&Confirmed::Touch)
    }
}

/// Confirmations of a person who can't be asked.
#[derive(Debug)]
pub(crate) struct NoPerson {
    /// Whether `frame.down` is right, confirmed for this time.
    is_down: bool,
    /// Whether the stage is at its zero.
    pub(crate) at_zero: bool,
    /// Whether nothing is in the way of a search for home toward the specimen.
    pub(crate) is_clear: bool,
    /// The file with the confirmed directions; `None` if the system names no folder for it.
    kept: Option<PathBuf>,
}

impl NoPerson {
    pub(crate) fn new(options: &ConfirmOptions) -> Self {
        let has = |what| options.confirmed.contains(&what);
        let (is_down, at_zero, is_clear) = (has(Confirmed::Down), has(Confirmed::Home), has(Confirmed::Clear));
        NoPerson { is_down, at_zero, is_clear, kept: kept_path() }
    }

    /// Stores that a direction is right.
    pub(crate) fn keep(&self, stage: &Identity, down: Down) -> io::Result<()> {
        let path = self.kept.as_ref().ok_or_else(|| io::Error::other("no folder to store it: set XDG_STATE_HOME"))?;
        path.parent().map_or(Ok(()), fs::create_dir_all)?;
        let Identity { identity, link, .. } = stage;
        let mut file = OpenOptions::new().create(true).append(true).open(path)?;
        writeln!(file, "{} {identity} at {link}", key(stage, down))
    }
}

impl WhichWay for NoPerson {
    fn is_known(&self, stage: &Identity, down: Down) -> bool {
        let known = |path: &PathBuf| {
            let text =
                fs::metadata(path).is_ok_and(|file| file.len() <= KEPT_MAX_BYTES).then(|| fs::read_to_string(path));
            let key = key(stage, down);
            text.and_then(Result::ok).is_some_and(|text| text.lines().any(|line| line.starts_with(&key)))
        };
        self.is_down || self.kept.as_ref().is_some_and(known)
    }

    fn announce(&self, Identity { identity, link, .. }: &Identity, _: f64, search: HomeSearch) -> Result<(), String> {
        let clear = match search {
            HomeSearch::Toward if !self.is_clear => ", and --confirmed clear if nothing is in the way of z to its home",
            _ => "",
        };
        Err(format!(
            "the direction of z isn't confirmed on this stage ({identity} at {link}), and there is no terminal to ask at: \
             nothing was moved. Run `palpate doctor` at a terminal once, or add --confirmed down if `frame.down` is right{clear}"
        ))
    }

    /// [`announce`](WhichWay::announce) refuses the move.
    fn confirm(&self, _: &Identity, _: Down, _: &dyn Fn() -> bool) -> Result<(), String> {
        Err("it isn't confirmed that z moved away from the specimen".to_owned())
    }

    fn confirm_clear(&self, Identity { identity, link, .. }: &Identity, _: &dyn Fn() -> bool) -> Result<(), String> {
        if self.is_clear {
            return Ok(());
        }
        Err(format!(
            "this stage ({identity} at {link}) homes z toward the specimen, it isn't confirmed that nothing is in the way, and \
             there is no terminal to ask at: nothing was moved. Take the indenter off or the specimen away, then add \
             --confirmed clear"
        ))
    }

    fn confirm_back(&self, _: &dyn Fn() -> bool) -> Result<(), String> {
        Ok(())
    }

    fn confirm_zero(
        &self,
        Identity { identity, link, .. }: &Identity,
        _: [f64; 3],
        _: &dyn Fn() -> bool,
    ) -> Result<(), String> {
        if self.at_zero {
            return Ok(());
        }
        Err(format!(
            "the zero of this stage ({identity} at {link}) isn't confirmed, and there is no terminal to ask at: nothing \
             was moved. It has no switches, and opening its port loses its position: bring it to the zero of \
             `travel_mm`, then add --confirmed home"
        ))
    }
}

/// Returns the text that identifies a stage, its link and a direction.
fn key(stage: &Identity, down: Down) -> String {
    hexadecimal(&Sha256::digest(format!("{}\0{}\0{}", stage.identity, stage.link, down.sign())))
}

/// Returns the folder in which programs store their state on this machine.
fn kept_path() -> Option<PathBuf> {
    let folder = |name: &str| env::var_os(name).filter(|path| !path.is_empty()).map(PathBuf::from);
    let state = folder("XDG_STATE_HOME")
        .or_else(|| folder("LOCALAPPDATA"))
        .or_else(|| folder("HOME").map(|home| home.join(".local/state")))?;
    Some(state.join("palpate").join("confirmed-down.txt"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage(link: &str) -> Identity {
        Identity { role: "stage".into(), identity: "ESP301".into(), link: link.into(), warnings: Vec::new() }
    }

    #[test]
    fn confirmation_holds_for_one_stage_link_and_direction() {
        let folder = tempfile::tempdir().unwrap();
        let kept = folder.path().join("state/confirmed-down.txt");
        let person = |is_down| NoPerson { is_down, at_zero: false, is_clear: false, kept: Some(kept.clone()) };
        let (here, there) = (stage("serial:///dev/ttyUSB0"), stage("serial:///dev/ttyUSB1"));
        assert!(!person(false).is_known(&here, Down::Minus));
        person(false).keep(&here, Down::Minus).unwrap();
        assert!(person(false).is_known(&here, Down::Minus));
        assert!(!person(false).is_known(&here, Down::Plus) && !person(false).is_known(&there, Down::Minus));
        assert!(person(true).is_known(&there, Down::Plus), "a person said so");
    }
}
