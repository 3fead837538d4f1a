//! The vocabulary, with units: places, limits, travel, the array's layout, force readings and random streams.
//!
//! Units stand last in every name. Two frames are used and never mixed:
//! the **stage frame** (what the controller counts in, [`Position`]) and the **specimen frame** ([`Place`] plus a
//! `z_mm` that grows into the specimen and is zero at its nominal surface). [`Frame`] leads from one to the other.

pub mod any_number;
mod frame;
mod layout;
mod limits;
mod reading;
mod stream;

pub use frame::{Axis, Down, Frame, Place, Position};
pub use layout::ArrayLayout;
pub use limits::{Limits, Range, Travel};
pub use reading::{ForceReading, Health};
pub use stream::{Stream, stream};
