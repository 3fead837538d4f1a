use super::spec::{Elastomer, Setting};
use crate::mechanics::lambda;
use crate::quantity::{ArrayLayout, Place, Stream, stream};
use rand::distr::Distribution;
use rand_distr::StandardNormal;

/// Force reversal over which a taxel goes from its loading to its unloading branch, N. The crossing is smooth at both ends, so
/// that the relaxation of a hold (some 2 % of the load) leaves the branch where it is.
const CROSSING_N: f64 = 0.5;

/// The taxels: half-space stress, noise that is one draw per unit and contact, hysteresis that is a state.
#[derive(Clone)]
pub(super) struct TaxelState {
    elastomer: Option<Elastomer>,
    layout: ArrayLayout,
    full_scale: f64,
    noise_sd: Option<Vec<f64>>,
    hysteresis: Option<Vec<f64>>,
    rng: Stream,
    /// This contact's error of each unit, reading units; empty in air.
    contact_error: Vec<f64>,
    /// How far the force has turned back from loading, 0 to 1.
    reversal: f64,
}

impl TaxelState {
    pub fn new(
        elastomer: Option<Elastomer>,
        repeatability_percent: Option<Vec<f64>>,
        hysteresis_percent: Option<Vec<f64>>,
        setting: &Setting,
    ) -> Self {
        let full_scale = setting.full_scale_n;
        let scaled = |percent: Vec<f64>, part: f64| percent.iter().map(|p| p / 100.0 * part * full_scale).collect();
        TaxelState {
            elastomer,
            layout: setting.layout.clone(),
            full_scale,
            noise_sd: repeatability_percent.map(|percent| scaled(percent, 1.0 / 3.0)),
            hysteresis: hysteresis_percent.map(|percent| scaled(percent, 1.0)),
            rng: stream(0, 0, "taxel noise"),
            contact_error: Vec::new(),
            reversal: 0.0,
        }
    }

    pub fn reseed(&mut self, rng: Stream) {
        self.rng = rng;
    }

    /// A new contact begins: it doesn't quite repeat the last one.
    pub fn touch(&mut self) {
        let rng = &mut self.rng;
        self.contact_error = match &self.noise_sd {
            None => Vec::new(),
            Some(sd) => sd.iter().map(|sd| -> f64 { sd * Distribution::<f64>::sample(&StandardNormal, rng) }).collect(),
        };
        self.reversal = 0.0;
    }

    /// The force went from one value to another.
    pub fn follow(&mut self, from_n: f64, to_n: f64, touching: bool) {
        if touching {
            self.reversal = (self.reversal - (to_n - from_n) / CROSSING_N).clamp(0.0, 1.0);
        } else {
            self.contact_error.clear();
            self.reversal = 0.0;
        }
    }

    /// What the taxels read under `force_n` at `place`, reading units (1 = 1 N straight above).
    pub fn outputs(&self, force_n: f64, place: Place, outputs: &mut [f64]) {
        assert_eq!(outputs.len(), self.layout.len(), "one output a taxel");
        let branch = self.reversal * self.reversal * (3.0 - 2.0 * self.reversal);
        for (unit, output) in outputs.iter_mut().enumerate() {
            let straight = match self.elastomer {
                None => 0.0,
                Some(cover) => force_n * lambda(place.distance_mm(self.layout.places()[unit]) / cover.depth_mm),
            };
            let u = straight / self.full_scale;
            let loop_width = self.hysteresis.as_ref().map_or(0.0, |h| h[unit]) * (4.0 * u * (1.0 - u)).max(0.0);
            let error = self.contact_error.get(unit).copied().unwrap_or(0.0);
            *output = straight + branch * loop_width + error;
        }
    }
}
