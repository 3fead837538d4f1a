//! Where presses come from: a rig, or a table of somebody else's bench.

use super::RigSpec;
use crate::quantity::{ArrayLayout, Place};

/// What is known of the bench that presses come from.
#[derive(Clone, Debug)]
pub struct Bench {
    /// The outputs and their units.
    pub layout: ArrayLayout,
    /// Whether the positions of the units are known.
    pub is_placed: bool,
    /// The unit of the outputs.
    pub unit: String,
    /// The rig; none of imported presses.
    pub rig: Option<RigSpec>,
}

impl Bench {
    /// That of a rig.
    pub fn of_rig(rig: RigSpec) -> Bench {
        Bench { layout: rig.array.layout.clone(), is_placed: true, unit: rig.array.unit.clone(), rig: Some(rig) }
    }

    /// That of imported presses: the array where a columns file states it, else so many outputs at places that nobody knows.
    pub fn of_import(array: Option<(ArrayLayout, String)>, outputs: usize) -> Bench {
        match array {
            Some((layout, unit)) => Bench { layout, is_placed: true, unit, rig: None },
            None => {
                let layout = ArrayLayout::from_places(vec![Place::default(); outputs]);
                Bench { layout, is_placed: false, unit: "a.u.".to_owned(), rig: None }
            }
        }
    }

    /// The layout, where the positions of its units are known.
    pub fn placed(&self) -> Option<&ArrayLayout> {
        self.is_placed.then_some(&self.layout)
    }

    /// Standard uncertainty of the pressed places, mm; none where it isn't known.
    pub fn u_place_mm(&self) -> Option<f64> {
        self.rig.as_ref().and_then(RigSpec::u_place_mm)
    }
}
