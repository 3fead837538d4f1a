//! Sizes of figures.

/// Width of a figure, px: the width of a telephone, so that its letters remain legible there.
pub(crate) const WIDTH_PX: f64 = 440.0;

/// Height of a square panel in such a figure, px.
pub(crate) const SQUARE_PX: f64 = 344.0;
