//! Results for people and for other programs.
//!
//! | module | what it is |
//! |---|---|
//! | [`report`] | a page about a run, or about many of them; the certificate |
//! | [`chart`] | charts as SVG |
//! | [`errors`] | the numbers of an evaluation, each with its name and unit |
//! | [`export`] | runs for other programs: frames, files, a lake, C |
//! | [`paper`] | what the paper reports |

#![forbid(unsafe_code)]

pub mod chart;
pub mod errors;
pub mod export;
pub mod paper;
pub mod report;
