//! One module per instrument family: a role of [`crate::device`] over a link of [`crate::wire`].

mod esp301;
pub mod modbus;

pub use esp301::Esp301;
