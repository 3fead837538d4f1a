//! cli
pub mod evaluate;
mod tables;
