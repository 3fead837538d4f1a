//! The person at the terminal, who confirms which way z goes, where the zero of a stage without switches is, and that z may home
//! toward the specimen.

use super::signals::is_attended;
use super::summary::tell;
use crate::api::which_rig::ChosenRig;
use crate::api::which_way::NoPerson;
use crate::api::{ConfirmOptions, Failure};
use palpate_core::quantity::Down;
use palpate_link::device::{HomeSearch, Identity};
use palpate_run::rig::{RigSpec, WhichWay};
use std::io;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// Interval of checks whether a person requested a stop instead of an answer.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Returns the rig, which asks the person at the terminal, if there is one.
pub(super) fn asked_at(options: &ConfirmOptions, spec: RigSpec) -> RigSpec {
    if !is_attended() {
        return options.of(spec);
    }
    let absent = NoPerson::new(options);
    RigSpec { which_way: Some(Arc::new(Person { absent })), is_touched: options.is_touched(), ..spec }
}

/// Asks the person at the terminal whether a real rig may move that `--rig` doesn't name.
pub(super) fn confirm_rig(chosen: &ChosenRig, rig: &RigSpec) -> Result<(), Failure> {
    if !chosen.is_to_confirm(rig) {
        return Ok(());
    }
    if !is_attended() {
        return Err(chosen.unconfirmed());
    }
    let refused = format!("{} isn't confirmed: nothing was moved. Name the rig with --rig", chosen.path.display());
    confirmed("This rig is real. Use it? [y/N] ", &|| false, &refused)
        .map_err(|why| Failure::usage(miette::miette!("{why}")))
}

/// Person at a terminal, with what is confirmed without a question.
#[derive(Debug)]
struct Person {
    absent: NoPerson,
}

impl WhichWay for Person {
    fn is_known(&self, stage: &Identity, down: Down) -> bool {
        self.absent.is_known(stage, down)
    }

    fn announce(&self, stage: &Identity, way_mm: f64, search: HomeSearch) -> Result<(), String> {
        let Identity { identity, link, .. } = stage;
        let way = match search {
            HomeSearch::Away => format!("z now moves {way_mm} mm away from the specimen, or homes there."),
            HomeSearch::Toward => format!("z now homes toward the specimen, and then moves {way_mm} mm away from it."),
            HomeSearch::Never => format!("z now moves {way_mm} mm away from the specimen."),
        };
        let text = format!(
            "\n{identity} at {link} moves for the first time with this `frame.down`.\n\
             {way} Watch it.\n\
             If z is already at that end and can't move, answer no, move it a few mm by hand and start again.\n"
        );
        tell(&text).map_err(|_| "the terminal is closed: nothing was moved".to_owned())
    }

    fn confirm(&self, stage: &Identity, down: Down, is_cancelled: &dyn Fn() -> bool) -> Result<(), String> {
        let refused = "z should move away from the specimen but didn't: reverse `frame.down`, check the wiring of z, and run \
                       `palpate doctor` again";
        confirmed("Did z move away from the specimen? [y/N] ", is_cancelled, refused)?;
        if let Err(error) = self.absent.keep(stage, down) {
            let _ = tell(&format!("the answer can't be stored ({error}): palpate will ask again\n"));
        }
        Ok(())
    }

    fn confirm_clear(&self, stage: &Identity, is_cancelled: &dyn Fn() -> bool) -> Result<(), String> {
        let Identity { identity, link, .. } = stage;
        if self.absent.is_clear {
            return Ok(());
        }
        let text = format!(
            "\n{identity} at {link} homes z toward the specimen.\n\
             Take the indenter off, or the specimen away, unless z misses it there.\n\
             Is nothing in the way of z to its end on that side? [y/N] "
        );
        confirmed(&text, is_cancelled, "z may not search for home toward the specimen: nothing was moved")
    }

    fn confirm_back(&self, is_cancelled: &dyn Fn() -> bool) -> Result<(), String> {
        if self.absent.is_clear {
            return Ok(());
        }
        let text =
            "\nz is home, and away from the specimen. Put back what you took away.\nIs it all in its place? [y/N] ";
        confirmed(text, is_cancelled, "indenter or specimen isn't in its place: put it back, then start again")
    }

    fn confirm_zero(&self, stage: &Identity, at_mm: [f64; 3], is_cancelled: &dyn Fn() -> bool) -> Result<(), String> {
        let Identity { identity, link, .. } = stage;
        let [x_mm, y_mm, z_mm] = at_mm;
        if self.absent.at_zero {
            return Ok(());
        }
        let text = format!(
            "\n{identity} at {link} has no switches. Only this program's limits stop it.\n\
             It counts x {x_mm:.3}, y {y_mm:.3}, z {z_mm:.3} mm here.\n\
             Is the stage at this position of the rig's `travel_mm` and `frame`? [y/N] "
        );
        confirmed(&text, is_cancelled, "the stage isn't at its zero: bring it there, then start again")
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
