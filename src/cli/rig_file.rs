//! A rig file that is changed: some keys, and nothing else of it.

use crate::api::Failure;
use crate::api::sources::bounded;
use miette::{IntoDiagnostic, WrapErr};
use palpate_data::dataset::files;
use palpate_run::rig;
use std::path::Path;
use std::{fs, io};

/// Checks that a run accepts the changed text. A text that a run would refuse isn't written.
pub(super) fn check_text(file: &Path, text: &str) -> Result<(), Failure> {
    let beside = |name: &str| bounded(&file.with_file_name(name));
    rig::parse(&file.display().to_string(), text, &beside).map(drop).map_err(Failure::usage)
}

/// Replaces the file by the changed text, completely or not at all, if the file hasn't changed since it was read.
pub(super) fn replace(file: &Path, read: &str, text: &str) -> Result<(), Failure> {
    put(file, read, text)
        .into_diagnostic()
        .wrap_err_with(|| format!("{} couldn't be written; the file is unchanged", file.display()))
        .map_err(Failure::unwritten)
}

fn put(file: &Path, read: &str, text: &str) -> io::Result<()> {
    let file = &fs::canonicalize(file)?; // a link stays one
    if bounded(file)? != read {
        return Err(io::Error::other("it was changed while the rig was in use"));
    }
    files::place(file, text)
}
