//! Inverts a map: the place and force that it reads as the array did.

use super::descent::{Descent, Estimate};
use super::normal::{Normal, inverse};
use super::response::Response;
use super::scan::{Scan, to_length_one};
use super::threshold::{chi2_quantile, one_contact};
use super::{
    Calibration, Covariance, ForceKnown, Locate, Located, Setting, Solution, SolveError, Solver, Verdict, Workspace,
};
use crate::quantity::Place;

/// Inverts a [`Response`]: the place and the force under which the array would read what was read.
///
/// The best of a grid of places is refined by [`Descent`]; each unit counts by its variance, which is the noise of this reading and
/// the map's own error. What the fit leaves tells whether one contact can have caused the reading.
pub(super) struct Forward {
    name: &'static str,
    response: Response,
    load: ForceKnown,
    common_offset: bool,
    starts: Starts,
    /// The largest output a newton that each unit showed anywhere.
    loudest: Vec<f64>,
    limits: Limits,
}

/// Sums of squares that as few readings exceed as the false-alarm rate says.
#[derive(Clone, Copy, Debug)]
struct Limits {
    /// What one contact leaves.
    one_contact: f64,
    /// The same with one unit left out.
    without_a_unit: f64,
    /// What no contact reads.
    no_contact: f64,
    /// What a contact in the area gains beyond its border.
    inside: f64,
    /// The map's error over the noise, mean of all units, where it is still known.
    known: f64,
}

/// Readings that no contact explains look broken where they are this many sd from silence, or over the loudest.
const BROKEN_SD: f64 = 3.0;

/// The largest standard deviation of a place that is still told, over the area's diagonal.
const MOST_SD_AREAS: f64 = 1000.0;

impl Forward {
    pub fn new(name: &'static str, response: Response, calibration: &Calibration, setting: &Setting<'_>) -> Self {
        let starts = Starts::new(&response, setting.common_offset);
        let mut loudest = vec![0.0f64; response.field.channels()];
        let mut value = vec![0.0; loudest.len()];
        for place in &starts.places {
            response.field.value(*place, &mut value);
            loudest.iter_mut().zip(&value).for_each(|(loudest, value)| *loudest = loudest.max(*value));
        }
        let (units, rate) = (loudest.len(), setting.false_alarms);
        let left = |units: usize| chi2_quantile(units.saturating_sub(setting.unknowns()), rate);
        let one_contact = one_contact(&response, calibration, setting);
        let limits = Limits {
            one_contact,
            without_a_unit: one_contact * left(units.saturating_sub(1)) / left(units),
            no_contact: chi2_quantile(units, rate),
            // on one side only: half of all errors point inward
            inside: chi2_quantile(1, 2.0 * rate),
            known: response.known_leverage,
        };
        Forward { name, response, load: setting.load, common_offset: setting.common_offset, starts, loudest, limits }
    }

    fn estimate(&self, outputs: &[f64], without: Option<usize>, workspace: &mut Workspace) -> Option<Estimate> {
        let start = self.starts.nearest(outputs, without, workspace)?;
        let Forward { response, load, common_offset, .. } = self;
        Descent { response, load: *load, common_offset: *common_offset, outputs, without }.from(start, workspace)
    }

    /// The best fit without a unit that reads as a broken one does, if that leaves nothing unexplained.
    fn without_a_unit(&self, outputs: &[f64], force_n: f64, workspace: &mut Workspace) -> Option<(usize, Estimate)> {
        let looks_broken = |&unit: &usize| {
            let sd = self.response.noise.variance(unit, 0.0).sqrt();
            outputs[unit].abs() < BROKEN_SD * sd || outputs[unit] > force_n * self.loudest[unit] + BROKEN_SD * sd
        };
        let candidates = (0..outputs.len()).filter(looks_broken);
        let fits = candidates.filter_map(|unit| Some((unit, self.estimate(outputs, Some(unit), workspace)?)));
        fits.min_by(|a, b| a.1.chi2.total_cmp(&b.1.chi2)).filter(|(_, fit)| fit.chi2 < self.limits.without_a_unit)
    }

    /// Whether errors are those of a place that is known at all: a calibration along a line tells nothing across it.
    fn tells(&self, sd: &Covariance) -> bool {
        let area = self.response.field.area();
        sd.x_mm().max(sd.y_mm()) < MOST_SD_AREAS * area.least.distance_mm(area.most)
    }

    /// The sum of squares of a reading, if nothing touched the array.
    fn loudness(&self, outputs: &[f64]) -> f64 {
        outputs.iter().enumerate().map(|(unit, output)| output * output / self.response.noise.variance(unit, 0.0)).sum()
    }
}

impl Solver for Forward {
    fn name(&self) -> &'static str {
        self.name
    }

    fn solve(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Solution, SolveError> {
        let mut estimate = self.estimate(outputs, None, workspace).ok_or(SolveError::AllEqual)?;
        let mut limit = self.limits.one_contact;
        let mut verdict = Verdict::Ok;
        if self.loudness(outputs) < self.limits.no_contact {
            verdict = Verdict::WeakSignal;
        } else if estimate.chi2 > limit {
            verdict = Verdict::NotOneContact;
            if let Some((unit, fit)) = self.without_a_unit(outputs, estimate.force_n, workspace) {
                (estimate, limit, verdict) = (fit, self.limits.without_a_unit, Verdict::ChannelFault(unit));
            }
        } else if estimate.beyond > self.limits.inside || estimate.leverage > self.limits.known {
            verdict = Verdict::OutsideArea;
        }
        Ok(Solution {
            place: estimate.place,
            force_n: estimate.force_n,
            covariance: inverse(&estimate.information).map(Covariance).filter(|sd| self.tells(sd)),
            misfit: Some(estimate.chi2 / limit),
            verdict,
        })
    }

    fn expected(&self, place: Place, force_n: f64) -> Option<Covariance> {
        let response = &self.response;
        let [mut value, mut along_x, mut along_y, mut leverage] =
            [(); 4].map(|()| vec![0.0; response.field.channels()]);
        response.field.value_and_gradient(place, &mut value, &mut along_x, &mut along_y);
        response.leverage.value(place, &mut leverage);
        let mut normal = Normal::default();
        for unit in 0..value.len() {
            let weight = 1.0 / response.variance(unit, force_n, value[unit], leverage[unit]);
            normal.add(weight, [force_n * along_x[unit], force_n * along_y[unit], value[unit]], 0.0);
        }
        normal.finish();
        inverse(&normal.information).map(Covariance).filter(|sd| self.tells(sd))
    }
}

impl Locate for Forward {
    fn name(&self) -> &'static str {
        self.name
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Located, SolveError> {
        let Estimate { place, force_n, chi2, .. } =
            self.estimate(outputs, None, workspace).ok_or(SolveError::AllEqual)?;
        Ok(Located { place, force_n, residue: chi2, scale_mm: 1.0 })
    }
}

/// A grid of places, and the direction in which the array reads a contact at each.
struct Starts {
    places: Vec<Place>,
    common_offset: bool,
    /// Noise of each unit under the calibration's force.
    sd: Vec<f64>,
    /// The response at each place in units of `sd`, of length 1.
    directions: Scan,
}

/// Places along each side of the area.
const STARTS_A_SIDE: usize = 25;

impl Starts {
    fn new(response: &Response, common_offset: bool) -> Self {
        let (area, units) = (response.field.area(), response.field.channels());
        let along = |least: f64, most: f64, i: usize| least + (most - least) * i as f64 / (STARTS_A_SIDE - 1) as f64;
        let place = |i: usize| {
            let x_mm = along(area.least.x_mm, area.most.x_mm, i % STARTS_A_SIDE);
            Place::new(x_mm, along(area.least.y_mm, area.most.y_mm, i / STARTS_A_SIDE))
        };
        let places: Vec<Place> = (0..STARTS_A_SIDE * STARTS_A_SIDE).map(place).collect();
        let sd = response.typical_sd();
        let mut directions = vec![0.0; places.len() * units];
        for (place, row) in places.iter().zip(directions.chunks_exact_mut(units)) {
            response.field.value(*place, row);
            row.iter_mut().zip(&sd).for_each(|(value, sd)| *value /= sd);
            if common_offset {
                project_out(row, &sd);
            }
            to_length_one(row); // a row of zeros stays, and is nobody's direction
        }
        Starts { places, common_offset, sd, directions: Scan::new(units, directions) }
    }

    /// The place whose direction is closest to the reading's, one unit left out or none.
    fn nearest(&self, outputs: &[f64], without: Option<usize>, workspace: &mut Workspace) -> Option<Place> {
        let direction = &mut workspace.row;
        direction.clear();
        direction.extend(outputs.iter().zip(&self.sd).map(|(output, sd)| output / sd));
        if let Some(unit) = without {
            direction[unit] = 0.0;
            return self.nearest_without(direction, unit);
        }
        if self.common_offset {
            project_out(direction, &self.sd);
        }
        to_length_one(direction)?;
        let hit = self.directions.best(direction, &mut workspace.scratch)?;
        (hit.score > 0.0).then(|| self.places[hit.row])
    }

    /// The same for rows that lost a unit and aren't of length 1 any more; rare, so one by one.
    fn nearest_without(&self, direction: &[f64], unit: usize) -> Option<Place> {
        let cosine = |row: &[f64]| {
            let along: f64 = direction.iter().zip(row).map(|(a, b)| a * b).sum();
            along / (1.0 - row[unit] * row[unit]).max(f64::EPSILON).sqrt()
        };
        let scored = self.places.iter().enumerate().map(|(i, place)| (cosine(self.directions.row(i)), place));
        scored.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(cosine, _)| *cosine > 0.0).map(|(_, place)| *place)
    }
}

/// Takes from a row of outputs over their sd what an offset common to all of them could have caused.
fn project_out(row: &mut [f64], sd: &[f64]) {
    let length: f64 = sd.iter().map(|sd| 1.0 / (sd * sd)).sum();
    let share = row.iter().zip(sd).map(|(value, sd)| value / sd).sum::<f64>() / length;
    row.iter_mut().zip(sd).for_each(|(value, sd)| *value -= share / sd);
}
