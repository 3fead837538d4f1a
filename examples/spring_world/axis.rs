//! One axis of the stage: a trapezoid, in steps of [`TICK_S`].

/// The world's step, s.
pub(crate) const TICK_S: f64 = 0.0005;

/// An axis creeps the last of its way, mm/s; and it stops at its target if it can within so many ticks.
const SLOWEST_MM_S: f64 = 0.05;
const NEARLY_RESTS: f64 = 4.0;

#[derive(Clone, Debug, Default)]
pub(crate) struct WorldAxis {
    pub(crate) at_mm: f64,
    target_mm: f64,
    /// Where it goes after the target.
    then_mm: Option<f64>,
    velocity_mm_s: f64,
    pub(crate) speed_mm_s: f64,
    pub(crate) moving: bool,
    braking: bool,
}

/// How an axis obeys: the acceleration it plans with, and what it does in truth.
#[derive(Clone, Copy)]
pub(crate) struct Law {
    pub(crate) acceleration_mm_s2: f64,
    pub(crate) speed_times: f64,
    pub(crate) brakes_softer: f64,
}

impl WorldAxis {
    pub(crate) fn at(at_mm: f64) -> WorldAxis {
        WorldAxis { at_mm, target_mm: at_mm, ..WorldAxis::default() }
    }

    pub(crate) fn start(&mut self, target_mm: f64, then_mm: Option<f64>, speed_mm_s: f64) {
        (self.target_mm, self.then_mm, self.speed_mm_s) = (target_mm, then_mm, speed_mm_s);
        (self.moving, self.braking) = (true, false);
    }

    pub(crate) fn brake(&mut self) {
        self.braking = self.moving;
    }

    pub(crate) fn target_mm(&self) -> f64 {
        self.target_mm
    }

    /// Moves it by one tick.
    pub(crate) fn tick(&mut self, law: Law) {
        if !self.moving {
            return;
        }
        let (left_mm, velocity) = (self.target_mm - self.at_mm, self.velocity_mm_s);
        // the faster one has stronger motors too
        let planned = law.acceleration_mm_s2 * law.speed_times.max(1.0);
        let largest = self.speed_mm_s * law.speed_times;
        // what is left after this tick must be enough to brake
        let room_mm = (left_mm.abs() - velocity.abs() * TICK_S).max(0.0);
        let wanted = match self.braking {
            true => 0.0,
            false => (2.0 * planned * room_mm).sqrt().min(largest).max(SLOWEST_MM_S.min(largest)).copysign(left_mm),
        };
        let change = TICK_S * if self.braking { planned / law.brakes_softer } else { planned };
        self.velocity_mm_s += (wanted - velocity).clamp(-change, change);
        let way_mm = self.velocity_mm_s * TICK_S;
        if self.braking && self.velocity_mm_s == 0.0 {
            (self.moving, self.braking, self.target_mm) = (false, false, self.at_mm);
        } else if !self.braking && left_mm.abs() <= way_mm.abs() && self.velocity_mm_s.abs() <= NEARLY_RESTS * change {
            (self.at_mm, self.velocity_mm_s) = (self.target_mm, 0.0);
            match self.then_mm.take() {
                Some(then_mm) => self.target_mm = then_mm,
                None => self.moving = false,
            }
        } else {
            self.at_mm += way_mm;
        }
    }
}
