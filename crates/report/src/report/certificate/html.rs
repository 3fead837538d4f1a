//! The certificate as a page that prints on A4.

use super::given::NamedAddress;
use super::results::{ResultRow, ResultTable, Uncertainty};
use super::{Certificate, NOT_SIGNED, UsedInstrument};
use crate::report::frame::{document as page, section, table, words};
use maud::{Markup, html};
use palpate_core::quantity::round;
use palpate_data::acceptance::{Decision, SensorVerdict};

/// Returns the complete page.
pub(super) fn document(certificate: &Certificate<'_>) -> String {
    let given = certificate.given;
    let body = html! {
        header {
            h1 { "Calibration certificate" }
            p.lede { (given.identifier) ", revision " (given.revision) ", issued " (given.issued) }
        }
        @if certificate.simulated {
            div class="verdict bad" { strong { "Simulated" } p { "The runs were made on a simulated rig: this page certifies no sensor." } }
        }
        (section("Sensor", &facts(&item(certificate))))
        (section("Calibration", &facts(&calibration(certificate))))
        (section("Instruments", &instruments(certificate)))
        @for results in &certificate.results { (section(results.title, &of(results))) }
        (section("Conformity", &conformity(certificate)))
        (section("Not measured", &html! { ul { @for text in &certificate.not_measured { li { (text) } } } }))
        (section("Record", &record(certificate)))
        (section("Responsible", &signatures(certificate)))
    };
    page(&format!("Calibration certificate {}", given.identifier), &body)
}

fn facts(rows: &[(&str, String)]) -> Markup {
    html! {
        div.wide {
            table { tbody { @for (name, text) in rows { tr { th scope="row" { (name) } td.words { (text) } } } } }
        }
    }
}

fn item(certificate: &Certificate<'_>) -> Vec<(&'static str, String)> {
    let given = certificate.given;
    let mut rows = vec![
        ("item", given.item.clone()),
        ("serial number", certificate.sensor.clone()),
        ("manufacturer", given.manufacturer.clone()),
    ];
    rows.extend(given.model.clone().map(|model| ("model", model)));
    rows.extend(certificate.labels.iter().cloned());
    rows.push(("customer", address(&given.customer)));
    rows
}

fn calibration(certificate: &Certificate<'_>) -> Vec<(&'static str, String)> {
    let given = certificate.given;
    let code = given.laboratory_code.as_ref().map(|code| format!(" ({code})")).unwrap_or_default();
    let range = |range: Option<(f64, f64)>, unit: &str| {
        range.map_or_else(|| "not measured".to_owned(), |(least, most)| format!("{least} to {most} {unit}"))
    };
    vec![
        ("laboratory", address(&given.laboratory) + &code),
        ("procedure", certificate.procedure()),
        ("performed", format!("{} to {}, {}", certificate.began, certificate.ended, given.place)),
        ("indenter", given.indenter.clone()),
        ("air temperature", range(given.temperature_c, "\u{b0}C")),
        ("relative humidity", range(given.humidity_percent, "%")),
        ("program", format!("palpate {}", certificate.release)),
    ]
}

fn instruments(certificate: &Certificate<'_>) -> Markup {
    let row = |UsedInstrument { role, identity, certificate }: &UsedInstrument| {
        [words(role), words(identity), words(certificate)]
    };
    let rows: Vec<[Markup; 3]> = certificate.instruments.iter().map(row).collect();
    html! {
        div.wide {
            table {
                thead { tr { th scope="col" { "instrument" } th.words scope="col" { "identity" } th.words scope="col" { "traceability" } } }
                tbody { @for [role, identity, own] in &rows { tr { th scope="row" { (role) } td.words { (identity) } td.words { (own) } } } }
            }
        }
    }
}

fn of(results: &ResultTable) -> Markup {
    let head = ["", "result", "expanded uncertainty or 95 % interval", "n"].map(words);
    let row = |row: &ResultRow| {
        let shown = |value: f64| format!("{value:.*}", row.digits);
        let unit = row.unit.symbol();
        let uncertainty = match row.uncertainty {
            Uncertainty::Expanded { expanded, k } => format!("{} {unit} (k = {})", shown(expanded), round(k, 2)),
            Uncertainty::Interval(low, high) => format!("{} to {} {unit}", shown(low), shown(high)),
            Uncertainty::NotStated => "not stated".to_owned(),
        };
        let value = html! { data value=(row.value) { (shown(row.value)) } " " (unit) };
        vec![words(&row.name), value, words(uncertainty), words(row.n)]
    };
    html! {
        p.note { (results.method) }
        (table(&head, &results.rows.iter().map(row).collect::<Vec<_>>()))
    }
}

fn conformity(certificate: &Certificate<'_>) -> Markup {
    let (class, statement) = match certificate.judgement.map(|judgement| judgement.verdict) {
        Some(SensorVerdict::Accepted) => ("verdict good", "Pass"),
        Some(SensorVerdict::NotAccepted) => ("verdict bad", "Fail"),
        Some(SensorVerdict::NotDecided) | None => ("verdict", "No statement"),
    };
    let limits = certificate.judgement.map(|judgement| {
        // the simple rule has no bounds
        let is_guarded = judgement.rule == Decision::Guarded.word();
        let row = |check: &palpate_data::acceptance::LimitCheck| {
            let shown = |value: Option<f64>| format!("{} {}", check.shown(value), check.kind.unit());
            let mut row = vec![check.kind.full_name(check.reach), shown(check.value)];
            row.extend(is_guarded.then(|| shown(check.bound)));
            row.extend([shown(Some(check.limit)), check.verdict.text().to_owned()]);
            row.into_iter().map(words).collect::<Vec<_>>()
        };
        let head = ["", "found"].into_iter().chain(is_guarded.then_some("95 % bound")).chain(["limit", ""]);
        table(&head.map(words).collect::<Vec<_>>(), &judgement.checks.iter().map(row).collect::<Vec<_>>())
    });
    html! {
        div class=(class) { strong { (statement) } p { (certificate.conformity()) } }
        @if let Some(limits) = limits { (limits) }
    }
}

fn record(certificate: &Certificate<'_>) -> Markup {
    html! {
        p { (NOT_SIGNED) }
        div.wide {
            table {
                thead { tr { th scope="col" { "run" } th.words scope="col" { "SHA-256 of journal.log" } } }
                tbody {
                    @for journal in &certificate.journals {
                        tr { th scope="row" { (journal.run) } td.words { code { (journal.sha256) } } }
                    }
                }
            }
        }
    }
}

fn signatures(certificate: &Certificate<'_>) -> Markup {
    html! {
        @for (name, role) in &certificate.given.responsible {
            p { (name) @if let Some(role) = role { ", " (role) } }
            p.note { "signature: " span style="display:inline-block;min-width:16em;border-bottom:1px solid" { "\u{a0}" } }
        }
    }
}

fn address(contact: &NamedAddress) -> String {
    let NamedAddress { name, street, post_code, city, country, e_mail } = contact;
    let place = post_code.iter().chain([city]).cloned().collect::<Vec<_>>().join(" ");
    let lines = [Some(name), street.as_ref(), Some(&place), Some(country), e_mail.as_ref()];
    lines.into_iter().flatten().cloned().collect::<Vec<_>>().join(", ")
}
