//! Readings of the taxels under contacts, without a running scene: pure code, without an allocation for a reading.

mod spec;

pub use spec::{Converter, Elastomer, NoiseOf, SkinSpec, TaxelFault, TaxelFaultKind, TaxelNoise, Taxels};

use palpate_core::mechanics::{Passage, TaxelResponse, traction};
use palpate_core::quantity::{ArrayLayout, Place, RandomStream, stream};
use rand::RngExt;
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use std::ops::Range;

/// Largest number of channels of a unit that read a signal: the normal stress, and its slopes or the shear stresses along x and y.
pub const SKIN_CHANNELS_MAX: usize = 3;

/// Taxels of a specimen: the stress at each taxel, and the resulting reading.
///
/// A contact is read in two steps. [`add_load`](Self::add_load) adds the effect of a load to the outputs, without any error;
/// several loads add up. [`read_out`](Self::read_out) turns the sum into readings: hysteresis, this contact's errors (drawn by
/// [`draw_contact`](Self::draw_contact)), baseline, faults, converter. [`outputs`](Self::outputs) does both for one load.
#[derive(Clone)]
pub struct Skin {
    /// Channels in the order of the outputs.
    channels: Vec<TaxelChannel>,
    /// Outputs of each unit.
    units: Vec<Range<usize>>,
    /// Reading for the largest force straight above.
    full_scale: f64,
    noise_of: NoiseOf,
    floor: f64,
    baseline: f64,
    faults: Vec<TaxelFault>,
    converter: Option<Converter>,
}

#[derive(Clone)]
struct TaxelChannel {
    reads: Reads,
    place: Place,
    /// Response of the elastomer; `None` if there is no elastomer.
    response: Option<TaxelResponse>,
    /// Reading for a response of 1.
    gain: f64,
    /// Standard deviation of the channel's error: of full scale in reading units, or of the reading as a fraction.
    error_sd: f64,
    /// Width of the hysteresis loop at half the full scale, reading units.
    hysteresis: f64,
    /// Error of this contact: a fraction of the noise-free reading, and reading units.
    error_of_reading: f64,
    error: f64,
}

/// Quantity that a channel of a unit reads.
#[derive(Clone, Copy, PartialEq)]
enum Reads {
    /// The response itself, on the first channel.
    Normal,
    /// Slope of the response along x times the unit's depth, for a load that moves along x, on the second channel.
    SlopeX,
    /// Slope of the response along y times the unit's depth, on the third channel.
    SlopeY,
    /// Traction along x, y or z, numbered from 0, by a point load on a half-space.
    Traction(usize),
    /// No signal.
    Nothing,
}

impl Skin {
    /// Creates the taxels of a specimen, without load. Gains, true places, depths, errors and hysteresis belong to a unit and hold for
    /// all its channels; each channel's error is a separate draw. `full_scale_n` is the largest specified force. The properties
    /// of the specimen (gains, true places, depths) depend on `seed` alone, each from its own stream.
    ///
    /// # Panics
    /// If a list of percentages is shorter than the layout, or a fault names a unit that doesn't exist.
    pub fn new(spec: &SkinSpec, layout: &ArrayLayout, full_scale_n: f64, seed: u64) -> Self {
        let Taxels { gain_spread_percent, place_spread_mm, depth_spread_percent, baseline, .. } = spec.taxels;
        let mut gains = UniformSpread::new(gain_spread_percent / 100.0, "taxel gains", seed);
        let mut places = UniformSpread::new(place_spread_mm, "taxel places", seed);
        let mut depths = UniformSpread::new(depth_spread_percent / 100.0, "taxel depths", seed);
        let nominal = spec.elastomer.map(|elastomer| TaxelResponse::new(passage(spec, elastomer)));
        let units: Vec<Range<usize>> = layout.units().collect();
        let channels = units.iter().enumerate().flat_map(|(index, outputs)| {
            let at = layout.places()[outputs.start];
            let of_response = 1.0 + gains.draw();
            let place = Place::new(at.x_mm + places.draw(), at.y_mm + places.draw());
            let deeper = 1.0 + depths.draw();
            let response = nominal.as_ref().map(|nominal| deepened(nominal, deeper));
            // 1 N straight above reads 1 where nothing is spread; the stress falls as the depth squared
            let peak = nominal.as_ref().map_or(1.0, |nominal| nominal.at(0.0));
            let drift = drift(&spec.faults, index + 1);
            let percent = |list: &Option<Vec<f64>>| list.as_ref().map_or(0.0, |percent| percent[index] / 100.0);
            let noise = spec.noise.as_ref().map_or(0.0, |noise| noise.repeatability_percent[index] / 100.0);
            let error_sd = match noise_of(spec) {
                NoiseOf::FullScale => noise * (1.0 / 3.0) * full_scale_n,
                NoiseOf::Reading => noise / 3.0,
            };
            let first = TaxelChannel {
                reads: Reads::Normal,
                place,
                response,
                gain: of_response * drift / (peak * deeper * deeper),
                error_sd,
                hysteresis: percent(&spec.hysteresis_percent) * full_scale_n,
                error_of_reading: 0.0,
                error: 0.0,
            };
            let reads = match spec.taxels.shear {
                true => [2, 0, 1].map(Reads::Traction),
                false => [Reads::Normal, Reads::SlopeX, Reads::SlopeY],
            };
            let reads = reads.into_iter().chain(std::iter::repeat(Reads::Nothing)).take(outputs.len());
            reads.map(|reads| TaxelChannel { reads, ..first.clone() }).collect::<Vec<_>>()
        });
        let channels: Vec<TaxelChannel> = channels.collect();
        assert!(
            spec.faults.iter().all(|fault| (1..=units.len()).contains(&fault.unit)),
            "a fault of a unit there isn't"
        );
        Skin {
            channels,
            units,
            full_scale: full_scale_n,
            noise_of: noise_of(spec),
            floor: spec.noise.as_ref().map_or(0.0, |noise| noise.floor),
            baseline,
            faults: spec.faults.clone(),
            converter: spec.converter,
        }
    }

    /// Number of outputs.
    pub fn len(&self) -> usize {
        self.channels.len()
    }

    /// Whether there are no outputs.
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }

    /// Sets the reading without load, reading units.
    pub(super) fn set_baseline(&mut self, baseline: f64) {
        self.baseline = baseline;
    }

    /// Begins a new contact, which differs slightly from the last one. It takes one draw for each channel, then one more for each
    /// channel if there is a floor.
    pub fn draw_contact(&mut self, rng: &mut RandomStream) {
        self.forget_contact();
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let noisy = self.channels.iter().any(|channel| channel.error_sd != 0.0);
        for channel in self.channels.iter_mut().filter(|_| noisy) {
            let error = channel.error_sd * normal();
            match self.noise_of {
                NoiseOf::FullScale => channel.error = error,
                NoiseOf::Reading => channel.error_of_reading = error,
            }
        }
        if self.floor > 0.0 {
            self.channels.iter_mut().for_each(|channel| channel.error += self.floor * normal());
        }
    }

    /// Ends the contact. Without load there is no error.
    pub fn forget_contact(&mut self) {
        for channel in &mut self.channels {
            (channel.error_of_reading, channel.error) = (0.0, 0.0);
        }
    }

    /// Adds to `outputs` the effect of `force_n` at a place (specimen frame) on each taxel, without any error.
    ///
    /// # Panics
    /// If the length of `outputs` isn't the number of outputs.
    pub fn add_load(&self, force_n: f64, place: Place, outputs: &mut [f64]) {
        self.add_force([0.0, 0.0, force_n], place, outputs);
    }

    /// Adds the effect of a force along x, y and into the specimen, N. Only taxels that read tractions respond to the force sideways.
    ///
    /// # Panics
    /// If the length of `outputs` isn't the number of outputs.
    pub fn add_force(&self, force_n: [f64; 3], place: Place, outputs: &mut [f64]) {
        assert_eq!(outputs.len(), self.len(), "one place an output");
        for (channel, output) in self.channels.iter().zip(outputs) {
            if let Some(response) = &channel.response {
                *output += channel.reads.of_force(force_n, response, channel.place, place) * channel.gain;
            }
        }
    }

    /// Turns the sum of all loads into the readings of the taxels. `unloading` is 0 on the loading branch of the hysteresis and 1
    /// on the unloading branch.
    pub fn read_out(&self, unloading: f64, outputs: &mut [f64]) {
        for (channel, output) in self.channels.iter().zip(&mut *outputs) {
            let straight = *output;
            let u = straight / self.full_scale;
            let loop_width = match channel.reads {
                Reads::Normal | Reads::Traction(2) => channel.hysteresis * (4.0 * u * (1.0 - u)).max(0.0),
                // a slope lags in either direction
                _ => (channel.hysteresis * (4.0 * u.abs() * (1.0 - u.abs())).max(0.0)).copysign(u),
            };
            let error = channel.error + channel.error_of_reading * straight;
            *output = straight + unloading * loop_width + error + self.baseline;
        }
        for fault in &self.faults {
            for output in &mut outputs[self.units[fault.unit - 1].clone()] {
                match fault.kind {
                    TaxelFaultKind::Dead => *output = 0.0,
                    TaxelFaultKind::Stuck(reading) => *output = reading,
                    TaxelFaultKind::Clipped(most) => *output = output.min(most),
                    TaxelFaultKind::Drifted(_) => {} // the gain contains it
                }
            }
        }
        if let Some(converter) = self.converter {
            outputs.iter_mut().for_each(|output| *output = converter.convert(*output));
        }
    }

    /// Writes to `outputs` the readings of the taxels under `force_n` at a place (specimen frame), in reading units. The readings
    /// are those during loading, with this contact's errors.
    ///
    /// # Panics
    /// If the length of `outputs` isn't the number of outputs.
    pub fn outputs(&self, force_n: f64, place: Place, outputs: &mut [f64]) {
        outputs.fill(0.0);
        self.add_load(force_n, place, outputs);
        self.read_out(0.0, outputs);
    }
}

impl Reads {
    /// Response of a unit's channel to a force along x, y and into the specimen, N, at another place.
    #[inline]
    fn of_force(self, force_n: [f64; 3], response: &TaxelResponse, unit: Place, load: Place) -> f64 {
        let Reads::Traction(along) = self else { return force_n[2] * self.of(response, unit, load) };
        let depth_mm = response.passage().depth_mm;
        let t = traction([unit.x_mm - load.x_mm, unit.y_mm - load.y_mm, depth_mm]);
        response.at(0.0) * t[along].iter().zip(force_n).map(|(t, force_n)| t * force_n).sum::<f64>()
    }

    /// Response of a unit's channel to 1 N at another place.
    #[inline]
    fn of(self, response: &TaxelResponse, unit: Place, load: Place) -> f64 {
        let distance_mm = load.distance_mm(unit);
        let along_mm = match self {
            Reads::Normal => return response.at(distance_mm),
            Reads::SlopeX => load.x_mm - unit.x_mm,
            Reads::SlopeY => load.y_mm - unit.y_mm,
            Reads::Nothing | Reads::Traction(_) => return 0.0,
        };
        if distance_mm == 0.0 {
            return 0.0; // straight above it has no direction
        }
        response.with_slope(distance_mm).1 * (along_mm / distance_mm) * response.passage().depth_mm
    }
}

/// Uniform draws around 0 that belong to the specimen. If the spread is zero, nothing is drawn.
struct UniformSpread {
    most: f64,
    rng: RandomStream,
}

impl UniformSpread {
    fn new(most: f64, name: &str, seed: u64) -> Self {
        UniformSpread { most, rng: stream(seed, 0, name) }
    }

    fn draw(&mut self) -> f64 {
        if self.most == 0.0 { 0.0 } else { self.most * self.rng.random_range(-1.0..=1.0) }
    }
}

fn passage(spec: &SkinSpec, elastomer: Elastomer) -> Passage {
    Passage {
        medium: elastomer.medium,
        depth_mm: elastomer.depth_mm,
        indenter_radius_mm: spec.indenter_radius_mm,
        taxel_radius_mm: spec.taxels.radius_mm,
    }
}

/// Returns the response at another depth. If the depth is the same, the table is shared.
fn deepened(nominal: &TaxelResponse, times: f64) -> TaxelResponse {
    let passage = *nominal.passage();
    if times == 1.0 {
        nominal.clone()
    } else {
        TaxelResponse::new(Passage { depth_mm: passage.depth_mm * times, ..passage })
    }
}

/// Factor of the drifts for a unit's gain.
fn drift(faults: &[TaxelFault], unit: usize) -> f64 {
    let of_unit = faults.iter().filter(|fault| fault.unit == unit);
    of_unit.fold(1.0, |gain, fault| match fault.kind {
        TaxelFaultKind::Drifted(percent) => gain * (1.0 + percent / 100.0),
        _ => gain,
    })
}

fn noise_of(spec: &SkinSpec) -> NoiseOf {
    spec.noise.as_ref().map_or(NoiseOf::default(), |noise| noise.of)
}

#[cfg(test)]
mod tests;
