//! Regression of a force with its memories, the content of a sensor file, and its sessions.

use super::features::{MEMORIES, Memory, Scale};
use super::{BLOCKS, Choice, MemoryChoice, Series, SeriesError, all_rows, table, tables};
use crate::forces::SeriesFit;
use crate::forces::folds::blocks;
use crate::{ModelError, SolveError, Unanswered, Validity};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Name of the method in a sensor file.
pub const HISTORY_METHOD: &str = "history";

/// Fitted regression of a force from readings over time, with the memories that help.
#[derive(Serialize, Deserialize)]
pub struct HistoryRegression {
    scale: Scale,
    /// Before the first reading.
    memory: Memory,
    fit: SeriesFit,
    validity: Validity,
    #[serde(skip)]
    choice: Option<MemoryChoice>,
}

/// Solves one reading after another.
pub struct HistorySession {
    regression: Arc<HistoryRegression>,
    memory: Memory,
}

impl HistoryRegression {
    /// Fits a series. Memories are used only if they lower the error clearly.
    ///
    /// # Errors
    /// The readings can't be regressed.
    pub fn fit(series: &Series) -> Result<HistoryRegression, SeriesError> {
        let tables = tables(series)?;
        let mut choice = Choice::of(&tables, &all_rows(&tables[0]));
        let (set, memories) = (choice.used(), choice.memories(series, choice.rmse_n));
        let regression = HistoryRegression::of(series, set, choice.fits.swap_remove(set));
        Ok(HistoryRegression { choice: Some(memories), ..regression })
    }

    /// Fits a series by its newest readings alone.
    ///
    /// # Errors
    /// The readings can't be regressed.
    pub fn fit_newest(series: &Series) -> Result<HistoryRegression, SeriesError> {
        let table = table(series, &MEMORIES[0])?;
        let rows = all_rows(&table);
        let (fit, _) = SeriesFit::of(&table, &rows, &blocks(rows.len(), BLOCKS));
        Ok(HistoryRegression::of(series, 0, fit))
    }

    fn of(series: &Series, set: usize, fit: SeriesFit) -> HistoryRegression {
        let range = |[least, most]: [f64; 2], force_n: &f64| [least.min(*force_n), most.max(*force_n)];
        let validity = Validity {
            units: series.channels,
            presses: series.rows(),
            places: 0,
            x_mm: [0.0; 2],
            y_mm: [0.0; 2],
            force_n: Some(series.force_n.iter().fold([f64::INFINITY, f64::NEG_INFINITY], range)),
            depth_mm: None,
        };
        let (scale, memory) = (Scale::of(series), Memory::of(&MEMORIES[set], series));
        HistoryRegression { scale, memory, fit, validity, choice: None }
    }

    /// Returns the range in which the regression is valid. Each reading of its series counts as a press, without a place.
    pub fn validity(&self) -> &Validity {
        &self.validity
    }

    /// Returns the memories that were chosen; `None` if the regression was read from bytes, or has the newest readings alone.
    pub fn choice(&self) -> Option<&MemoryChoice> {
        self.choice.as_ref()
    }

    /// Serialises the regression as bytes (postcard, whose specification is version 1), with exact numbers.
    ///
    /// # Errors
    /// No known case.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModelError> {
        Ok(postcard::to_allocvec(self)?)
    }

    /// Reads a regression from bytes. Its answers are equal to those of the written one, to the last bit.
    ///
    /// # Errors
    /// The bytes aren't a regression of this version, or its numbers contradict each other.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelError> {
        let (regression, rest): (HistoryRegression, &[u8]) = postcard::take_from_bytes(bytes)?;
        match rest.is_empty() && regression.is_sound() {
            true => Ok(regression),
            false => Err(postcard::Error::DeserializeBadEncoding.into()),
        }
    }

    fn is_sound(&self) -> bool {
        let channels = self.scale.channels();
        channels > 0
            && channels == self.validity.units
            && self.scale.is_sound()
            && self.memory.is_sound(channels)
            && self.fit.is_sound(self.memory.width(channels))
    }
}

impl HistorySession {
    /// Creates a session, which has seen no reading.
    pub fn new(regression: impl Into<Arc<HistoryRegression>>) -> Self {
        let regression = regression.into();
        HistorySession { memory: regression.memory.clone(), regression }
    }

    /// Returns the force that caused a reading at a time, s, in N. A reading that isn't finite or came late is forgotten. Where the time
    /// jumps, forward or back, history begins again with the first reading there.
    ///
    /// # Errors
    /// The reading isn't finite, isn't later than the one before, or comes after a gap and memories are used.
    pub fn solve(&mut self, t_s: f64, outputs: &[f64]) -> Result<f64, Unanswered> {
        let HistoryRegression { scale, fit, .. } = &*self.regression;
        let (expected, found) = (scale.channels(), outputs.len());
        if found != expected {
            return Err(SolveError::Channels { expected, found }.into());
        }
        if !t_s.is_finite() {
            return Err(Unanswered::NoTime);
        }
        if let Some(unit) = outputs.iter().position(|output| !output.is_finite()) {
            return Err(SolveError::NotFinite { unit: unit + 1 }.into());
        }
        let now = scale.scaled(outputs);
        let mut memory = self.memory.clone();
        let features = memory.features(t_s, &now);
        let force_n = fit.answer_n(&features, memory.instant);
        if !now.iter().chain([&force_n]).all(|number| number.is_finite()) {
            return Err(SolveError::OutOfProportion.into());
        }
        let (gap_s, before_s) = (self.memory.gap_s(t_s), self.memory.before_s);
        let not_later = before_s.filter(|before_s| t_s <= *before_s);
        // a reading that only came late is forgotten; a clock that was set back goes on from here
        if not_later.is_none() || self.memory.begins_again(t_s) {
            self.memory = memory;
        }
        match (not_later, gap_s) {
            (Some(before_s), _) => Err(Unanswered::NotLater { t_s, before_s }),
            (None, Some(gap_s)) => Err(Unanswered::Gap { gap_s }),
            (None, None) => Ok(force_n),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL_S: f64 = 0.1;

    /// Two taxels of a skin that creeps, pressed in steps and ramps: time, outputs, force.
    fn readings() -> Vec<(f64, [f64; 2], f64)> {
        let mut crept = 0.0;
        (0..400)
            .map(|row| {
                let force_n = f64::from(row * 37 % 113 / 20) * 0.3 + 0.5 * (0.05 * f64::from(row)).sin().abs();
                crept += (force_n - crept) * (1.0 - (-INTERVAL_S / 1.5f64).exp());
                let output = force_n + 0.4 * crept;
                (INTERVAL_S * f64::from(row), [output + 0.1 * output * output, 0.6 * output], force_n)
            })
            .collect()
    }

    fn series() -> Series {
        let readings = readings();
        Series::new(readings.iter().map(|(t_s, outputs, force_n)| (*t_s, outputs.as_slice(), *force_n))).unwrap()
    }

    fn fitted() -> HistoryRegression {
        HistoryRegression::fit(&series()).unwrap()
    }

    fn answers(regression: HistoryRegression) -> Vec<u64> {
        let mut session = HistorySession::new(regression);
        readings().iter().map(|(t_s, outputs, _)| session.solve(*t_s, outputs).unwrap().to_bits()).collect()
    }

    #[test]
    fn a_session_gives_the_answers_of_the_fit_also_after_its_bytes() {
        let (regression, series) = (fitted(), series());
        let choice = regression.choice().unwrap();
        assert!(choice.is_used && choice.lower_by > 0.3, "{choice:?}");
        let tables = tables(&series).unwrap();
        let choice = Choice::of(&tables, &all_rows(&tables[0]));
        for (row, bits) in answers(fitted()).into_iter().enumerate() {
            let of_fit_n = choice.fits[choice.used()].error_n(&tables[choice.used()], row) + series.force_n[row];
            assert!((f64::from_bits(bits) - of_fit_n).abs() < 1e-12, "reading {row}");
        }
        let copy = HistoryRegression::from_bytes(&regression.to_bytes().unwrap()).unwrap();
        assert_eq!(copy.validity(), regression.validity());
        assert_eq!(copy.validity().presses, 400);
        assert_eq!(answers(copy), answers(regression));
    }

    #[test]
    fn without_memories_a_gap_is_no_loss() {
        let mut session = HistorySession::new(HistoryRegression::fit_newest(&series()).unwrap());
        let [early_n, late_n] = [0.0, 100.0].map(|t_s| session.solve(t_s, &[1.0, 0.6]));
        assert!(early_n.is_ok() && early_n == late_n, "{early_n:?} {late_n:?}");
    }

    #[test]
    fn damaged_bytes_are_refused_or_answer_without_a_panic() {
        let bytes = fitted().to_bytes().unwrap();
        for end in (0..bytes.len()).step_by(7) {
            assert!(HistoryRegression::from_bytes(&bytes[..end]).is_err(), "{end}");
        }
        assert!(HistoryRegression::from_bytes(&[&bytes[..], &[0]].concat()).is_err());
        for (at, mask) in (0..bytes.len()).flat_map(|at| [0x01, 0x7f, 0xff].map(|mask| (at, mask))) {
            let mut changed = bytes.clone();
            changed[at] ^= mask;
            if let Ok(regression) = HistoryRegression::from_bytes(&changed) {
                let mut session = HistorySession::new(regression);
                for (t_s, outputs, _) in readings().iter().take(3) {
                    assert!(session.solve(*t_s, outputs).map_or(true, f64::is_finite));
                }
            }
        }
    }

    #[test]
    fn numbers_that_contradict_each_other_are_refused() {
        type Damage = fn(&mut HistoryRegression);
        let damages: [Damage; 5] = [
            |regression| regression.validity.units += 1,
            |regression| regression.memory.instant += 1,
            |regression| regression.memory.taus_s.push(1.0),
            |regression| regression.memory.taus_s[0] = f64::NAN,
            |regression| regression.validity.units = 0,
        ];
        for (number, damage) in damages.into_iter().enumerate() {
            let mut regression = fitted();
            damage(&mut regression);
            assert!(HistoryRegression::from_bytes(&regression.to_bytes().unwrap()).is_err(), "damage {number}");
        }
    }

    #[test]
    fn a_reading_without_an_answer_is_forgotten_and_a_clock_may_be_set_back() {
        let readings = readings();
        let (mut session, mut other) = (HistorySession::new(fitted()), HistorySession::new(fitted()));
        for (t_s, outputs, _) in &readings[..50] {
            assert_eq!(session.solve(*t_s, outputs), other.solve(*t_s, outputs));
            let refused = [
                other.solve(*t_s, &[outputs[0], f64::NAN]),
                other.solve(*t_s, &[f64::MAX, outputs[1]]),
                other.solve(f64::NAN, outputs),
                other.solve(t_s - 0.05, &[9.0, 9.0]),
                other.solve(*t_s, &outputs[..1]),
            ];
            let expected = [
                Err(SolveError::NotFinite { unit: 2 }.into()),
                Err(SolveError::OutOfProportion.into()),
                Err(Unanswered::NoTime),
                Err(Unanswered::NotLater { t_s: t_s - 0.05, before_s: *t_s }),
                Err(SolveError::Channels { expected: 2, found: 1 }.into()),
            ];
            assert_eq!(refused, expected);
        }
        // a gap, and then a clock that was set back; each time is exact
        let last_s = readings[49].0;
        let refused = [
            (last_s + 100.0, Unanswered::Gap { gap_s: last_s + 100.0 - last_s }),
            (0.0, Unanswered::NotLater { t_s: 0.0, before_s: last_s + 100.0 + INTERVAL_S }),
        ];
        for (t_s, why) in refused {
            let mut fresh = HistorySession::new(fitted());
            assert!(fresh.solve(t_s, &readings[50].1).is_ok());
            assert_eq!(session.solve(t_s, &readings[50].1), Err(why));
            let (next_s, next) = (t_s + INTERVAL_S, &readings[51].1);
            assert_eq!(session.solve(next_s, next), fresh.solve(next_s, next));
        }
    }
}
