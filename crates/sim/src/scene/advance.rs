//! Advance of a scene to a moment, in closed form from one change of the laws to the next.

use super::Scene;
use super::creep::{CreepState, ForcePiece, advance_in_pieces};
use super::faults::FaultKind;
use super::motion::Trajectory;
use super::spec::ContactLaw;
use palpate_core::quantity::{Axis, Place};

/// Least factor of a stiffness map for the contact curve, because a normal draw has no bound.
const SOFTEST: f64 = 0.1;

impl Scene {
    /// Advances the physics to `to_s`. Stops at every instant at which something changes the laws of motion or contact.
    pub(super) fn advance(&mut self, to_s: f64) {
        while self.now_s < to_s {
            let until_s = self.next_knot(to_s);
            self.advance_smooth(until_s);
            self.strike(self.now_s, until_s);
            self.now_s = until_s;
            self.weight.strike(until_s);
            self.load_cell.latch(self.now_s);
        }
    }

    /// Force of the tip on the specimen by friction along x and y, N.
    pub(super) fn friction_n(&self) -> [f64; 2] {
        self.friction.as_ref().map_or([0.0; 2], |(_, state)| state.force_n())
    }

    /// Returns the next instant at which an axis changes its acceleration, a fault begins, or the load cell or the window needs
    /// the force. It is at most `to_s`.
    pub(super) fn next_knot(&self, to_s: f64) -> f64 {
        let z = &self.axes[Axis::Z.index()];
        let engages_s =
            self.backlash.as_ref().map_or(f64::INFINITY, |backlash| backlash.engages_in_s(z.state(self.now_s)));
        let others = [
            self.now_s + engages_s,
            self.load_cell.next_knot(self.now_s, to_s),
            self.faults.next_s(self.now_s),
            self.weight.next_s(),
            self.witness.next_knot(self.now_s),
            self.creep_knot_s(),
        ];
        let knots = self.axes.iter().filter_map(|axis| axis.next_knot(self.now_s)).chain(others);
        knots.filter(|&knot_s| knot_s > self.now_s).fold(to_s, f64::min)
    }

    /// Latest time at which the scene must stop so that creep and lag of the taxels follow their load, s.
    fn creep_knot_s(&self) -> f64 {
        if !self.taxels.creeps() {
            return f64::INFINITY;
        }
        let rests_s = self.axes.iter().map(Trajectory::end_s).fold(f64::NEG_INFINITY, f64::max);
        CreepState::next_knot(self.now_s, rests_s, self.contact.touching())
    }

    /// Advances over one stretch in which all axes keep their accelerations, so the depth is a quadratic function of time. Local
    /// properties of the specimen are those at the place where the stretch begins, also in a drag.
    fn advance_smooth(&mut self, until_s: f64) {
        let dt_s = until_s - self.now_s;
        let [x, y, z] = self.axes.each_ref().map(|axis| axis.state(self.now_s));
        let z_acceleration_mm_s2 = z.2;
        let z = self.backlash.as_mut().map_or(z, |backlash| backlash.follow(z, dt_s));
        let place = self.setting.frame.place_from_stage(x.0, y.0);
        let mut depth = self.surface.depth(x, y, z);
        if let Some(wave) = self.surface_wave {
            depth.mm -= wave.at(self.now_s);
            depth.speed_mm_s -= wave.slope_at(self.now_s);
        }
        if let Some(relief) = &mut self.relief {
            depth.mm -= relief.at(place);
        }
        depth.mm += self.faults.values(FaultKind::Risen, self.now_s).sum::<f64>();
        let cosine = self.surface.cosine();
        let depth = depth.times(cosine);
        let was_touching = self.contact.touching();
        let before_n = self.contact.force_n();
        if !was_touching {
            self.lay_under_the_tip(place);
        }
        let friction_before_n = self.friction_n();
        let pieces = self.taxels.creeps().then(|| advance_in_pieces(&mut self.contact, depth, dt_s));
        if pieces.is_none() {
            self.contact.advance(depth, dt_s);
        }
        let (touching, after_n) = (self.contact.touching(), self.contact.force_n());
        if touching && !was_touching {
            self.taxels.touch(place);
        }
        self.taxels.follow(before_n, after_n, touching);
        let [.., hung_z_n] = self.weight.force_n();
        let hung_n = hung_z_n + self.load_cell.tool_n(z_acceleration_mm_s2 * self.setting.frame.down.sign());
        self.load_cell.follow(dt_s, before_n * cosine + hung_n, after_n * cosine + hung_n);
        if let Some((friction, state)) = &mut self.friction {
            let [x, y, _] = self.axes.each_ref().map(|axis| axis.position_mm(until_s));
            state.follow(friction, self.setting.frame.place_from_stage(x, y), after_n);
            let (per_force, friction_n) = (self.surface.side_per_force(), state.force_n());
            self.load_cell.press_sideways(friction_n);
            let side_n = [0, 1].map(|axis| per_force[axis] * after_n * cosine + friction_n[axis]);
            self.witness.press(side_n, after_n * cosine);
        }
        if let Some(pieces) = pieces {
            self.creep(&pieces, dt_s, friction_before_n);
        }
        self.witness.follow(dt_s, before_n, after_n);
        let sideways = [x, y].iter().any(|&(_, speed, acceleration)| speed != 0.0 || acceleration != 0.0);
        if sideways && (touching || was_touching) {
            self.witness.slide(self.place(until_s).distance_mm(place));
        }
    }

    /// Lets the taxels follow their load over a stretch of `dt_s` from now, in which the friction changes steadily.
    fn creep(&mut self, pieces: &[ForcePiece], dt_s: f64, friction_before_n: [f64; 2]) {
        let (from_s, friction_n, frame) = (self.now_s, self.friction_n(), &self.setting.frame);
        self.taxels.creep(pieces, |after_s, force_n| {
            let share = after_s / dt_s;
            let [x_n, y_n] = [0, 1].map(|axis| (1.0 - share) * friction_before_n[axis] + share * friction_n[axis]);
            let [x, y, _] = self.axes.each_ref().map(|axis| axis.position_mm(from_s + after_s));
            ([x_n, y_n, force_n], frame.place_from_stage(x, y))
        });
    }

    /// Sets the contact law for the place under the tip. The tip is without load, and will meet this place.
    fn lay_under_the_tip(&mut self, place: Place) {
        if let Some(linear_n_mm) = self.faults.values(FaultKind::HardContact, self.now_s).last() {
            self.contact.will_meet(ContactLaw { linear_n_mm, quadratic_n_mm2: 0.0, toe_mm: 0.0 }, false);
        } else if self.curve.more.is_some() || self.curve.edges.is_some() {
            let more = self.curve.more.as_mut().map_or(0.0, |more| more.at(place));
            let at_edge = self.curve.edges.map_or(0.0, |edges| edges.at(place));
            let factor = (1.0 + more) * (1.0 + at_edge);
            self.contact.will_meet(self.curve.nominal.times(factor.max(SOFTEST)), true);
        }
    }

    /// Applies to the contact the faults that begin after `after_s` and at most at `now_s`.
    pub(super) fn strike(&mut self, after_s: f64, now_s: f64) {
        for kind in self.faults.beginning(after_s, now_s) {
            let before_n = self.contact.force_n();
            match kind {
                FaultKind::Slip => self.contact.slip(),
                FaultKind::NoContact => self.contact.vanish(),
                _ => continue,
            }
            self.taxels.follow(before_n, self.contact.force_n(), self.contact.touching());
        }
    }
}
