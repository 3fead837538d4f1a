//! Hysteresis and relaxation of the taxels' readings.

use super::skin::Skin;
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
}

impl TaxelState {
    pub(super) fn new(skin: Skin) -> Self {
        TaxelState { skin, rng: stream(0, 0, "taxel noise"), reversal: 0.0 }
    }

    pub(super) fn reseed(&mut self, rng: RandomStream) {
        self.rng = rng;
    }

    /// Begins a new contact, which differs slightly from the last one.
    pub(super) fn touch(&mut self) {
        self.skin.draw_contact(&mut self.rng);
        self.reversal = 0.0;
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

    /// Writes the readings of the taxels under a force along x, y and into the specimen at `place`, reading units (1 = 1 N straight
    /// above).
    pub(super) fn outputs(&self, force_n: [f64; 3], place: Place, outputs: &mut [f64]) {
        outputs.fill(0.0);
        self.skin.add_force(force_n, place, outputs);
        let unloading = self.reversal * self.reversal * (3.0 - 2.0 * self.reversal);
        self.skin.read_out(unloading, outputs);
    }
}
