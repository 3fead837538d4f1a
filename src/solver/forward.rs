use super::response::Response;
use super::threshold::Threshold;
use super::{Covariance, Load, Setting, Solution, SolveError, Solver, Verdict, Workspace};
use crate::quantity::Place;

/// Inverts a [`Response`]: the place and the force under which the array would read what was read.
///
/// From the best of a grid of places, Gauss and Newton's steps minimise the sum of squares of reading less response, each unit
/// weighted by its variance (noise of this reading and the map's own error); the force, in which the response is linear, is
/// eliminated after each step. Places stay in the calibrated area.
pub(super) struct Forward {
    name: &'static str,
    response: Response,
    load: Load,
    starts: Vec<Place>,
    /// Row-major, starts x units: the response a newton there in units of `typical_sd`, of length 1.
    directions: Vec<f64>,
    /// Noise of each unit under the calibration's force, root mean square over the area.
    typical_sd: Vec<f64>,
    /// The largest output that each unit showed a newton, anywhere.
    loudest: Vec<f64>,
    limits: Limits,
}

/// What a reading is held against.
#[derive(Clone, Copy, Debug)]
struct Limits {
    /// Sum of squares of the residuals of one contact.
    one_contact: f64,
    /// The same with one unit left out.
    one_contact_without_a_unit: f64,
    /// Sum of squares of a reading of no contact.
    no_contact: f64,
    /// What a place beyond the area may fit better by.
    inside: f64,
}

/// Buffers of one value a unit each.
#[derive(Clone, Debug, Default)]
pub(super) struct Buffers {
    value: Vec<f64>,
    along_x: Vec<f64>,
    along_y: Vec<f64>,
    weight: Vec<f64>,
    leverage: Vec<f64>,
}

/// Where and how hard, as far as it is known.
#[derive(Clone, Copy, Debug)]
struct Estimate {
    place: Place,
    force_n: f64,
    /// Weighted sum of squares of reading less response.
    chi2: f64,
    /// J'WJ of x, y and force.
    information: [[f64; 3]; 3],
    /// By how much chi2 would fall if the place could leave the area.
    beyond: f64,
}

/// Starting places along each side of the area.
const STARTS_A_SIDE: usize = 25;
/// The most steps from a start; four mostly do.
const MOST_STEPS: usize = 10;
/// The longest step, as a share of the area's longer side.
const LONGEST_STEP: f64 = 0.1;
/// How often a step that doesn't improve the fit is halved.
const MOST_HALVINGS: usize = 4;
/// A step shorter than this share of the area's longer side is the last.
const LAST_STEP: f64 = 1e-6;

impl Forward {
    pub fn new(name: &'static str, response: Response, setting: &Setting<'_>) -> Self {
        let units = response.field.channels();
        let area = response.field.area();
        let along = |least: f64, most: f64, i: usize| least + (most - least) * i as f64 / (STARTS_A_SIDE - 1) as f64;
        let starts: Vec<Place> = (0..STARTS_A_SIDE * STARTS_A_SIDE)
            .map(|i| {
                let (column, row) = (i % STARTS_A_SIDE, i / STARTS_A_SIDE);
                let x_mm = along(area.least.x_mm, area.most.x_mm, column);
                Place::new(x_mm, along(area.least.y_mm, area.most.y_mm, row))
            })
            .collect();
        let mut directions = vec![0.0; starts.len() * units];
        for (start, row) in starts.iter().zip(directions.chunks_exact_mut(units)) {
            response.field.value(*start, row);
        }
        let mut typical_sd = vec![0.0; units];
        let mut loudest = vec![0.0f64; units];
        for row in directions.chunks_exact(units) {
            for (unit, output) in row.iter().enumerate() {
                typical_sd[unit] += response.noise.variance(unit, response.force_n * output) / starts.len() as f64;
                loudest[unit] = loudest[unit].max(*output);
            }
        }
        typical_sd.iter_mut().for_each(|variance| *variance = variance.sqrt());
        for row in directions.chunks_exact_mut(units) {
            row.iter_mut().zip(&typical_sd).for_each(|(output, sd)| *output /= sd);
            let length = row.iter().map(|output| output * output).sum::<f64>().sqrt();
            if length > 0.0 {
                row.iter_mut().for_each(|output| *output /= length);
            }
        }
        let threshold = Threshold::new(&response, setting);
        let unknowns = match setting.load {
            Load::Unknown => 3,
            Load::Constant => 2,
        };
        let limits = Limits {
            one_contact: threshold.of_misfit(),
            one_contact_without_a_unit: threshold.of_misfit()
                * Threshold::quantile(units.saturating_sub(unknowns + 1), setting.false_alarms)
                / Threshold::quantile(units.saturating_sub(unknowns), setting.false_alarms),
            no_contact: Threshold::quantile(units, setting.false_alarms),
            // one-sided: the area can be left on this side only
            inside: Threshold::quantile(1, 2.0 * setting.false_alarms),
        };
        Forward { name, response, load: setting.load, starts, directions, typical_sd, loudest, limits }
    }

    /// The response behind it.
    pub fn response(&self) -> &Response {
        &self.response
    }

    /// The start whose direction is closest to the reading's, one unit left out or none.
    fn start(&self, outputs: &[f64], without: Option<usize>) -> Option<Place> {
        let units = outputs.len();
        let mut best = (0.0, None);
        for (start, row) in self.starts.iter().zip(self.directions.chunks_exact(units)) {
            let mut dot = 0.0;
            for ((output, sd), direction) in outputs.iter().zip(&self.typical_sd).zip(row) {
                dot += output / sd * direction;
            }
            if let Some(unit) = without {
                dot -= outputs[unit] / self.typical_sd[unit] * row[unit];
                dot /= (1.0 - row[unit] * row[unit]).max(1e-9).sqrt();
            }
            if dot > best.0 {
                best = (dot, Some(*start));
            }
        }
        best.1
    }

    /// The best fit near a place, one unit left out or none.
    fn refine(&self, outputs: &[f64], from: Place, without: Option<usize>, buffers: &mut Buffers) -> Option<Estimate> {
        let area = self.response.field.area();
        let side = (area.most.x_mm - area.least.x_mm).max(area.most.y_mm - area.least.y_mm);
        let mut place = from;
        let mut force_n = None;
        for _ in 0..MOST_STEPS {
            let here = self.look(outputs, place, force_n, without, buffers);
            let step = self.step(outputs, place, here, buffers)?;
            force_n = Some(step.force_n);
            let length = step.dx_mm.hypot(step.dy_mm);
            let mut share = (LONGEST_STEP * side / length).min(1.0);
            let mut next = place;
            for _ in 0..=MOST_HALVINGS {
                next = area.clamp(Place::new(place.x_mm + share * step.dx_mm, place.y_mm + share * step.dy_mm));
                if self.chi2(outputs, next, buffers) <= step.chi2 {
                    break;
                }
                share *= 0.5;
            }
            let moved = next.distance_mm(place);
            place = next;
            if moved.is_nan() || moved <= LAST_STEP * side {
                break;
            }
        }
        let here = self.look(outputs, place, force_n, without, buffers);
        let step = self.step(outputs, place, here, buffers)?;
        let estimate = Estimate {
            place,
            force_n: step.force_n,
            chi2: step.chi2,
            information: step.information,
            beyond: step.beyond,
        };
        (estimate.force_n.is_finite() && estimate.chi2.is_finite()).then_some(estimate)
    }

    /// Fills the buffers with response, slopes and weights at a place; returns the force that the weights are for.
    fn look(
        &self,
        outputs: &[f64],
        place: Place,
        force_n: Option<f64>,
        without: Option<usize>,
        b: &mut Buffers,
    ) -> f64 {
        self.response.field.value_and_gradient(place, &mut b.value, &mut b.along_x, &mut b.along_y);
        self.response.leverage.value(place, &mut b.leverage);
        let force_n = match (self.load, force_n) {
            (Load::Constant, _) => self.response.force_n,
            (Load::Unknown, Some(force_n)) => force_n,
            (Load::Unknown, None) => {
                let (mut yg, mut gg) = (0.0, 0.0);
                for (unit, output) in outputs.iter().enumerate().filter(|(unit, _)| Some(*unit) != without) {
                    let g = b.value[unit] / self.typical_sd[unit];
                    yg += output / self.typical_sd[unit] * g;
                    gg += g * g;
                }
                if gg > 0.0 { yg / gg } else { 0.0 }
            }
        };
        for unit in 0..outputs.len() {
            let variance = self.response.variance(unit, force_n, b.value[unit], b.leverage[unit]);
            b.weight[unit] = if Some(unit) == without { 0.0 } else { 1.0 / variance };
        }
        force_n
    }

    /// The force that fits best at a place, by the weights in the buffers.
    fn force_n(&self, outputs: &[f64], b: &Buffers) -> f64 {
        match self.load {
            Load::Constant => self.response.force_n,
            Load::Unknown => {
                let (mut yg, mut gg) = (0.0, 0.0);
                for ((output, g), weight) in outputs.iter().zip(&b.value).zip(&b.weight) {
                    yg += weight * output * g;
                    gg += weight * g * g;
                }
                if gg > 0.0 { yg / gg } else { 0.0 }
            }
        }
    }

    /// Weighted sum of squares at another place, by the weights in the buffers.
    fn chi2(&self, outputs: &[f64], place: Place, b: &mut Buffers) -> f64 {
        self.response.field.value(place, &mut b.value);
        let force_n = self.force_n(outputs, b);
        let terms = outputs.iter().zip(&b.value).zip(&b.weight);
        terms.map(|((output, g), weight)| weight * (output - force_n * g).powi(2)).sum()
    }

    /// One step of Gauss and Newton's from what the buffers hold.
    fn step(&self, outputs: &[f64], place: Place, _force_n: f64, b: &Buffers) -> Option<Step> {
        let force_n = self.force_n(outputs, b);
        let mut a = [[0.0; 3]; 3];
        let mut r = [0.0; 3];
        let mut chi2 = 0.0;
        for unit in 0..outputs.len() {
            let jacobian = [force_n * b.along_x[unit], force_n * b.along_y[unit], b.value[unit]];
            let (weight, residual) = (b.weight[unit], outputs[unit] - force_n * b.value[unit]);
            chi2 += weight * residual * residual;
            for i in 0..3 {
                r[i] += weight * jacobian[i] * residual;
                for j in 0..=i {
                    a[i][j] += weight * jacobian[i] * jacobian[j];
                }
            }
        }
        for i in 0..3 {
            for j in 0..i {
                a[j][i] = a[i][j];
            }
        }
        let known = matches!(self.load, Load::Constant);
        let free_step = solve_free(&a, &r, [true, true, !known]);
        let area = self.response.field.area();
        let mut free = [true, true, !known];
        let mut step = free_step;
        // A step that would leave the area goes along its border instead.
        for _ in 0..2 {
            let leaves_x = free[0]
                && ((place.x_mm <= area.least.x_mm && step[0] < 0.0)
                    || (place.x_mm >= area.most.x_mm && step[0] > 0.0));
            let leaves_y = free[1]
                && ((place.y_mm <= area.least.y_mm && step[1] < 0.0)
                    || (place.y_mm >= area.most.y_mm && step[1] > 0.0));
            if !leaves_x && !leaves_y {
                break;
            }
            free = [free[0] && !leaves_x, free[1] && !leaves_y, free[2]];
            step = solve_free(&a, &r, free);
        }
        let gain = |step: [f64; 3]| step.iter().zip(&r).map(|(s, r)| s * r).sum::<f64>();
        let beyond = gain(free_step) - gain(step);
        let is_finite = step.iter().all(|value| value.is_finite()) && force_n.is_finite() && chi2.is_finite();
        is_finite.then_some(Step { dx_mm: step[0], dy_mm: step[1], force_n, chi2, information: a, beyond })
    }
}

struct Step {
    dx_mm: f64,
    dy_mm: f64,
    force_n: f64,
    chi2: f64,
    information: [[f64; 3]; 3],
    beyond: f64,
}

impl Solver for Forward {
    fn name(&self) -> &'static str {
        self.name
    }

    fn solve(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Solution, SolveError> {
        let units = self.response.field.channels();
        let buffers = &mut workspace.buffers;
        for buffer in
            [&mut buffers.value, &mut buffers.along_x, &mut buffers.along_y, &mut buffers.weight, &mut buffers.leverage]
        {
            buffer.resize(units, 0.0);
        }
        let solved = |without, buffers: &mut Buffers| {
            let start = self.start(outputs, without)?;
            self.refine(outputs, start, without, buffers)
        };
        let mut estimate = solved(None, buffers).ok_or(SolveError::AllEqual)?;
        let mut verdict = Verdict::Ok;
        let mut limit = self.limits.one_contact;
        let silence: f64 =
            outputs.iter().enumerate().map(|(unit, y)| y * y / self.response.noise.additive_variance(unit)).sum();
        if silence < self.limits.no_contact {
            verdict = Verdict::WeakSignal;
        } else if estimate.chi2 > limit {
            verdict = Verdict::NotOneContact;
            let mut best: Option<(usize, Estimate)> = None;
            for unit in (0..units).filter(|&unit| self.looks_faulty(unit, outputs[unit], &estimate)) {
                if let Some(other) =
                    solved(Some(unit), buffers).filter(|other| other.chi2 < self.limits.one_contact_without_a_unit)
                    && best.as_ref().is_none_or(|(_, best)| other.chi2 < best.chi2)
                {
                    best = Some((unit, other));
                }
            }
            if let Some((unit, other)) = best {
                (estimate, verdict, limit) =
                    (other, Verdict::ChannelFault(unit), self.limits.one_contact_without_a_unit);
            }
        } else if estimate.beyond > self.limits.inside {
            verdict = Verdict::OutsideArea;
        }
        Ok(Solution {
            place: estimate.place,
            force_n: estimate.force_n,
            covariance: invert(&estimate.information).map(Covariance),
            misfit: Some(estimate.chi2 / limit),
            verdict,
        })
    }
}

impl Forward {
    /// Whether a unit reads what a broken one does: nothing, or more than any contact of this force makes it read.
    fn looks_faulty(&self, unit: usize, output: f64, estimate: &Estimate) -> bool {
        let sd = self.response.noise.additive_variance(unit).sqrt();
        output.abs() < 3.0 * sd || output > estimate.force_n * self.loudest[unit] + 3.0 * sd
    }
}

/// Solves a x = r for the free unknowns; the others stay 0. A direction in which nothing is known isn't stepped along.
fn solve_free(a: &[[f64; 3]; 3], r: &[f64; 3], free: [bool; 3]) -> [f64; 3] {
    let mut m = *a;
    let mut x = *r;
    for i in 0..3 {
        if !free[i] {
            for j in 0..3 {
                m[i][j] = 0.0;
                m[j][i] = 0.0;
            }
            m[i][i] = 1.0;
            x[i] = 0.0;
        }
    }
    match cholesky(&m) {
        Some(l) => substitute(&l, x),
        None => [0.0; 3],
    }
}

/// The inverse of a positive definite matrix; none of another.
fn invert(a: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let l = cholesky(a)?;
    let mut inverse = [[0.0; 3]; 3];
    for i in 0..3 {
        let mut unit = [0.0; 3];
        unit[i] = 1.0;
        let column = substitute(&l, unit);
        for j in 0..3 {
            inverse[j][i] = column[j];
        }
    }
    inverse.iter().flatten().all(|value| value.is_finite()).then_some(inverse)
}

fn cholesky(a: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let mut l = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..=i {
            let sum: f64 = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i == j {
                // what is left of a pivot that rounding has eaten tells nothing
                if !(sum > 1e-12 * a[i][i]) {
                    return None;
                }
                l[i][i] = sum.sqrt();
            } else {
                l[i][j] = sum / l[j][j];
            }
        }
    }
    Some(l)
}

fn substitute(l: &[[f64; 3]; 3], mut x: [f64; 3]) -> [f64; 3] {
    for i in 0..3 {
        for k in 0..i {
            x[i] -= l[i][k] * x[k];
        }
        x[i] /= l[i][i];
    }
    for i in (0..3).rev() {
        for k in i + 1..3 {
            x[i] -= l[k][i] * x[k];
        }
        x[i] /= l[i][i];
    }
    x
}
