//! The library of published protocols: each is listed, written by `init`, checked and run.

use palpate_testing::{TestFolder, campaign};

/// The protocols, each with the number of its presses and the name of its recipe.
const PROTOCOLS: [(&str, usize, &str); 8] = [
    ("liu-2018", 770, "paper"),
    ("tue-matrix", 675, "tue-matrix"),
    ("shaevitz-barometers", 961, "shaevitz-barometers"),
    ("fkeel-interdigitation", 1562, "fkeel-interdigitation"),
    ("py3dcal-reskin", 567, "py3dcal-reskin"),
    ("printed-membrane", 11000, "printed-membrane"),
    ("sensor-probing", 5000, "sensor-probing"),
    ("ts-comparison", 2, "ts-comparison"),
];

/// Those with a load cell.
const BY_FORCE: [&str; 4] = ["liu-2018", "tue-matrix", "printed-membrane", "ts-comparison"];

/// That which keeps readings over time, in a file of the feature `files`.
const OVER_TIME: &str = "ts-comparison";

/// What `list protocols` prints.
const LISTED: &str = "\
protocols: palpate init --from protocol:NAME
  liu-2018               Sensors 2018, 18, 351; 770 presses by force; whole
  tue-matrix             HaodongZheng/Tactile-Sensor-Array-Test-Bed-TU-e-
                         Robotics-Motion-Lab-, commit 3aa972f; 675 presses by
                         force; in part: places, forces and array aren't
                         published, and are our own
  shaevitz-barometers    Shaevitzaiden/Underwater-Tactile-Sensor, commit
                         1745e63, sensorTestBench-Final.py; 961 presses by
                         depth, no load cell; in part: presses by a dead weight,
                         temperatures, each single reading
  fkeel-interdigitation  fkeel/interdigitation, commit a260f25: 17 designs of
                         textile strips; 1562 presses by depth, no load cell; in
                         part: presses to a height of the machine; where the
                         surface is isn't published
  py3dcal-reskin         rohankotanu/py3DCal, commit d0e3631, data_collection/
                         sensors/ReSkin; 567 presses by depth, no load cell; in
                         part: ten single readings of each press
  printed-membrane       DSHardman/PrintedMembrane, commit 0fbdf02,
                         PrinterControl.py; 11000 presses by force; in part:
                         frames of the board over time
  sensor-probing         DSHardman/SensorProbing, commit 03b5bb4,
                         RandomSynchronised.py; 5000 presses by depth, no load
                         cell; in part: readings over time, on a rig without a
                         load cell
  ts-comparison          sonjagross/TS_Comparison, commit bb91037, code/
                         RobotControl/python; 2 presses by force; in part: shear
                         and slip; speeds toward the specimen are those that are
                         safe

`palpate reference protocols` lists what other published protocols lack.
";

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
        if name == OVER_TIME && cfg!(not(feature = "files")) {
            let refused = bench.palpate_ends(2, &format!("check {name}/recipe.toml --simulate")).running();
            assert!(refused.contains("`series` needs the feature `files`"), "{refused}");
            continue;
        }
        let checked = bench.palpate_ends(0, &format!("check {name}/recipe.toml --simulate --json")).json_lines();
        assert_eq!(checked[0]["plan"]["presses"].as_u64().or(checked[0]["presses"].as_u64()), Some(presses as u64));
    }
    assert_eq!(listed, LISTED);
    let objects = bench.palpate_ends(0, "list protocols --json").json_lines();
    for (name, presses, _) in PROTOCOLS {
        let all = objects[0]["protocols"].as_array().unwrap();
        let object = all.iter().find(|object| object["name"] == name).unwrap();
        assert_eq!(object["presses"], presses, "{name}");
        // the page, the list and the source agree; a bench that was never published in full isn't whole
        assert_eq!(object["is_whole"], name == "liu-2018", "{name}");
        assert_eq!(object["is_whole"], object["lacks"].is_null(), "{name}");
    }
    let page = bench.palpate_ends(0, "reference protocols").out;
    assert_eq!((page.matches("| whole: ").count(), page.matches("| in part: ").count()), (1, 7));
    let refused = bench.palpate_ends(2, "list rigs/esp301 --json").err;
    assert!(refused.contains("a file is printed as it is"), "{refused}");
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
    let here = |(name, ..): &(&str, usize, &str)| *name != OVER_TIME || cfg!(feature = "files");
    for (name, presses, recipe) in PROTOCOLS.into_iter().filter(here) {
        bench.palpate_ends(0, &format!("init {name} --from protocol:{name}"));
        bench.palpate_ends(0, &format!("run {name}/recipe.toml --rig {name}/rig.toml --simulate --out {name}/run"));
        let manifest = bench.manifest(&format!("{name}/run"));
        assert_eq!(manifest["presses_done"], presses, "{name}");
        assert_eq!(manifest["recipe"], recipe);
    }
}
