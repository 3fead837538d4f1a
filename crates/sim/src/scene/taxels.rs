//! Readings of the taxels in a running scene: hysteresis, creep, and the effects of temperature and wear.

use super::creep::{CreepState, ForcePiece};
use super::skin::Skin;
use super::temperature::Temperature;
use super::wear::WearState;
use palpate_core::quantity::{Place, RandomStream, stream};

/// Force reversal over which a taxel changes from its loading branch to its unloading branch, N. The transition is smooth at both
/// ends. So the relaxation of a hold (some 2 % of the load) doesn't leave the branch.
const CROSSING_N: f64 = 0.5;

/// State of the taxels in a running scene: a skin with noise and hysteresis. The noise is one draw for each unit and contact.
#[derive(Clone)]
pub(super) struct TaxelState {
    skin: Skin,
    rng: RandomStream,
    /// Reversal of the force from loading, 0 to 1.
    reversal: f64,
    terms: TaxelTerms,
}

/// Effects over time; each is `None` if the scene doesn't name it.
#[derive(Clone)]
pub(super) struct TaxelTerms {
    pub(super) creep: Option<CreepState>,
    pub(super) temperature: Option<Temperature>,
    pub(super) wear: Option<WearState>,
    /// Reading without load that temperature and wear shift, reading units.
    pub(super) baseline: f64,
}

impl TaxelState {
    pub(super) fn new(skin: Skin, terms: TaxelTerms) -> Self {
        TaxelState { skin, rng: stream(0, 0, "taxel noise"), reversal: 0.0, terms }
    }

    pub(super) fn reseed(&mut self, rng: RandomStream) {
        self.rng = rng;
    }

    /// Begins a new contact, which differs slightly from the last one.
    pub(super) fn touch(&mut self) {
        self.skin.draw_contact(&mut self.rng);
        self.reversal = 0.0;
        if let Some(wear) = &mut self.terms.wear {
            wear.touch();
        }
    }

    /// Takes a change of the force from one value to another.
    pub(super) fn follow(&mut self, from_n: f64, to_n: f64, touching: bool) {
        if touching {
            self.reversal = (self.reversal - (to_n - from_n) / CROSSING_N).clamp(0.0, 1.0);
        } else {
            self.skin.forget_contact();
            self.reversal = 0.0;
        }
    }

    /// Whether the outputs depend on earlier loads.
    pub(super) fn creeps(&self) -> bool {
        self.terms.creep.is_some()
    }

    /// Takes the load over a stretch of time, as [`CreepState::follow`] does.
    pub(super) fn creep(&mut self, pieces: &[ForcePiece], load_at: impl Fn(f64, f64) -> ([f64; 3], Place)) {
        if let Some(creep) = &mut self.terms.creep {
            creep.follow(&self.skin, pieces, load_at);
        }
    }

    /// Writes the readings of the taxels at `now_s` under a force along x, y and into the specimen at `place`, reading units (1 = 1 N
    /// straight above). Temperature and wear change the gain of the outputs that have crept.
    pub(super) fn outputs(&mut self, force_n: [f64; 3], place: Place, now_s: f64, outputs: &mut [f64]) {
        outputs.fill(0.0);
        self.skin.add_force(force_n, place, outputs);
        let TaxelTerms { creep, temperature, wear, baseline } = &self.terms;
        if let Some(creep) = creep {
            creep.read_out(outputs);
        }
        let warm = temperature.map(|temperature| temperature.of_taxels(now_s));
        let worn = wear.map(|wear| wear.of_taxels());
        let mut shifted = *baseline;
        for (gain, zero) in warm.into_iter().chain(worn) {
            outputs.iter_mut().for_each(|output| *output *= gain);
            shifted += zero;
        }
        self.skin.set_baseline(shifted);
        let unloading = self.reversal * self.reversal * (3.0 - 2.0 * self.reversal);
        self.skin.read_out(unloading, outputs);
    }
}
