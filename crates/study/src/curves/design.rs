//! The paper's study for any array: its range, its ability to distinguish two places, and where r misleads.

use super::array::StudiedArray;
use super::row;
use super::turning::{ContactArea, Survey, last, spread};
use crate::methods::cramer_rao::{MeanBound, bound};
use crate::methods::specimen::FORCES_N;
use palpate_core::mechanics::{MOST_RADIUS_DEPTHS, Medium, Passage, TaxelResponse};
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_sim::scene::{Elastomer, NoiseOf, Skin, SkinSpec, TaxelNoise, Taxels};
use serde_json::json;
use thiserror::Error;

/// Standard deviation of a unit's error if a rig states no noise, reading units: a third of the mean of the paper's Table 1, as a
/// fraction of 2 N.
pub const ASSUMED_SD: f64 = 0.0129;
/// Distance of the loading area's edge beyond the outermost units, as a fraction of the pitch, as in the paper.
const MARGIN: f64 = 1.0 / 3.0;
/// Requirements of the paper's rule for a line: number of units, and spacing in depths.
const RULE: (usize, f64) = (5, 1.0);
/// Largest distance of a unit from a line at which it counts as on the line, as a fraction of the pitch.
const ON_LINE: f64 = 0.25;
/// Number of first contacts along the row, and of points of each curve.
const STARTS: usize = 6;
const POINTS: usize = 240;
/// Largest number of readings that are computed for the paths over the area. The second constant is the least and the largest
/// number of paths.
const READINGS: f64 = 3e6;
const RAYS: (usize, usize) = (400, 8000);
/// Number of contacts over which the bound is averaged.
const CONTACTS: usize = 2000;
/// Distance up to which the receptive field is drawn, depths.
const FIELD_TO: f64 = 3.0;

/// Reason why an array can't be studied.
#[derive(Debug, Error, PartialEq)]
pub enum DesignError {
    /// One unit has no pattern.
    #[error("the array has one unit, but r compares several units")]
    OneUnit,
    /// Two units at one place, so there is no pitch.
    #[error("units {0} and {1} are at the same place")]
    SamePlace(usize, usize),
    /// The depth of the units is unknown.
    #[error("the depth of the units is unknown: the rig has no elastomer")]
    NoDepth,
    /// The radius of an indenter or a taxel is too large for the computation.
    #[error(
        "an indenter or a taxel has a radius of {radius_mm} mm, over {MOST_RADIUS_DEPTHS} times the depth of {depth_mm} mm"
    )]
    Radius {
        /// Radius, mm.
        radius_mm: f64,
        /// Depth of the units, mm.
        depth_mm: f64,
    },
}

/// An array as designed: every unit is at its nominal position, and all units are equal.
#[derive(Clone, Debug)]
pub struct NominalArray {
    layout: ArrayLayout,
    skin: SkinSpec,
    elastomer: Elastomer,
    full_scale_n: f64,
    pitch_mm: f64,
    area: ContactArea,
    noise_is_assumed: bool,
}

/// r along the row through the middle, from one first contact.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// Position of the first contact along the row, mm.
    pub first_mm: f64,
    /// Position of the second contact along the row, mm, and r; `None` if r is 0/0.
    pub points: Vec<(f64, Option<f64>)>,
}

/// Results for a design.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignFindings {
    /// Number of units.
    pub units: usize,
    /// Smallest distance between two units, mm.
    pub pitch_mm: f64,
    /// Material above the units, and the sizes of indenter and taxels.
    pub passage: Passage,
    /// Pitch in depths: the paper's s.
    pub spacing: f64,
    /// Area of possible contacts.
    pub area: ContactArea,
    /// Number of units on the row (or column) through the middle, the paper's n.
    pub row_units: usize,
    /// Whether that row is along y.
    pub row_is_column: bool,
    /// Distance at which a reading is half its peak, mm.
    pub half_peak_mm: f64,
    /// Distance from which a reading is below a hundredth of its peak, mm.
    pub hundredth_mm: f64,
    /// Fraction of the peak that remains at two depths.
    pub share_at_two_depths: f64,
    /// Reading divided by its peak, as a function of distance, mm.
    pub field: Vec<(f64, f64)>,
    /// The same for a point load over a point in a half-space of the same depth.
    pub half_space_field: Vec<(f64, f64)>,
    /// r along the row through the middle.
    pub courses: Vec<Course>,
    /// r over the area.
    pub survey: Survey,
    /// Smallest errors of any method, averaged over area and forces. `None` if unbounded, because for some contacts the units
    /// don't determine location and force.
    pub least: Option<MeanBound>,
    /// Whether the rig states no noise, so that [`ASSUMED_SD`] is used.
    pub noise_is_assumed: bool,
}

impl NominalArray {
    /// Creates the design of an array. Only the skin's design properties count: elastomer, indenter and taxel size, noise and
    /// converter. A specimen's variation and faults don't count.
    ///
    /// # Errors
    /// r or the response of the array isn't defined.
    pub fn new(
        layout: &ArrayLayout,
        skin: &SkinSpec,
        full_scale_n: f64,
        area: Option<ContactArea>,
    ) -> Result<NominalArray, DesignError> {
        let pitch_mm = pitch_mm(layout.places())?;
        let elastomer = skin.elastomer.ok_or(DesignError::NoDepth)?;
        let (radius_mm, depth_mm) = (skin.indenter_radius_mm.max(skin.taxels.radius_mm), elastomer.depth_mm);
        if radius_mm > MOST_RADIUS_DEPTHS * depth_mm {
            return Err(DesignError::Radius { radius_mm, depth_mm });
        }
        let assumed =
            || TaxelNoise { repeatability_percent: vec![0.0; layout.len()], of: NoiseOf::FullScale, floor: ASSUMED_SD };
        let designed = SkinSpec {
            elastomer: Some(elastomer),
            indenter_radius_mm: skin.indenter_radius_mm,
            taxels: Taxels { radius_mm: skin.taxels.radius_mm, ..Taxels::default() },
            noise: skin.noise.clone().or_else(|| Some(assumed())),
            converter: skin.converter,
            ..SkinSpec::default()
        };
        Ok(NominalArray {
            layout: layout.clone(),
            skin: designed,
            elastomer,
            full_scale_n,
            pitch_mm,
            area: area.unwrap_or_else(|| ContactArea::around(layout.places(), MARGIN * pitch_mm)),
            noise_is_assumed: skin.noise.is_none(),
        })
    }

    /// Executes the study.
    pub fn study(&self) -> DesignFindings {
        let Elastomer { depth_mm, medium } = self.elastomer;
        let passage = Passage {
            medium,
            depth_mm,
            indenter_radius_mm: self.skin.indenter_radius_mm,
            taxel_radius_mm: self.skin.taxels.radius_mm,
        };
        let array = StudiedArray::new(&self.layout, TaxelResponse::new(passage));
        let response = array.response();
        let share = |response: &TaxelResponse, mm: f64| response.at(mm) / response.at(0.0);
        let far_mm = |least: f64| {
            // the response of a layer may rise again: the last of all distances counts
            let steps = (0..=2000).map(|step| 0.01 * f64::from(step) * depth_mm);
            let above = steps.rev().find(|mm| share(response, *mm) > least).unwrap_or(0.0);
            last(above, above + 0.01 * depth_mm, |mm| share(response, mm) > least)
        };
        let field = |response: &TaxelResponse| {
            let distances = (0..=POINTS).map(|point| FIELD_TO * depth_mm * point as f64 / POINTS as f64);
            distances.map(|mm| (mm, share(response, mm))).collect()
        };
        let (row, row_is_column) = self.row();
        DesignFindings {
            units: self.layout.len(),
            pitch_mm: self.pitch_mm,
            passage,
            spacing: self.pitch_mm / depth_mm,
            area: self.area,
            row_units: row.len(),
            row_is_column,
            half_peak_mm: far_mm(0.5),
            hundredth_mm: far_mm(0.01),
            share_at_two_depths: share(response, 2.0 * depth_mm),
            field: field(response),
            half_space_field: field(&TaxelResponse::new(Passage::half_space(depth_mm))),
            courses: self.courses(&array, &row, row_is_column),
            survey: Survey::new(&array, &self.area, self.pitch_mm, self.rays()),
            least: self.least(),
            noise_is_assumed: self.noise_is_assumed,
        }
    }

    /// Returns the units on a line along x or y through the unit in the middle. It takes the line with more units.
    fn row(&self) -> (Vec<Place>, bool) {
        let places = self.layout.places();
        let middle = ContactArea::around(places, 0.0).at(0.5, 0.5);
        let nearest = places.iter().min_by(|a, b| a.distance_mm(middle).total_cmp(&b.distance_mm(middle)));
        let Some(centre) = nearest.copied() else { return (Vec::new(), false) };
        let on_line = |off_mm: &dyn Fn(&Place) -> f64| -> Vec<Place> {
            places.iter().filter(|place| off_mm(place).abs() < ON_LINE * self.pitch_mm).copied().collect()
        };
        let row = on_line(&|place| place.y_mm - centre.y_mm);
        let column = on_line(&|place| place.x_mm - centre.x_mm);
        if column.len() > row.len() { (column, true) } else { (row, false) }
    }

    /// Returns r along the row, from first contacts that are evenly spaced from edge to edge.
    fn courses(&self, array: &StudiedArray, row: &[Place], is_column: bool) -> Vec<Course> {
        let mean = |along: fn(&Place) -> f64| row.iter().map(along).sum::<f64>() / row.len().max(1) as f64;
        let beside_mm = if is_column { mean(|place| place.x_mm) } else { mean(|place| place.y_mm) };
        let (from, to) = if is_column { self.area.y_mm } else { self.area.x_mm };
        let at = |along: f64| if is_column { Place::new(beside_mm, along) } else { Place::new(along, beside_mm) };
        let between = |index: usize, last: usize| from + (to - from) * index as f64 / last as f64;
        let starts = (0..STARTS).map(|start| between(start, STARTS - 1));
        let point = |first_mm: f64, mm: f64| (mm, array.r(at(first_mm), at(mm)));
        let course = |first_mm: f64| Course {
            first_mm,
            points: (0..=POINTS).map(|index| point(first_mm, between(index, POINTS))).collect(),
        };
        starts.map(course).collect()
    }

    /// Number of paths. A large array leaves time for fewer.
    fn rays(&self) -> usize {
        let ContactArea { x_mm, y_mm } = self.area;
        let step_mm = self.pitch_mm.min(self.elastomer.depth_mm) / 20.0;
        let readings_a_ray = self.layout.len() as f64 * (x_mm.1 - x_mm.0).hypot(y_mm.1 - y_mm.0) / (2.0 * step_mm);
        ((READINGS / readings_a_ray) as usize).clamp(RAYS.0, RAYS.1)
    }

    fn least(&self) -> Option<MeanBound> {
        let skin = Skin::new(&self.skin, &self.layout, self.full_scale_n, 0);
        let of_contact = |contact: usize| {
            let [across, up, hard] = spread(contact);
            let force_n = FORCES_N.0 + hard * (FORCES_N.1 - FORCES_N.0);
            bound(&skin, &self.skin, self.full_scale_n, self.area.at(across, up), force_n)
        };
        MeanBound::mean((1..=CONTACTS).map(|contact| of_contact(contact).map(MeanBound::of)))
    }
}

impl DesignFindings {
    /// Returns whether the paper's rule is satisfied: enough units on the row, and a small enough spacing.
    pub fn keeps_rule(&self) -> (bool, bool) {
        (self.row_units >= RULE.0, self.spacing <= RULE.1)
    }

    /// Whether all units lie under a point load in a half-space, as in the paper.
    pub(crate) fn is_papers(&self) -> bool {
        self.passage == Passage::half_space(self.passage.depth_mm)
    }

    /// Returns one JSON object per line: the results, then every point of every curve.
    pub fn ndjson(&self) -> String {
        let Passage { medium, depth_mm, indenter_radius_mm, taxel_radius_mm } = self.passage;
        let poisson_ratio = match medium {
            Medium::HalfSpace => None,
            Medium::BondedLayer { poisson_ratio } => Some(poisson_ratio),
        };
        let near = self.survey.near_median_and_worst();
        let (enough, near_enough) = self.keeps_rule();
        let found = json!({
            "units": self.units,
            "row_units": self.row_units,
            "pitch_mm": self.pitch_mm,
            "depth_mm": depth_mm,
            "bonded_poisson_ratio": poisson_ratio,
            "indenter_radius_mm": indenter_radius_mm,
            "taxel_radius_mm": taxel_radius_mm,
            "spacing": self.spacing,
            "area": self.area,
            "enough_units": enough,
            "near_enough": near_enough,
            "half_peak_mm": self.half_peak_mm,
            "hundredth_mm": self.hundredth_mm,
            "share_at_two_depths": self.share_at_two_depths,
            "first_turning": self.survey.first,
            "rays": self.survey.rays,
            "share_of_rays_turned": self.survey.share_turned(),
            "near_median_mm": near.map(|(median_mm, _)| median_mm),
            "near_worst": near.map(|(_, worst)| worst),
            "location_bound_mm": self.least.map(|least| least.location_mm),
            "force_bound_n": self.least.map(|least| least.force_n),
            "noise_is_assumed": self.noise_is_assumed,
        });
        let field = self.field.iter().map(|(mm, share)| row("field", &json!({"distance_mm": mm, "share": share})));
        let points = self.courses.iter().flat_map(|Course { first_mm, points }| {
            points.iter().map(move |(mm, r)| row("course", &json!({"first_mm": first_mm, "second_mm": mm, "r": r})))
        });
        std::iter::once(row("array", &found)).chain(field).chain(points).collect()
    }
}

/// Smallest distance between two units, mm.
fn pitch_mm(places: &[Place]) -> Result<f64, DesignError> {
    let mut least_mm = f64::INFINITY;
    for (second, place) in places.iter().enumerate() {
        for (first, other) in places[..second].iter().enumerate() {
            let distance_mm = place.distance_mm(*other);
            if distance_mm == 0.0 {
                return Err(DesignError::SamePlace(first + 1, second + 1));
            }
            least_mm = least_mm.min(distance_mm);
        }
    }
    if least_mm.is_finite() { Ok(least_mm) } else { Err(DesignError::OneUnit) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn skin() -> SkinSpec {
        SkinSpec { elastomer: Some(Elastomer::half_space(5.0)), ..SkinSpec::default() }
    }

    fn design(layout: &ArrayLayout) -> Result<NominalArray, DesignError> {
        NominalArray::new(layout, &skin(), 2.0, None)
    }

    #[test]
    fn the_papers_area_is_that_of_its_layout() {
        let papers = design(&ArrayLayout::grid(3, 3, 4.5)).unwrap();
        assert_eq!(papers.area, ContactArea { x_mm: (-6.0, 6.0), y_mm: (-6.0, 6.0) });
        assert_eq!((papers.pitch_mm, papers.row().0.len()), (4.5, 3));
    }

    #[test]
    fn the_row_is_the_longer_line_through_the_middle() {
        let tall = design(&ArrayLayout::grid(5, 2, 4.0)).unwrap();
        assert!(matches!(tall.row(), (row, true) if row.len() == 5));
        let slanted = (0..4).map(|unit| Place::new(3.0 * f64::from(unit), 0.1 * f64::from(unit))).collect();
        let slanted = design(&ArrayLayout::from_places(slanted)).unwrap();
        assert!(matches!(slanted.row(), (row, false) if row.len() == 4));
    }

    #[test]
    fn reading_without_correlation_is_refused() {
        let refusal = |layout: ArrayLayout| design(&layout).err();
        assert_eq!(refusal(ArrayLayout::grid(1, 1, 4.5)), Some(DesignError::OneUnit));
        let places = vec![Place::new(1.0, 2.0), Place::default(), Place::new(1.0, 2.0)];
        assert_eq!(refusal(ArrayLayout::from_places(places)), Some(DesignError::SamePlace(1, 3)));
        let grid = ArrayLayout::grid(2, 2, 1.0);
        assert_eq!(NominalArray::new(&grid, &SkinSpec::default(), 2.0, None).err(), Some(DesignError::NoDepth));
        let wide = SkinSpec { indenter_radius_mm: 10.1, ..skin() };
        let refused = Some(DesignError::Radius { radius_mm: 10.1, depth_mm: 5.0 });
        assert_eq!(NominalArray::new(&grid, &wide, 2.0, None).err(), refused);
    }

    #[test]
    fn design_excludes_spread_and_faults_of_a_specimen() {
        let mut spread = skin();
        spread.taxels.gain_spread_percent = 20.0;
        spread.faults =
            vec![palpate_sim::scene::TaxelFault { unit: 5, kind: palpate_sim::scene::TaxelFaultKind::Dead }];
        let grid = ArrayLayout::grid(3, 3, 4.5);
        let found = |skin: &SkinSpec| NominalArray::new(&grid, skin, 2.0, None).unwrap().study().ndjson();
        assert_eq!(found(&spread), found(&skin()));
    }

    #[test]
    fn two_units_have_a_step_and_no_bound() {
        let found = design(&ArrayLayout::grid(1, 2, 4.5)).unwrap().study();
        assert_eq!((found.least, found.survey.first), (None, None));
        assert_eq!(found.keeps_rule(), (false, true));
        assert!(found.ndjson().contains("\"location_bound_mm\":null"));
    }
}
