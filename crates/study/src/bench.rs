//! Simulated benches on which conditions are measured.

use super::StudyError;
use palpate_data::dataset::{Memory, RecordedContact};
use palpate_data::recipe::Plan;
use palpate_document::Problems;
use palpate_link::time::run_virtually;
use palpate_run::rig::{self, RigSpec};
use palpate_run::run::{Cancel, Ending, Listener, RunJob, execute};

/// Simulated benches on which conditions are measured: one plant with two controllers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StudyBench {
    /// A stage behind an ESP301: 5 to 20 ms per exchange.
    Esp301,
    /// The same stage behind a controller as fast as an XPS: 1 to 5 ms per exchange.
    XpsLike,
}

impl StudyBench {
    /// Both benches, the slow one first.
    pub const ALL: [StudyBench; 2] = [StudyBench::Esp301, StudyBench::XpsLike];

    /// Returns the name in tables and figures.
    pub fn name(self) -> &'static str {
        match self {
            StudyBench::Esp301 => "ESP301",
            StudyBench::XpsLike => "XPS-like",
        }
    }

    /// Returns the rig as supplied.
    ///
    /// # Errors
    /// Never in practice: a test checks that the supplied text is valid.
    pub fn spec(self) -> Result<RigSpec, Problems> {
        let (file, text) = match self {
            StudyBench::Esp301 => ("rigs/bench-esp301.toml", include_str!("../../../rigs/bench-esp301.toml")),
            StudyBench::XpsLike => ("rigs/bench-fast.toml", include_str!("../../../rigs/bench-fast.toml")),
        };
        shipped(file, text)
    }
}

/// Returns each kind of stage with its name, over the specimen and with the load cell of the fast bench.
///
/// # Errors
/// Never in practice: a test checks that the supplied texts are valid.
pub(crate) fn stages() -> Result<Vec<(&'static str, RigSpec)>, Problems> {
    let texts = [
        ("ESP301", "rigs/esp301.toml", include_str!("../../../rigs/esp301.toml")),
        ("XPS", "rigs/xps.toml", include_str!("../../../rigs/xps.toml")),
        ("GRBL", "rigs/grbl.toml", include_str!("../../../rigs/grbl.toml")),
        ("Marlin", "rigs/marlin.toml", include_str!("../../../rigs/marlin.toml")),
        ("Klipper", "rigs/klipper.toml", include_str!("../../../rigs/klipper.toml")),
        ("UR5e", "rigs/ur.toml", include_str!("../../../rigs/ur.toml")),
    ];
    let stages = texts.into_iter().map(|(name, file, text)| {
        let (bench, own) = (StudyBench::XpsLike.spec()?, shipped(file, text)?.simulated());
        let mut spec = RigSpec { stage: own.stage, frame: own.frame, ..bench };
        // the controller's own; an XPS is as fast as the bench's
        match name {
            "XPS" => {}
            "ESP301" => spec.scene.latencies.stage_s = StudyBench::Esp301.spec()?.scene.latencies.stage_s,
            _ => spec.scene.latencies.stage_s = own.scene.latencies.stage_s,
        }
        Ok((name, spec))
    });
    stages.collect()
}

/// Returns the paper's own rig as supplied.
///
/// # Errors
/// Never in practice: a test checks that the supplied text is valid.
pub(crate) fn papers_rig() -> Result<RigSpec, Problems> {
    shipped("rigs/paper.toml", include_str!("../../../rigs/paper.toml"))
}

/// Executes a plan in virtual time and writes no files. Returns the measured contacts and the ending.
///
/// # Errors
/// An error of the operating system: it provides no runtime.
pub(crate) fn executed(plan: &Plan, spec: &RigSpec) -> Result<(Vec<RecordedContact>, Ending), StudyError> {
    let mut memory = Memory::default();
    let job = RunJob { plan, spec, ledger: &mut memory, cancel: &Cancel::default(), shown: &|_| {} };
    let ending = run_virtually(execute(job, &mut StudyListener));
    Ok((memory.contacts().cloned().collect(), ending))
}

struct StudyListener;

impl Listener for StudyListener {}

fn shipped(file: &str, text: &str) -> Result<RigSpec, Problems> {
    rig::parse(file, text, &|_| Err(std::io::ErrorKind::NotFound.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_benches_are_simulated_and_differ_in_their_controller_alone() {
        let [slow, fast] = StudyBench::ALL.map(|bench| bench.spec().unwrap());
        assert!(slow.is_simulated() && fast.is_simulated());
        assert!(fast.scene.latencies.stage_s.1 < slow.scene.latencies.stage_s.0 + 1e-9);
        let mut scene = slow.scene.clone();
        scene.latencies.stage_s = fast.scene.latencies.stage_s;
        assert_eq!((scene, slow.limits), (fast.scene, fast.limits));
    }
}
