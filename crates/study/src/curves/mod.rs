//! The paper's numerical study: the similarity of an array's readings of two contacts (Pearson's r) as a function of their
//! distance.
//!
//! [`curves`] draws the paper's lines of units (PAPER S3) and compares each of its claims with computed results. [`NominalArray`] does
//! the same for any array. No random numbers are used, so the same study gives the same bytes.

mod array;
mod claims;
mod design;
mod figures;
mod line;
mod turning;

pub use super::methods::cramer_rao::MeanBound;
pub use array::Aim;
pub use array::StudiedArray;
pub use claims::PaperClaim;
pub use design::{ASSUMED_SD, Course, DesignError, DesignFindings, NominalArray};
pub use figures::{design_figures, figures};
pub use line::LineCurve;
pub use turning::PathSearch;
pub use turning::Survey;
pub use turning::{ContactArea, NEAR_R, Turning};

use serde::Serialize;
use serde_json::json;

/// The paper's curves and the verdicts on its claims.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    /// Figure 3: k and lambda.
    pub lambda: Vec<(f64, f64)>,
    /// Figures 4 and 5.
    pub curves: Vec<LineCurve>,
    /// Claims with their verdicts.
    pub claims: Vec<PaperClaim>,
}

/// Computes the complete study.
pub fn curves() -> Curves {
    Curves { lambda: line::lambda_curve(), curves: line::curves(), claims: claims::claims() }
}

impl Curves {
    /// Returns one JSON object per line: the claims, then every point of every curve.
    pub fn ndjson(&self) -> String {
        let claims = self.claims.iter().map(|claim| row("claim", claim));
        let lambda =
            self.lambda.iter().map(|(k, lambda)| row("curve", &json!({"figure": "3", "k": k, "lambda": lambda})));
        let points = self.curves.iter().flat_map(|LineCurve { figure, n, s, d1, points }| {
            let point =
                move |(d2, r): &(f64, Option<f64>)| json!({"figure": figure, "n": n, "s": s, "d1": d1, "d2": d2, "r": r});
            points.iter().map(move |at| row("curve", &point(at)))
        });
        claims.chain(lambda).chain(points).collect()
    }
}

/// Formats one line of rows.
fn row(part: &'static str, of: &impl Serialize) -> String {
    #[derive(Serialize)]
    struct CurvesRow<'a, T> {
        part: &'static str,
        #[serde(flatten)]
        of: &'a T,
    }
    // numbers and text can't fail
    serde_json::to_string(&CurvesRow { part, of }).unwrap_or_default() + "\n"
}
