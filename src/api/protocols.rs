//! Published calibration protocols: those that come with the program, and what the others lack.

use super::Failure;
use palpate_control::OverTime;
use palpate_data::recipe::{self, Plan, SeriesScope};
use palpate_document::{Problems, keys};
use palpate_run::rig;
use std::io;

/// A published protocol that this program executes.
#[derive(Debug)]
pub(crate) struct Protocol {
    /// Its name: the folder in `recipes/protocols`.
    pub name: &'static str,
    /// Its name as a template of `palpate init`.
    pub template: &'static str,
    /// Text of its recipe.
    pub recipe: &'static str,
    /// Text of a rig of its kind, with a scene for a simulated run.
    pub rig: &'static str,
    source: &'static str,
}

/// What the source of a protocol does, and what this program does.
#[derive(Debug)]
pub(crate) struct Source {
    /// Paper or repository.
    pub source: String,
    /// Its address, if it is known.
    pub url: Option<String>,
    /// What a person reads about the difference; none for a protocol that runs whole.
    pub lacks: Option<String>,
    /// Parts in which this program doesn't do the same; empty for a protocol that runs whole.
    pub differs: Vec<&'static str>,
}

macro_rules! protocol {
    ($name:literal, $recipe:literal, $rig:literal) => {
        Protocol {
            name: $name,
            template: concat!("protocol:", $name),
            recipe: include_str!(concat!("../../", $recipe)),
            rig: include_str!(concat!("../../", $rig)),
            source: include_str!(concat!("../../recipes/protocols/", $name, "/source.toml")),
        }
    };
}

/// All protocols.
pub(crate) const PROTOCOLS: &[Protocol] = &[
    protocol!("liu-2018", "recipes/paper.toml", "rigs/paper.toml"),
    protocol!("tue-matrix", "recipes/protocols/tue-matrix/recipe.toml", "rigs/matrix.toml"),
    protocol!(
        "shaevitz-barometers",
        "recipes/protocols/shaevitz-barometers/recipe.toml",
        "recipes/protocols/shaevitz-barometers/rig.toml"
    ),
    protocol!(
        "fkeel-interdigitation",
        "recipes/protocols/fkeel-interdigitation/recipe.toml",
        "recipes/protocols/fkeel-interdigitation/rig.toml"
    ),
    protocol!(
        "py3dcal-reskin",
        "recipes/protocols/py3dcal-reskin/recipe.toml",
        "recipes/protocols/py3dcal-reskin/rig.toml"
    ),
    protocol!(
        "printed-membrane",
        "recipes/protocols/printed-membrane/recipe.toml",
        "recipes/protocols/printed-membrane/rig.toml"
    ),
    protocol!(
        "sensor-probing",
        "recipes/protocols/sensor-probing/recipe.toml",
        "recipes/protocols/sensor-probing/rig.toml"
    ),
    protocol!(
        "ts-comparison",
        "recipes/protocols/ts-comparison/recipe.toml",
        "recipes/protocols/ts-comparison/rig.toml"
    ),
];

/// Protocols that were read as files: number, name, folder of the library if it runs whole, and what it lacks.
const PUBLISHED: &str = include_str!("protocols.csv");

keys! {
    /// `source.toml` of a protocol.
    source_file {
        source: Text, Refused, "paper or repository", "\"Sensors 2018, 18, 351\"";
        url: Text, Allowed, "its address", "\"https://github.com/NAME/REPOSITORY\"";
        lacks: Text, Allowed, "what differs, for a list", "\"temperatures\"";
        places: Table(&part::KEYS), Refused, "where it presses";
        quantity: Table(&part::KEYS), Refused, "what it presses to: force or depth";
        repeats: Table(&part::KEYS), Refused, "how often it presses";
        channels: Table(&part::KEYS), Refused, "which outputs it reads";
        record: Table(&part::KEYS), Refused, "what it keeps of a press";
    }
}

keys! {
    /// One part of a protocol.
    part {
        source: Text, Refused, "what the source does", "\"625 places\"";
        here: Text, Refused, "what this program does", "\"the same\"";
        same: Flag, Refused, "whether both are the same", "true";
    }
}

impl Protocol {
    /// Whether its rig has a load cell.
    pub(crate) fn has_load_cell(&self) -> bool {
        !self.rig.contains("load_cell = \"none\"")
    }

    /// Reads its `source.toml`.
    ///
    /// # Errors
    /// The text isn't sound; a test shows that the shipped ones are.
    pub(crate) fn source(&self) -> Result<Source, Problems> {
        let parts = [
            source_file::places,
            source_file::quantity,
            source_file::repeats,
            source_file::channels,
            source_file::record,
        ];
        palpate_document::read("source.toml", self.source, &source_file::KEYS, |table| {
            let source = table.text(&source_file::source)?.to_owned();
            let (url, lacks) =
                [&source_file::url, &source_file::lacks].map(|key| table.text(key).map(str::to_owned)).into();
            let mut differs = Vec::new();
            for key in parts {
                let table = table.table(&key)?;
                let (_, _) = (table.text(&part::source)?, table.text(&part::here)?);
                if !table.flag(&part::same)? {
                    differs.push(key.name);
                }
            }
            Some(Source { source, url, lacks, differs })
        })
    }

    /// Number of presses in its plan.
    pub(crate) fn presses(&self) -> Result<usize, Failure> {
        let beside = |_: &str| Err(io::ErrorKind::NotFound.into());
        let mut recipe = recipe::parse(self.name, self.recipe).map_err(Failure::usage)?;
        // a build without the feature `files` counts too
        recipe.series = SeriesScope::None;
        recipe.steps.iter_mut().for_each(|step| step.over_time = OverTime::default());
        let rig = rig::parse(self.name, self.rig, &beside).map_err(Failure::usage)?.simulated();
        Ok(Plan::new(&recipe, &rig.ground(), 1).map_err(Failure::usage)?.entries.len())
    }
}

impl Source {
    /// What a list states: whole, or in part and what differs.
    pub(crate) fn runs(&self) -> String {
        match &self.lacks {
            None => "whole".to_owned(),
            Some(lacks) => format!("in part: {lacks}"),
        }
    }
}

/// Returns the published protocols as the rows of a table in Markdown.
pub(crate) fn published() -> String {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(PUBLISHED.as_bytes());
    let row = |row: csv::StringRecord| {
        let [number, name, library, lacks] = [0, 1, 2, 3].map(|cell| row.get(cell).unwrap_or_default());
        let shipped = PROTOCOLS.iter().find(|protocol| protocol.name == library);
        match shipped.and_then(|protocol| protocol.source().ok()) {
            None => format!("| {number} | {name} | no | {lacks} |\n"),
            Some(source) => {
                let how = if source.differs.is_empty() { "whole" } else { "in part" };
                let lacks = source.lacks.unwrap_or_default();
                format!("| {number} | {name} | {how}: `protocol:{library}` | {lacks} |\n")
            }
        }
    };
    reader.records().filter_map(Result::ok).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn protocols_that_run_whole_are_those_of_the_library() {
        let page = published();
        assert_eq!(page.lines().count(), 41);
        for protocol in PROTOCOLS {
            let source = protocol.source().map_err(|problems| problems.lines()).unwrap();
            let row = format!("| whole: `protocol:{}` |  |", protocol.name);
            assert_eq!(page.contains(&row), source.differs.is_empty(), "{}", protocol.name);
            assert_eq!(source.lacks.is_none(), source.differs.is_empty(), "{}", protocol.name);
            assert_eq!(page.matches(&format!("`protocol:{}`", protocol.name)).count(), 1);
        }
    }
}
