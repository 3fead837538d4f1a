//! `evaluate --holdout`: the options, the split of one table or run, and the saved parts.

use super::sources::seed;
use super::{Failure, Note};
use miette::{IntoDiagnostic, WrapErr};
use palpate_core::quantity::ArrayLayout;
use palpate_data::dataset::{HeldOutBy, Holdout, Presses, SAME_PLACE_MM, Split};
use std::fs::{File, create_dir_all};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Which presses of one table or run are the test.
#[derive(Clone, Debug, clap::Args)]
pub struct HoldoutOptions {
    /// Hold out presses as the test: a share of the places, of single presses (press), or the last presses (time), such as:
    /// places 20%
    #[arg(long, num_args = 2, value_names = ["BY", "SHARE"], conflicts_with_all = ["calibration", "test"])]
    pub holdout: Vec<String>,
    /// Seed of the choice of the held-out presses
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed, allow_negative_numbers = true, requires = "holdout")]
    pub seed: u64,
    /// Presses up to this distance apart are at one place
    #[arg(long, value_name = "MM", default_value_t = SAME_PLACE_MM, value_parser = distance, requires = "holdout")]
    pub same_place: f64,
    /// Write both parts into this folder: calibration.csv, test.csv, and columns.toml if the units' positions are known
    #[arg(long, value_name = "DIR", requires = "holdout")]
    pub save: Option<PathBuf>,
}

impl Default for HoldoutOptions {
    fn default() -> Self {
        HoldoutOptions { holdout: Vec::new(), seed: 1, same_place: SAME_PLACE_MM, save: None }
    }
}

impl HoldoutOptions {
    /// Returns what is to be held out, if anything is.
    pub(crate) fn asked(&self) -> Result<Option<Holdout>, Failure> {
        let (by, share) = match self.holdout.as_slice() {
            [] => return Ok(None),
            [by, share] => (by, share),
            _ => return Err(Failure::usage(miette::miette!("--holdout: expected two words, such as places 20%"))),
        };
        let refused = |text: String| {
            let help = "write for example --holdout places 20%";
            Failure::usage(miette::miette!(help = help, "--holdout {by} {share}: {text}"))
        };
        let by = match by.as_str() {
            "places" => HeldOutBy::Places,
            "press" => HeldOutBy::Press,
            "time" => HeldOutBy::Time,
            _ => return Err(refused("expected places, press or time".to_owned())),
        };
        let number = match share.strip_suffix('%') {
            Some(percent) => percent.trim().parse::<f64>().map(|percent| percent / 100.0),
            None => share.parse::<f64>(),
        };
        match number {
            Ok(number) if number > 0.0 && number < 1.0 => {
                Ok(Some(Holdout { by, share: number, seed: self.seed, same_place_mm: self.same_place }))
            }
            _ => Err(refused("expected a share between 0 and 100 %".to_owned())),
        }
    }

    /// Splits the presses, notes what a person should know, and saves both parts if that is asked for.
    pub(crate) fn split(
        &self,
        holdout: &Holdout,
        presses: &Presses,
        layout: Option<&ArrayLayout>,
        note: Note<'_>,
    ) -> Result<Split, Failure> {
        let split = holdout.split(presses).map_err(Failure::usage)?;
        for line in &split.notes {
            let kind = if line.starts_with("warning: ") { "" } else { "hold-out: " };
            note(&format!("{kind}{line}"));
        }
        if let Some(folder) = &self.save {
            let saved = save(folder, &split, layout);
            saved.wrap_err("can't save the parts; name a folder without such files").map_err(Failure::unwritten)?;
        }
        Ok(split)
    }
}

/// Writes both parts as tables with every digit. Nothing is replaced.
fn save(folder: &Path, split: &Split, layout: Option<&ArrayLayout>) -> miette::Result<()> {
    create_dir_all(folder).into_diagnostic().wrap_err_with(|| folder.display().to_string())?;
    let files = [
        ("calibration.csv", Some(split.calibration.to_csv())),
        ("test.csv", Some(split.test.to_csv())),
        ("columns.toml", layout.map(columns_text)),
    ];
    for (name, text) in files.into_iter().filter_map(|(name, text)| Some((name, text?))) {
        let path = folder.join(name);
        let written = File::create_new(&path).and_then(|mut file| file.write_all(text.as_bytes()));
        written.into_diagnostic().wrap_err_with(|| path.display().to_string())?;
    }
    Ok(())
}

/// Returns a columns file with the positions of the units.
fn columns_text(layout: &ArrayLayout) -> String {
    let units = layout.one_per_unit();
    let places: Vec<[f64; 2]> = units.places().iter().map(|place| [place.x_mm, place.y_mm]).collect();
    format!("[array]\nplaces_mm = {places:?}\nchannels_per_unit = {}\n", layout.len() / units.len().max(1))
}

fn distance(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(mm) if (1e-6..=100.0).contains(&mm) => Ok(mm),
        _ => Err("expected a distance of 0.000001 to 100 mm".to_owned()),
    }
}
