//! Sizes of figures.

/// Width of a figure, px: the width of a telephone, so that its letters remain legible there.
pub(crate) const WIDTH_PX: f64 = 440.0;

/// Height of a square panel in such a figure, px.
pub(crate) const SQUARE_PX: f64 = 344.0;

/// Width of a narrow figure, px, of which two are next to a table.
pub(crate) const NARROW_PX: f64 = 300.0;

/// Height of a square panel in such a figure, px.
pub(crate) const NARROW_SQUARE_PX: f64 = 204.0;
