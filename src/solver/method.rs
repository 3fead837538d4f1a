//! A fitted method, selected by name.

use super::blend::Blend;
use super::extra_trees::ExtraTrees;
use super::forward::Forward;
use super::gaussian_process::GaussianProcess;
use super::pattern_map::PatternMap;
use super::{Locate, Located, Pearson, PearsonKnn, SolveError, Whitened, Workspace};
use serde::{Deserialize, Serialize};

/// A fitted method. A sensor file holds one, so the variants keep their order, and a new one goes last.
#[derive(Serialize, Deserialize)]
pub(super) enum Method {
    Pearson(Pearson),
    PearsonKnn(PearsonKnn),
    Whitened(Whitened),
    Forward(Box<Forward>),
    GaussianProcess(GaussianProcess),
    PatternMap(PatternMap),
    Blend(Blend),
    ExtraTrees(ExtraTrees),
}

/// The names of the methods to which a fit comes in more ways than one.
pub(super) const SURROGATE: &str = "surrogate";
pub(super) const PHYSICS: &str = "physics";
pub(super) const PROCESS: &str = "gaussian-process";
pub(super) const PATTERN_MAP: &str = "pattern-map";
pub(super) const BLEND: &str = "blend";
pub(super) const EXTRA_TREES: &str = "extra-trees";

impl Method {
    fn inner(&self) -> &dyn Locate {
        match self {
            Method::Pearson(method) => method,
            Method::PearsonKnn(method) => method,
            Method::Whitened(method) => method,
            Method::Forward(method) => &**method,
            Method::GaussianProcess(method) => method,
            Method::PatternMap(method) => method,
            Method::Blend(method) => method,
            Method::ExtraTrees(method) => method,
        }
    }
}

impl Locate for Method {
    fn name(&self) -> &'static str {
        self.inner().name()
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Located, SolveError> {
        self.inner().locate(outputs, workspace)
    }
}
