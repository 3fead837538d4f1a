//! Creep and lag of the taxels: a load that stays changes the output slowly, and the output follows a load late.
//!
//! Lag and creep are linear, so their chain is a weighted sum of first-order followers of the load, side by side: `y' = (load - y) / T`.
//! Within a piece of time the load is a parabola through three values, under which a follower advances in closed form.

use super::contact::ContactState;
use super::skin::Skin;
use super::spec::RelaxationBranch;
use super::surface::Depth;
use palpate_core::quantity::Place;

/// Longest piece of a motion, s. A parabola through three of its forces changes the output by less than 1 nN at 10 mm/s.
const STRETCH_S: f64 = 0.002;

/// Longest piece of a rest, as a share of the time since the motion ended. Only slow branches of the contact's relaxation are left
/// then, so a parabola is as good.
const GROWTH: f64 = 0.005;

/// Number of times that a piece is halved to find when the force begins or ends. The rest is 1e-12 of the piece.
const HALVINGS: usize = 40;

/// Force at the beginning, the middle and the end of a piece of time in which the contact keeps its law.
pub(super) struct ForcePiece {
    for_s: f64,
    force_n: [f64; 3],
}

/// Memory of the taxels: the followers of each channel's load.
#[derive(Clone)]
pub(super) struct CreepState {
    /// Share of the load itself in the output: 1 without a lag, otherwise 0.
    direct: f64,
    followers: Vec<Follower>,
    /// Loads of all channels at the beginning, the middle and the end of a piece.
    loads: [Vec<f64>; 3],
}

#[derive(Clone)]
struct Follower {
    time_s: f64,
    /// Share of its values in the output.
    weight: f64,
    /// Value of each channel, in units of the outputs.
    values: Vec<f64>,
}

impl CreepState {
    /// Creates the memory of unloaded taxels; `None` if there is neither creep nor lag. The time constant of each branch differs
    /// from the lag.
    pub(super) fn new(branches: &[RelaxationBranch], lag_s: Option<f64>, channels: usize) -> Option<CreepState> {
        if branches.is_empty() && lag_s.is_none() {
            return None;
        }
        // 1 / (1 + lag s) (1 + sum of share / (1 + time s)) in partial fractions
        let after_lag_s = |branch: &RelaxationBranch| branch.time_s - lag_s.unwrap_or(0.0);
        let lag = lag_s.map(|lag_s| {
            let parts = branches.iter().map(|branch| branch.share * lag_s / after_lag_s(branch));
            (lag_s, 1.0 - parts.sum::<f64>())
        });
        let creep = branches.iter().map(|branch| (branch.time_s, branch.share * branch.time_s / after_lag_s(branch)));
        let values = vec![0.0; channels];
        let followers = lag.into_iter().chain(creep);
        Some(CreepState {
            direct: if lag_s.is_some() { 0.0 } else { 1.0 },
            loads: [(); 3].map(|()| values.clone()),
            followers: followers.map(|(time_s, weight)| Follower { time_s, weight, values: values.clone() }).collect(),
        })
    }

    /// Latest time at which the scene must stop after `now_s`, s. `rests_s` is the time at which the last axis comes to rest.
    pub(super) fn next_knot(now_s: f64, rests_s: f64, touching: bool) -> f64 {
        if now_s >= rests_s && !touching {
            return f64::INFINITY; // the load stays zero
        }
        now_s + STRETCH_S.max(GROWTH * (now_s - rests_s))
    }

    /// Takes a stretch of time. `load_at` returns the force along x, y and into the specimen, N, and its place, from the time since
    /// the stretch began, s, and the contact force then, N.
    pub(super) fn follow(
        &mut self,
        skin: &Skin,
        pieces: &[ForcePiece],
        load_at: impl Fn(f64, f64) -> ([f64; 3], Place),
    ) {
        let mut from_s = 0.0;
        for &ForcePiece { for_s, force_n } in pieces {
            for ((loads, node), force_n) in self.loads.iter_mut().zip([0.0, 0.5, 1.0]).zip(force_n) {
                let (force_n, place) = load_at(from_s + node * for_s, force_n);
                loads.fill(0.0);
                skin.add_force(force_n, place, loads);
            }
            let [first, middle, last] = &self.loads;
            for follower in &mut self.followers {
                let weights = weights(for_s / follower.time_s);
                for (channel, value) in follower.values.iter_mut().enumerate() {
                    let beyond = [first, middle, last].map(|loads| loads[channel] - *value);
                    *value += weights.iter().zip(beyond).map(|(weight, beyond)| weight * beyond).sum::<f64>();
                }
            }
            from_s += for_s;
        }
    }

    /// Turns the outputs under the load of this moment into those of the taxels with their memory.
    pub(super) fn read_out(&self, outputs: &mut [f64]) {
        for (channel, output) in outputs.iter_mut().enumerate() {
            let slow: f64 = self.followers.iter().map(|follower| follower.weight * follower.values[channel]).sum();
            *output = self.direct * *output + slow;
        }
    }
}

/// Advances a contact, and returns its force piece by piece. The pieces end where the law of the contact changes, and where the force
/// begins or ends.
pub(super) fn advance_in_pieces(contact: &mut ContactState, depth: Depth, dt_s: f64) -> Vec<ForcePiece> {
    let (mut from_s, mut pieces) = (0.0, Vec::new());
    for law_end_s in contact.law_ends(&depth, dt_s) {
        if law_end_s <= from_s {
            continue;
        }
        let turn_s = from_s + force_turns_in_s(contact, depth.later(from_s), law_end_s - from_s);
        for end_s in [turn_s.min(law_end_s), law_end_s] {
            if end_s <= from_s {
                continue;
            }
            let half_s = (end_s - from_s) / 2.0;
            let before_n = contact.force_n();
            contact.advance(depth.later(from_s), half_s);
            let middle_n = contact.force_n();
            contact.advance(depth.later(from_s + half_s), half_s);
            pieces.push(ForcePiece { for_s: end_s - from_s, force_n: [before_n, middle_n, contact.force_n()] });
            from_s = end_s;
        }
    }
    pieces
}

/// Time after which the force begins or ends, s, at most `for_s`. It ends before the depth does, because an unloaded specimen rises
/// slowly. It begins late if the tip has an elastic support.
fn force_turns_in_s(contact: &ContactState, depth: Depth, for_s: f64) -> f64 {
    let pressed = contact.force_n() > 0.0;
    let stays_after = |after_s: f64| {
        let mut tried = contact.clone();
        tried.advance(depth, after_s);
        (tried.force_n() > 0.0) == pressed
    };
    let (mut before_s, mut after_s) = (0.0, for_s);
    if stays_after(for_s) {
        return for_s;
    }
    for _ in 0..HALVINGS {
        let middle_s = (before_s + after_s) / 2.0;
        if stays_after(middle_s) { before_s = middle_s } else { after_s = middle_s }
    }
    after_s
}

/// Weights of a follower's distance from the loads at the beginning, the middle and the end of a piece that lasts `x` time constants.
/// They integrate `x exp(-x (1 - u))` times the parabola over u from 0 to 1. They add up to `1 - exp(-x)`.
fn weights(x: f64) -> [f64; 3] {
    let [whole, first, second] = moments(x);
    [whole - 3.0 * first + 2.0 * second, 4.0 * (first - second), 2.0 * second - first]
}

/// Integrals of `x exp(-x (1 - u)) u^k` over u from 0 to 1, for k = 0, 1 and 2. One follows from the next: backward for a short piece,
/// forward for a long one, so no digits are lost.
fn moments(x: f64) -> [f64; 3] {
    if x < 1.0 {
        let second = (3..20).rev().fold(0.0, |next, k| x * (1.0 - next) / f64::from(k));
        let first = x * (1.0 - second) / 2.0;
        return [x * (1.0 - first), first, second];
    }
    let whole = -(-x).exp_m1();
    let first = 1.0 - whole / x;
    [whole, first, 1.0 - 2.0 * first / x]
}
