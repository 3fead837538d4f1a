//! The terms of a skin.

use crate::mechanics::Medium;

/// What the taxels read of a contact: each term is optional, and what isn't named isn't computed.
///
/// Readings are in units of the reading for 1 N straight above a taxel of no spread.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SkinSpec {
    /// The cover over the taxels; none: the taxels read nothing.
    pub elastomer: Option<Elastomer>,
    /// Radius of the indenter, a rigid flat punch, mm; 0: a point.
    pub indenter_radius_mm: f64,
    /// What the taxels are, and how one differs from the other.
    pub taxels: Taxels,
    /// How well a contact repeats; none: perfectly.
    pub noise: Option<TaxelNoise>,
    /// Hysteresis of each taxel, % of full scale (PAPER Table 1). None: the unloading branch is the loading one.
    pub hysteresis_percent: Option<Vec<f64>>,
    /// What is wrong with which unit.
    pub faults: Vec<TaxelFault>,
    /// What the readings are rounded to; none: they aren't.
    pub converter: Option<Converter>,
}

/// The elastomer cover.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elastomer {
    /// Depth of the taxels below the surface, mm; of a bonded layer its thickness.
    pub depth_mm: f64,
    /// What there is below the taxels.
    pub medium: Medium,
}

impl Elastomer {
    /// A cover that is taken for an elastic half-space (PAPER S2).
    pub fn half_space(depth_mm: f64) -> Self {
        Elastomer { depth_mm, medium: Medium::HalfSpace }
    }
}

/// The taxels' size, what they read in air, and how they differ: uniform draws that belong to the specimen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Taxels {
    /// Radius of the disc over which each takes the mean of the stress, mm; 0: a point.
    pub radius_mm: f64,
    /// Gains are within this of 1 either way, %.
    pub gain_spread_percent: f64,
    /// True places are within this of the layout's either way along x and y, mm.
    pub place_spread_mm: f64,
    /// Depths are within this of the elastomer's either way, %. A deeper taxel reads less and farther around.
    pub depth_spread_percent: f64,
    /// What all of them read in air, reading units.
    pub baseline: f64,
}

/// How well a contact repeats: one draw per unit and contact, normal.
#[derive(Clone, Debug, PartialEq)]
pub struct TaxelNoise {
    /// Loading repeatability of each taxel, % (PAPER Table 1); one standard deviation is a third of it.
    pub repeatability_percent: Vec<f64>,
    /// What that is a percentage of.
    pub of: NoiseOf,
    /// Standard deviation of another draw that is the same for all units and readings, reading units; 0: none.
    pub floor: f64,
}

/// What a noise grows with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NoiseOf {
    /// Nothing: it is a share of the full scale.
    #[default]
    FullScale,
    /// The unit's noise-free reading.
    Reading,
}

/// Something that is wrong with one unit from the first contact to the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaxelFault {
    /// Which unit, counted from 1.
    pub unit: usize,
    /// What is wrong with it.
    pub kind: TaxelFaultKind,
}

/// What can be wrong with a unit; readings in reading units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TaxelFaultKind {
    /// It reads 0.
    Dead,
    /// It always reads this.
    Stuck(f64),
    /// It reads no more than this.
    Clipped(f64),
    /// Its gain has changed by this, %.
    Drifted(f64),
}

/// An analog-to-digital converter: readings are rounded to a multiple of 2 `range` / 2^`bits` and end at the range's ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Converter {
    /// Bits, 1 to 32.
    pub bits: u32,
    /// What it converts either way of 0, reading units.
    pub range: f64,
}

impl Converter {
    /// What a reading becomes.
    #[inline]
    pub fn convert(self, reading: f64) -> f64 {
        let codes = (1u64 << (self.bits - 1)) as f64; // on either side of 0
        let step = self.range / codes;
        nearest((reading / step).clamp(-codes, codes - 1.0)) * step
    }
}

/// As `f64::round`, to the last bit, of what is within 2^51: by sums alone, which a processor does several at a time, where
/// `round` may be a call of the C library and a quarter of a reading's time.
#[inline]
fn nearest(x: f64) -> f64 {
    const ONES: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52: next to it floats are whole numbers
    let even = (x + ONES) - ONES;
    let away = if x - even == 0.5f64.copysign(x) { 1f64.copysign(x) } else { 0.0 };
    (even + away).copysign(x)
}
