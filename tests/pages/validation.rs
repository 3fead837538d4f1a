//! `docs/validation.md` is what the program finds.

use crate::support::{Bench, shipped_text};

#[test]
fn the_page_on_validation_is_what_the_program_writes() {
    let bench = Bench::new();
    let told = bench.palpate_ends(0, "study validation --out found");
    assert!(told.out.lines().all(|line| line.chars().count() <= 80), "{}", told.out);
    let found = bench.read("found/validation.md");
    let kept = shipped_text("docs/validation.md");
    for (line, (found, kept)) in found.lines().zip(kept.lines()).enumerate() {
        assert_eq!(found, kept, "line {}: `palpate study validation` writes it anew", line + 1);
    }
    assert_eq!(found, kept);
}

#[test]
fn a_first_look_has_a_row_a_specimen_and_is_the_same_twice() {
    let bench = Bench::new();
    let rows = bench.palpate_ends(0, "study validation --quick --json --seed 7 --out a").json_lines();
    let seeds: Vec<u64> = rows.iter().filter_map(|row| row["seed"].as_u64()).collect();
    assert_eq!(seeds, [7, 8]);
    for row in rows.iter().filter(|row| row["study"] == "validation") {
        assert_eq!((row["presses"].as_u64(), row["papers"]["points"].as_u64()), (Some(770), Some(100)));
        assert!(
            row["best"]["location_error_mm"]["mean"].as_f64() < row["papers"]["location_error_mm"]["mean"].as_f64()
        );
    }
    assert!(rows.iter().any(|row| row["verdict"] == "fails"), "claims are among the rows");
    bench.palpate_ends(0, "study validation --quick --json --seed 7 --out b");
    assert_eq!(bench.bytes("a"), bench.bytes("b"));
}
