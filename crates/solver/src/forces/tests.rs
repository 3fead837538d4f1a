use super::*;
use rand::RngExt;

/// A taxel with three outputs whose gains differ from group to group by a few percent.
fn table(rows: usize, bent: f64, noise: f64) -> ForceTable {
    let mut rng = stream(1, 0, "rows");
    let made: Vec<(Vec<f64>, [f64; 3], u64)> = (0..rows)
        .map(|row| {
            let mut within = |most: f64| rng.random_range(-most..most);
            let force_n = [within(0.5), within(0.5), 1.0 + within(1.0)];
            let [x, y, z] = force_n;
            let group = row as u64 % 6;
            let gain = 1.0 + 0.02 * group as f64;
            let outputs = [2.0 * x + 0.3 * z, 1.5 * y - 0.2 * z, z + bent * z * z + 0.1 * x];
            (outputs.iter().map(|output| gain * output + within(noise)).collect(), force_n, group)
        })
        .collect();
    ForceTable::new(made.iter().map(|(outputs, force_n, group)| (outputs.as_slice(), *force_n, *group))).unwrap()
}

fn rmse_n(evaluation: &ForceEvaluation, method: &str) -> [f64; 3] {
    let found = evaluation.methods.iter().find(|errors| errors.method == method).unwrap();
    found.components.map(|component| component.rmse_n)
}

#[test]
fn best_is_hardly_worse_than_the_best_method_in_any_component() {
    for (bent, noise) in [(0.3, 0.02), (0.3, 0.3)] {
        let evaluation = evaluate_forces(&table(150, bent, noise)).unwrap();
        let best = rmse_n(&evaluation, "best");
        for component in 0..3 {
            let least = METHODS.iter().map(|name| rmse_n(&evaluation, name)[component]).fold(f64::INFINITY, f64::min);
            assert!(best[component] <= 1.05 * least, "{bent} {noise} {component}: {best:?}, {least}");
        }
        assert!(best[0] < 0.2 && evaluation.folds == 6, "{evaluation:?}");
    }
}

#[test]
fn a_bent_response_needs_more_than_the_linear_regression() {
    let evaluation = evaluate_forces(&table(150, 0.3, 0.01)).unwrap();
    let ([.., linear], [.., best]) = (rmse_n(&evaluation, "linear"), rmse_n(&evaluation, "best"));
    assert!(best < 0.8 * linear, "{best} {linear}");
}

#[test]
fn rows_that_say_nothing_are_refused_and_a_dead_output_is_ignored() {
    let rows = |count: usize, group: u64| {
        (0..count).map(move |row| ([0.0, (row % 2) as f64], [0.0, 0.0, 1.0], group)).collect::<Vec<_>>()
    };
    let new = |rows: &[([f64; 2], [f64; 3], u64)]| {
        ForceTable::new(rows.iter().map(|(outputs, force_n, group)| (outputs.as_slice(), *force_n, *group)))
    };
    assert_eq!(new(&rows(5, 0)).unwrap_err(), ForceTableError::TooFew { rows: 5 });
    assert_eq!(evaluate_forces(&new(&rows(50, 0)).unwrap()).unwrap_err(), ForceTableError::OneGroup);
    assert_eq!(new(&[([0.0, 1.0], [0.0; 3], 0); 40]).unwrap_err(), ForceTableError::Constant);
    let one_more = [rows(40, 0), rows(1, 1)].concat();
    assert_eq!(evaluate_forces(&new(&one_more).unwrap()).unwrap_err(), ForceTableError::TooFew { rows: 1 });
    let mut infinite = rows(50, 0);
    infinite[7].0[1] = f64::NAN;
    assert_eq!(new(&infinite).unwrap_err(), ForceTableError::Row { row: 7 });
    let regression = ForceRegression::fit(&new(&rows(50, 0)).unwrap());
    assert!((regression.solve(&[0.0, 1.0])[2] - 1.0).abs() < 1e-6);
}

#[test]
fn the_same_table_gives_the_same_answers() {
    let solve = || ForceRegression::fit(&table(200, 0.3, 0.1)).solve(&[0.5, 0.1, 1.2]);
    assert_eq!(solve(), solve());
}
