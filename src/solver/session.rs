//! One reading after another, broken units left out.

use super::{
    Broken, Calibration, Fault, FitError, Fitted, Prepared, Setting, Solution, SolveError, Solver, Verdict, Workspace,
};

/// Solves one reading after another, and leaves a unit that breaks on the way out of account from then on.
///
/// A forward method says of a reading which unit contradicts all others, if one does. Such verdicts are summed up, for each unit, by
/// a cumulative sum test (Page 1954): a broken unit is named by every other contact or more, a good one by one of fifty or fewer.
/// Readings of one and the same contact are one witness, however many there are.
pub struct Session<'a> {
    name: String,
    calibration: &'a Calibration,
    setting: Setting<'a>,
    fitted: Fitted,
    /// For each unit, how much more likely than not it is broken: a logarithm, 0 at least.
    evidence: Vec<f64>,
    /// The last contact that counted.
    witness: Option<Solution>,
    workspace: Workspace,
}

/// The share of contacts in which a broken unit is named.
const NAMED_IF_BROKEN: f64 = 0.5;
/// The share of contacts in which a good unit is named.
const NAMED_IF_GOOD: f64 = 0.02;
/// The evidence that is enough: a million to one.
const ENOUGH: f64 = 13.8;
/// How many sd two contacts are apart that aren't the same.
const APART_SD: f64 = 3.0;

impl<'a> Session<'a> {
    /// Fits the method of that name.
    pub fn new(name: &str, calibration: &'a Calibration, setting: Setting<'a>) -> Result<Self, FitError> {
        let fitted = super::fit(name, calibration, &setting)?;
        Ok(Session {
            name: fitted.name().to_owned(),
            calibration,
            setting,
            evidence: vec![0.0; calibration.units()],
            fitted,
            witness: None,
            workspace: Workspace::default(),
        })
    }

    /// The method.
    pub fn fitted(&self) -> &Fitted {
        &self.fitted
    }

    /// The units that are left out, in the order in which they were found.
    pub fn broken(&self) -> &[Broken] {
        self.fitted.broken()
    }

    /// The contact behind the next reading.
    pub fn solve(&mut self, outputs: &[f64]) -> Result<Solution, SolveError> {
        let solution = self.fitted.solve(outputs, &mut self.workspace)?;
        let says_nothing = solution.verdict == Verdict::WeakSignal;
        if says_nothing || self.witness.is_some_and(|last| is_same(&last, &solution)) {
            return Ok(solution);
        }
        self.witness = Some(solution);
        let named = match solution.verdict {
            Verdict::ChannelFault(unit) => Some(unit),
            _ => None,
        };
        for (unit, evidence) in self.evidence.iter_mut().enumerate() {
            let ratio = match named == Some(unit) {
                true => NAMED_IF_BROKEN / NAMED_IF_GOOD,
                false => (1.0 - NAMED_IF_BROKEN) / (1.0 - NAMED_IF_GOOD),
            };
            *evidence = (*evidence + ratio.ln()).max(0.0);
        }
        if let Some(unit) = named.filter(|unit| self.evidence[*unit] > ENOUGH) {
            let mut broken = self.fitted.broken().to_vec();
            broken.push(Broken { unit, fault: Fault::Contradicts });
            // an array that has too few units left goes on with those it has
            let prepared = Prepared::without(self.calibration.clone(), &self.setting, broken);
            if let Ok(fitted) = prepared.and_then(|prepared| prepared.fit(&self.name)) {
                self.fitted = fitted;
            }
            self.evidence.fill(0.0);
        }
        Ok(solution)
    }
}

/// Whether two solutions may be of one contact.
fn is_same(a: &Solution, b: &Solution) -> bool {
    let (Some(sd_a), Some(sd_b)) = (a.covariance, b.covariance) else { return false };
    let location_sd_mm = sd_a.x_mm().hypot(sd_a.y_mm()).hypot(sd_b.x_mm()).hypot(sd_b.y_mm());
    let force_sd_n = sd_a.force_n().hypot(sd_b.force_n());
    a.place.distance_mm(b.place) < APART_SD * location_sd_mm && (a.force_n - b.force_n).abs() < APART_SD * force_sd_n
}
