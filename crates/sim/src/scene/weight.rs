//! A known weight on the tip, put on and removed by a person.

use palpate_core::quantity::stream;
use rand::RngExt;

/// State of the weight: the acting force and the next change.
#[derive(Clone, Default)]
pub(super) struct Weight {
    acts_n: [f64; 3],
    next: Option<(f64, [f64; 3])>,
}

impl Weight {
    /// Makes the weight act with this force along x, y and the press from `at_s` on; 0 removes it.
    pub(super) fn change(&mut self, at_s: f64, force_n: [f64; 3]) {
        self.next = Some((at_s, force_n));
    }

    /// Time of the next change, s.
    pub(super) fn next_s(&self) -> f64 {
        self.next.map_or(f64::INFINITY, |(at_s, _)| at_s)
    }

    /// Applies a change that is due.
    pub(super) fn strike(&mut self, now_s: f64) {
        if let Some((_, force_n)) = self.next.take_if(|(at_s, _)| *at_s <= now_s) {
            self.acts_n = force_n;
        }
    }

    /// Force of the weight along x, y and the press, N.
    pub(super) fn force_n(&self) -> [f64; 3] {
        self.acts_n
    }
}

/// Real force of a weight with this nominal force, N. It is uniformly distributed within `u_n` of the nominal force, and the same
/// for each seed.
pub(super) fn true_force_n(nominal_n: f64, u_n: f64, seed: u64) -> f64 {
    nominal_n + u_n * stream(seed, 0, "check weight").random_range(-1.0..=1.0)
}
