//! History of a batch, for a reader: the results in their order, the measurements of the reference sensor, and the alarms.

use super::folder::read_events;
use super::{Alarm, BatchError, BatchEvent, BatchState, Ended, Quantity};
use palpate_data::dataset::Status;
use std::collections::HashMap;
use std::path::Path;

/// Largest number of measurements of the reference sensor, and of alarms, that are kept. Later ones are only counted.
pub(super) const KEPT_MOST: usize = 200_000;

/// Largest number of names of benches and of operators that are kept.
const NAMES_MOST: usize = 100;

/// History of a batch. Its size is bounded by the numbers of sensors and of outputs, and by `KEPT_MOST`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// State after all events.
    pub state: BatchState,
    /// Latest result of each sensor, in the order in which they ended. A sensor that was begun again, allowed again or skipped since
    /// has none.
    pub results: Vec<Ended>,
    /// Complete measurements of the reference sensor, each with the number of results before it.
    pub references: Vec<(usize, Ended)>,
    /// Statistics of the control charts of the reference sensor and of the sensors after each of these measurements, standard
    /// deviations. Empty without a prior.
    pub charted: Vec<Vec<(Quantity, [f64; 2])>>,
    /// Alarms of the control charts, each with the number of results before it.
    pub alarms: Vec<(usize, Alarm)>,
    /// Number of measurements of the reference sensor and of alarms that aren't kept.
    pub unkept: u64,
    /// Number of times that a sensor began, without the reference sensor.
    pub attempts: u64,
    /// Names of the benches.
    pub benches: Vec<String>,
    /// Names of the operators.
    pub operators: Vec<String>,
    /// Time of the last event of a sensor; that of the batch's creation if no sensor began.
    pub until: String,
}

impl History {
    /// Reads the history of a batch from its journal, in one pass. The batch may be in use.
    ///
    /// # Errors
    /// There is no batch, or its journal is damaged.
    pub fn read(path: &Path) -> Result<History, BatchError> {
        let mut reading = HistoryReader::default();
        read_events(path, |event| reading.take_in(event))?;
        Ok(reading.finished())
    }

    /// Creates the history of events.
    ///
    /// # Errors
    /// What contradicts the events before.
    pub fn of<'a>(events: impl IntoIterator<Item = &'a BatchEvent>) -> Result<History, String> {
        let mut reading = HistoryReader::default();
        events.into_iter().try_for_each(|event| reading.take_in(event))?;
        Ok(reading.finished())
    }
}

/// A history that is being read. Each part has the number of events before it.
#[derive(Default)]
struct HistoryReader {
    history: History,
    events: u64,
    results: HashMap<String, (u64, Ended)>,
    references: Vec<(u64, Ended)>,
    alarms: Vec<(u64, Alarm)>,
}

impl HistoryReader {
    fn take_in(&mut self, event: &BatchEvent) -> Result<(), String> {
        self.history.state.take_in(event)?;
        self.events += 1;
        let history = &mut self.history;
        match event {
            BatchEvent::Batch(facts) => history.until.clone_from(&facts.at),
            BatchEvent::Session(session) => {
                note(&mut history.benches, Some(&session.bench));
                note(&mut history.operators, session.operator.as_ref());
            }
            BatchEvent::Began(began) => {
                history.until.clone_from(&began.at);
                if !began.reference {
                    history.attempts += 1;
                    self.results.remove(&began.serial);
                }
            }
            BatchEvent::Ended(ended) => {
                history.until.clone_from(&ended.at);
                if !ended.reference {
                    self.results.insert(ended.serial.clone(), (self.events, ended.clone()));
                } else if ended.status == Status::Complete
                    && keep(&mut self.references, (self.events, ended), &mut history.unkept)
                {
                    let charts = history.state.monitor.charts().iter();
                    history.charted.push(charts.map(|(quantity, charts)| (*quantity, charts.sigmas())).collect());
                }
            }
            BatchEvent::Retry { serial, .. } | BatchEvent::Skipped { serial, .. } => _ = self.results.remove(serial),
            BatchEvent::Alarm(alarm) => _ = keep(&mut self.alarms, (self.events, alarm), &mut history.unkept),
            _ => {}
        }
        Ok(())
    }

    fn finished(self) -> History {
        let mut results: Vec<(u64, Ended)> = self.results.into_values().collect();
        results.sort_by_key(|(order, _)| *order);
        let before = |order: u64| results.partition_point(|(other, _)| *other < order);
        History {
            references: self.references.into_iter().map(|(order, ended)| (before(order), ended)).collect(),
            alarms: self.alarms.into_iter().map(|(order, alarm)| (before(order), alarm)).collect(),
            results: results.into_iter().map(|(_, ended)| ended).collect(),
            ..self.history
        }
    }
}

/// Whether the part was kept.
fn keep<T: Clone>(kept: &mut Vec<(u64, T)>, (order, new): (u64, &T), unkept: &mut u64) -> bool {
    let has_room = kept.len() < KEPT_MOST;
    if has_room {
        kept.push((order, new.clone()))
    } else {
        *unkept += 1
    }
    has_room
}

fn note(names: &mut Vec<String>, name: Option<&String>) {
    if let Some(name) = name.filter(|name| !name.is_empty() && names.len() < NAMES_MOST && !names.contains(name)) {
        names.push(name.clone());
    }
}

#[cfg(test)]
mod tests {
    use super::super::state::tests::{at, began, begun, ended};
    use super::super::{BatchSession, Cause, Facts, ReferenceSensor};
    use super::*;
    use palpate_data::acceptance::SensorVerdict;
    use palpate_data::dataset::Status;

    fn done(serial: &str) -> BatchEvent {
        ended(serial, Status::Complete, (serial != "REF").then_some(SensorVerdict::Accepted))
    }

    #[test]
    fn a_sensor_has_its_latest_result_in_the_order_of_the_ends() {
        let serials = (1..=4).map(|number| format!("A-{number}")).collect();
        let reference = Some(ReferenceSensor { serial: "REF".to_owned(), every: 2 });
        let facts = Facts { format: 1, reference, ..Facts::default() };
        let session =
            |bench: &str| BatchEvent::Session(BatchSession { bench: bench.to_owned(), ..BatchSession::default() });
        let alarm = Alarm {
            at: at(),
            serial: "REF".to_owned(),
            cause: Cause::Bench,
            quantity: "mean gain".to_owned(),
            sigmas: 3.0,
            limit: 2.9,
        };
        let events = [
            BatchEvent::Batch(facts),
            BatchEvent::Added { at: at(), serials },
            session("one"),
            began("REF"),
            done("REF"),
            began("A-1"),
            done("A-1"),
            began("A-2"),
            done("A-2"),
            session("two"),
            session("one"),
            began("REF"),
            done("REF"),
            BatchEvent::Alarm(alarm),
            BatchEvent::Retry { at: at(), serial: "A-1".to_owned() },
            began("A-1"),
            ended("A-1", Status::Tripped, None),
            began("A-3"),
            done("A-3"),
            BatchEvent::Retry { at: at(), serial: "A-3".to_owned() },
        ];
        let history = History::of(&events).unwrap();
        let serials: Vec<&str> = history.results.iter().map(|ended| ended.serial.as_str()).collect();
        assert_eq!(serials, ["A-2", "A-1"]);
        assert_eq!(history.results[1].status, Status::Tripped);
        assert_eq!(history.references.iter().map(|(before, _)| *before).collect::<Vec<_>>(), [0, 1]);
        assert_eq!((history.alarms[0].0, history.attempts, history.charted.len()), (1, 4, 2));
        assert_eq!(history.benches, ["one", "two"]);
        assert_eq!(history.state.mountings, 6);
        assert_eq!(begun().items.len(), history.state.items.len());
    }
}
