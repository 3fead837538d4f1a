//! palpate
pub mod cli;
pub mod control;
pub mod dataset;
pub mod device;
pub mod document;
pub mod driver;
pub mod emulator;
pub mod mechanics;
pub mod quantity;
pub mod recipe;
pub mod rig;
pub mod run;
pub mod scene;
pub mod solver;
pub mod wire;
