//! Fits of one model without some of its units, which sessions share.

use super::expectation::Expectation;
use super::{Broken, FitError, Fitted, Model};
use palpate_core::parallel::lock;
use std::sync::{Arc, Mutex, OnceLock};

/// Largest number of fits that are kept at the same time, for all sessions of a model.
pub(crate) const MOST_FITS: usize = 64;

/// A model, and its fits without some units. Sessions that share it need each fit only once.
pub struct Fits {
    model: Arc<Model>,
    made: Mutex<Vec<Made>>,
    expectation: OnceLock<Option<Expectation>>,
}

/// A fit without some units.
struct Made {
    /// The units without which it was made, in addition to those of the model.
    without: Vec<Broken>,
    fitted: Result<Arc<Fitted>, FitError>,
}

impl Fits {
    /// Creates the fits of a model, of which none is made yet.
    pub fn new(model: impl Into<Arc<Model>>) -> Self {
        Fits { model: model.into(), made: Mutex::new(Vec::new()), expectation: OnceLock::new() }
    }

    /// Returns the model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Returns what the model expects of good contacts; `None` if nothing shows it.
    pub(super) fn expectation(&self) -> Option<&Expectation> {
        self.expectation.get_or_init(|| Expectation::of(self.model.clone())).as_ref()
    }

    /// Returns the method fitted without some units, in addition to those that the model leaves out. Makes the fit if it doesn't
    /// exist. A fit that no session uses leaves its place to another one.
    pub(super) fn without(&self, units: &[Broken]) -> Result<Result<Arc<Fitted>, FitError>, Unmade> {
        if let Some(fitted) = self.known(units) {
            return Ok(fitted);
        }
        // other sessions continue meanwhile; one of them may make the same fit
        let fitted = self.model.fit_without(units).ok_or(Unmade::NoPresses)?.map(Arc::new);
        let mut made = lock(&self.made);
        if let Some(known) = made.iter().find(|made| made.without == units) {
            return Ok(known.fitted.clone());
        }
        if made.len() >= MOST_FITS {
            let unused = made.iter().position(Made::is_unused).ok_or(Unmade::TooMany)?;
            made.remove(unused);
        }
        made.push(Made { without: units.to_vec(), fitted: fitted.clone() });
        Ok(fitted)
    }

    fn known(&self, units: &[Broken]) -> Option<Result<Arc<Fitted>, FitError>> {
        let made = lock(&self.made);
        made.iter().find(|made| made.without == units).map(|made| made.fitted.clone())
    }
}

impl Made {
    fn is_unused(&self) -> bool {
        self.fitted.as_ref().map_or(true, |fitted| Arc::strong_count(fitted) == 1)
    }
}

/// Reason why there is no fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unmade {
    /// The model doesn't contain its presses.
    NoPresses,
    /// Sessions use the largest number of fits.
    TooMany,
}
