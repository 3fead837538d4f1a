//! Values of the monitors at the presses.

use super::Subject;
use super::frame::Section;
use super::record::{by_press, presses};
use maud::html;
use palpate_data::recipe::Phase;
use std::collections::BTreeMap;

/// Creates a figure for each monitor; `None` if the runs have none.
pub(super) fn section(subject: &Subject) -> Option<Section> {
    let mut values: BTreeMap<&str, Vec<(Phase, f64, f64)>> = BTreeMap::new();
    for (press, contact) in presses(&subject.runs) {
        let Some(phase) = contact.levels.first().and_then(|level| level.phase) else { continue };
        for monitor in &contact.monitors {
            values.entry(&monitor.name).or_default().push((phase, press, monitor.value));
        }
    }
    let figure = |(name, points): (&&str, &Vec<_>)| {
        Some(
            by_press(&format!("Monitor {name}"), name, points, false, f64::INFINITY)?
                .named(&format!("press-monitor-{name}")),
        )
    };
    let drawn: Vec<_> = values.iter().filter_map(figure).collect();
    let before = html! {
        p.note { "Values that slow devices of the rig read without load before each press. Several presses may have one reading; "
            "monitors.csv has the times." }
    };
    (!drawn.is_empty()).then(|| Section::new("Monitors", &before, drawn))
}
