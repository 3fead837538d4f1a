//! `--columns`: what the columns of a person's own tables hold.

use super::exit::Failure;
use super::sources::read;
use crate::dataset::Mapping;
use std::path::Path;

/// What the columns of tables hold.
#[derive(Debug, Default, clap::Args)]
pub struct ColumnsArgs {
    /// What the columns of tables hold: a columns file, or a short form such as x_mm=X,y_mm=Y,outputs=ch0..ch15
    #[arg(long, value_name = "COLUMNS")]
    columns: Option<String>,
}

/// A columns file as it was read.
pub struct ReadColumns {
    /// Its name.
    pub name: String,
    /// Its text.
    pub text: String,
    /// What it says.
    pub mapping: Mapping,
}

impl ColumnsArgs {
    /// The columns file that was named, or that the short form stands for.
    pub fn read(&self) -> Result<Option<ReadColumns>, Failure> {
        let Some(given) = &self.columns else { return Ok(None) };
        let path = Path::new(given);
        let is_short = given.contains('=') && !path.exists();
        let (name, text) = match is_short {
            true => ("--columns".to_owned(), Mapping::text_of(given)),
            false => (given.clone(), read(path)?),
        };
        let mapping = Mapping::parse(&name, &text).map_err(Failure::usage)?;
        Ok(Some(ReadColumns { name, text, mapping }))
    }

    /// What the columns hold; without the option, the program's own names.
    pub fn mapping(&self) -> Result<Mapping, Failure> {
        Ok(self.read()?.map(|read| read.mapping).unwrap_or_default())
    }
}
