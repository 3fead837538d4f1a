//! `--columns`: the meaning of the columns of a user's tables.

use super::Failure;
use super::sources::read;
use palpate_data::dataset::Mapping;
use std::path::Path;

/// Meaning of the columns of tables.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ColumnsOptions {
    /// What the columns of tables hold: a columns file, or a short form such as x_mm=X,y_mm=Y,outputs=ch0..ch15
    #[arg(long, value_name = "COLUMNS")]
    pub columns: Option<String>,
    /// Sheet of .xlsx files [default: the first]
    #[arg(long, value_name = "NAME")]
    pub sheet: Option<String>,
}

/// A columns file as it was read.
pub(crate) struct ReadColumns {
    /// Its name.
    pub name: String,
    /// Its text.
    pub text: String,
    /// Its content.
    pub mapping: Mapping,
}

impl ColumnsOptions {
    /// The columns file that was named, or that the short form stands for.
    pub(crate) fn read(&self) -> Result<Option<ReadColumns>, Failure> {
        let Some(given) = &self.columns else { return Ok(None) };
        let path = Path::new(given);
        let is_short = given.contains('=') && !path.exists();
        if !is_short && !path.exists() && given.contains([',', ':']) {
            let help = "the short form is x_mm=X,y_mm=Y,outputs=ch0..ch15, with `=` between a key and its column";
            return Err(Failure::usage(miette::miette!(help = help, "--columns {given}: there is no such file")));
        }
        if is_short
            && let Some(key) =
                given.split(',').filter_map(|part| Some(part.split_once('=')?.0)).find(|key| key.contains('.'))
        {
            let (table, name) = key.split_once('.').unwrap_or((key, ""));
            let help = format!(
                "write a columns file with [{table}] and {name} = ... below it: `palpate init DIR --from tables` writes one to begin with"
            );
            let words = "the short form of --columns names columns only: factors and offsets need a columns file";
            return Err(Failure::usage(miette::miette!(help = help, "{key}: {words}")));
        }
        let (name, text) = match is_short {
            true => ("--columns".to_owned(), Mapping::text_of(given)),
            false => (given.clone(), read(path)?),
        };
        let mapping = Mapping::parse(&name, &text).map_err(Failure::usage)?;
        Ok(Some(ReadColumns { name, text, mapping: mapping.of_sheet(self.sheet.clone()) }))
    }

    /// Returns the meaning of the columns; without the option, that of the program's own names.
    pub(crate) fn mapping(&self) -> Result<Mapping, Failure> {
        let own = || Mapping::default().of_sheet(self.sheet.clone());
        Ok(self.read()?.map_or_else(own, |read| read.mapping))
    }
}
