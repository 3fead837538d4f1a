//! palpate
pub mod document;
pub mod mechanics;
pub mod quantity;
pub mod scene;
