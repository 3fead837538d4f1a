//! `certificate.toml`: required content of a certificate that isn't in any run.

use palpate_document::{self as document, Bounds, Key, Keys, Problem, Problems, Table, keys, words};

const TEMPERATURE: Bounds = Bounds::within(-100.0, 200.0, "degrees Celsius");
const HUMIDITY: Bounds = Bounds::within(0.0, 100.0, "%");
/// Largest number of revisions of a certificate.
const REVISIONS_MAX: u64 = 1000;

/// Places where a calibration is performed, with their names in schema 3.2.0.
const PLACES: [(&str, &str); 5] = [
    ("laboratory", "laboratory"),
    ("customer", "customer"),
    ("laboratory-branch", "laboratoryBranch"),
    ("customer-branch", "customerBranch"),
    ("other", "other"),
];

/// All keys of `certificate.toml`.
pub const CERTIFICATE_KEYS: Keys = root::KEYS;

/// Data that a laboratory gives about itself, its customer and the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct CertificateData {
    /// Number of the certificate, unique.
    pub identifier: String,
    /// Revision of the certificate, from 1.
    pub revision: u64,
    /// Date of issue, as year-month-day.
    pub issued: String,
    /// Language, ISO 639-1, such as `en`.
    pub language: String,
    /// Country, ISO 3166-1, such as `DE`.
    pub country: String,
    /// Place where the calibration was performed, in the schema's word.
    pub place: &'static str,
    /// Laboratory that calibrated the sensor.
    pub laboratory: NamedAddress,
    /// Accreditation code of the laboratory.
    pub laboratory_code: Option<String>,
    /// Customer.
    pub customer: NamedAddress,
    /// Responsible persons: name and role.
    pub responsible: Vec<(String, Option<String>)>,
    /// Name of the sensor.
    pub item: String,
    /// Manufacturer of the sensor.
    pub manufacturer: String,
    /// Model of the sensor.
    pub model: Option<String>,
    /// Name of the procedure.
    pub procedure: String,
    /// Description of the indenter's geometry.
    pub indenter: String,
    /// Air temperature, degrees Celsius: smallest and largest.
    pub temperature_c: Option<(f64, f64)>,
    /// Relative humidity, %: smallest and largest.
    pub humidity_percent: Option<(f64, f64)>,
}

/// A name with its address.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedAddress {
    /// The name.
    pub name: String,
    /// Street and number.
    pub street: Option<String>,
    /// Postal code.
    pub post_code: Option<String>,
    /// City.
    pub city: String,
    /// Country, ISO 3166-1, such as `DE`.
    pub country: String,
    /// E-mail address.
    pub e_mail: Option<String>,
}

keys! {
    /// The complete file.
    root {
        certificate: Table(&certificate::KEYS), Refused, "the certificate itself";
        laboratory: Table(&laboratory::KEYS), Refused, "who calibrated";
        customer: Table(&contact::KEYS), Refused, "for whom";
        responsible: Tables(&responsible::KEYS), Refused, "who is responsible; at least one";
        item: Table(&item::KEYS), Refused, "the sensor; its serial number is the run's sensor ID";
        procedure: Table(&procedure::KEYS), Refused, "how it was calibrated";
        environment: Table(&environment::KEYS), Allowed, "ambient conditions, if measured";
    }
}

keys! {
    /// `[certificate]`
    certificate {
        identifier: Text, Refused, "its number, which must be unique", "\"LAB-2026-0042\"";
        revision: Whole(1, REVISIONS_MAX), or_whole(1), "its revision", "1";
        issued: Text, Refused, "date of issue, as year-month-day", "\"2026-05-04\"";
        language: Word(&["en"]), Refused, "the language it is written in, ISO 639-1", "\"en\"";
        country: Text, Refused, "country where it is issued, ISO 3166-1", "\"DE\"";
        place: Word(&words(&PLACES)), Refused, "where the calibration was performed", "\"laboratory\"";
    }
}

keys! {
    /// `[customer]`, and the same keys in `[laboratory]`.
    contact {
        name: Text, Refused, "the name", "\"Institute of Touch\"";
        street: Text, Allowed, "street and number", "\"Main Street 1\"";
        post_code: Text, Allowed, "postal code", "\"12345\"";
        city: Text, Refused, "the city", "\"Berlin\"";
        country: Text, Refused, "the country, ISO 3166-1", "\"DE\"";
        e_mail: Text, Allowed, "e-mail address", "\"touch@example.org\"";
    }
}

keys! {
    /// `[laboratory]`
    laboratory {
        code: Text, Allowed, "its accreditation code", "\"D-K-00000\"";
    }
    as contact { name, street, post_code, city, country, e_mail }
}

keys! {
    /// `[[responsible]]`
    responsible {
        name: Text, Refused, "the name of a responsible person", "\"A. Person\"";
        role: Text, Allowed, "the role", "\"head of laboratory\"";
    }
}

keys! {
    /// `[item]`
    item {
        name: Text, Refused, "name of the item", "\"tactile sensor\"";
        manufacturer: Text, Refused, "manufacturer", "\"Institute of Touch\"";
        model: Text, Allowed, "its model", "\"TS-9\"";
    }
}

keys! {
    /// `[procedure]`
    procedure {
        name: Text, Refused, "the name of the procedure", "\"LAB-WI-7, revision 2\"";
        indenter: Text, Refused, "the indenter's geometry", "\"steel hemisphere, radius 2 mm\"";
    }
}

keys! {
    /// `[environment]`
    environment {
        temperature_c: Range(TEMPERATURE), Allowed, "air temperature, lowest and highest", "[22.0, 24.0]";
        humidity_percent: Range(HUMIDITY), Allowed, "relative humidity, lowest and highest", "[40.0, 55.0]";
    }
}

/// Reads a certificate file; `file` is its name in messages.
///
/// # Errors
/// Every problem of the text, each with its line.
pub fn parse(file: &str, text: &str) -> Result<CertificateData, Problems> {
    document::read(file, text, &root::KEYS, |table| {
        let certificate = table.table(&root::certificate).and_then(|table| read_certificate(&table));
        let laboratory = table.table(&root::laboratory);
        let laboratory_code = laboratory.as_ref().and_then(|table| text_of(table, &laboratory::code));
        let laboratory = laboratory.and_then(|table| read_contact(&table));
        let customer = table.table(&root::customer).and_then(|table| read_contact(&table));
        let people = table.tables(&root::responsible);
        if people.is_empty() && table.has(&root::responsible) {
            table.complain(Problem::new(table.span_of(&root::responsible), "a responsible person is required"));
        }
        let responsible = document::all(people.iter().map(|table| {
            let (name, role) = (text_of(table, &responsible::name), text_of(table, &responsible::role));
            Some((name?, role))
        }));
        let item = table.table(&root::item).and_then(|table| {
            let (name, manufacturer) = (text_of(&table, &item::name), text_of(&table, &item::manufacturer));
            let model = text_of(&table, &item::model);
            Some((name?, manufacturer?, model))
        });
        let procedure = table.table(&root::procedure).and_then(|table| {
            let (name, indenter) = (text_of(&table, &procedure::name), text_of(&table, &procedure::indenter));
            Some((name?, indenter?))
        });
        let environment = table.table(&root::environment);
        let range = |key| environment.as_ref().and_then(|table| table.range(key)).map(|range| (range.min, range.max));
        let (temperature_c, humidity_percent) =
            (range(&environment::temperature_c), range(&environment::humidity_percent));
        let (item, manufacturer, model) = item?;
        let (procedure, indenter) = procedure?;
        Some(CertificateData {
            laboratory: laboratory?,
            laboratory_code,
            customer: customer?,
            responsible: responsible?,
            item,
            manufacturer,
            model,
            procedure,
            indenter,
            temperature_c,
            humidity_percent,
            ..certificate?
        })
    })
}

/// Reads `[certificate]`. Values from other tables are left empty.
fn read_certificate(table: &Table) -> Option<CertificateData> {
    let identifier = text_of(table, &certificate::identifier);
    let revision = table.whole(&certificate::revision);
    let issued = table.day(&certificate::issued).map(str::to_owned);
    let language = table.word(&certificate::language, &[("en", "en")]).map(str::to_owned);
    let country = country_of(table, &certificate::country);
    let place = table.word(&certificate::place, &PLACES);
    let nobody = NamedAddress {
        name: String::new(),
        street: None,
        post_code: None,
        city: String::new(),
        country: String::new(),
        e_mail: None,
    };
    Some(CertificateData {
        identifier: identifier?,
        revision: revision?,
        issued: issued?,
        language: language?,
        country: country?,
        place: place?,
        laboratory: nobody.clone(),
        laboratory_code: None,
        customer: nobody,
        responsible: Vec::new(),
        item: String::new(),
        manufacturer: String::new(),
        model: None,
        procedure: String::new(),
        indenter: String::new(),
        temperature_c: None,
        humidity_percent: None,
    })
}

fn read_contact(table: &Table) -> Option<NamedAddress> {
    let [name, street, post_code, city, e_mail] =
        [contact::name, contact::street, contact::post_code, contact::city, contact::e_mail]
            .map(|key| text_of(table, &key));
    let country = country_of(table, &contact::country);
    Some(NamedAddress { name: name?, street, post_code, city: city?, country: country?, e_mail })
}

/// Reads a text that isn't empty, and replaces multiple blanks by single ones, as the schema requires.
fn text_of(table: &Table, key: &Key) -> Option<String> {
    let text = table.text(key)?;
    let single = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if single.is_empty() || single.contains(char::is_control) {
        let words = match single.is_empty() {
            true => format!("`{}` is empty: fill it in", key.name),
            false => format!("`{}` is {text:?}, expected printable characters", key.name),
        };
        table.complain(Problem::new(table.span_of(key), words));
        return None;
    }
    Some(single)
}

/// Reads a country code of two letters.
fn country_of(table: &Table, key: &Key) -> Option<String> {
    let expected = "two upper-case letters, such as \"DE\"";
    let code = table.text(key)?;
    if code.len() == 2 && code.chars().all(|c| c.is_ascii_uppercase()) {
        return Some(code.to_owned());
    }
    table.complain(Problem::new(table.span_of(key), format!("`{}` is {code:?}, expected {expected}", key.name)));
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_document::sample::assert_read_is_listed;

    #[test]
    fn certificate_reader_reads_exactly_the_listed_keys() {
        assert_read_is_listed(&root::KEYS, |text| drop(parse("certificate.toml", text)));
    }

    #[test]
    fn missing_or_invalid_code_is_named() {
        let problems =
            parse("certificate.toml", "[certificate]\nidentifier = \" \"\ncountry = \"Germany\"\n").unwrap_err();
        let lines = problems.lines().join("\n");
        for part in [
            "`identifier` is empty: fill it in",
            "`country` is \"Germany\", expected two upper-case letters",
            "`laboratory` is missing",
            "`issued` is missing",
        ] {
            assert!(lines.contains(part), "{part}: {lines}");
        }
    }
}
