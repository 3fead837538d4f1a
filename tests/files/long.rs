//! A long run in the lake has all of its presses. `cargo bench --features files --bench lake` prints the cost of one.

use crate::killed::visible;
use crate::recorded::recorded;
use palpate_report::export::lake::Lake;

const PRESSES: u64 = 10_000;

#[test]
fn long_run_is_completely_in_the_lake() {
    let home = tempfile::tempdir().unwrap();
    let (run, place) = (home.path().join("run"), home.path().join("lake"));
    recorded(&run, PRESSES);
    let mut lake = Lake::open(&place).unwrap();
    let staged = lake.stage(&run).unwrap();
    assert_eq!(visible(&place), [], "nothing is seen before it is published");
    let output = lake.publish(staged).unwrap();
    assert!(output.starts_with(&format!("{PRESSES} presses at ")), "{output}");
    let rows: Vec<i64> = visible(&place).into_iter().map(|(_, rows)| rows).collect();
    assert_eq!(rows, [PRESSES as i64]);
}
