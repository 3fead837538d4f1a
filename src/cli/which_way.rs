//! The person who confirms which way z goes, where the zero of a stage without switches is, and that z may home toward
//! the specimen; and a store of earlier confirmations.

use super::signals::is_attended;
use super::summary::tell;
use palpate_core::quantity::Down;
use palpate_link::device::{HomeSearch, Identity};
use palpate_run::rig::{RigSpec, WhichWay};
use sha2::{Digest, Sha256};
use std::env;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// Interval of checks whether a person requested a stop instead of an answer.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Largest number of bytes that are read from the file of confirmed directions.
const KEPT_MAX_BYTES: u64 = 1 << 20;

/// What a person has made sure of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Confirmed {
    /// `frame.down` is right: z moves away from the specimen when it is sent away
    Down,
    /// A stage without switches is at the zero of `travel_mm` (`home` of the rig: by hand)
    Home,
    /// Nothing is in the way of z while it homes on the specimen's side (`home_side` of the rig: toward), and it stays so
    Clear,
}

/// What a person has made sure of before a rig that isn't simulated moves.
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct ConfirmArgs {
    /// Confirm without a terminal: that `frame.down` is right, that the stage is at its zero, or that it may home toward the specimen
    #[arg(long, value_name = "WHAT", value_enum)]
    pub confirmed: Vec<Confirmed>,
}

impl ConfirmArgs {
    /// The rig, with whom it asks which way z goes: a person at the terminal, if there is one.
    pub(super) fn of(&self, spec: RigSpec) -> RigSpec {
        self.with(spec, is_attended())
    }

    /// The rig, which asks no person.
    pub(super) fn of_absent(&self, spec: RigSpec) -> RigSpec {
        self.with(spec, false)
    }

    fn with(&self, spec: RigSpec, is_attended: bool) -> RigSpec {
        let has = |what| self.confirmed.contains(&what);
        let person = Person {
            confirmed: has(Confirmed::Down),
            at_zero: has(Confirmed::Home),
            clear: has(Confirmed::Clear),
            kept: kept_path(),
            is_attended,
        };
        RigSpec { which_way: Some(Arc::new(person)), ..spec }
    }
}

/// Person at a terminal, or the answer of a person.
#[derive(Debug)]
struct Person {
    /// Confirmed on the command line, for this time.
    confirmed: bool,
    /// Whether the stage is at its zero, confirmed on the command line.
    at_zero: bool,
    /// Whether nothing is in the way of a search for home toward the specimen, confirmed on the command line.
    clear: bool,
    /// Returns the file with the confirmed directions; `None` if the system names no folder for it.
    kept: Option<PathBuf>,
    /// Whether there is a terminal at which the person can be asked.
    is_attended: bool,
}

impl WhichWay for Person {
    fn is_known(&self, stage: &Identity, down: Down) -> bool {
        let known = |path: &PathBuf| {
            let text =
                fs::metadata(path).is_ok_and(|file| file.len() <= KEPT_MAX_BYTES).then(|| fs::read_to_string(path));
            let key = key(stage, down);
            text.and_then(Result::ok).is_some_and(|text| text.lines().any(|line| line.starts_with(&key)))
        };
        self.confirmed || self.kept.as_ref().is_some_and(known)
    }

    fn announce(&self, stage: &Identity, way_mm: f64, search: HomeSearch) -> Result<(), String> {
        let Identity { identity, link, .. } = stage;
        if !self.is_attended {
            let clear = match search {
                HomeSearch::Toward if !self.clear => {
                    ", and --confirmed clear if nothing is in the way of z to its home"
                }
                _ => "",
            };
            return Err(format!(
                "the direction of z isn't confirmed on this stage ({identity} at {link}), and there is no terminal to ask at: \
                 nothing was moved. Run `palpate doctor` at a terminal once, or add --confirmed down if `frame.down` is right{clear}"
            ));
        }
        let way = match search {
            HomeSearch::Away => format!("z now moves {way_mm} mm away from the specimen, or homes there."),
            HomeSearch::Toward => format!("z now homes toward the specimen, and then moves {way_mm} mm away from it."),
            HomeSearch::Never => format!("z now moves {way_mm} mm away from the specimen."),
        };
        let told = format!(
            "\n{identity} at {link} moves for the first time with this `frame.down`.\n\
             {way} Watch it.\n\
             If z is already at that end and can't move, answer no, move it a few mm by hand and start again.\n"
        );
        tell(&told).map_err(|_| "the terminal is closed: nothing was moved".to_owned())
    }

    fn confirm(&self, stage: &Identity, down: Down, is_cancelled: &dyn Fn() -> bool) -> Result<(), String> {
        let refused = "z should move away from the specimen but didn't: reverse `frame.down`, check the wiring of z, and run \
                       `palpate doctor` again";
        confirmed("Did z move away from the specimen? [y/N] ", is_cancelled, refused)?;
        if let Err(error) = self.keep(stage, down) {
            let _ = tell(&format!("the answer can't be stored ({error}): palpate will ask again\n"));
        }
        Ok(())
    }

    fn confirm_clear(&self, stage: &Identity, is_cancelled: &dyn Fn() -> bool) -> Result<(), String> {
        let Identity { identity, link, .. } = stage;
        if self.clear {
            return Ok(());
        }
        if !self.is_attended {
            return Err(format!(
                "this stage ({identity} at {link}) homes z toward the specimen, it isn't confirmed that nothing is in the way, and \
                 there is no terminal to ask at: nothing was moved. Take the indenter off or the specimen away, then add \
                 --confirmed clear"
            ));
        }
        let told = format!(
            "\n{identity} at {link} homes z toward the specimen.\n\
             Take the indenter off, or the specimen away, unless z misses it there.\n\
             Is nothing in the way of z to its end on that side? [y/N] "
        );
        confirmed(&told, is_cancelled, "z may not search for home toward the specimen: nothing was moved")
    }

    fn confirm_back(&self, is_cancelled: &dyn Fn() -> bool) -> Result<(), String> {
        if self.clear || !self.is_attended {
            return Ok(());
        }
        let told =
            "\nz is home, and away from the specimen. Put back what you took away.\nIs it all in its place? [y/N] ";
        confirmed(told, is_cancelled, "indenter or specimen isn't in its place: put it back, then start again")
    }

    fn confirm_zero(&self, stage: &Identity, at_mm: [f64; 3], is_cancelled: &dyn Fn() -> bool) -> Result<(), String> {
        let Identity { identity, link, .. } = stage;
        let [x_mm, y_mm, z_mm] = at_mm;
        if self.at_zero {
            return Ok(());
        }
        if !self.is_attended {
            return Err(format!(
                "the zero of this stage ({identity} at {link}) isn't confirmed, and there is no terminal to ask at: nothing \
                 was moved. It has no switches, and opening its port loses its position: bring it to the zero of \
                 `travel_mm`, then add --confirmed home"
            ));
        }
        let told = format!(
            "\n{identity} at {link} has no switches. Only this program's limits stop it.\n\
             It counts x {x_mm:.3}, y {y_mm:.3}, z {z_mm:.3} mm here.\n\
             Is the stage at this position of the rig's `travel_mm` and `frame`? [y/N] "
        );
        confirmed(&told, is_cancelled, "the stage isn't at its zero: bring it there, then start again")
    }
}

/// Asks a question; an answer other than yes is the error `refused`.
pub(super) fn confirmed(question: &str, is_cancelled: &dyn Fn() -> bool, refused: &str) -> Result<(), String> {
    let _ = tell(question);
    let answer = typed_line(is_cancelled).unwrap_or_default();
    match answer.trim().to_lowercase().as_str() {
        "y" | "yes" => Ok(()),
        _ => Err(refused.to_owned()),
    }
}

impl Person {
    fn keep(&self, stage: &Identity, down: Down) -> io::Result<()> {
        let path = self.kept.as_ref().ok_or_else(|| io::Error::other("no folder to store it: set XDG_STATE_HOME"))?;
        path.parent().map_or(Ok(()), fs::create_dir_all)?;
        let Identity { identity, link, .. } = stage;
        let mut file = OpenOptions::new().create(true).append(true).open(path)?;
        writeln!(file, "{} {identity} at {link}", key(stage, down))
    }
}

/// Returns the text that identifies a stage, its link and a direction.
fn key(stage: &Identity, down: Down) -> String {
    format!("{:x}", Sha256::digest(format!("{}\0{}\0{}", stage.identity, stage.link, down.sign())))
}

/// Returns the folder in which programs store their state on this machine.
fn kept_path() -> Option<PathBuf> {
    let folder = |name: &str| env::var_os(name).filter(|path| !path.is_empty()).map(PathBuf::from);
    let state = folder("XDG_STATE_HOME")
        .or_else(|| folder("LOCALAPPDATA"))
        .or_else(|| folder("HOME").map(|home| home.join(".local/state")))?;
    Some(state.join("palpate").join("confirmed-down.txt"))
}

/// Returns a line from the terminal. `None` if a person requests a stop instead, or no more input comes.
fn typed_line(is_cancelled: &dyn Fn() -> bool) -> Option<String> {
    let (sender, receiver) = channel();
    // it ends with the program if nobody types anything
    thread::spawn(move || {
        let mut line = String::new();
        let _ = sender.send(io::stdin().read_line(&mut line).ok().map(|_| line));
    });
    loop {
        match receiver.recv_timeout(LOOK_EVERY) {
            Ok(line) => return line,
            Err(RecvTimeoutError::Timeout) if !is_cancelled() => {}
            Err(_) => return None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage(link: &str) -> Identity {
        Identity { role: "stage".into(), identity: "ESP301".into(), link: link.into(), warnings: Vec::new() }
    }

    #[test]
    fn what_was_confirmed_is_known_for_this_stage_link_and_direction_alone() {
        let folder = tempfile::tempdir().unwrap();
        let person = |confirmed| Person {
            confirmed,
            at_zero: false,
            clear: false,
            kept: Some(folder.path().join("state/confirmed-down.txt")),
            is_attended: false,
        };
        let (here, there) = (stage("serial:///dev/ttyUSB0"), stage("serial:///dev/ttyUSB1"));
        assert!(!person(false).is_known(&here, Down::Minus));
        person(false).keep(&here, Down::Minus).unwrap();
        assert!(person(false).is_known(&here, Down::Minus));
        assert!(!person(false).is_known(&here, Down::Plus) && !person(false).is_known(&there, Down::Minus));
        assert!(person(true).is_known(&there, Down::Plus), "a person said so");
    }
}
