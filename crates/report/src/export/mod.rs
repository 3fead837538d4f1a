//! Runs for other programs: frames with units and definitions, as files of common formats, and as a lake of Parquet files.
//!
//! An [`ExportTable`](frame::ExportTable) is a table in memory. It needs no other library. Files except CSV need the feature `files`.

#[cfg(feature = "files")]
pub mod arrow;
mod bench;
mod c;
pub(crate) mod csv;
mod format;
pub mod frame;
#[cfg(feature = "files")]
mod hdf5;
#[cfg(feature = "files")]
pub mod lake;
#[cfg(feature = "files")]
mod mat;
#[cfg(feature = "files")]
mod npz;
#[cfg(feature = "files")]
mod rows;
#[cfg(feature = "files")]
mod series;

pub use bench::{BenchError, bench_of};
pub use c::NoC;
pub use c::c_file;
pub use format::{ExportFormat, NotBuilt, write_file, write_tables};
#[cfg(feature = "files")]
pub use rows::of_run;
#[cfg(feature = "files")]
pub use series::add_series;
