//! palpate
pub mod control;
pub mod device;
pub mod document;
pub mod driver;
pub mod mechanics;
pub mod quantity;
pub mod recipe;
pub mod scene;
pub mod wire;
