//! Labels that a person gives to a run: the sensor, its design and batch, the mounting, the operator, a note.

use super::Failure;
use palpate_data::dataset::{LABEL_MOST, Labels, is_label};
use palpate_run::batch::check_serial;

/// The labels of a run, all of them stored in the manifest.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct LabelOptions {
    /// Sensor ID
    #[arg(long, value_name = "ID", value_parser = sensor_id)]
    pub sensor: Option<String>,
    /// Design of the sensor
    #[arg(long, value_name = "NAME", value_parser = label)]
    pub design: Option<String>,
    /// Batch of the sensor
    #[arg(long, value_name = "NAME", value_parser = label)]
    pub batch: Option<String>,
    /// Mounting of the sensor on the bench: give a new one each time it is mounted
    #[arg(long, value_name = "NAME", value_parser = label)]
    pub mounting: Option<String>,
    /// Operator
    #[arg(long, value_name = "NAME", value_parser = label)]
    pub operator: Option<String>,
    /// Note
    #[arg(long, value_name = "TEXT", value_parser = label)]
    pub note: Option<String>,
}

impl LabelOptions {
    /// Checks that the labels can be printed anywhere.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        let LabelOptions { sensor, design, batch, mounting, operator, note } = self;
        let others = [
            ("--design", design),
            ("--batch", batch),
            ("--mounting", mounting),
            ("--operator", operator),
            ("--note", note),
        ];
        let checked = |name, text: &Option<String>, check: fn(&str) -> Result<String, String>| match text {
            Some(text) => check(text).map(drop).map_err(|why| Failure::option(name, text, &why)),
            None => Ok(()),
        };
        checked("--sensor", sensor, sensor_id)?;
        others.into_iter().try_for_each(|(name, text)| checked(name, text, label))
    }

    /// The labels that were given.
    pub(crate) fn labels(&self) -> Labels {
        let LabelOptions { sensor, design, batch, mounting, operator, note } = self;
        let [sensor, design, batch, mounting, operator, note] =
            [sensor, design, batch, mounting, operator, note].map(Clone::clone);
        Labels { sensor, design, batch, mounting, operator, note }
    }
}

/// Reads a sensor ID, by the rule of a batch: two IDs that look alike are the same.
fn sensor_id(text: &str) -> Result<String, String> {
    check_serial(text).map(|()| text.to_owned())
}

/// Checks that a text can be printed anywhere.
pub(crate) fn label(text: &str) -> Result<String, String> {
    let expected = || format!("expected 1 to {LABEL_MOST} printable characters");
    is_label(text).then(|| text.to_owned()).ok_or_else(expected)
}
