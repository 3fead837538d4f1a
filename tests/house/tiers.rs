//! The size of a campaign follows from one variable alone.

use palpate_testing::campaign::Tier;
use std::fs;
use std::path::{Path, PathBuf};

#[test]
fn a_tier_is_quick_or_full_or_a_multiple_of_full() {
    for (value, expected) in [
        (None, Tier::Quick),
        (Some("quick"), Tier::Quick),
        (Some("full"), Tier::Share(1.0)),
        (Some("0.2"), Tier::Share(0.2)),
        (Some("20"), Tier::Share(20.0)),
    ] {
        assert_eq!(Tier::parse(value), Ok(expected), "{value:?}");
    }
    for value in ["", "all", "0", "-1", "nan", "inf", "full "] {
        let output = Tier::parse(Some(value)).expect_err(value);
        for part in ["PALPATE_TESTS", value, "`quick`", "`full`", "`0.2`"] {
            assert!(output.contains(part), "{part}: {output}");
        }
    }
}

#[test]
fn a_multiple_is_rounded_up_and_is_no_less_than_quick() {
    for (tier, quick, full, expected) in [
        (Tier::Quick, 5, 50, 5),
        (Tier::Share(1.0), 5, 50, 50),
        (Tier::Share(20.0), 5, 50, 1000),
        (Tier::Share(0.2), 5, 50, 10),
        (Tier::Share(0.05), 5, 50, 5),
        (Tier::Share(0.5), 1, 3, 2),
        (Tier::Share(0.2), 1, 1, 1),
        (Tier::Share(0.2), 9, 3, 3),
    ] {
        assert_eq!(tier.size(quick, full), expected, "{tier:?} of {quick} and {full}");
    }
}

#[test]
fn fraction_of_a_campaign_skips_trials_evenly() {
    for (tier, quick, full, expected) in [
        (Tier::Quick, 97, 1, 97),
        (Tier::Share(1.0), 97, 1, 1),
        (Tier::Share(0.2), 97, 1, 5),
        (Tier::Share(20.0), 97, 1, 1),
        (Tier::Share(1.0), 97, 11, 11),
        (Tier::Share(20.0), 97, 11, 1),
        (Tier::Share(0.1), 5, 2, 5),
    ] {
        assert_eq!(tier.every(quick, full), expected, "{tier:?} of {quick} and {full}");
    }
}

#[test]
fn no_test_reads_the_build_profile_or_passes_as_a_skipped_one() {
    let mut files = Vec::new();
    rust_files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests"), &mut files);
    assert!(files.len() > 100, "{} files", files.len());
    let never = [concat!("debug", "_assertions"), concat!("skipped", "(")];
    for path in files {
        let text = fs::read_to_string(&path).expect("a text");
        for word in never {
            assert!(!text.contains(word), "{} has {word}", path.display());
        }
    }
}

fn rust_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for path in fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        if path.is_dir() {
            rust_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}
