//! Runs for other programs: frames with units and definitions, as files of common formats, and as a lake of Parquet files.
//!
//! A [`Frame`](frame::Frame) is a table in memory. It needs no other library. Files except CSV need the feature `files`.

mod bench;
pub mod frame;

pub use bench::{BenchError, bench_of};
