//! Source of presses: a rig, or a table from an external bench.

use super::RigSpec;
use palpate_core::quantity::{ArrayLayout, Place};

/// Known properties of the bench of presses.
#[derive(Clone, Debug)]
pub struct Bench {
    /// Outputs and their units.
    pub layout: ArrayLayout,
    /// Whether the positions of the units are known.
    pub is_placed: bool,
    /// Unit of the outputs.
    pub unit: String,
    /// The rig; `None` for imported presses.
    pub rig: Option<RigSpec>,
}

impl Bench {
    /// Returns the bench of a rig.
    pub fn of_rig(rig: RigSpec) -> Bench {
        Bench { layout: rig.array.layout.clone(), is_placed: true, unit: rig.array.unit.clone(), rig: Some(rig) }
    }

    /// Returns the bench of imported presses. The array is that of the columns file, if stated. Otherwise it has `outputs`
    /// outputs at unknown places.
    pub fn of_import(array: Option<(ArrayLayout, String)>, outputs: usize) -> Bench {
        match array {
            Some((layout, unit)) => Bench { layout, is_placed: true, unit, rig: None },
            None => {
                let layout = ArrayLayout::from_places(vec![Place::default(); outputs]);
                Bench { layout, is_placed: false, unit: "a.u.".to_owned(), rig: None }
            }
        }
    }

    /// Returns the layout, if the positions of its units are known.
    pub fn placed(&self) -> Option<&ArrayLayout> {
        self.is_placed.then_some(&self.layout)
    }

    /// Returns the standard uncertainty of the pressed places, mm; `None` if it is unknown.
    pub fn u_place_mm(&self) -> Option<f64> {
        self.rig.as_ref().and_then(RigSpec::u_place_mm)
    }
}
