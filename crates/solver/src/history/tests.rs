use super::*;

#[test]
fn times_that_go_back_and_short_series_are_refused() {
    let row = |t_s: f64| (t_s, [1.0, 2.0], 0.5);
    let new = |rows: &[(f64, [f64; 2], f64)]| {
        Series::new(rows.iter().map(|(t_s, outputs, force_n)| (*t_s, outputs.as_slice(), *force_n))).unwrap_err()
    };
    assert_eq!(new(&[row(0.0), row(1.0), row(1.0)]), SeriesError::Order { row: 2 });
    assert_eq!(new(&[row(0.0), row(1.0)]), SeriesError::TooFew { rows: 2 });
    assert_eq!(new(&[row(0.0), row(f64::NAN)]), SeriesError::Table(ForceTableError::Row { row: 1 }));
}
