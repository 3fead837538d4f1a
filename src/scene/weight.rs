//! A known weight on the tip, put there and taken off by a person.

use crate::quantity::stream;
use rand::RngExt;

/// What the weight does: a force that acts, and the next change.
#[derive(Clone, Default)]
pub(super) struct Weight {
    acts_n: f64,
    next: Option<(f64, f64)>,
}

impl Weight {
    /// From `at_s` on the weight presses with this force; 0: it is taken off.
    pub fn change(&mut self, at_s: f64, force_n: f64) {
        self.next = Some((at_s, force_n));
    }

    /// When it changes next, s.
    pub fn next_s(&self) -> f64 {
        self.next.map_or(f64::INFINITY, |(at_s, _)| at_s)
    }

    /// Takes in a change that is due.
    pub fn strike(&mut self, now_s: f64) {
        if let Some((_, force_n)) = self.next.take_if(|(at_s, _)| *at_s <= now_s) {
            self.acts_n = force_n;
        }
    }

    /// What it presses with, N.
    pub fn force_n(&self) -> f64 {
        self.acts_n
    }
}

/// What a weight of this nominal force really weighs, N: as likely anywhere within `u_n` of it, and the same for each seed.
pub(super) fn true_force_n(nominal_n: f64, u_n: f64, seed: u64) -> f64 {
    nominal_n + u_n * stream(seed, 0, "check weight").random_range(-1.0..=1.0)
}
