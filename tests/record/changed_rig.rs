//! A run continues with the rig of its beginning: each key is compared.

use palpate_run::rig::{KEYS, SIM_RIG};
use palpate_testing::{Live, SMALL, TestFolder, exchanged};
use std::fs;
use std::io::Read as _;
use toml_edit::{DocumentMut, Item, Value};

/// A simulated rig with more keys than the shipped one, which can be changed one by one.
fn rig() -> String {
    let more = "surface = { tilt_mm = 0.0 }\nstiffness = { smooth_percent = 0.0 }\nstage = { servo_ms = 0.0 }\n\
                mounting = { x_mm = 0.0 }\nindenter = { radius_mm = 0.1 }\ntaxels = { radius_mm = 0.1 }\nelastomer =";
    exchanged(SIM_RIG, "elastomer =", more)
}

/// A run on that rig that was killed after its second press.
fn killed() -> TestFolder {
    let bench = TestFolder::with([("r.toml", SMALL), ("rig.toml", &rig())]);
    let mut live = Live::start(bench.command("run r.toml --rig rig.toml --out run --json --pace 20"));
    let _ = (live.line(), live.line());
    live.kill();
    drop(live);
    bench
}

/// Another value of the same kind.
fn another(value: &Value) -> Value {
    match value {
        Value::Float(number) => (number.value() * 1.25 + 0.01).into(),
        Value::Integer(number) => (number.value() + 1).into(),
        Value::Boolean(flag) => (!flag.value()).into(),
        Value::Array(list) => {
            let mut other = list.clone();
            match list.get(0) {
                Some(Value::InlineTable(_)) => _ = other.remove(0),
                Some(first) => _ = other.replace(0, another(first)),
                None => {}
            }
            other.into()
        }
        _ => "another".into(),
    }
}

#[test]
fn a_rig_that_was_changed_is_refused_by_key_and_nothing_is_changed() {
    let bench = killed();
    let began = bench.read("run/rig.toml");
    let mut changed = 0;
    for listed in KEYS.visit() {
        let mut rig: DocumentMut = began.parse().expect("a rig");
        let mut item = Some(rig.as_item_mut());
        for name in listed.path.split('.') {
            item = item.and_then(|item| if item.is_array() { item.get_mut(0) } else { Some(item) });
            item = item.and_then(|item| item.as_table_like_mut()?.get_mut(name));
        }
        match item {
            Some(Item::Value(value)) if !value.is_inline_table() => *value = another(value),
            // a missing key is added if its table exists
            None if !listed.key.example.is_empty() => {
                let Some((table, name)) = listed.path.rsplit_once('.') else { continue };
                let mut parent = Some(rig.as_item_mut());
                for name in table.split('.') {
                    parent = parent.and_then(|item| if item.is_array() { item.get_mut(0) } else { Some(item) });
                    parent = parent.and_then(|item| item.as_table_like_mut()?.get_mut(name));
                }
                let Some(parent) = parent.and_then(Item::as_table_like_mut) else { continue };
                let example: Value = listed.key.example.parse().expect("an example is TOML");
                if listed.key.default().is_some_and(|default| default.to_string() == listed.key.example) {
                    parent.insert(name, Item::Value(another(&example)));
                } else {
                    parent.insert(name, Item::Value(example));
                }
            }
            _ => continue,
        }
        let is_tighter = listed.path == "limits.stiffness_n_mm"; // a larger one: each permit counts on it
        if is_tighter {
            continue;
        }
        bench.write("run/rig.toml", &rig.to_string());
        let before = bench.bytes("run");
        let output = bench.palpate("resume run");
        assert_eq!(output.code, Some(2), "{}: {}", listed.path, output.err);
        let name = listed.path.split('.').collect::<Vec<_>>();
        let is_named = output.running().contains(name[name.len() - 1]);
        assert!(is_named && output.running().contains("the run began with"), "{}: {}", listed.path, output.err);
        assert!(bench.bytes("run") == before, "{} changed something", listed.path);
        changed += 1;
    }
    assert!(changed > 70, "only {changed} keys were changed");
    bench.write("run/rig.toml", &began);
    bench.palpate_ends(0, "resume run");
}

#[test]
fn tighter_limit_is_accepted_recorded_and_both_texts_kept() {
    let bench = killed();
    let began = bench.read("run/rig.toml");
    let tighter = began.replacen("stiffness_n_mm = 2.0", "stiffness_n_mm = 2.5", 1);
    bench.write("run/rig.toml", &tighter);
    let output = bench.palpate_ends(0, "resume run");
    assert!(
        output.err.contains("rig: `limits.stiffness_n_mm` is 2.5 (it was 2.0 when the run began)"),
        "{}",
        output.err
    );
    assert_eq!(bench.read("run/rig-1.toml"), began);
    assert_eq!(bench.read("run/rig.toml"), tighter);
    let change = &bench.manifest("run")["sessions"][1]["changes"][0];
    assert_eq!(change.to_string(), "{\"before\":\"2.0\",\"key\":\"limits.stiffness_n_mm\",\"now\":\"2.5\"}");
    bench.palpate_ends(0, "verify run");
    // looser than at the beginning, though tighter than nothing: refused
    for (from, to) in [("stiffness_n_mm = 2.0", "stiffness_n_mm = 1.0"), ("depth_mm = 1.6", "depth_mm = 3.2")] {
        let bench = killed();
        bench.write("run/rig.toml", &bench.read("run/rig.toml").replacen(from, to, 1));
        let output = bench.palpate_ends(2, "resume run");
        assert!(output.running().contains("the run began with"), "{}", output.err);
    }
}

#[test]
fn another_rig_file_gives_the_links_and_a_lost_one_comes_from_the_journal() {
    let bench = killed();
    let began = bench.read("run/rig.toml");
    bench.write("elsewhere.toml", &began.replacen("depth_mm = 1.6", "depth_mm = 1.5", 1));
    let output = bench.palpate_ends(0, "resume run --rig elsewhere.toml");
    assert!(output.err.contains("`limits.depth_mm` is 1.5"), "{}", output.err);
    assert_eq!((bench.read("run/rig-1.toml"), bench.read("run/rig.toml")), (began, bench.read("elsewhere.toml")));

    let bench = killed();
    let began = bench.read("run/rig.toml");
    fs::remove_file(bench.path("run/rig.toml")).expect("a rig");
    bench.palpate_ends(0, "resume run");
    let mut restored = String::new();
    fs::File::open(bench.path("run/rig.toml")).expect("a rig").read_to_string(&mut restored).expect("a text");
    assert_eq!(restored, began);
}

#[test]
fn simulated_links_do_not_become_real() {
    let bench = killed();
    let began = bench.read("run/rig.toml");
    bench.write("run/rig.toml", &began.replace("link = \"sim\"", "link = \"tcp://127.0.0.1:1\""));
    let output = bench.palpate_ends(2, "resume run");
    for key in ["stage.link", "load_cell.link", "array.link"] {
        assert!(output.running().contains(&format!("`{key}` is \"tcp://127.0.0.1:1\"")), "{}", output.err);
    }
}
