//! Section about the origin of the run: recipe, devices, sessions, and everything unusual.

use super::Subject;
use super::frame::{clock, section as framed, words};
use maud::{Markup, html};
use palpate_control::Trip;
use palpate_data::dataset::{Flag, Imported, Loss, Recorded, RigChange};
use std::collections::BTreeMap;

/// Creates a part for each run.
pub(super) fn section(subject: &Subject) -> Option<Markup> {
    let body = html! { @for run in &subject.runs { (of_run(run)) } };
    Some(framed("Devices, program and files", &body))
}

fn of_run(run: &Recorded) -> Markup {
    let manifest = &run.manifest;
    let facts = &manifest.facts;
    let presses = format!("{} of {}, {}", manifest.presses_done, facts.presses_planned, manifest.status.name());
    let mut rows: Vec<(&str, String)> = match &facts.imported {
        None => vec![
            ("recipe", facts.recipe.clone()),
            ("presses", presses),
            ("time in the run", format!("{:.1} min", manifest.virtual_s / 60.0)),
            ("seed", facts.seed.to_string()),
        ],
        Some(imported) => imported_rows(imported, presses),
    };
    rows.splice(0..0, facts.labels.given().map(|(name, label)| (name, label.to_owned())));
    if let Some(strategy) = facts.strategy {
        rows.push(("strategy", strategy.name().to_owned()));
    }
    for session in &manifest.sessions {
        let commit = session.commit.as_ref().map(|commit| format!(" ({commit})")).unwrap_or_default();
        let text = format!(
            "{}, palpate {}{commit} on {}, {}",
            clock(&session.started),
            session.palpate,
            session.host,
            session.system
        );
        rows.push(("began", text));
        let changed = |change: &RigChange| format!("{} is {}; it was {}", change.key, change.now, change.before);
        rows.extend(session.changes.iter().map(|change| ("rig changed", changed(change))));
    }
    for Loss { accepted, lost, journal } in &manifest.losses {
        let given =
            [("journal exchanged", journal), ("presses lost", lost)].into_iter().filter(|(_, of)| !of.is_empty());
        rows.extend(given.map(|(what, of)| (what, format!("accepted {}: {}", clock(accepted), of.join("; ")))));
    }
    rows.extend(manifest.ended.iter().map(|ended| ("ended", clock(ended))));
    rows.push(("flagged rows", flags(run)));
    rows.extend(manifest.glitches.text().map(|text| ("glitches", text)));
    rows.extend(manifest.missed.text().map(|text| ("missed readings", text)));
    if facts.imported.is_none() && !facts.without_load_cell {
        rows.push(("zero without load", zeros(run)));
    }
    let trips = run.trips.iter().map(|(t_s, press, trip)| ("safety trip", trip_text(*t_s, *press, trip)));
    rows.extend(trips);
    for touch in &run.retouches {
        let (x_mm, y_mm) = (touch.place.x_mm, touch.place.y_mm);
        let moved_um = 1000.0 * (touch.touched_mm - touch.before_mm);
        rows.push(("touched again", format!("({x_mm}, {y_mm}) mm: moved by {moved_um:+.1} um")));
    }
    rows.extend(run.checks.iter().map(|check| ("check", check.line())));
    let devices: Vec<[Markup; 3]> = manifest
        .devices
        .iter()
        .map(|device| {
            let warned = device.warnings.iter().map(|warning| format!("; {warning}")).collect::<String>();
            [words(&device.role), words(format!("{}{warned}", device.identity)), words(&device.link)]
        })
        .collect();
    html! {
        h3 { (run.name()) }
        div.wide {
            table { tbody { @for (name, text) in &rows { tr { th scope="row" { (name) } td.words { (text) } } } } }
        }
        @if !devices.is_empty() {
            div.wide {
                table {
                    thead { tr { th scope="col" { "device" } th.words scope="col" { "reported identity" } th.words scope="col" { "link" } } }
                    tbody {
                        @for [role, identity, link] in &devices {
                            tr { th scope="row" { (role) } td.words { (identity) } td.words { (link) } }
                        }
                    }
                }
            }
        }
        p.note {
            "In the same folder: " (if facts.imported.is_none() { "recipe.toml and rig.toml as given" } else { "columns.toml, if one was given" })
            ", journal.log, presses.csv; SHA-256 of each in manifest.json."
        }
    }
}

/// Returns the origin of an import.
fn imported_rows(imported: &Imported, presses: String) -> Vec<(&'static str, String)> {
    let mut rows = vec![("presses", format!("{presses}: imported, not measured by this program"))];
    let measured = imported.measured.as_deref().unwrap_or("not stated");
    rows.push(("measured on", measured.to_owned()));
    rows.extend(imported.files().map(|file| ("imported from", format!("{}, SHA-256 {}", file.name, file.sha256))));
    rows.extend(imported.notes.iter().map(|note| ("on import", note.clone())));
    rows
}

fn flags(run: &Recorded) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let levels = run.contacts.iter().flat_map(|contact| &contact.levels);
    levels.flat_map(|press| &press.flags).for_each(|flag: &Flag| *counts.entry(flag.name()).or_default() += 1);
    let text: Vec<String> = counts.iter().map(|(flag, count)| format!("{count} {flag}")).collect();
    if text.is_empty() { "none".to_owned() } else { format!("{}: {}", run.manifest.rows_flagged, text.join(", ")) }
}

fn zeros(run: &Recorded) -> String {
    let offsets = || run.zeros.iter().map(|(_, offset_n)| 1000.0 * offset_n);
    match (offsets().next(), offsets().reduce(f64::min), offsets().reduce(f64::max)) {
        (Some(first), Some(least), Some(most)) => {
            format!(
                "taken {}, {first:.1} mN at first, {:.1} mN between largest and smallest",
                if run.zeros.len() == 1 { "once".to_owned() } else { format!("{} times", run.zeros.len()) },
                most - least
            )
        }
        _ => "never taken".to_owned(),
    }
}

fn trip_text(t_s: f64, press: Option<u64>, trip: &Trip) -> String {
    let press = press.map(|press| format!(", press {press}")).unwrap_or_default();
    format!("at {t_s:.1} s{press}: {trip}")
}
