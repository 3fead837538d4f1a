//! Files of a run: the journal, which is the record, and plain tables, which are views of it.
//!
//! A run folder appears by one rename, with its recipe, its rig and its manifest. Each press is in the [`Journal`], flushed to
//! the disk, before the next press begins. `presses.csv` grows with the journal, and all tables are regenerated at the end.
//! Tables and manifest are views: [`RunFolder::rebuild`] makes them from the journal. Code that makes presses sees only a
//! [`Ledger`]: a run folder, or a [`Memory`] that writes no files.
//!
//! [`Press`] is one press and the list of its columns. There are two sources of presses, with the same result: [`Recorded`] reads
//! a run's journal, [`read_table`] reads an external table.

mod acceptance;
pub mod answers;
#[cfg(feature = "files")]
pub mod arrow;
pub mod calibration;
mod cell;
pub mod characteristics;
mod check;
mod dialect;
mod error;
pub mod evaluate;
pub mod files;
mod fingerprint;
mod flag;
mod folder;
mod foreign;
mod foreseen;
mod formats;
mod header;
mod holdout;
mod index;
mod journal;
mod known;
mod ledger;
mod live;
mod lock;
mod lookalike;
mod loss;
mod manifest;
mod mapping;
mod missed;
mod new_folder;
mod over_time;
mod places;
mod press;
mod presses;
pub mod readings;
mod record;
mod recorded;
pub mod sensor_file;
mod series;
mod session;
mod stated;
mod table;
mod table_error;
mod temperatures;
mod verify;
mod views;

pub use acceptance::Evidence;
pub use cell::{CellType, CellValue};
pub use check::{CheckChange, RecordedCheck};
pub use error::DatasetError;
pub use fingerprint::Fingerprint;
pub use flag::Flag;
pub use folder::{Accepted, Origins, RunFolder};
pub use foreseen::{Truths, foreseen};
pub use holdout::{HeldOutBy, Holdout, HoldoutError, Split};
pub use index::RecordedContacts;
pub use journal::{JOURNAL, Journal, JournalError, JournalRecords, Logged};
pub use known::check_run;
pub use ledger::{Ledger, Memory};
pub use live::LiveSession;
pub use lock::hold as hold_folder;
pub use lookalike::Lookalike;
pub use manifest::Manifest;
pub use mapping::{COLUMN_KEYS, Mapping};
pub use missed::{MissedReading, MissedReadings};
pub use new_folder::make_folder;
#[cfg(feature = "files")]
pub use over_time::followed;
pub use over_time::{Cycled, Followed, cycled};
use palpate_core::quantity::round;
pub use places::SAME_PLACE_MM;
pub use press::{COLUMNS, OUTPUTS, Press, PressColumn, is_press_column, output_name};
pub use press::{Presence, RunColumns};
pub use presses::Presses;
pub use record::{
    FollowedTime, Left, MonitorValue, NoLoad, Peaks, PressTruth, Record, RecordedContact, RecordedSurface, Retouch,
    SurfaceFinder,
};
pub use recorded::{Recorded, Texts, journal_sha256, source_fingerprint};
pub use series::{
    ReadValue, SERIES, SeriesColumn, SeriesMark, SeriesQueue, SeriesReading, SeriesReadings, SeriesRequest,
    SeriesWriteError, series_columns, series_queue,
};
#[cfg(feature = "files")]
pub use series::{RecordedSeries, SeriesBatch};
pub use session::{
    CalledSound, Durability, FORMAT, Imported, LABEL_MOST, Labels, Loss, Provenance, RecordedText, RigChange, RunFacts,
    SessionEnd, Status, is_label,
};
pub use stated::doubted_half_widths;
pub use table::{parse_table, read_table};
pub(crate) use table_error::MAX_COLUMNS;
pub use table_error::{MAX_TABLE_BYTES, TableError};
pub use temperatures::{Warmed, WarmedQuantity, warmed};
pub use verify::{Verified, verify};
pub use views::Characteristic;
pub use views::{CHARACTERISTIC_COLUMNS, TABLES};
