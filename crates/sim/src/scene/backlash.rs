//! Play of an axis: after a reversal, the controller's motion takes up the play before the indenter moves.

/// Mechanical play of an axis, and the position of the indenter in it.
#[derive(Clone)]
pub(super) struct Backlash {
    half_mm: f64,
    /// Position of the indenter minus the controller's position, mm.
    offset_mm: f64,
}

/// Position, speed and acceleration: mm, mm/s, mm/s^2.
type Kinematics = (f64, f64, f64);

impl Backlash {
    /// Creates a play with this total size, mm; `None` if the size is zero.
    pub(super) fn new(backlash_mm: f64) -> Option<Backlash> {
        (backlash_mm > 0.0).then_some(Backlash { half_mm: backlash_mm / 2.0, offset_mm: 0.0 })
    }

    /// Time after which an axis in this state has taken up the play, s from now; infinite if the play is already taken up or the
    /// axis rests.
    pub(super) fn engages_in_s(&self, state: Kinematics) -> f64 {
        let (_, speed, acceleration) = state;
        let way_mm = self.offset_mm + heading(state) * self.half_mm;
        if way_mm.abs() <= f64::EPSILON || heading(state) == 0.0 {
            return f64::INFINITY;
        }
        let root = (speed * speed + 2.0 * acceleration * way_mm).sqrt();
        let engages_s = 2.0 * way_mm / (speed + root.copysign(way_mm));
        if engages_s.is_finite() && engages_s > 0.0 { engages_s } else { f64::INFINITY }
    }

    /// Returns the indenter's state over the next interval. In this interval the controller's axis keeps its acceleration, and a
    /// play that is being taken up doesn't end.
    pub(super) fn follow(&mut self, state: Kinematics, dt_s: f64) -> Kinematics {
        let (position_mm, speed, acceleration) = state;
        let engaged_mm = -heading(state) * self.half_mm;
        let before_mm = position_mm + self.offset_mm;
        if heading(state) == 0.0 {
            return (before_mm, 0.0, 0.0);
        }
        let way_mm = dt_s * (speed + dt_s * acceleration / 2.0);
        let left_mm = self.offset_mm - engaged_mm;
        if left_mm.abs() <= f64::EPSILON {
            self.offset_mm = engaged_mm;
            return (position_mm + engaged_mm, speed, acceleration);
        }
        self.offset_mm = if way_mm.abs() >= left_mm.abs() { engaged_mm } else { self.offset_mm - way_mm };
        (before_mm, 0.0, 0.0)
    }
}

/// Direction in which an axis moves or starts to move: 1, -1, or 0 at rest.
fn heading((_, speed, acceleration): Kinematics) -> f64 {
    let leading = if speed == 0.0 { acceleration } else { speed };
    if leading == 0.0 { 0.0 } else { leading.signum() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indenter_waits_for_the_backlash_at_each_reversal() {
        let mut backlash = Backlash::new(0.004).unwrap();
        let run = |backlash: &mut Backlash, from_mm: f64, speed: f64| {
            let engages_s = backlash.engages_in_s((from_mm, speed, 0.0));
            let first_s = engages_s.min(0.01);
            backlash.follow((from_mm, speed, 0.0), first_s);
            let then = backlash.follow((from_mm + first_s * speed, speed, 0.0), 0.01 - first_s);
            (engages_s, then.0 + then.1 * (0.01 - first_s))
        };
        let (engages_s, at_mm) = run(&mut backlash, 0.0, 1.0);
        assert!((engages_s - 0.002).abs() < 1e-12 && (at_mm - 0.008).abs() < 1e-12, "{engages_s} {at_mm}");
        let (engages_s, at_mm) = run(&mut backlash, 0.010, 1.0);
        assert!(engages_s.is_infinite() && (at_mm - 0.018).abs() < 1e-12, "{engages_s} {at_mm}");
        let (engages_s, at_mm) = run(&mut backlash, 0.020, -1.0);
        assert!((engages_s - 0.004).abs() < 1e-12 && (at_mm - 0.012).abs() < 1e-12, "{engages_s} {at_mm}");
    }
}
