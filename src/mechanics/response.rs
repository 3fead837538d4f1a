//! What a taxel reads of a load, from place to place.

use super::hankel::Table;
use super::lambda;
use super::layer::Medium;
use super::spread::{disc, flat_punch};
use std::sync::Arc;

/// What there is between a load and a taxel, all of it round and seen from straight above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passage {
    /// What the load presses on.
    pub medium: Medium,
    /// Depth of the taxel below the surface, mm; of a bonded layer its thickness.
    pub depth_mm: f64,
    /// Radius of the indenter, a rigid flat punch, mm; 0: a point. At most [`MOST_RADIUS_DEPTHS`] times the depth.
    pub indenter_radius_mm: f64,
    /// Radius of the disc over which the taxel takes the mean of the stress, mm; 0: a point. Bounded as the indenter's.
    pub taxel_radius_mm: f64,
}

/// The largest radius of an indenter or a taxel, depths.
pub const MOST_RADIUS_DEPTHS: f64 = 2.0;

impl Passage {
    /// A point load over a point taxel in a half-space (the paper's).
    pub fn half_space(depth_mm: f64) -> Self {
        Passage { medium: Medium::HalfSpace, depth_mm, indenter_radius_mm: 0.0, taxel_radius_mm: 0.0 }
    }
}

/// What a taxel reads of a load, as a function of the distance between their centres.
///
/// The normal stress at the taxel per newton, compression positive, in units of a point load's peak in a half-space of the
/// same depth, which is `3 / (2 pi depth^2)` MPa a newton. Linear: the readings of several loads add up. A point load over a
/// point taxel in a half-space is [`lambda`] itself; anything else is a table, made in a fraction of a millisecond and
/// accurate to some 1e-8, which is shared by all copies. Far out (20 depths) there is nothing left of a layer's stress, and
/// nothing but `lambda` of a half-space's.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    passage: Passage,
    /// Whether `lambda` is to be added to the table: only what differs from it is tabulated.
    over_lambda: bool,
    table: Option<Arc<Table>>,
}

impl Response {
    /// The response of a passage.
    pub fn new(passage: Passage) -> Self {
        let Passage { medium, depth_mm, indenter_radius_mm, taxel_radius_mm } = passage;
        let over_lambda = medium == Medium::HalfSpace;
        let points = indenter_radius_mm == 0.0 && taxel_radius_mm == 0.0;
        let left_out = if over_lambda { 1.0 } else { 0.0 };
        let (indenter, taxel) = (indenter_radius_mm / depth_mm, taxel_radius_mm / depth_mm);
        let table = (!(over_lambda && points)).then(|| {
            let spread = |h: f64| flat_punch(h * indenter) * disc(h * taxel) - left_out;
            Arc::new(Table::inverse_of(|h| medium.transform(h) * spread(h)))
        });
        Response { passage, over_lambda, table }
    }

    /// The passage this is the response of.
    pub fn passage(&self) -> &Passage {
        &self.passage
    }

    /// The reading per newton at a distance (mm).
    #[inline]
    pub fn at(&self, distance_mm: f64) -> f64 {
        let k = distance_mm / self.passage.depth_mm;
        let tabulated = self.table.as_ref().map(|table| table.value_and_slope(k).0);
        match (self.over_lambda, tabulated) {
            (true, None) => lambda(k),
            (true, Some(more)) => lambda(k) + more,
            (false, tabulated) => tabulated.unwrap_or(0.0),
        }
    }

    /// The reading per newton at a distance (mm), and what it changes by in a millimetre.
    #[inline]
    pub fn with_slope(&self, distance_mm: f64) -> (f64, f64) {
        let k = distance_mm / self.passage.depth_mm;
        let (mut value, mut slope) = self.table.as_ref().map_or((0.0, 0.0), |table| table.value_and_slope(k));
        if self.over_lambda {
            let lambda = lambda(k);
            value += lambda;
            slope -= 5.0 * k * lambda / (k * k + 1.0);
        }
        (value, slope / self.passage.depth_mm)
    }
}

#[cfg(test)]
mod tests;
