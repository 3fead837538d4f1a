//! A fitted method, selected by name.

use super::blend::Blend;
use super::extra_trees::ExtraTrees;
use super::forward::Forward;
use super::gaussian_process::GaussianProcess;
use super::pattern_map::PatternMap;
use super::{Locate, LocatedContact, Pearson, SolveError, Workspace};
use serde::{Deserialize, Serialize};

/// Fitted method. A sensor file contains one, so the order of the variants is fixed, and a new variant is added last.
#[derive(Serialize, Deserialize)]
pub(super) enum FittedMethod {
    Pearson(Pearson),
    /// Places of the [removed](super::REMOVED) methods: the variants after them keep their numbers.
    PearsonKnn(Removed),
    Whitened(Removed),
    Forward(Box<Forward>),
    GaussianProcess(GaussianProcess),
    PatternMap(PatternMap),
    Blend(Blend),
    ExtraTrees(ExtraTrees),
}

/// A method that no file can have.
#[derive(Serialize, Deserialize)]
pub(super) enum Removed {}

/// Names of the methods that can be fitted in several ways.
pub(super) const SURROGATE: &str = "surrogate";
pub(super) const PHYSICS: &str = "physics";
pub(super) const PROCESS: &str = "gaussian-process";
pub(super) const PATTERN_MAP: &str = "pattern-map";
pub(super) const BLEND: &str = "blend";
pub(super) const EXTRA_TREES: &str = "extra-trees";

impl FittedMethod {
    fn inner(&self) -> &dyn Locate {
        match self {
            FittedMethod::Pearson(method) => method,
            FittedMethod::PearsonKnn(never) | FittedMethod::Whitened(never) => match *never {},
            FittedMethod::Forward(method) => &**method,
            FittedMethod::GaussianProcess(method) => method,
            FittedMethod::PatternMap(method) => method,
            FittedMethod::Blend(method) => method,
            FittedMethod::ExtraTrees(method) => method,
        }
    }
}

impl Locate for FittedMethod {
    fn name(&self) -> &'static str {
        self.inner().name()
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<LocatedContact, SolveError> {
        self.inner().locate(outputs, workspace)
    }
}
