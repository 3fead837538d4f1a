//! The certificate as PTB's Digital Calibration Certificate, schema 3.2.0, with quantities in D-SI 2.1.0.

use super::given::NamedAddress;
use super::results::{ResultRow, ResultTable, Uncertainty};
use super::{Certificate, NOT_SIGNED, UsedInstrument};
use palpate_data::acceptance::SensorVerdict;
use std::fmt::Write as _;

/// Namespaces of the schema and of D-SI.
const DCC: &str = "https://ptb.de/dcc";
const SI: &str = "https://ptb.de/si";

/// Returns the complete document.
pub(super) fn document(certificate: &Certificate<'_>) -> String {
    let mut xml = Xml::default();
    xml.text.push_str("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let root =
        format!("dcc:digitalCalibrationCertificate schemaVersion=\"3.2.0\" xmlns:dcc=\"{DCC}\" xmlns:si=\"{SI}\"");
    xml.within(&root, |xml| {
        xml.within("dcc:administrativeData", |xml| administrative(xml, certificate));
        xml.within("dcc:measurementResults", |xml| {
            xml.within("dcc:measurementResult", |xml| measurement(xml, certificate));
        });
    });
    xml.text
}

fn administrative(xml: &mut Xml, certificate: &Certificate<'_>) {
    let given = certificate.given;
    xml.within("dcc:dccSoftware", |xml| software(xml, certificate));
    xml.within("dcc:coreData", |xml| {
        xml.leaf("dcc:countryCodeISO3166_1", &given.country);
        xml.leaf("dcc:usedLangCodeISO639_1", &given.language);
        xml.leaf("dcc:mandatoryLangCodeISO639_1", &given.language);
        xml.leaf("dcc:uniqueIdentifier", &given.identifier);
        xml.within("dcc:identifications", |xml| {
            identification(xml, "calibrationLaboratory", &given.revision.to_string(), "revision");
        });
        xml.leaf("dcc:beginPerformanceDate", &certificate.began);
        xml.leaf("dcc:endPerformanceDate", &certificate.ended);
        xml.leaf("dcc:performanceLocation", given.place);
        xml.leaf("dcc:issueDate", &given.issued);
    });
    xml.within("dcc:items", |xml| {
        xml.within("dcc:item", |xml| {
            xml.named("dcc:name", &given.item);
            xml.within("dcc:manufacturer", |xml| xml.named("dcc:name", &given.manufacturer));
            if let Some(model) = &given.model {
                xml.leaf("dcc:model", model);
            }
            xml.within("dcc:identifications", |xml| {
                identification(xml, "manufacturer", &certificate.sensor, "serial number");
                for (name, label) in certificate.labels.iter().filter(|(name, _)| matches!(*name, "design" | "batch")) {
                    identification(xml, "manufacturer", label, name);
                }
            });
        });
    });
    xml.within("dcc:calibrationLaboratory", |xml| {
        if let Some(code) = &given.laboratory_code {
            xml.leaf("dcc:calibrationLaboratoryCode", code);
        }
        xml.within("dcc:contact", |xml| contact(xml, &given.laboratory));
    });
    xml.within("dcc:respPersons", |xml| {
        for (index, (name, role)) in given.responsible.iter().enumerate() {
            xml.within("dcc:respPerson", |xml| {
                xml.within("dcc:person", |xml| xml.named("dcc:name", name));
                if let Some(role) = role {
                    xml.leaf("dcc:role", role);
                }
                xml.leaf("dcc:mainSigner", if index == 0 { "true" } else { "false" });
            });
        }
    });
    xml.within("dcc:customer", |xml| contact(xml, &given.customer));
    xml.within("dcc:statements", |xml| {
        if certificate.simulated {
            statement(xml, "Simulated", "The runs were made on a simulated rig: this document certifies no sensor.");
        }
        statement(xml, "Signature", NOT_SIGNED);
        for journal in &certificate.journals {
            statement(xml, "Record", &format!("journal.log of {}: SHA-256 {}", journal.run, journal.sha256));
        }
        for (name, label) in certificate.labels.iter().filter(|(name, _)| !matches!(*name, "design" | "batch")) {
            statement(xml, name, label);
        }
        for text in &certificate.not_measured {
            statement(xml, "Not measured", text);
        }
    });
}

fn measurement(xml: &mut Xml, certificate: &Certificate<'_>) {
    let given = certificate.given;
    xml.named("dcc:name", "Calibration of a tactile sensor");
    xml.within("dcc:usedMethods", |xml| {
        xml.within("dcc:usedMethod", |xml| {
            xml.named("dcc:name", &given.procedure);
            xml.named("dcc:description", &certificate.procedure());
        });
    });
    xml.within("dcc:usedSoftware", |xml| software(xml, certificate));
    xml.within("dcc:measuringEquipments", |xml| {
        for UsedInstrument { role, identity, certificate } in &certificate.instruments {
            xml.within("dcc:measuringEquipment", |xml| {
                xml.named("dcc:name", role);
                xml.named("dcc:description", &format!("{identity}; {certificate}"));
            });
        }
        xml.within("dcc:measuringEquipment", |xml| {
            xml.named("dcc:name", "indenter");
            xml.named("dcc:description", &given.indenter);
        });
    });
    let conditions = [
        ("air temperature", given.temperature_c, "\\degreecelsius"),
        ("relative humidity", given.humidity_percent, "\\percent"),
    ];
    if conditions.iter().any(|(_, range, _)| range.is_some()) {
        xml.within("dcc:influenceConditions", |xml| {
            for (name, range, unit) in conditions {
                let Some((least, most)) = range else { continue };
                xml.within("dcc:influenceCondition", |xml| {
                    xml.named("dcc:name", name);
                    xml.within("dcc:data", |xml| {
                        for (which, value) in [("least", least), ("most", most)] {
                            xml.within("dcc:quantity", |xml| {
                                xml.named("dcc:name", which);
                                xml.within("si:real", |xml| {
                                    xml.leaf("si:value", &decimal(value));
                                    xml.leaf("si:unit", unit);
                                });
                            });
                        }
                    });
                });
            }
        });
    }
    xml.within("dcc:results", |xml| certificate.results.iter().for_each(|results| table(xml, results)));
    xml.within("dcc:measurementMetaData", |xml| {
        xml.within("dcc:metaData", |xml| {
            xml.named("dcc:name", "Decision rule and conformity");
            xml.named("dcc:declaration", &certificate.conformity());
            // not decided: no statement
            match certificate.judgement.map(|judgement| judgement.verdict) {
                Some(SensorVerdict::Accepted) => xml.leaf("dcc:conformity", "pass"),
                Some(SensorVerdict::NotAccepted) => xml.leaf("dcc:conformity", "fail"),
                Some(SensorVerdict::NotDecided) | None => {}
            }
        });
    });
}

fn table(xml: &mut Xml, results: &ResultTable) {
    xml.within("dcc:result", |xml| {
        xml.named("dcc:name", results.title);
        xml.named("dcc:description", &results.method);
        xml.within("dcc:data", |xml| {
            xml.within("dcc:list", |xml| results.rows.iter().for_each(|row| quantity(xml, row)));
        });
    });
}

fn quantity(xml: &mut Xml, row: &ResultRow) {
    xml.within("dcc:quantity", |xml| {
        xml.named("dcc:name", &row.name);
        xml.named("dcc:description", &format!("from {} readings", row.n));
        xml.within("si:real", |xml| {
            xml.leaf("si:value", &decimal(row.value));
            xml.leaf("si:unit", row.unit.d_si());
            match row.uncertainty {
                Uncertainty::Expanded { expanded, k } => xml.within("si:expandedUnc", |xml| {
                    xml.leaf("si:uncertainty", &decimal(expanded));
                    xml.leaf("si:coverageFactor", &decimal(k));
                    xml.leaf("si:coverageProbability", "0.95");
                }),
                Uncertainty::Interval(low, high) => xml.within("si:coverageInterval", |xml| {
                    // the schema demands one: a quarter of the interval, as if it were normal
                    xml.leaf("si:standardUnc", &decimal((high - low) / 4.0));
                    xml.leaf("si:intervalMin", &decimal(low));
                    xml.leaf("si:intervalMax", &decimal(high));
                    xml.leaf("si:coverageProbability", "0.95");
                }),
                Uncertainty::NotStated => {}
            }
        });
    });
}

fn software(xml: &mut Xml, certificate: &Certificate<'_>) {
    xml.within("dcc:software", |xml| {
        xml.named("dcc:name", "palpate");
        xml.leaf("dcc:release", certificate.release);
        xml.leaf("dcc:type", "application");
    });
}

fn identification(xml: &mut Xml, issuer: &str, value: &str, name: &str) {
    xml.within("dcc:identification", |xml| {
        xml.leaf("dcc:issuer", issuer);
        xml.leaf("dcc:value", value);
        xml.named("dcc:name", name);
    });
}

fn statement(xml: &mut Xml, name: &str, text: &str) {
    xml.within("dcc:statement", |xml| {
        xml.named("dcc:name", name);
        xml.named("dcc:declaration", text);
    });
}

fn contact(xml: &mut Xml, contact: &NamedAddress) {
    xml.named("dcc:name", &contact.name);
    if let Some(e_mail) = &contact.e_mail {
        xml.leaf("dcc:eMail", e_mail);
    }
    xml.within("dcc:location", |xml| {
        xml.leaf("dcc:city", &contact.city);
        xml.leaf("dcc:countryCode", &contact.country);
        for (name, text) in [("dcc:postCode", &contact.post_code), ("dcc:street", &contact.street)] {
            if let Some(text) = text {
                xml.leaf(name, text);
            }
        }
    });
}

/// Formats a number for the schema: with every digit, and without an exponent that the schema doesn't allow.
fn decimal(value: f64) -> String {
    format!("{value}")
}

/// Whether XML 1.0 allows the character.
fn is_of_xml(c: char) -> bool {
    !matches!(c, '\u{0}'..='\u{8}' | '\u{b}' | '\u{c}' | '\u{e}'..='\u{1f}' | '\u{fffe}' | '\u{ffff}')
}

/// Indented XML document that is being written.
#[derive(Default)]
struct Xml {
    text: String,
    depth: usize,
}

impl Xml {
    /// Writes an element with the content that `inner` writes. `head` is the element's name and attributes.
    fn within(&mut self, head: &str, inner: impl FnOnce(&mut Xml)) {
        let name = head.split(' ').next().unwrap_or_default();
        let indent = "  ".repeat(self.depth);
        let _ = writeln!(self.text, "{indent}<{head}>");
        self.depth += 1;
        inner(self);
        self.depth -= 1;
        let _ = writeln!(self.text, "{indent}</{name}>");
    }

    /// Writes an element that contains text. As the schema requires, the text has single blanks, and none at its ends.
    fn leaf(&mut self, name: &str, text: &str) {
        let fit: String = text.chars().map(|c| if is_of_xml(c) { c } else { char::REPLACEMENT_CHARACTER }).collect();
        let single = fit.split_whitespace().collect::<Vec<_>>().join(" ");
        let escaped = single.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        let _ = writeln!(self.text, "{}<{name}>{escaped}</{name}>", "  ".repeat(self.depth));
    }

    /// Writes an element that contains text in a `content` element.
    fn named(&mut self, name: &str, text: &str) {
        self.within(name, |xml| xml.leaf("dcc:content", text));
    }
}
