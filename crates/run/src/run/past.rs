//! Information from a record about the presses so far.

use super::checks::Checking;
use super::execute::Standby;
use palpate_control::{ContactMap, LearnedContact, MeasuredContact, SetPoint};
use palpate_core::quantity::Place;
use palpate_data::dataset::{
    self, CalledSound, DatasetError, Flag, Ledger, Left, Record, RecordedContact, RecordedSurface,
};
use palpate_data::recipe::Plan;
use palpate_link::device::{DeviceError, DeviceProblem, Identity};

/// Largest number of places that are remembered for another touch.
const KNOWN_MAX: usize = 4096;

/// Knowledge of a continued run from its own records: everything except the rig that a press depends on.
pub(super) struct Past {
    /// Knowledge from the presses so far.
    pub map: ContactMap,
    /// Load cell reading without load when the run began, N; `None` before the first zero.
    pub first_zero_n: Option<f64>,
    /// Time that has passed in the run, s.
    pub elapsed_s: f64,
    /// Last completed entry, and the state after it.
    pub last: Option<(u64, Option<Standby>)>,
    /// Identities that the devices reported.
    pub devices: Vec<Identity>,
    /// What the array felt at every place.
    pub felt: Vec<MeasuredContact>,
    /// Checks so far, and what they are compared with.
    pub checks: Checking,
    /// What a person called sound.
    pub called_sound: Vec<CalledSound>,
    /// Surfaces that were found without a load cell.
    pub surfaces: Vec<RecordedSurface>,
    /// Places that were touched.
    known: Vec<TouchedPlace>,
}

/// Place that was touched.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TouchedPlace {
    pub place: Place,
    /// Position where contact began, mm into the specimen.
    pub z_mm: f64,
    /// The largest force on the way from the touch to the first level, N.
    pub force_n: f64,
    /// Number of its press in the plan.
    pub press: u64,
    /// What the array felt at the first loaded level, and the set point of that level.
    pub felt: Option<(MeasuredContact, SetPoint)>,
}

impl Past {
    /// Reads the content of the ledger of a plan. By the frame, the surface is within `uncertainty_mm` of z = 0.
    pub(super) fn of(ledger: &dyn Ledger, plan: &Plan, uncertainty_mm: f64) -> Result<Past, DatasetError> {
        let mut past = Past {
            map: ContactMap::new(uncertainty_mm),
            first_zero_n: None,
            elapsed_s: 0.0,
            last: None,
            devices: Vec::new(),
            felt: Vec::new(),
            checks: Checking::of(plan),
            called_sound: Vec::new(),
            surfaces: Vec::new(),
            known: Vec::new(),
        };
        ledger.recall(&mut |record| past.take_in(record))?;
        Ok(past)
    }

    /// Checks that the devices are the devices of the run's start.
    pub(super) fn check_devices(&self, devices: &[Identity]) -> Result<(), DeviceError> {
        let differing = |before: &&Identity| {
            devices
                .iter()
                .find(|now| now.role == before.role && now.identity != before.identity)
                .map(|now| (before.identity.clone(), now))
        };
        match self.devices.iter().find_map(|before| differing(&before)) {
            None => Ok(()),
            Some((before, now)) => Err(DeviceError {
                device: now.role.clone(),
                doing: "identifying it, to continue the run".to_owned(),
                problem: DeviceProblem::Mismatch(format!(
                    "it was \"{before}\" and is now \"{}\": connect the original device, or start a new run",
                    now.identity
                )),
            }),
        }
    }

    fn take_in(&mut self, record: &Record) {
        self.elapsed_s = record.t_s().map_or(self.elapsed_s, |t_s| self.elapsed_s.max(t_s));
        match record {
            Record::Session(session) => self.called_sound.extend(session.sound),
            Record::Zero { offset_n, .. } => _ = self.first_zero_n.get_or_insert(*offset_n),
            Record::Surface(surface) if self.surfaces.len() < KNOWN_MAX => self.surfaces.push(*surface),
            Record::Devices(devices) => self.devices.clone_from(devices),
            Record::Check(check) => {
                let RecordedContact { left, no_load_after, .. } = &check.contact;
                let standby = left.map(|Left { z_mm }| Standby { z_mm, no_load: Some(no_load_after.clone()) });
                self.last = self.last.take().map(|(press, _)| (press, standby));
                self.checks.take_check(check);
            }
            Record::Contact(contact) => {
                self.checks.take_contact(contact);
                let no_load = Some(contact.no_load_after.clone());
                let standby = contact.left.map(|Left { z_mm }| Standby { z_mm, no_load });
                self.last = Some((contact.press, standby));
                contact.learned_contact.iter().for_each(|learned_contact| self.learn(learned_contact, contact));
                self.felt.extend(felt(contact).map(|(felt, _)| felt));
            }
            _ => {}
        }
    }

    fn learn(&mut self, learned_contact: &LearnedContact, contact: &RecordedContact) {
        self.map.learn(learned_contact);
        if let LearnedContact::Touch { place, z_mm, path } = learned_contact
            && let Some((_, force_n)) = path.last()
            && *force_n > 0.0
            && self.known.len() < KNOWN_MAX
        {
            self.known.push(TouchedPlace {
                place: *place,
                z_mm: *z_mm,
                force_n: *force_n,
                press: contact.press,
                felt: felt(contact).map(|(felt, set)| (MeasuredContact { place: *place, ..felt }, set)),
            });
        }
    }

    /// Returns three places of the plan that were touched, or all of them if there are fewer. The places are as far from one
    /// another as possible. A surface that has sunk, risen or tilted shows at one of these places.
    pub(super) fn landmarks(&self, plan: &Plan) -> Vec<TouchedPlace> {
        let planned = |known: &&TouchedPlace| plan.entries.iter().any(|entry| entry.place == known.place);
        let mut chosen: Vec<TouchedPlace> = self.known.iter().find(planned).cloned().into_iter().collect();
        while chosen.len() < 3 {
            let apart_mm = |known: &TouchedPlace| {
                chosen.iter().map(|other| other.place.distance_mm(known.place)).fold(f64::INFINITY, f64::min)
            };
            let farthest = self.known.iter().filter(planned).max_by(|a, b| apart_mm(a).total_cmp(&apart_mm(b)));
            match farthest.filter(|known| apart_mm(known) > 0.0) {
                Some(known) => chosen.push(known.clone()),
                None => break,
            }
        }
        chosen
    }
}

/// Returns what the array felt at the first loaded level of a contact, and the set point of that level. `None` if the array didn't
/// measure it.
pub(super) fn felt(contact: &RecordedContact) -> Option<(MeasuredContact, SetPoint)> {
    let loaded = |level: &&dataset::Press| level.set_point().is_some_and(SetPoint::is_loaded);
    let level = contact.levels.iter().find(loaded)?;
    let (set, force_n, place) = (level.set_point()?, level.force_n?, Place::new(level.x_mm, level.y_mm));
    let is_measured = !level.flags.iter().any(|flag| matches!(flag, Flag::Saturated | Flag::Stale | Flag::Missed));
    let felt = MeasuredContact { place, force_n, outputs: level.outputs.clone(), sigmas: [0.0; 2] };
    (force_n > 0.0 && is_measured).then_some((felt, set))
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_control::{PressTask, Strategy};
    use palpate_data::dataset::Memory;
    use palpate_data::recipe::{Checks, Entry, OnMiss, Phase, SeriesScope};

    fn contact(press: u64, learned_contact: LearnedContact) -> Record {
        let left = Some(Left { z_mm: -0.2 - press as f64 });
        Record::Contact(RecordedContact {
            press,
            learned_contact: Some(learned_contact),
            left,
            ..RecordedContact::default()
        })
    }

    /// A plan of presses at these places.
    fn plan(places: &[(f64, f64)]) -> Plan {
        let entry = |(press, &(x_mm, y_mm)): (u64, &(f64, f64))| Entry {
            press,
            phase: Phase::Test,
            place: Place::new(x_mm, y_mm),
            task: PressTask {
                levels: PressTask::press(1.0),
                force_tolerance_n: 0.05,
                depth_tolerance_mm: 0.02,
                hold_s: 0.0,
                sample_s: 0.1,
                strategy: Strategy::Guarded,
                sample_after_s: None,
                over_time: None,
                drag: None,
            },
            rest_after_s: 0.0,
        };
        Plan {
            name: "p".to_owned(),
            seed: 1,
            entries: (0..).zip(places).map(entry).collect(),
            checks: Checks::None,
            on_miss: OnMiss::End,
            series: SeriesScope::None,
        }
    }

    fn touch(x_mm: f64, y_mm: f64) -> LearnedContact {
        LearnedContact::Touch { place: Place::new(x_mm, y_mm), z_mm: 0.02, path: vec![(0.1, 0.1), (0.5, 0.7)] }
    }

    #[test]
    fn recalled_state_follows_the_records_in_order() {
        let mut memory = Memory::default();
        let zero = |t_s, offset_n| Record::Zero { t_s, offset_n, sigma_n: 0.003, mains: None, outputs: vec![] };
        let shot =
            LearnedContact::Shot { place: Place::new(5.0, 5.0), z_mm: 0.4, force_n: 0.5, expected_n: 0.5, faded: 0.0 };
        let learned_contacts = [touch(0.0, 0.0), touch(0.1, 0.0), shot, touch(6.0, 0.0), touch(0.0, 6.0)];
        let contacts =
            (0..).zip(learned_contacts.clone()).map(|(press, learned_contact)| contact(press, learned_contact));
        for record in [zero(1.0, 0.25)].into_iter().chain(contacts).chain([zero(9.0, 0.3)]) {
            memory.record(&record).unwrap();
        }
        let plan = plan(&[(0.0, 0.0), (0.1, 0.0), (6.0, 0.0), (0.0, 6.0)]);
        let past = Past::of(&memory, &plan, 0.3).unwrap();
        let mut map = ContactMap::new(0.3);
        learned_contacts.iter().for_each(|learned_contact| map.learn(learned_contact));
        assert_eq!(format!("{:?}", past.map), format!("{map:?}"));
        assert_eq!((past.first_zero_n, past.elapsed_s), (Some(0.25), 9.0), "the first zero stays the first");
        assert_eq!(
            past.last.as_ref().and_then(|(_, standby)| standby.as_ref()).map(|standby| standby.z_mm),
            Some(-4.2),
            "the last contact's"
        );
        let landmarks: Vec<Place> = past.landmarks(&plan).iter().map(|known| known.place).collect();
        assert_eq!(
            landmarks,
            [Place::new(0.0, 0.0), Place::new(0.0, 6.0), Place::new(6.0, 0.0)],
            "touched, and far apart"
        );
        assert_eq!(past.landmarks(&plan)[0].force_n, 0.7);
    }

    #[test]
    fn resumed_run_touches_only_touched_places_again() {
        let mut memory = Memory::default();
        let plan = plan(&[(1.0, 1.0)]);
        assert_eq!(Past::of(&memory, &plan, 0.3).unwrap().landmarks(&plan), []);
        memory.record(&contact(0, touch(1.0, 1.0))).unwrap();
        memory.record(&contact(1, touch(1.0, 1.0))).unwrap();
        memory.record(&contact(2, touch(999.0, 1.0))).unwrap();
        let landmarks = Past::of(&memory, &plan, 0.3).unwrap().landmarks(&plan);
        assert_eq!(landmarks.len(), 1, "one place is one, and one that no plan names is none");
    }
}
