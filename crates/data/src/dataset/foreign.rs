//! Checks whether a journal is the one that the manifest of its run describes.

use super::journal::JOURNAL;
use super::known::JournalSummary;
use super::manifest::MANIFEST;
use super::{DatasetError, Fingerprint, Manifest, Status};
use std::io::ErrorKind;
use std::path::Path;

/// Returns the differences between a run's journal and its manifest. The list is empty if it is the manifest's journal, or if
/// there is no manifest that can be read.
///
/// The manifest of a run that has ended states size and SHA-256 of the journal: they decide. A journal that lost its end is for
/// [`lost`](super::loss::lost) to report, and a run that was continued has a longer journal. Without a SHA-256, sensor, seed, and
/// the texts of recipe and rig decide.
///
/// # Errors
/// A file can't be read.
pub(super) fn foreign(folder: &Path, known: &JournalSummary) -> Result<Vec<String>, DatasetError> {
    if known.records == 0 {
        return Ok(Vec::new());
    }
    let manifest = match Manifest::read(&folder.join(MANIFEST)) {
        Ok(manifest) => manifest,
        Err(DatasetError::Io { why, .. }) if why.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error @ DatasetError::Io { .. }) => return Err(error),
        Err(_) => return Ok(Vec::new()),
    };
    let others = of_another_run(&manifest, &known.manifest);
    let Some(vouched) = manifest.files.iter().find(|file| file.name == JOURNAL) else { return Ok(others) };
    let path = folder.join(JOURNAL);
    let start = Fingerprint::of_start(folder, JOURNAL, vouched.bytes).map_err(DatasetError::io("reading", &path))?;
    let bytes = path.metadata().map_err(DatasetError::io("reading", &path))?.len();
    let is_same = start == *vouched && (bytes == vouched.bytes || manifest.status != Status::Complete);
    let is_cut = bytes < vouched.bytes && others.is_empty() && !known.is_complete();
    if is_same || is_cut {
        return Ok(Vec::new());
    }
    let size = (bytes != vouched.bytes).then(|| format!("{bytes} bytes, {MANIFEST} states {}", vouched.bytes));
    Ok(others.into_iter().chain([size.unwrap_or("its SHA-256 differs".to_owned())]).collect())
}

/// Returns the facts of a manifest that are different in a journal.
fn of_another_run(stated: &Manifest, found: &Manifest) -> Vec<String> {
    let (was, is) = (&stated.facts, &found.facts);
    let sensor = |labels: &super::Labels| labels.sensor.clone().unwrap_or("none".to_owned());
    let facts = [
        ("sensor", sensor(&was.labels), sensor(&is.labels)),
        ("seed", was.seed.to_string(), is.seed.to_string()),
        ("recipe", was.recipe.clone(), is.recipe.clone()),
    ];
    let facts = facts.into_iter().filter(|(_, was, is)| was != is);
    let facts = facts.map(|(name, was, is)| format!("{name} {is}, {MANIFEST} states {was}"));
    let texts = |manifest: &Manifest| manifest.sessions.first().map_or(Vec::new(), |session| session.texts.clone());
    let was = texts(stated);
    let is_other = |text: &Fingerprint| was.iter().any(|before| before.name == text.name && before != text);
    let other = texts(found).into_iter().filter(is_other).map(|text| format!("another text of {}", text.name));
    facts.chain(other).collect()
}
