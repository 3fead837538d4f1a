//! How large figures are.

/// Width of a figure, px: as wide as a telephone, so that its letters stay legible there.
pub const WIDTH_PX: f64 = 440.0;

/// Height of a square panel in such a figure, px.
pub const SQUARE_PX: f64 = 344.0;
