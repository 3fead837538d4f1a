//! Content of a sensor file for force vectors: a map with its array.

use super::{DraggedRow, VectorMap};
use crate::causes::{Causes, GainLimits};
use crate::field::CalibratedArea;
use crate::{ModelError, Validity};
use palpate_core::quantity::{ArrayLayout, Place};
use serde::{Deserialize, Serialize};

/// Name of the method in a sensor file.
pub const VECTOR_METHOD: &str = "force-vector";

/// A map of force vectors with the array and the range that it belongs to.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct VectorModel {
    pub(super) map: VectorMap,
    pub(super) layout: ArrayLayout,
    pub(super) validity: Validity,
    pub(super) limits: GainLimits,
}

impl VectorModel {
    /// Returns the model of a map fitted to these presses and drags. Learns the limits of its verdicts. Without a layout, each output is
    /// a unit of its own.
    pub fn new(map: VectorMap, rows: &[DraggedRow<'_>], layout: Option<ArrayLayout>) -> Self {
        let units = map.outputs();
        let layout = layout.filter(|layout| layout.len() == units);
        let layout = layout.unwrap_or_else(|| ArrayLayout::from_places(vec![Place::default(); units]));
        let places = || rows.iter().map(|row| row.pressed);
        let area = CalibratedArea::around(places()).unwrap_or_default();
        let mut pressed: Vec<[u64; 2]> = places().map(|place| [place.x_mm, place.y_mm].map(f64::to_bits)).collect();
        pressed.sort_unstable();
        pressed.dedup();
        let forces = || rows.iter().map(|row| row.row.force_n[super::PRESS]);
        let validity = Validity {
            units,
            presses: rows.len(),
            places: pressed.len(),
            x_mm: [area.least.x_mm, area.most.x_mm],
            y_mm: [area.least.y_mm, area.most.y_mm],
            force_n: Some([forces().fold(f64::INFINITY, f64::min), forces().fold(0.0, f64::max)]),
            depth_mm: None,
        };
        let limits = Causes::new(map.clone(), &layout).limits();
        VectorModel { map, layout, validity, limits }
    }

    /// Returns the map.
    pub fn map(&self) -> &VectorMap {
        &self.map
    }

    /// Returns the range in which the map is valid. Its force is that into the specimen.
    pub fn validity(&self) -> &Validity {
        &self.validity
    }

    /// Serialises the model as bytes (postcard, whose specification is version 1), with exact numbers.
    ///
    /// # Errors
    /// No known case.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModelError> {
        Ok(postcard::to_allocvec(self)?)
    }

    /// Reads a model from bytes. Its answers are equal to those of the written model, to the last bit.
    ///
    /// # Errors
    /// The bytes aren't a model of this version.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelError> {
        Ok(postcard::from_bytes(bytes)?)
    }
}
