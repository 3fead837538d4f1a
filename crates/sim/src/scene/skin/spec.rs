//! Terms of a skin.

use palpate_core::mechanics::Medium;

/// Reading of the taxels under a contact. Each term is optional, and a term that isn't named isn't computed.
///
/// Readings are in units of the reading for 1 N straight above a taxel without spread.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SkinSpec {
    /// Cover over the taxels; `None`: the taxels read nothing.
    pub elastomer: Option<Elastomer>,
    /// Radius of the indenter, a rigid flat punch, mm; 0: a point load.
    pub indenter_radius_mm: f64,
    /// Properties of the taxels, and their differences.
    pub taxels: Taxels,
    /// Repeatability of a contact; `None`: perfect.
    pub noise: Option<TaxelNoise>,
    /// Hysteresis of each taxel, % of full scale (PAPER Table 1). `None`: the unloading branch equals the loading branch.
    pub hysteresis_percent: Option<Vec<f64>>,
    /// Faults of units.
    pub faults: Vec<TaxelFault>,
    /// Rounding of the readings; `None`: no rounding.
    pub converter: Option<Converter>,
}

/// The elastomer cover.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elastomer {
    /// Depth of the taxels below the surface, mm; for a bonded layer this is its thickness.
    pub depth_mm: f64,
    /// Material below the surface.
    pub medium: Medium,
}

impl Elastomer {
    /// Creates a cover that is treated as an elastic half-space (PAPER S2).
    pub fn half_space(depth_mm: f64) -> Self {
        Elastomer { depth_mm, medium: Medium::HalfSpace }
    }
}

/// Size of the taxels, their reading without load, and their differences, which are uniform draws that belong to the specimen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Taxels {
    /// Radius of the disc over which each taxel averages the stress, mm; 0: a point.
    pub radius_mm: f64,
    /// Largest difference of a gain from 1 either way, %.
    pub gain_spread_percent: f64,
    /// Largest difference of a true place from the layout's place either way along x and y, mm.
    pub place_spread_mm: f64,
    /// Largest difference of a depth from the elastomer's depth either way, %. A deeper taxel has a smaller but wider response.
    pub depth_spread_percent: f64,
    /// Reading of all taxels without load, reading units.
    pub baseline: f64,
    /// Whether the second and third channels of a unit read shear stresses, and all channels the force sideways too.
    pub shear: bool,
}

/// Repeatability of a contact: one normal draw for each unit and contact.
#[derive(Clone, Debug, PartialEq)]
pub struct TaxelNoise {
    /// Loading repeatability of each taxel, % (PAPER Table 1). One standard deviation is a third of it.
    pub repeatability_percent: Vec<f64>,
    /// Reference value of the percentage.
    pub of: NoiseOf,
    /// Standard deviation of a second draw that is the same for all units and readings, reading units; 0: no second draw.
    pub floor: f64,
}

/// Reference value of a noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NoiseOf {
    /// The full scale, so the noise is constant.
    #[default]
    FullScale,
    /// The unit's noise-free reading.
    Reading,
}

/// Fault of one unit from the first contact to the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaxelFault {
    /// Number of the unit, counted from 1.
    pub unit: usize,
    /// Kind of the fault.
    pub kind: TaxelFaultKind,
}

/// Kinds of faults of a unit; readings in reading units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TaxelFaultKind {
    /// The unit reads 0.
    Dead,
    /// The unit always reads this value.
    Stuck(f64),
    /// The unit reads at most this value.
    Clipped(f64),
    /// The gain of the unit has changed by this value, %.
    Drifted(f64),
}

/// An analog-to-digital converter. Readings are rounded to a multiple of 2 `range` / 2^`bits` and are limited to the range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Converter {
    /// Bits, 1 to 32.
    pub bits: u32,
    /// Range either side of 0, reading units.
    pub range: f64,
}

impl Converter {
    /// Returns the converted reading.
    #[inline]
    pub fn convert(self, reading: f64) -> f64 {
        let codes = (1u64 << (self.bits - 1)) as f64; // on either side of 0
        let step = self.range / codes;
        nearest((reading / step).clamp(-codes, codes - 1.0)) * step
    }
}

/// Same result as `f64::round`, to the last bit, for values within 2^51. It uses only additions, which a processor does several
/// at a time. `round` may be a call of the C library that takes a quarter of a reading's time.
#[inline]
fn nearest(x: f64) -> f64 {
    const ONES: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52: next to it floats are whole numbers
    let even = (x + ONES) - ONES;
    let away = if x - even == 0.5f64.copysign(x) { 1f64.copysign(x) } else { 0.0 };
    (even + away).copysign(x)
}
