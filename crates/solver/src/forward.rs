//! Inverts a map: finds the place and force at which the map reads like the array.

use super::descent::{BestFit, Descent};
use super::expectation::Prediction;
use super::heldout::HeldPress;
use super::method::{PHYSICS, SURROGATE};
use super::normal::{NormalEquations, inverse};
use super::rescaled::Rescaled;
use super::response::ForwardResponse;
use super::starts::Starts;
use super::threshold::{Unexplained, WEAK_SHARE, chi2_quantile, upper};
use super::widths::{FEWEST_TRIALS, Widths};
use super::{
    Calibration, CalibrationPoint, ContactVerdict, Covariance, ForceKnown, Locate, LocatedContact, Setting, Solution,
    SolveError, Solver, Workspace,
};
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// Inverts a [`Response`]: finds the place and the force for which the array would give this reading.
///
/// The best place of a grid is refined by [`Descent`]. Each unit is weighted by its variance, which contains this reading's noise
/// and the map's own error. The residual of the fit shows whether one contact can have caused the reading.
#[derive(Serialize, Deserialize)]
#[serde(from = "StoredForward")]
pub(super) struct Forward {
    kind: MapKind,
    pub response: ForwardResponse,
    pub load: ForceKnown,
    common_offset: bool,
    pub starts: Starts,
    /// Largest output per newton that each unit showed anywhere.
    pub loudest: Vec<f64>,
    pub limits: MisfitLimits,
    widths: Option<Widths>,
}

/// An inverted map in a sensor file, whose starts have no directions.
#[derive(Deserialize)]
struct StoredForward {
    kind: MapKind,
    response: ForwardResponse,
    load: ForceKnown,
    common_offset: bool,
    starts: Starts,
    loudest: Vec<f64>,
    limits: MisfitLimits,
    widths: Option<Widths>,
}

impl From<StoredForward> for Forward {
    fn from(stored: StoredForward) -> Self {
        let StoredForward { kind, response, load, common_offset, starts, loudest, limits, widths } = stored;
        let starts = starts.with_directions(&response.field);
        Forward { kind, response, load, common_offset, starts, loudest, limits, widths }
    }
}

/// Kind of a map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum MapKind {
    /// By regression.
    Smooth,
    /// By elasticity, from the properties of an elastic cover.
    Elastic,
}

impl MapKind {
    fn name(self) -> &'static str {
        match self {
            MapKind::Smooth => SURROGATE,
            MapKind::Elastic => PHYSICS,
        }
    }
}

/// Limits of sums of squares that are exceeded at the false-alarm rate.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct MisfitLimits {
    /// Limit for the residue of one contact.
    pub one_contact: f64,
    /// Limit for the residue of one contact with one unit excluded.
    pub without_a_unit: f64,
    /// Limit for a reading without contact.
    pub no_contact: f64,
    /// Limit for the improvement of the fit if a contact in the area could be beyond its border.
    pub inside: f64,
    /// Error of the map divided by the noise, mean of all units, up to which the map is known.
    pub known: f64,
    /// Factor by which sums of squares exceed those of noise alone.
    excess: f64,
    /// Whether the residuals of the map on its own calibration are only noise. Needed only before the map is written to a file.
    #[serde(skip)]
    is_noise: bool,
}

/// Distance in sd for the broken-unit test of unexplained readings. A unit looks broken if its reading is this close to silence,
/// or this far above the loudest reading.
pub(super) const BROKEN_SD: f64 = 3.0;

/// Largest excess of the sum of squares at which another place counts as nearly as likely: odds of one to twenty.
const NEARLY_AS_LIKELY: f64 = 6.0;

/// Largest leverage with which held-out presses don't raise the limit of one contact: the map's own error is a small part of the noise.
const LEVERAGE_OF_LIMIT: f64 = 0.2;

/// Number of cells along a side of the area, at whose centres expected errors are averaged.
const EXPECTED_A_SIDE: usize = 9;

/// Largest standard deviation of a place that is stated, as a multiple of the area's diagonal.
const MOST_SD_AREAS: f64 = 1000.0;

impl Forward {
    pub(crate) fn new(
        kind: MapKind,
        response: ForwardResponse,
        calibration: &Calibration,
        setting: &Setting<'_>,
    ) -> Self {
        let starts = Starts::new(&response, setting.common_offset);
        let mut loudest = vec![0.0f64; response.field.channels()];
        let mut value = vec![0.0; loudest.len()];
        for place in &starts.places {
            response.field.value(*place, &mut value);
            loudest.iter_mut().zip(&value).for_each(|(loudest, value)| *loudest = loudest.max(*value));
        }
        let (units, rate) = (loudest.len(), setting.false_alarms);
        let left = |units: usize| chi2_quantile(units.saturating_sub(setting.unknowns()), rate);
        let unexplained = Unexplained::of(&response, calibration, setting);
        let one_contact = unexplained.limit(setting.excluded_share());
        let limits = MisfitLimits {
            one_contact,
            without_a_unit: one_contact * left(units.saturating_sub(1)) / left(units),
            no_contact: chi2_quantile(units, rate),
            // on one side only: half of all errors point inward
            inside: chi2_quantile(1, 2.0 * rate),
            known: response.known_leverage,
            excess: (one_contact / left(units)).max(1.0),
            is_noise: unexplained.is_noise(),
        };
        Forward {
            widths: None,
            kind,
            response,
            load: setting.load,
            common_offset: setting.common_offset,
            starts,
            loudest,
            limits,
        }
    }

    /// Learns from presses at held-out places: their errors, and the part of real contacts that noise alone doesn't explain.
    /// Limits that distinguish a contact from something else only get wider. Limits that distinguish a contact from no contact
    /// only get lower.
    pub(crate) fn learned_curve(mut self, trials: &[HeldPress], setting: &Setting<'_>) -> Self {
        let answered = || trials.iter().filter_map(|trial| Some((trial, trial.answer.as_ref().ok()?)));
        let residues = answered().map(|(_, located)| located.residue).collect();
        // if the map is known well and contacts leave only noise, held-out ones leave more only because the map without them is worse
        let is_known = self.limits.is_noise && self.response.mean_leverage() <= LEVERAGE_OF_LIMIT;
        if let Some(most) = upper(residues, setting.excluded_share()).filter(|_| !is_known) {
            let limit = self.limits.one_contact.max(most);
            self.limits.without_a_unit *= limit / self.limits.one_contact;
            self.limits.one_contact = limit;
        }
        // a place at the border lies beyond the others once it is held out
        let beyond = answered().filter(|(trial, _)| trial.is_inside).map(|(_, located)| located.beyond).collect();
        if let Some(most) = upper(beyond, WEAK_SHARE * setting.false_alarms) {
            self.limits.inside = self.limits.inside.max(most);
        }
        let loudness: Vec<f64> = trials.iter().map(|trial| -trial.loudness).collect();
        if let Some(least) = upper(loudness, WEAK_SHARE * setting.false_alarms) {
            self.limits.no_contact = self.limits.no_contact.min(-least);
        }
        self.widths = half_widths(trials);
        self
    }

    /// Learns the half-widths from presses to which the map wasn't fitted.
    pub(crate) fn learn_half_widths(&mut self, test: &Calibration) {
        let mut workspace = Workspace::default();
        let mut solved = |point: CalibrationPoint<'_>| HeldPress {
            place: point.place,
            force_n: point.force_n,
            is_inside: true,
            loudness: self.response.loudness(point.outputs),
            answer: self.locate(point.outputs, &mut workspace),
        };
        let trials: Vec<HeldPress> = test.points().map(&mut solved).collect();
        self.widths = half_widths(&trials);
    }

    /// Returns the same map with the half-widths of normal errors.
    pub(crate) fn stating_normal_errors(self) -> Self {
        Forward { widths: Some(Widths::NORMAL), ..self }
    }

    /// Multiplies the half-widths and the limits of a misfit.
    pub(crate) fn rescale(&mut self, rescaled: &Rescaled) {
        self.widths = self.widths.map(|widths| widths.rescaled(rescaled));
        self.limits.one_contact *= rescaled.misfit;
        self.limits.without_a_unit *= rescaled.misfit;
        self.limits.inside *= rescaled.misfit;
        self.limits.excess *= rescaled.misfit;
        // few presses spread over the area know all of it, with the errors that the half-widths state
        self.limits.known = self.limits.known.max(self.response.largest_leverage());
    }

    /// Part of the half-widths' squares that is due to the map's error.
    pub(crate) fn of_map_stated(&self, outputs: &[f64], workspace: &mut Workspace) -> f64 {
        let estimate = self.estimate(outputs, &[], workspace);
        estimate.zip(self.widths).map_or(0.0, |((estimate, _), widths)| widths.of_map(self.of_map(&estimate)))
    }

    pub(crate) fn forget_half_widths(&mut self) {
        self.widths = None;
    }

    /// Returns the expected mean location error of contacts of one force in the area, mm.
    pub(crate) fn expected_mean_mm(&self, force_n: f64) -> f64 {
        let errors = self.response.field.area().cells(EXPECTED_A_SIDE).into_iter();
        let errors = errors.filter_map(|place| self.expected(place, force_n)).map(|sd| sd.mean_distance_mm());
        let errors: Vec<f64> = errors.collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    }

    /// Returns the best fit, and another place that fits nearly as well.
    fn estimate(
        &self,
        outputs: &[f64],
        without: &[usize],
        workspace: &mut Workspace,
    ) -> Option<(BestFit, Option<Place>)> {
        self.starts.seek(outputs, without, workspace);
        let Forward { response, load, common_offset, .. } = self;
        let descent = Descent { response, load: *load, common_offset: *common_offset, outputs, without };
        let starts = std::mem::take(&mut workspace.starts);
        let (mut best, mut other): (Option<BestFit>, Option<BestFit>) = (None, None);
        for (_, start) in &starts {
            let Some(next) = descent.from(*start, workspace) else { continue };
            let Some(first) = best else {
                best = Some(next);
                continue;
            };
            let (better, worse) = if next.chi2 < first.chi2 { (next, first) } else { (first, next) };
            best = Some(better);
            let is_elsewhere = |fit: &BestFit| fit.place.distance_mm(better.place) > self.starts.step_mm();
            other = [other, Some(worse)]
                .into_iter()
                .flatten()
                .filter(is_elsewhere)
                .min_by(|a, b| a.chi2.total_cmp(&b.chi2));
        }
        workspace.starts = starts;
        let best = best?;
        let is_as_likely = |other: &BestFit| other.chi2 - best.chi2 < NEARLY_AS_LIKELY * self.limits.excess;
        Some((best, other.filter(is_as_likely).map(|other| other.place)))
    }

    /// Returns the best fit to a reading without some units, and what it predicts of each unit.
    pub(crate) fn predict(&self, outputs: &[f64], without: &[usize], workspace: &mut Workspace) -> Option<Prediction> {
        let (fit, _) = self.estimate(outputs, without, workspace)?;
        let [mut value, mut leverage] = [(); 2].map(|()| vec![0.0; outputs.len()]);
        self.response.field.value(fit.place, &mut value);
        self.response.leverage.value(fit.place, &mut leverage);
        let variance = |unit: usize| self.response.variance(unit, fit.force_n, value[unit], leverage[unit]);
        let sd = (0..outputs.len()).map(|unit| variance(unit).sqrt()).collect();
        let quiet_sd = (0..outputs.len()).map(|unit| self.response.noise.variance(unit, 0.0).sqrt()).collect();
        let unknowns = if self.load == ForceKnown::Constant { 2 } else { 3 } + usize::from(self.common_offset);
        let free = outputs.len().saturating_sub(without.len() + unknowns).max(1) as f64;
        let misfit = (1.0 + fit.chi2 / self.limits.excess) / (1.0 + free);
        let outputs = value.iter().map(|per_newton| fit.force_n * per_newton).collect();
        Some(Prediction { log_misfit: misfit.ln(), outputs, sd, quiet_sd })
    }

    /// Returns the best fit without a unit that looks broken, if this fit explains the reading.
    fn without_a_unit(&self, outputs: &[f64], force_n: f64, workspace: &mut Workspace) -> Option<(usize, BestFit)> {
        let looks_broken = |&unit: &usize| {
            let sd = self.response.noise.variance(unit, 0.0).sqrt();
            outputs[unit].abs() < BROKEN_SD * sd || outputs[unit] > force_n * self.loudest[unit] + BROKEN_SD * sd
        };
        let candidates = (0..outputs.len()).filter(looks_broken);
        let fits = candidates.filter_map(|unit| Some((unit, self.estimate(outputs, &[unit], workspace)?.0)));
        fits.min_by(|a, b| a.1.chi2.total_cmp(&b.1.chi2)).filter(|(_, fit)| fit.chi2 < self.limits.without_a_unit)
    }

    /// Part of the variance of a solution that is due to the map's own error, to first order.
    fn of_map(&self, estimate: &BestFit) -> f64 {
        let share = estimate.force_n / self.response.force_n;
        let of_map = share * share * estimate.leverage.max(0.0);
        of_map / (1.0 + of_map)
    }

    /// Returns the errors that follow from an information matrix for x, y and force. `None` if the place is unknown in a
    /// direction, for example across a calibration along a line.
    fn covariance(&self, information: &[[f64; 3]; 3]) -> Option<Covariance> {
        let area = self.response.field.area();
        let most_mm = MOST_SD_AREAS * area.least.distance_mm(area.most);
        let mut information = *information;
        if self.load == ForceKnown::Constant {
            // a known force has no effect on the errors of the place
            (information[0][2], information[1][2]) = (0.0, 0.0);
            (information[2][0], information[2][1]) = (0.0, 0.0);
        }
        inverse(&information).map(Covariance).filter(|sd| sd.x_mm().max(sd.y_mm()) < most_mm)
    }
}

impl Solver for Forward {
    fn name(&self) -> &'static str {
        self.kind.name()
    }

    fn solve(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Solution, SolveError> {
        let (mut estimate, mut other) = self.estimate(outputs, &[], workspace).ok_or(SolveError::AllEqual)?;
        let mut limit = self.limits.one_contact;
        let mut verdict = ContactVerdict::Ok;
        if self.response.loudness(outputs) < self.limits.no_contact {
            verdict = ContactVerdict::WeakSignal;
        } else if estimate.chi2 > limit {
            verdict = ContactVerdict::NotOneContact;
            if let Some((unit, fit)) = self.without_a_unit(outputs, estimate.force_n, workspace) {
                (estimate, limit, verdict) = (fit, self.limits.without_a_unit, ContactVerdict::ChannelFault(unit));
                other = None;
            }
        } else if estimate.beyond > self.limits.inside || estimate.leverage > self.limits.known {
            verdict = ContactVerdict::OutsideArea;
        }
        let misfit = estimate.chi2 / limit;
        let covariance = self.covariance(&estimate.information);
        // beyond the calibrated places no held-out press could show it
        let widths = self.widths.filter(|_| verdict != ContactVerdict::OutsideArea);
        let (scale_mm, scale_n) = scales(covariance);
        let of_map = self.of_map(&estimate);
        let half_widths = widths.map(|widths| widths.at(scale_mm, scale_n, of_map).widened(misfit));
        let covariance = covariance.map(|sd| self.widths.map_or(sd, |widths| widths.applied(sd, of_map)));
        Ok(Solution {
            depth: None,
            place: estimate.place,
            force_n: estimate.force_n,
            covariance,
            half_widths,
            other,
            misfit: Some(misfit),
            verdict,
            is_calibrated_load: false,
        })
    }

    fn expected(&self, place: Place, force_n: f64) -> Option<Covariance> {
        let response = &self.response;
        let [mut value, mut along_x, mut along_y, mut leverage] =
            [(); 4].map(|()| vec![0.0; response.field.channels()]);
        response.field.value_and_gradient(place, &mut value, &mut along_x, &mut along_y);
        response.leverage.value(place, &mut leverage);
        let mut normal = NormalEquations::default();
        for unit in 0..value.len() {
            let weight = 1.0 / response.variance(unit, force_n, value[unit], leverage[unit]);
            normal.add(weight, [force_n * along_x[unit], force_n * along_y[unit], value[unit]], 0.0);
        }
        normal.finish();
        self.covariance(&normal.information)
    }
}

impl Locate for Forward {
    fn name(&self) -> &'static str {
        self.kind.name()
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<LocatedContact, SolveError> {
        let (estimate, _) = self.estimate(outputs, &[], workspace).ok_or(SolveError::AllEqual)?;
        let BestFit { place, force_n, chi2, beyond, .. } = estimate;
        let covariance = self.covariance(&estimate.information);
        let (scale_mm, scale_n) = scales(covariance);
        Ok(LocatedContact { place, force_n, residue: chi2, beyond, scale_mm, scale_n, of_map: self.of_map(&estimate) })
    }
}

fn half_widths(trials: &[HeldPress]) -> Option<Widths> {
    // a map is extrapolated to a place at the border that is held out
    let inside = trials.iter().filter(|trial| trial.is_inside).count();
    let counts = trials.iter().filter(|trial| inside < FEWEST_TRIALS || trial.is_inside);
    Widths::of(counts, |trial| {
        let located = trial.answer.as_ref().ok()?;
        Some((located.scale_mm, located.scale_n, located.of_map))
    })
}

/// Scales of the errors of location, mm, and of force, N; NaN if they are unknown.
fn scales(covariance: Option<Covariance>) -> (f64, f64) {
    covariance.map_or((f64::NAN, f64::NAN), |sd| (sd.x_mm().hypot(sd.y_mm()), sd.force_n()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CalibrationPoint;
    use crate::surrogate::surrogate;
    use palpate_core::quantity::stream;
    use rand::RngExt;
    use rand::distr::Distribution;
    use rand_distr::StandardNormal;

    /// A skin that folds: left and right of its middle line it reads nearly the same.
    struct Folded {
        /// For each unit: x over the fold, y, and the difference of the two sides.
        units: Vec<(f64, f64, f64)>,
    }

    /// Difference of two sides, as a fraction of the output 1 mm from the middle; and noise, as a fraction of the largest output
    /// under 1 N.
    const DIFFERS: f64 = 0.004;
    const NOISE: f64 = 0.008;
    const HALF_MM: f64 = 6.0;
    const FAR_OFF_MM: f64 = 2.0;

    impl Folded {
        fn new(seed: u64) -> Self {
            let mut rng = stream(seed, 0, "folded skin");
            let unit = |i: usize| (1.0 + 2.0 * (i / 3) as f64, 4.0 * (i % 3) as f64 - 4.0, rng.random_range(-1.0..1.0));
            Folded { units: (0..9).map(unit).collect() }
        }

        fn read(&self, place: Place, force_n: f64, rng: &mut impl rand::Rng) -> Vec<f64> {
            let output = |&(x_mm, y_mm, side): &(f64, f64, f64)| {
                let square = (place.x_mm.abs() - x_mm).powi(2) + (place.y_mm - y_mm).powi(2);
                let normal: f64 = StandardNormal.sample(rng);
                force_n * (-square / 18.0).exp() * (1.0 + DIFFERS * side * place.x_mm) + NOISE * normal
            };
            self.units.iter().map(output).collect()
        }
    }

    fn folded_map(skin: &Folded, seed: u64) -> Forward {
        let mut rng = stream(seed, 1, "folded skin");
        let at = |i: usize| -HALF_MM + i as f64;
        let rows: Vec<(Place, Vec<f64>)> = (0..169)
            .map(|i| Place::new(at(i % 13), at(i / 13)))
            .map(|place| (place, skin.read(place, 1.0, &mut rng)))
            .collect();
        let points: Vec<CalibrationPoint<'_>> =
            rows.iter().map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs }).collect();
        let calibration = Calibration::new(&points).unwrap();
        Forward::new(MapKind::Smooth, surrogate(&calibration).unwrap(), &calibration, &Setting::default())
    }

    #[test]
    fn ambiguous_places_have_a_wide_stated_error() {
        for seed in 1..=3 {
            let skin = Folded::new(seed);
            let forward = folded_map(&skin, seed);
            let mut rng = stream(seed, 2, "folded skin");
            let mut workspace = Workspace::default();
            let (mut far_off, mut marked, mut searched_far_off) = (0, 0, 0);
            for _ in 0..80 {
                let place = Place::new(rng.random_range(-HALF_MM..HALF_MM), rng.random_range(-HALF_MM..HALF_MM));
                let force_n = rng.random_range(0.3..1.0);
                let outputs = skin.read(place, force_n, &mut rng);
                let solved = forward.solve(&outputs, &mut workspace).unwrap();
                let is_far = |found: Place| found.distance_mm(place) > FAR_OFF_MM;
                far_off += usize::from(is_far(solved.place));
                marked += usize::from(is_far(solved.place) && solved.other.is_some());
                searched_far_off += usize::from(is_far(searched(&forward, &outputs, &mut workspace)));
            }
            println!("seed {seed}: {far_off} far off, {marked} of them marked; full search {searched_far_off}");
            assert!(searched_far_off >= 10, "nothing looks alike: {searched_far_off}");
            assert!(10 * far_off <= 11 * searched_far_off, "{far_off} far off, the full search {searched_far_off}");
            assert!(10 * marked >= 8 * far_off, "{marked} of {far_off} marked");
        }
    }

    /// Returns the best of the fits that begin at each place of a grid of 0.4 mm. The nearest of them is at most 0.3 mm from
    /// the best fit, so a descent from there ends at it.
    fn searched(forward: &Forward, outputs: &[f64], workspace: &mut Workspace) -> Place {
        let Forward { response, load, common_offset, .. } = forward;
        let descent = Descent { response, load: *load, common_offset: *common_offset, outputs, without: &[] };
        let starts = response.field.area().grid((2.0 * HALF_MM / 0.4) as usize + 1);
        let fits = starts.into_iter().filter_map(|start| descent.from(start, workspace));
        fits.min_by(|a, b| a.chi2.total_cmp(&b.chi2)).unwrap().place
    }

    #[test]
    fn under_a_constant_load_the_force_does_not_change_location_errors() {
        let mut rng = stream(3, 0, "a constant load");
        // three units that read nearly the same: the length of a reading shows the place better than its direction
        let presses: Vec<(Place, [f64; 3])> = (0..100)
            .map(|i| {
                let place = Place::new(f64::from(i % 10), f64::from(i / 10));
                let outputs = [1.0 + 0.1 * place.x_mm, 1.0 + 0.1 * place.y_mm, 1.0 + 0.05 * (place.x_mm + place.y_mm)];
                let normal: [f64; 3] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
                (place, std::array::from_fn(|unit| outputs[unit] + 0.01 * normal[unit]))
            })
            .collect();
        let points: Vec<CalibrationPoint<'_>> =
            presses.iter().map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs }).collect();
        let calibration = Calibration::new(&points).unwrap();
        let sd_mm = |load: ForceKnown| {
            let setting = Setting { load, ..Setting::default() };
            let response = surrogate(&calibration).unwrap();
            let forward = Forward::new(MapKind::Smooth, response, &calibration, &setting);
            let solution = forward.solve(&presses[44].1, &mut Workspace::default()).unwrap();
            solution.covariance.map_or(f64::INFINITY, |sd| sd.x_mm().hypot(sd.y_mm()))
        };
        let (any_mm, constant_mm) = (sd_mm(ForceKnown::Unknown), sd_mm(ForceKnown::Constant));
        // 0.01 / 0.1 per axis, and less by the third unit
        assert!((0.1..0.16).contains(&constant_mm) && any_mm > 2.0 * constant_mm, "{any_mm} {constant_mm}");
    }
}
