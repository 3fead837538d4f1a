//! Differences between two rigs, key by key, and whether a run begun on one may continue on the other.

use super::keys::limits;
use super::{KEYS, keys};
use palpate_document::{self as document, GivenValue, KeyChange, Problems};

/// A key with different values in two rigs.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Path of the key: `limits.force_n`. A table in a list has its number, counted from 1: `scene.fault[2].kind`.
    pub path: String,
    /// Value in the first rig as written, or its default; `not set` without either.
    pub before: String,
    /// Value in the second rig, in the same way.
    pub now: String,
    /// Consequence for a run that was begun on the first rig.
    pub verdict: Consequence,
}

/// Consequence of a difference between two rigs for a run that was begun on the first and continues on the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Consequence {
    /// The same device has another address: a link between real devices, or the command of a program. Or another program is
    /// notified.
    Link,
    /// A limit of the specimen became stricter: a smaller force, a smaller depth, or a larger stiffness.
    Tighter,
    /// The rig is a different rig.
    Other,
}

impl Difference {
    /// Whether a limit of the specimen isn't as strict as before. The least stiffness is stricter if it is larger, or if it is set at
    /// all.
    pub fn is_wider_limit(&self) -> bool {
        let Some(key) = self.path.strip_prefix(keys::root::limits.name) else { return false };
        let number = |text: &str| text.parse::<f64>().ok();
        let is_raised = number(&self.now) >= number(&self.before);
        self.verdict == Consequence::Other && !(key.ends_with(limits::stiffness_least_n_mm.name) && is_raised)
    }
}

/// Returns the keys with different values in two rigs, in the order of the list of keys. A missing key has its default. Numbers
/// are compared by value, not by spelling. A missing `[scene]` differs from a `[scene]` with the paper's values.
///
/// # Errors
/// A text isn't TOML.
pub fn differences(before: &str, now: &str) -> Result<Vec<Difference>, Problems> {
    let changes = document::differences(&KEYS, ("the rig before", before), ("the rig now", now))?;
    let shown = |given: Option<GivenValue>| given.map_or_else(|| "not set".to_owned(), |given| given.text);
    let difference = |change: KeyChange| {
        let verdict = verdict(&change);
        Difference { path: change.path, before: shown(change.before), now: shown(change.now), verdict }
    };
    Ok(changes.into_iter().map(difference).collect())
}

fn verdict(change: &KeyChange) -> Consequence {
    let (before, now) = (change.before.as_ref(), change.now.as_ref());
    let numbers = before.and_then(|given| given.number).zip(now.and_then(|given| given.number));
    let is_limit = |key: &document::Key| change.path == format!("{}.{}", keys::root::limits.name, key.name);
    let is_simulated = |given: &GivenValue| given.text.trim_matches(['"', '\'']) == "sim";
    match change.path.split('.').collect::<Vec<_>>()[..] {
        // in a rig where any link is simulated all are: none becomes real, or the other way round
        [_, "link"] if !before.into_iter().chain(now).any(is_simulated) => Consequence::Link,
        ["notify", ..] => Consequence::Link,
        [_, "driver", "process"] if before.is_some() && now.is_some() => Consequence::Link,
        _ => match numbers {
            Some((before, now)) if is_limit(&limits::force_n) && now < before => Consequence::Tighter,
            Some((before, now)) if is_limit(&limits::depth_mm) && now < before => Consequence::Tighter,
            // the largest stiffness that the specimen may have: each permit counts on it
            Some((before, now)) if is_limit(&limits::stiffness_n_mm) && now > before => Consequence::Tighter,
            _ => Consequence::Other,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::SIM_RIG;
    use palpate_document::sample::{most_cases, sample};
    use std::collections::BTreeSet;

    fn verdicts(before: &str, now: &str) -> Vec<(String, String, String, Consequence)> {
        let found = differences(before, now).unwrap();
        found.into_iter().map(|found| (found.path, found.before, found.now, found.verdict)).collect()
    }

    fn changed(from: &str, to: &str) -> Vec<(String, String, String, Consequence)> {
        assert!(SIM_RIG.contains(from), "{from}");
        verdicts(SIM_RIG, &SIM_RIG.replacen(from, to, 1))
    }

    fn one(path: &str, before: &str, now: &str, verdict: Consequence) -> Vec<(String, String, String, Consequence)> {
        vec![(path.to_owned(), before.to_owned(), now.to_owned(), verdict)]
    }

    #[test]
    fn changed_limits_must_be_tighter() {
        use Consequence::{Other, Tighter};
        for (key, tighter, looser) in
            [("force_n = 2.0", "1.5", "2.5"), ("depth_mm = 1.6", "1.5", "1.7"), ("stiffness_n_mm = 2.0", "2.5", "1.5")]
        {
            let (name, value) = key.split_once(" = ").unwrap();
            let path = format!("limits.{name}");
            assert_eq!(changed(key, &format!("{name} = {tighter}")), one(&path, value, tighter, Tighter));
            assert_eq!(changed(key, &format!("{name} = {looser}")), one(&path, value, looser, Other));
        }
        assert_eq!(changed("speed_mm_s = 10.0", "speed_mm_s = 9.0"), one("stage.speed_mm_s", "10.0", "9.0", Other));
    }

    #[test]
    fn a_limit_is_wider_if_it_is_less_strict_than_before() {
        let least = |text: &str| format!("stiffness_n_mm = 2.0\n{text}");
        for (from, to, is_wider) in [
            ("force_n = 2.0", "force_n = 2.5", true),
            ("force_n = 2.0", "force_n = 1.5", false),
            ("stiffness_n_mm = 2.0", "stiffness_n_mm = 1.5", true),
            ("speed_mm_s = 10.0", "speed_mm_s = 20.0", false),
            ("stiffness_n_mm = 2.0", &least("stiffness_least_n_mm = 0.9"), false),
        ] {
            let found = differences(SIM_RIG, &SIM_RIG.replacen(from, to, 1)).unwrap();
            assert_eq!(found.iter().map(Difference::is_wider_limit).collect::<Vec<_>>(), [is_wider], "{to}");
        }
        let rig = |n_mm: &str| format!("[limits]\nstiffness_least_n_mm = {n_mm}\n");
        for (before, now, is_wider) in [("0.9", "1.0", false), ("0.9", "0.8", true)] {
            let found = differences(&rig(before), &rig(now)).unwrap();
            assert_eq!(found.iter().map(Difference::is_wider_limit).collect::<Vec<_>>(), [is_wider], "{now}");
        }
        assert!(differences(&rig("0.9"), "[limits]\n").unwrap()[0].is_wider_limit());
    }

    #[test]
    fn links_and_commands_may_change_but_not_between_simulated_and_real() {
        let link = |text: &str| format!("[stage]\ndriver = \"grbl\"\n{text}\n");
        let (one_port, other, sim) = ("link = \"serial:///dev/a?baud=1\"", "link = \"tcp://a:1\"", "link = 'sim'");
        let verdict = |before: &str, now: &str| verdicts(&link(before), &link(now)).into_iter().map(|found| found.3);
        assert!(verdict(one_port, other).eq([Consequence::Link]));
        for (before, now) in [(sim, other), (other, sim), (sim, "")] {
            assert!(verdict(before, now).eq([Consequence::Other]), "{before} {now}");
        }
        let driver = |text: &str| format!("[array]\ndriver = {{ {text} }}\n");
        let (mine, others) = (driver("process = [\"a\"]"), driver("process = [\"b\", \"c\"]"));
        let found = one("array.driver.process", "[\"a\"]", "[\"b\", \"c\"]", Consequence::Link);
        assert_eq!(verdicts(&mine, &others), found);
        let found = verdicts(&mine, &driver("modbus = \"labjack-t7\""));
        assert!(found.iter().all(|found| found.3 == Consequence::Other) && found.len() == 2, "{found:?}");
    }

    #[test]
    fn equivalent_rigs_have_no_difference() {
        assert_eq!(verdicts(SIM_RIG, SIM_RIG), []);
        for (from, to) in [
            ("speed_mm_s = 10.0", "speed_mm_s = 1e1"),
            ("settle_ms = 10.0", "# by default"),
            ("lag_ms = 0.0", ""),
            ("x = [-12.5, 12.5], y", "x = [ -12.50, +12.5 ], y"),
            ("[frame]", "[frame] # elsewhere\nrotation_deg = 0"),
            ("linear_n_mm = 1.1, quadratic_n_mm2 = 0.1556", "quadratic_n_mm2 = 0.1556, linear_n_mm = 1.1"),
        ] {
            assert_eq!(changed(from, to), [], "{to}");
        }
    }

    #[test]
    fn a_table_of_a_list_is_named_by_its_number() {
        let fault = |kind: &str| format!("\n[[scene.fault]]\nkind = \"{kind}\"\nfrom_s = 1.0\n");
        let (first, second) = (format!("{SIM_RIG}{}", fault("slip")), format!("{SIM_RIG}{0}{0}", fault("slip")));
        let found = one("scene.fault[2]", "not set", "{ from_s = 1.0, kind = \"slip\" }", Consequence::Other);
        assert_eq!(verdicts(&first, &second), found);
        let other = format!("{first}{}", fault("stuck"));
        let found = one("scene.fault[2].kind", "\"slip\"", "\"stuck\"", Consequence::Other);
        assert_eq!(verdicts(&second, &other), found);
        assert_eq!(verdicts(SIM_RIG, &first)[0].0, "scene.fault[1]");
    }

    /// Another value; none of a table, whose keys have others.
    fn another(value: &toml_edit::Value) -> Option<toml_edit::Value> {
        use toml_edit::Value;
        Some(match value {
            Value::InlineTable(_) => return None,
            Value::Array(list) if list.iter().any(Value::is_inline_table) => return None,
            Value::Array(list) => list.iter().take(list.len() - 1).cloned().collect(),
            Value::Float(number) => (number.value() + 1.0).into(),
            Value::Integer(number) => (number.value() + 1).into(),
            Value::Boolean(flag) => (!flag.value()).into(),
            _ => "another".into(),
        })
    }

    #[test]
    fn any_one_key_that_differs_is_reported_with_its_verdict() {
        let mut reported = BTreeSet::new();
        for case in 0..=most_cases(&KEYS) {
            let text = sample(&KEYS, case);
            for listed in KEYS.visit() {
                let mut rig: toml_edit::DocumentMut = text.parse().unwrap();
                let (mut item, mut path) = (Some(rig.as_item_mut()), String::new());
                for name in listed.path.split('.') {
                    item = item.and_then(|item| if item.is_array() { item.get_mut(0) } else { Some(item) });
                    item = item.and_then(|item| item.get_mut(name));
                    let is_list = item.as_ref().is_some_and(|item| item.is_array());
                    path += &format!(
                        "{}{name}{}",
                        if path.is_empty() { "" } else { "." },
                        if is_list { "[1]" } else { "" }
                    );
                }
                let Some(value) = item.and_then(|item| item.as_value_mut()) else { continue };
                let Some(other) = another(value) else { continue };
                let shown = |value: &toml_edit::Value| value.to_string().trim().to_owned();
                let (before, now) = (shown(value), shown(&other));
                *value = other;
                let verdict = match listed.path.as_str() {
                    "stage.link" | "load_cell.link" | "array.link" | "monitor.link" | "notify.command" => {
                        Consequence::Link
                    }
                    path if path.ends_with("driver.process") => Consequence::Link,
                    "limits.stiffness_n_mm" => Consequence::Tighter,
                    _ => Consequence::Other,
                };
                let path = path.strip_suffix("[1]").unwrap_or(&path);
                assert_eq!(verdicts(&text, &rig.to_string()), one(path, &before, &now, verdict));
                reported.insert(listed.path);
            }
        }
        let inner: BTreeSet<String> =
            KEYS.visit().iter().filter_map(|listed| Some(listed.path.rsplit_once('.')?.0.to_owned())).collect();
        let listed = KEYS.visit().into_iter().map(|listed| listed.path);
        let missing: Vec<String> = listed.filter(|path| !reported.contains(path) && !inner.contains(path)).collect();
        assert_eq!(missing, [""; 0]);
    }
}
