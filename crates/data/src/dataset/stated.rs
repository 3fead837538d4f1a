//! Whether the errors that a method states agree with its errors on the test.

use crate::acceptance::bound::share_interval;
use palpate_solver::Evaluation;

/// Largest deviation of the share of errors within a half-width that isn't reported: of 68 % and of 95 %.
const TOLERATED: [f64; 2] = [0.08, 0.03];

/// Returns a line for each stated half-width that contains clearly fewer or more errors of the test than it should.
pub fn doubted_half_widths(evaluation: &Evaluation) -> Vec<String> {
    let Some(coverage) = &evaluation.coverage else { return Vec::new() };
    let solver = &evaluation.solver;
    let stated = [
        ("half68_mm", coverage.location_68, 0.68, TOLERATED[0]),
        ("half95_mm", coverage.location_95, 0.95, TOLERATED[1]),
        ("half68_n", coverage.force_68, 0.68, TOLERATED[0]),
        ("half95_n", coverage.force_95, 0.95, TOLERATED[1]),
        ("half68_depth_mm", coverage.depth_68, 0.68, TOLERATED[0]),
        ("half95_depth_mm", coverage.depth_95, 0.95, TOLERATED[1]),
    ];
    let doubt = |(name, share, expected, tolerated): (&str, Option<f64>, f64, f64)| {
        let count = (share? * evaluation.points as f64).round() as usize;
        let (least, most) = share_interval(count, evaluation.points);
        let (amount, size) = match () {
            () if most < expected - tolerated => ("fewer", "small"),
            () if least > expected + tolerated => ("more", "large"),
            () => return None,
        };
        Some(format!(
            "{name} of {solver} is too {size}: it contains {:.0} % of the {} test errors ({:.0} to {:.0} %), clearly {amount} than {:.0} %",
            100.0 * share?,
            evaluation.points,
            100.0 * least,
            100.0 * most,
            100.0 * expected
        ))
    };
    stated.into_iter().filter_map(doubt).collect()
}

#[cfg(test)]
mod tests {
    use super::super::evaluate::Trial;
    use super::super::evaluate::tests::{RUN, run};
    use super::*;
    use palpate_solver::Coverage;

    #[test]
    fn half_widths_that_are_clearly_wrong_are_named_with_the_numbers() {
        let text = |points: usize, location_68: f64, location_95: f64| {
            let presses = run(RUN);
            let evaluation = Trial::of_run(&presses, None).unwrap().evaluate("pearson").unwrap();
            let coverage = Coverage {
                xy_1sd: 0.0,
                xy_2sd: 0.0,
                force_1sd: None,
                force_2sd: None,
                location_68: Some(location_68),
                location_95: Some(location_95),
                force_68: None,
                force_95: None,
                depth_1sd: None,
                depth_2sd: None,
                depth_68: None,
                depth_95: None,
            };
            doubted_half_widths(&Evaluation { points, coverage: Some(coverage), ..evaluation })
        };
        assert_eq!(
            text(100, 0.08, 0.95),
            [
                "half68_mm of pearson is too small: it contains 8 % of the 100 test errors (4 to 15 %), clearly fewer than 68 %"
            ]
        );
        assert!(text(400, 0.95, 1.0)[0].contains("too large"), "{:?}", text(400, 0.95, 1.0));
        assert_eq!(text(400, 0.95, 1.0).len(), 2);
        assert!(text(10, 0.5, 0.9).is_empty(), "ten presses show little");
        assert!(text(100_000, 0.70, 0.96).is_empty(), "small deviations aren't reported, however certain");
    }
}
