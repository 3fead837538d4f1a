//! Friction between tip and specimen: it sticks, and slips.

use palpate_core::quantity::Place;

/// Friction of the tip on the specimen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction {
    /// Largest force sideways per force along z while the tip sticks.
    pub sticking: f64,
    /// Force sideways per force along z after a slip. If it equals `sticking`, the tip slides without jumps.
    pub sliding: f64,
    /// Force sideways per distance while the tip sticks, N/mm.
    pub stiffness_n_mm: f64,
}

/// Force of the tip on the specimen sideways, and the place where it would be zero.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FrictionState {
    anchor: Option<Place>,
    force_n: [f64; 2],
}

impl FrictionState {
    /// Force of the tip on the specimen along x and y, N.
    pub(super) fn force_n(&self) -> [f64; 2] {
        self.force_n
    }

    /// Follows the tip to a place, where it presses with `normal_n`. Without a contact there is no friction.
    pub(super) fn follow(&mut self, friction: &Friction, place: Place, normal_n: f64) {
        if normal_n <= 0.0 {
            *self = FrictionState::default();
            return;
        }
        let anchor = *self.anchor.get_or_insert(place);
        let spring = [place.x_mm - anchor.x_mm, place.y_mm - anchor.y_mm].map(|mm| friction.stiffness_n_mm * mm);
        let length_n = spring[0].hypot(spring[1]);
        if length_n <= friction.sticking * normal_n {
            self.force_n = spring;
            return;
        }
        let share = friction.sliding * normal_n / length_n;
        self.force_n = spring.map(|n| share * n);
        let [back_x_mm, back_y_mm] = self.force_n.map(|n| n / friction.stiffness_n_mm);
        self.anchor = Some(Place::new(place.x_mm - back_x_mm, place.y_mm - back_y_mm));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRICTION: Friction = Friction { sticking: 0.6, sliding: 0.4, stiffness_n_mm: 2.0 };

    fn along_x(state: &mut FrictionState, x_mm: f64) -> f64 {
        state.follow(&FRICTION, Place::new(x_mm, 0.0), 1.0);
        state.force_n()[0]
    }

    #[test]
    fn the_tip_sticks_then_slips_and_sticks_again() {
        let mut state = FrictionState::default();
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(near(along_x(&mut state, 1.0), 0.0), "the contact begins here");
        assert!(near(along_x(&mut state, 1.2), 0.4) && near(along_x(&mut state, 1.29), 0.58));
        assert!(near(along_x(&mut state, 1.31), 0.4), "it slips");
        assert!(near(along_x(&mut state, 1.36), 0.5), "and sticks where it is");
        assert!(near(along_x(&mut state, 1.06), -0.1), "the other way too");
        state.follow(&FRICTION, Place::new(1.06, 0.0), 0.0);
        assert!(near(along_x(&mut state, 5.0), 0.0), "a new contact begins without it");
    }
}
