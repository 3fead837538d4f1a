//! The library of published protocols: each is listed, written by `init`, checked and run.

use palpate_testing::{TestFolder, campaign};

/// The protocols, each with the number of its presses and the name of its recipe.
const PROTOCOLS: [(&str, usize, &str); 4] = [
    ("liu-2018", 770, "paper"),
    ("tue-matrix", 675, "tue-matrix"),
    ("shaevitz-barometers", 338, "shaevitz-barometers"),
    ("fkeel-interdigitation", 1562, "fkeel-interdigitation"),
];

/// Those with a load cell.
const BY_FORCE: [&str; 2] = ["liu-2018", "tue-matrix"];

/// Five places of every protocol.
const PLACES: &str = "list = { places_mm = [[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] }";

#[test]
fn every_protocol_is_listed_written_and_checked() {
    let bench = TestFolder::new();
    let listed = bench.palpate_ends(0, "list protocols").out;
    for (name, presses, _) in PROTOCOLS {
        assert!(listed.contains(name), "{listed}");
        let written = bench.palpate_ends(0, &format!("init {name} --from protocol:{name}")).out;
        assert!(written.contains("recipe.toml") && written.contains("rig.toml"), "{written}");
        let checked = bench.palpate_ends(0, &format!("check {name}/recipe.toml --simulate --json")).json_lines();
        assert_eq!(checked[0]["plan"]["presses"].as_u64().or(checked[0]["presses"].as_u64()), Some(presses as u64));
    }
    let listed = listed.split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(listed.matches("; whole").count(), PROTOCOLS.len());
    let refused = bench.palpate_ends(2, "init other --from protocol:liu-2019").err;
    assert!(refused.contains("protocol:liu-2018"), "{refused}");
}

#[test]
fn five_presses_of_every_protocol_run_on_its_rig() {
    let bench = TestFolder::new();
    for (name, ..) in PROTOCOLS {
        bench.palpate_ends(0, &format!("init {name} --from protocol:{name}"));
        let load = if BY_FORCE.contains(&name) { "force_n = 1.0" } else { "depth_mm = 0.3" };
        bench.write("five.toml", &format!("name = \"five\"\n[[step]]\nphase = \"calibration\"\n{PLACES}\n{load}\n"));
        bench.palpate_ends(0, &format!("run five.toml --rig {name}/rig.toml --simulate --out {name}/five"));
        assert_eq!(bench.manifest(&format!("{name}/five"))["presses_done"], 5, "{name}");
    }
}

#[test]
fn every_protocol_runs_whole() {
    if campaign::is_quick() {
        return; // the full tier runs them
    }
    let bench = TestFolder::new();
    for (name, presses, recipe) in PROTOCOLS {
        bench.palpate_ends(0, &format!("init {name} --from protocol:{name}"));
        bench.palpate_ends(0, &format!("run {name}/recipe.toml --rig {name}/rig.toml --simulate --out {name}/run"));
        let manifest = bench.manifest(&format!("{name}/run"));
        assert_eq!(manifest["presses_done"], presses, "{name}");
        assert_eq!(manifest["recipe"], recipe);
    }
}
