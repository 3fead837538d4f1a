//! State of a batch: what became of each sensor, and what is due. It follows from the events alone, in one pass.

use super::{BatchEvent, BatchSession, Began, Ended, Facts, Monitor, ReferenceSensor, SERIALS_MAX};
use palpate_data::acceptance::SensorVerdict;
use palpate_data::dataset::{RecordedText, Status};
use serde::Serialize;
use std::collections::HashMap;

/// Name under which a batch folder keeps the text of its rig.
pub const RIG: &str = "rig.toml";

/// State of a batch. Its size is bounded by the number of sensors.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BatchState {
    /// Description of the batch.
    pub facts: Facts,
    /// Latest text of each name.
    pub texts: Vec<RecordedText>,
    /// Text of the rig with which the batch began.
    pub first_rig: String,
    /// Last program that worked on the batch.
    pub session: Option<BatchSession>,
    /// Sensors, in the order in which they were listed.
    pub items: Vec<BatchSensor>,
    /// The reference sensor.
    pub reference: Option<BatchSensor>,
    /// Number of sensors and reference measurements that began.
    pub mountings: u64,
    /// Number of refused serial numbers.
    pub refused: u64,
    /// Number of alarms of control charts.
    pub alarms: u64,
    /// Control charts.
    pub monitor: Monitor,
    /// Serial number of the sensor that ended last.
    pub last: Option<String>,
    /// Position of each serial number among the items.
    places: HashMap<String, usize>,
    /// Number of sensors that were measured since the reference sensor was; `None` if it never was.
    since_reference: Option<u64>,
    is_postponed: bool,
}

/// A sensor of a batch.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BatchSensor {
    /// Serial number.
    pub serial: String,
    /// What became of it.
    #[serde(rename = "standing")]
    pub sensor_state: SensorState,
    /// How many times it began.
    pub times: u64,
    /// Folder of its last run, relative to the batch folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Time of the last event about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at: Option<String>,
    /// Time that its runs took, minutes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub minutes: Option<f64>,
    /// First reason for its standing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Last note of a person.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// What became of it each time that it ended, the last `ENDS_MOST` in order. Always empty for the reference sensor.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ends: Vec<SensorState>,
}

/// Largest number of a sensor's ends that are kept.
const ENDS_MOST: usize = 20;

impl BatchSensor {
    /// Returns what became of the sensor before, the last time left out; `None` if it ended once at most.
    pub fn before(&self) -> Option<String> {
        let before = match self.ends.split_last() {
            Some((last, before)) if *last == self.sensor_state => before,
            _ => &self.ends,
        };
        let before: Vec<&str> = before.iter().map(|sensor_state| sensor_state.name()).collect();
        (!before.is_empty()).then(|| format!("before: {}", before.join(", ")))
    }
}

/// What became of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SensorState {
    /// Its turn is ahead, for the first time or again.
    #[default]
    Waiting,
    /// Its run began and didn't end, or a person stopped it.
    Interrupted,
    /// It was calibrated, and there is no verdict because there is no rule; or it is the reference sensor.
    Calibrated,
    /// It is accepted.
    Accepted,
    /// It isn't accepted.
    NotAccepted,
    /// Too little was measured to decide.
    NotDecided,
    /// A device failed, or the quick check found a fault.
    Failed,
    /// A safety rule was broken.
    Tripped,
    /// A person skipped it.
    Skipped,
}

impl SensorState {
    /// All standings, in the order in which they are reported.
    pub const ALL: [SensorState; 9] = [
        SensorState::Accepted,
        SensorState::NotAccepted,
        SensorState::NotDecided,
        SensorState::Calibrated,
        SensorState::Failed,
        SensorState::Tripped,
        SensorState::Interrupted,
        SensorState::Skipped,
        SensorState::Waiting,
    ];

    /// Returns the standing in words.
    pub const fn name(self) -> &'static str {
        match self {
            SensorState::Waiting => "waiting",
            SensorState::Interrupted => "interrupted",
            SensorState::Calibrated => "calibrated",
            SensorState::Accepted => "accepted",
            SensorState::NotAccepted => "not accepted",
            SensorState::NotDecided => "not decided",
            SensorState::Failed => "failed",
            SensorState::Tripped => "tripped",
            SensorState::Skipped => "skipped",
        }
    }

    /// Whether the sensor has its result.
    pub const fn is_judged(self) -> bool {
        matches!(
            self,
            SensorState::Accepted | SensorState::NotAccepted | SensorState::NotDecided | SensorState::Calibrated
        )
    }

    fn of(ended: &Ended) -> SensorState {
        match (ended.status, ended.verdict) {
            (Status::Stopped, _) => SensorState::Interrupted,
            (Status::Tripped, _) => SensorState::Tripped,
            (Status::Failed, _) => SensorState::Failed,
            (Status::Complete, None) => SensorState::Calibrated,
            (Status::Complete, Some(SensorVerdict::Accepted)) => SensorState::Accepted,
            (Status::Complete, Some(SensorVerdict::NotAccepted)) => SensorState::NotAccepted,
            (Status::Complete, Some(SensorVerdict::NotDecided)) => SensorState::NotDecided,
        }
    }
}

impl BatchState {
    /// Adds an event. A journal begins with exactly one description of the batch, and names no sensor that wasn't added.
    ///
    /// # Errors
    /// What contradicts the events before.
    pub fn take_in(&mut self, event: &BatchEvent) -> Result<(), String> {
        let is_first = self.facts.format == 0;
        match event {
            BatchEvent::Batch(_) if !is_first => return Err("a second start of the batch".to_owned()),
            _ if is_first && !matches!(event, BatchEvent::Batch(_)) => {
                return Err("the first record is missing".to_owned());
            }
            BatchEvent::Batch(facts) => {
                self.facts = facts.clone();
                self.monitor = Monitor::new(&facts.charted);
                let item = |ReferenceSensor { serial, .. }: &ReferenceSensor| BatchSensor {
                    serial: serial.clone(),
                    ..BatchSensor::default()
                };
                self.reference = facts.reference.as_ref().map(item);
            }
            BatchEvent::Text(text) => match self.texts.iter_mut().find(|kept| kept.name == text.name) {
                Some(kept) => *kept = text.clone(),
                None => {
                    if text.name == RIG {
                        self.first_rig.clone_from(&text.text);
                    }
                    self.texts.push(text.clone());
                }
            },
            BatchEvent::Session(session) => self.session = Some(session.clone()),
            BatchEvent::Added { serials, .. } => serials.iter().try_for_each(|serial| self.add(serial))?,
            BatchEvent::Began(began) => self.began(began)?,
            BatchEvent::Ended(ended) => self.ended(ended)?,
            BatchEvent::Postponed { .. } => self.is_postponed = true,
            BatchEvent::Skipped { at, serial } => self.mark(serial, at, SensorState::Skipped)?,
            BatchEvent::Retry { at, serial } => self.mark(serial, at, SensorState::Waiting)?,
            BatchEvent::Noted { serial, note, .. } => self.item_mut(serial)?.note = Some(note.clone()),
            BatchEvent::Refused { .. } => self.refused += 1,
            BatchEvent::Alarm(_) => self.alarms += 1,
            BatchEvent::Paused { .. } | BatchEvent::Closed { .. } => {}
        }
        Ok(())
    }

    /// Returns a sensor or the reference sensor by its serial number.
    pub fn item(&self, serial: &str) -> Option<&BatchSensor> {
        let place = self.places.get(serial).map(|place| &self.items[*place]);
        place.or(self.reference.as_ref().filter(|reference| reference.serial == serial))
    }

    /// Whether a serial number is that of the reference sensor.
    pub fn is_reference(&self, serial: &str) -> bool {
        self.reference.as_ref().is_some_and(|reference| reference.serial == serial)
    }

    /// Whether the reference sensor is due: at the beginning, after every `every` sensors, and if a control chart asks for it,
    /// unless a person postponed it.
    pub fn is_reference_due(&self) -> bool {
        let Some(ReferenceSensor { every, .. }) = &self.facts.reference else { return false };
        let is_time = self.since_reference.is_none_or(|sensors| sensors >= *every);
        !self.is_postponed && (is_time || self.monitor.is_reference_due())
    }

    /// Returns the next sensor in the order of the list.
    pub fn next(&self) -> Option<&BatchSensor> {
        self.items.iter().find(|item| item.sensor_state == SensorState::Waiting)
    }

    /// Returns the number of sensors of a standing.
    pub fn count(&self, sensor_state: SensorState) -> usize {
        self.items.iter().filter(|item| item.sensor_state == sensor_state).count()
    }

    fn add(&mut self, serial: &str) -> Result<(), String> {
        if self.item(serial).is_some() {
            return Err(format!("the sensor {serial:?} was added twice"));
        }
        if self.items.len() >= SERIALS_MAX {
            return Err(format!("more than {SERIALS_MAX} sensors"));
        }
        self.places.insert(serial.to_owned(), self.items.len());
        self.items.push(BatchSensor { serial: serial.to_owned(), ..BatchSensor::default() });
        Ok(())
    }

    fn began(&mut self, began: &Began) -> Result<(), String> {
        self.mountings += 1;
        let item = self.item_mut(&began.serial)?;
        item.times += 1;
        (item.run, item.minutes, item.reason) = (Some(began.run.clone()), None, None);
        self.mark(&began.serial, &began.at, SensorState::Interrupted)
    }

    fn ended(&mut self, ended: &Ended) -> Result<(), String> {
        let sensor_state = SensorState::of(ended);
        let item = self.item_mut(&ended.serial)?;
        item.run = ended.runs.last().cloned().or(item.run.take());
        (item.minutes, item.reason) = (Some(ended.minutes), ended.reasons.first().cloned());
        if !ended.reference {
            item.ends.drain(..(item.ends.len() + 1).saturating_sub(ENDS_MOST));
            item.ends.push(sensor_state);
        }
        self.mark(&ended.serial, &ended.at, sensor_state)?;
        self.last = Some(ended.serial.clone());
        self.monitor.take_in(ended);
        match (ended.reference, ended.status) {
            (true, Status::Complete) => self.since_reference = Some(0),
            (false, Status::Complete) => self.since_reference = self.since_reference.map(|sensors| sensors + 1),
            _ => {}
        }
        self.is_postponed &= ended.reference;
        Ok(())
    }

    fn mark(&mut self, serial: &str, at: &str, sensor_state: SensorState) -> Result<(), String> {
        let item = self.item_mut(serial)?;
        (item.sensor_state, item.at) = (sensor_state, Some(at.to_owned()));
        Ok(())
    }

    fn item_mut(&mut self, serial: &str) -> Result<&mut BatchSensor, String> {
        let reference = self.reference.as_mut().filter(|reference| reference.serial == serial);
        let place = self.places.get(serial).map(|place| &mut self.items[*place]);
        place.or(reference).ok_or_else(|| format!("the batch has no sensor {serial:?}"))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(crate) fn at() -> String {
        "2026-11-23T10:00:00+01:00[Europe/Berlin]".to_owned()
    }

    pub(crate) fn began(serial: &str) -> BatchEvent {
        let reference = serial == "REF";
        BatchEvent::Began(Began {
            at: at(),
            serial: serial.to_owned(),
            reference,
            nest: None,
            run: format!("runs/{serial}"),
        })
    }

    pub(crate) fn ended(serial: &str, status: Status, verdict: Option<SensorVerdict>) -> BatchEvent {
        BatchEvent::Ended(Ended {
            at: at(),
            serial: serial.to_owned(),
            reference: serial == "REF",
            runs: vec![format!("runs/{serial}")],
            status,
            verdict,
            reasons: vec!["a reason".to_owned()],
            found: Vec::new(),
            calibration_presses: 9,
            test_presses: 20,
            minutes: 3.5,
            change: Vec::new(),
            refused: false,
            model: None,
        })
    }

    /// State of a batch with the sensors and a reference sensor every second one.
    pub(crate) fn begun() -> BatchState {
        let mut state = BatchState::default();
        let reference = Some(ReferenceSensor { serial: "REF".to_owned(), every: 2 });
        let facts = Facts { format: 1, name: "day".to_owned(), reference, ..Facts::default() };
        let serials = (1..=4).map(|number| format!("A-{number}")).collect();
        for event in [BatchEvent::Batch(facts), BatchEvent::Added { at: at(), serials }] {
            state.take_in(&event).unwrap();
        }
        state
    }

    fn take(state: &mut BatchState, events: &[BatchEvent]) {
        events.iter().for_each(|event| state.take_in(event).unwrap());
    }

    fn sensor_state(state: &BatchState, serial: &str) -> SensorState {
        state.item(serial).unwrap().sensor_state
    }

    #[test]
    fn sensor_state_follows_from_its_last_events() {
        let mut state = begun();
        assert_eq!(state.next().unwrap().serial, "A-1");
        take(&mut state, &[began("A-1")]);
        assert_eq!(sensor_state(&state, "A-1"), SensorState::Interrupted, "until it ends");
        for (status, verdict, expected) in [
            (Status::Complete, Some(SensorVerdict::Accepted), SensorState::Accepted),
            (Status::Complete, Some(SensorVerdict::NotAccepted), SensorState::NotAccepted),
            (Status::Complete, Some(SensorVerdict::NotDecided), SensorState::NotDecided),
            (Status::Complete, None, SensorState::Calibrated),
            (Status::Failed, None, SensorState::Failed),
            (Status::Tripped, None, SensorState::Tripped),
            (Status::Stopped, None, SensorState::Interrupted),
        ] {
            take(&mut state, &[ended("A-1", status, verdict)]);
            assert_eq!(sensor_state(&state, "A-1"), expected);
        }
        let serial = || "A-1".to_owned();
        take(&mut state, &[BatchEvent::Skipped { at: at(), serial: serial() }]);
        assert_eq!((sensor_state(&state, "A-1"), state.next().unwrap().serial.as_str()), (SensorState::Skipped, "A-2"));
        take(
            &mut state,
            &[
                BatchEvent::Retry { at: at(), serial: serial() },
                BatchEvent::Noted { at: at(), serial: serial(), note: "n".to_owned() },
            ],
        );
        let item = state.item("A-1").unwrap();
        assert_eq!((item.sensor_state, item.times, item.note.as_deref()), (SensorState::Waiting, 1, Some("n")));
        assert_eq!((state.count(SensorState::Waiting), state.mountings), (4, 1));
    }

    #[test]
    fn the_reference_sensor_is_due_first_and_after_every_second_sensor_and_can_be_postponed_by_one() {
        let mut state = begun();
        let done = |serial: &str| ended(serial, Status::Complete, None);
        assert!(state.is_reference_due());
        take(&mut state, &[began("REF"), ended("REF", Status::Failed, None)]);
        assert!(state.is_reference_due(), "it wasn't measured");
        take(&mut state, &[began("REF"), done("REF")]);
        assert!(!state.is_reference_due());
        take(&mut state, &[began("A-1"), done("A-1"), began("A-2"), ended("A-2", Status::Failed, None)]);
        assert!(!state.is_reference_due(), "only one was measured");
        take(&mut state, &[began("A-3"), done("A-3")]);
        assert!(state.is_reference_due());
        take(&mut state, &[BatchEvent::Postponed { at: at() }]);
        assert!(!state.is_reference_due());
        take(&mut state, &[began("A-4"), done("A-4")]);
        assert!(state.is_reference_due(), "after the next sensor");
    }

    #[test]
    fn events_that_contradict_those_before_are_damage() {
        assert_eq!(BatchState::default().take_in(&began("A-1")).unwrap_err(), "the first record is missing");
        let mut state = begun();
        let wrong = [
            (BatchEvent::Batch(Facts::default()), "a second start of the batch"),
            (began("B-1"), "the batch has no sensor \"B-1\""),
            (ended("B-1", Status::Complete, None), "the batch has no sensor \"B-1\""),
            (BatchEvent::Added { at: at(), serials: vec!["A-1".to_owned()] }, "the sensor \"A-1\" was added twice"),
        ];
        for (event, problem) in wrong {
            assert_eq!(state.take_in(&event).unwrap_err(), problem);
        }
    }
}
