//! Force of a contact, with relaxation, advanced in closed form.

use super::spec::{ContactLaw, RelaxationBranch};
use super::surface::Depth;

/// Longest stretch of moving contact that one quadrature covers, s. It is far below the shortest relaxation time constant, so
/// five nodes are exact except for rounding. The peak force is checked at the same interval.
const STRETCH_S: f64 = 0.002;

/// Nodes and weights of five-point Gauss-Legendre quadrature on [0, 1].
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668, 0.118_463_442_528_094_5),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_23),
    (0.5, 0.284_444_444_444_444_45),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_23),
    (0.953_089_922_969_332, 0.118_463_442_528_094_5),
];

/// Largest number of iterations to find the deflection of the tip's support. The second constant is the allowed error, mm.
const YIELDS_MAX: usize = 6;
const YIELDED_MM: f64 = 1e-9;

/// Fraction of the force that remains after the tip has slipped.
const SLIPPED: f64 = 0.35;

/// State of the contact: relaxed curve plus Zener branches, each following q' = share F_el' - q / time.
#[derive(Clone)]
pub(super) struct ContactState {
    curve: ContactLaw,
    relaxes: bool,
    branches: Vec<RelaxationBranch>,
    /// Stiffness of the support of the tip, N/mm; `None`: rigid.
    series_n_mm: Option<f64>,
    /// Decay of each branch over the last piece of a motion, stored because the next piece usually has the same duration.
    fades: Vec<Fade>,
    /// Additional force of each branch now, N.
    extra_n: Vec<f64>,
    force_n: f64,
    depth_mm: f64,
    peak_n: f64,
    peak_mm: f64,
    will_slip: bool,
    slipped: bool,
    gone: bool,
}

/// Fractions that a branch keeps until the end of a piece: of its value at the beginning, and of the change at each node.
#[derive(Clone, Copy, Default)]
struct Fade {
    for_s: f64,
    whole: f64,
    nodes: [f64; GAUSS.len()],
}

impl ContactState {
    pub(super) fn new(curve: ContactLaw, branches: Vec<RelaxationBranch>, series_n_mm: Option<f64>) -> Self {
        let (extra_n, fades) = (vec![0.0; branches.len()], vec![Fade::default(); branches.len()]);
        let depth_mm = f64::NEG_INFINITY;
        ContactState {
            curve,
            relaxes: true,
            branches,
            series_n_mm,
            fades,
            extra_n,
            force_n: 0.0,
            depth_mm,
            peak_n: 0.0,
            peak_mm: 0.0,
            will_slip: false,
            slipped: false,
            gone: false,
        }
    }

    /// Sets the properties of the next contact; the tip must be without load.
    pub(super) fn will_meet(&mut self, curve: ContactLaw, relaxes: bool) {
        self.curve = curve;
        self.relaxes = relaxes;
        if !relaxes {
            self.forget_load();
        }
    }

    /// Makes the tip slip, in the contact under way or the next one, until it leaves the specimen.
    pub(super) fn slip(&mut self) {
        self.will_slip = true;
        self.settle(self.depth_mm);
    }

    /// Removes the specimen. The depth still counts from the specimen's earlier surface.
    pub(super) fn vanish(&mut self) {
        self.gone = true;
        self.settle(self.depth_mm);
    }

    /// True contact force, N. It is never negative, because the tip doesn't stick.
    pub(super) fn force_n(&self) -> f64 {
        self.force_n
    }

    /// Whether the tip is below the surface of a specimen that is present.
    pub(super) fn touching(&self) -> bool {
        self.depth_mm > 0.0 && !self.gone
    }

    /// Largest force, N, and largest depth, mm, since the last reset. Between two evaluations (2 ms of motion at most) the force
    /// may have been higher, by the relaxation of the branches in that time. This is less than 0.1 mN at 1 N.
    pub(super) fn peaks(&self) -> (f64, f64) {
        (self.peak_n, self.peak_mm)
    }

    pub(super) fn forget_peaks(&mut self) {
        self.peak_n = self.force_n;
        self.peak_mm = self.depth_mm.max(0.0);
    }

    /// Relaxes at once, because the tip goes to a spot that hasn't been loaded.
    pub(super) fn forget_load(&mut self) {
        self.extra_n.fill(0.0);
    }

    /// Advances by `dt_s`, during which the support of the tip follows one quadratic of depth.
    pub(super) fn advance(&mut self, depth: Depth, dt_s: f64) {
        match self.series_n_mm {
            Some(series_n_mm) if depth.mm > 0.0 || depth.after(dt_s) > 0.0 => self.yield_to(series_n_mm, &depth, dt_s),
            _ => self.advance_rigidly(depth, dt_s),
        }
    }

    /// Advances the contact of a tip on an elastic support. The tip lags behind its support by the force divided by the support's
    /// stiffness. The lag is found with secants, in short pieces.
    fn yield_to(&mut self, series_n_mm: f64, depth: &Depth, dt_s: f64) {
        let pieces = (dt_s / STRETCH_S).ceil().max(1.0);
        let piece_s = dt_s / pieces;
        for piece in 1..=pieces as usize {
            let carrier_mm = depth.after(piece as f64 * piece_s);
            let from_mm = self.depth_mm.max(depth.mm - self.force_n / series_n_mm);
            let tried = |to_mm: f64| {
                let mut tried = self.clone();
                let speed_mm_s = (to_mm - from_mm) / piece_s;
                tried.advance_rigidly(Depth { mm: from_mm, speed_mm_s, acceleration_mm_s2: 0.0 }, piece_s);
                let beyond_mm = to_mm + tried.force_n / series_n_mm - carrier_mm;
                (tried, beyond_mm)
            };
            let (mut now_mm, mut found) = (carrier_mm - self.force_n / series_n_mm, tried(carrier_mm));
            let mut last_mm = carrier_mm;
            for _ in 0..YIELDS_MAX {
                let last_beyond_mm = found.1;
                found = tried(now_mm);
                let slope = (found.1 - last_beyond_mm) / (now_mm - last_mm);
                if found.1.abs() < YIELDED_MM || !(slope.is_finite() && slope > 0.0) {
                    break;
                }
                (last_mm, now_mm) = (now_mm, now_mm - found.1 / slope);
            }
            *self = found.0;
        }
    }

    fn advance_rigidly(&mut self, depth: Depth, dt_s: f64) {
        let stays_unloaded = depth.mm <= 0.0 && depth.after(dt_s) <= 0.0 && depth.crossings(0.0, dt_s).next().is_none();
        if depth.at_rest() || stays_unloaded {
            self.decay(dt_s);
            self.settle(depth.after(dt_s));
            return;
        }
        let mut from_s = 0.0;
        for end_s in self.law_ends(&depth, dt_s) {
            if end_s == from_s {
                continue;
            }
            let pieces = ((end_s - from_s) / STRETCH_S).ceil().max(1.0);
            let piece_s = (end_s - from_s) / pieces;
            for piece in 0..pieces as usize {
                self.advance_moving(&depth, from_s + piece as f64 * piece_s, piece_s);
            }
            from_s = end_s;
        }
    }

    /// Times at which the curve's law changes, where the tip touches and where its toe ends, then `dt_s`, s from now. A time may occur
    /// more than once. A tip on an elastic support is later.
    pub(super) fn law_ends(&self, depth: &Depth, dt_s: f64) -> [f64; 5] {
        let mut ends = [dt_s; 5];
        let changes = depth.crossings(0.0, dt_s).chain(depth.crossings(self.curve.toe_mm, dt_s));
        ends.iter_mut().zip(changes).for_each(|(end, at_s)| *end = at_s);
        ends.sort_by(f64::total_cmp);
        ends
    }

    fn advance_moving(&mut self, depth: &Depth, from_s: f64, for_s: f64) {
        let curve = self.curve;
        // rate of the relaxed force at the nodes, shared by all branches
        let rates = GAUSS.map(|(node, weight)| {
            let t = from_s + node * for_s;
            weight * for_s * curve.stiffness_n_mm(depth.after(t)) * depth.speed_after(t)
        });
        for ((extra, branch), fade) in self.extra_n.iter_mut().zip(&self.branches).zip(&mut self.fades) {
            if fade.for_s != for_s {
                let left = |before_end_s: f64| (-before_end_s / branch.time_s).exp();
                *fade = Fade { for_s, whole: left(for_s), nodes: GAUSS.map(|(node, _)| left(for_s * (1.0 - node))) };
            }
            let fed: f64 = rates.iter().zip(fade.nodes).map(|(rate, left)| rate * left).sum();
            let share = if self.relaxes { branch.share } else { 0.0 };
            *extra = *extra * fade.whole + share * fed;
        }
        self.settle(depth.after(from_s + for_s));
    }

    fn decay(&mut self, dt_s: f64) {
        for (extra, branch) in self.extra_n.iter_mut().zip(&self.branches) {
            if *extra != 0.0 {
                *extra *= (-dt_s / branch.time_s).exp();
            }
        }
    }

    fn settle(&mut self, depth_mm: f64) {
        self.depth_mm = depth_mm;
        let bearing_n = self.curve.force_n(depth_mm) + self.extra_n.iter().sum::<f64>();
        self.force_n = if self.touching() { bearing_n.max(0.0) } else { 0.0 };
        self.slipped = self.touching() && (self.slipped || self.will_slip);
        if self.slipped {
            self.will_slip = false;
            self.force_n *= SLIPPED;
        }
        self.peak_n = self.peak_n.max(self.force_n);
        self.peak_mm = self.peak_mm.max(depth_mm);
    }
}

impl ContactLaw {
    /// Returns the curve with its force multiplied by `factor`.
    pub(super) fn times(self, factor: f64) -> ContactLaw {
        let ContactLaw { linear_n_mm, quadratic_n_mm2, toe_mm } = self;
        ContactLaw { linear_n_mm: factor * linear_n_mm, quadratic_n_mm2: factor * quadratic_n_mm2, toe_mm }
    }

    /// Relaxed force at a depth, N.
    pub fn force_n(&self, depth_mm: f64) -> f64 {
        let s = self.bearing_mm(depth_mm);
        s * (self.linear_n_mm + self.quadratic_n_mm2 * s)
    }

    /// Depth at a relaxed force, mm.
    pub fn depth_mm(&self, force_n: f64) -> f64 {
        let ContactLaw { linear_n_mm: k, quadratic_n_mm2: q, toe_mm } = *self;
        let bearing_mm = 2.0 * force_n / (k + (k * k + 4.0 * q * force_n).sqrt());
        if bearing_mm < toe_mm / 2.0 { (2.0 * toe_mm * bearing_mm).sqrt() } else { bearing_mm + toe_mm / 2.0 }
    }

    /// Slope of the relaxed force at a depth, N/mm.
    pub fn stiffness_n_mm(&self, depth_mm: f64) -> f64 {
        let s = self.bearing_mm(depth_mm);
        let bearing_share = if self.toe_mm > 0.0 { (depth_mm / self.toe_mm).clamp(0.0, 1.0) } else { 1.0 };
        if depth_mm <= 0.0 { 0.0 } else { bearing_share * (self.linear_n_mm + 2.0 * self.quadratic_n_mm2 * s) }
    }

    /// Effective depth for the force: a parabola over the toe, then the depth minus half the toe, with no kink between.
    fn bearing_mm(&self, depth_mm: f64) -> f64 {
        if depth_mm <= 0.0 {
            0.0
        } else if depth_mm < self.toe_mm {
            depth_mm * depth_mm / (2.0 * self.toe_mm)
        } else {
            depth_mm - self.toe_mm / 2.0
        }
    }
}
