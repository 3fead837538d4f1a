//! Units that break after the calibration: they are named, left out, and used again when they work.
//!
//! The real skins are those of [`real_skins`](super::real_skins), whose folder `PALPATE_DATA` names.

use palpate_core::quantity::{ArrayLayout, Place, stream};
use palpate_data::dataset::{Mapping, read_table};
use palpate_solver::{
    BEST, Calibration, CalibrationPoint, FaultChange, Fits, Model, Session, Setting, Solver as _, Workspace,
};
use palpate_testing::campaign;
use palpate_testing::skins::{GridSkin, Pressed as Row};
use rand::RngExt;
use std::path::Path;
use std::sync::Arc;

/// Contacts that a unit should have felt, within which it must be named.
const NAMED_WITHIN: usize = 60;
/// Contacts of a stream in which nothing may be named.
const CLEAN: usize = 1000;

/// Name, units, and change of a reading.
type Fault<'a> = (String, Vec<usize>, Box<dyn Fn(&mut [f64]) + 'a>);

/// A sensor that is calibrated, and contacts of it.
struct Calibrated {
    name: String,
    fits: Arc<Fits>,
    contacts: Vec<Row>,
    in_newtons: bool,
    layout: Option<ArrayLayout>,
    /// Standard deviation of each output without a contact.
    quiet: Vec<f64>,
}

impl Calibrated {
    fn new(name: &str, presses: &[Row], in_newtons: bool, contacts: Vec<Row>, layout: Option<&ArrayLayout>) -> Self {
        let points = presses.iter().map(|(place, force_n, outputs)| CalibrationPoint {
            place: *place,
            force_n: *force_n,
            outputs,
        });
        let calibration = Calibration::new(&points.collect::<Vec<_>>()).unwrap();
        let calibration = if in_newtons { calibration } else { calibration.with_unknown_forces() };
        let model = Model::fit(BEST, calibration, &Setting::of_layout(layout)).unwrap();
        let quiet = vec![0.0; model.validity().units];
        Calibrated {
            name: format!("{name} ({})", model.fitted().name()),
            fits: Arc::new(Fits::new(model)),
            contacts,
            in_newtons,
            layout: layout.cloned(),
            quiet,
        }
    }

    /// A grid of simulated units, pressed every so many mm.
    fn simulated(columns: usize, rows: usize, spacing_mm: f64) -> Self {
        let mut skin = GridSkin::new(columns, rows);
        let (presses, contacts) = (skin.spaced(spacing_mm), skin.random(CLEAN));
        let still: Vec<Row> = (0..200).map(|_| skin.press(Place::default(), 0.0)).collect();
        let rms = |unit: usize| (still.iter().map(|row| row.2[unit].powi(2)).sum::<f64>() / still.len() as f64).sqrt();
        let quiet = (0..columns * rows).map(rms).collect();
        let name = format!("{} units", columns * rows);
        Calibrated { quiet, ..Calibrated::new(&name, &presses, true, contacts, Some(&skin.layout)) }
    }

    /// The unit whose outputs vary most, and the median one.
    fn strongest_and_median(&self) -> [usize; 2] {
        let variance = |unit: usize| {
            let mean = self.contacts.iter().map(|row| row.2[unit]).sum::<f64>() / self.contacts.len() as f64;
            self.contacts.iter().map(|row| (row.2[unit] - mean).powi(2)).sum::<f64>()
        };
        let mut order: Vec<usize> = (0..self.quiet.len()).collect();
        order.sort_by(|a, b| variance(*b).total_cmp(&variance(*a)));
        [order[0], order[order.len() / 2]]
    }

    /// Returns the number of contacts that the units should have felt until just they are left out, for each fault and each of some
    /// streams; `None` if they aren't left out.
    fn until_named(&self, streams: usize) -> Vec<(String, Option<usize>)> {
        let [strong, median] = self.strongest_and_median();
        let stuck = |unit: usize| self.contacts[5].2[unit];
        let mut faults: Vec<Fault<'_>> = Vec::new();
        for unit in [strong, median] {
            faults.push((format!("dead {unit}"), vec![unit], Box::new(move |outputs| outputs[unit] = 0.0)));
            faults.push((format!("weak {unit}"), vec![unit], Box::new(move |outputs| outputs[unit] *= 0.3)));
            faults.push((format!("stuck {unit}"), vec![unit], Box::new(move |outputs| outputs[unit] = stuck(unit))));
        }
        let pair = vec![strong.min(median), strong.max(median)];
        faults.push(("swapped".to_owned(), pair, Box::new(move |outputs| outputs.swap(strong, median))));
        let mut until = Vec::new();
        for (fault, units, apply) in &faults {
            for stream in 0..streams {
                let (mut session, mut felt) = (Session::sharing(self.fits.clone()), 0);
                let from = self.contacts.iter().cycle().skip(stream * 333).take(CLEAN);
                let is_named = from.into_iter().any(|(_, _, clean)| {
                    let mut outputs = clean.clone();
                    apply(&mut outputs);
                    felt += usize::from(units.iter().any(|&unit| clean[unit].abs() > 5.0 * self.quiet[unit]));
                    _ = session.solve(&outputs);
                    let mut left_out: Vec<usize> = session.at_fault().iter().map(|faulty| faulty.unit).collect();
                    left_out.sort_unstable();
                    left_out == *units
                });
                let is_wrong = session.at_fault().iter().any(|faulty| !units.contains(&faulty.unit));
                assert!(!is_wrong, "{} {fault}: {:?}", self.name, session.changes());
                until.push((fault.clone(), is_named.then_some(felt)));
                // a weak or stuck unit leaves the same units as a dead one
                if stream == 0 && is_named && !fault.starts_with("weak") && !fault.starts_with("stuck") {
                    self.assert_as_without(units, &mut session, fault);
                }
            }
        }
        println!("{}: {until:?}", self.name);
        until
    }

    /// Asserts that a session without some units locates contacts as well as a model that was fitted without them.
    fn assert_as_without(&self, units: &[usize], session: &mut Session, fault: &str) {
        let calibration = self.fits.model().calibration().unwrap();
        let kept: Vec<usize> = (0..calibration.units()).filter(|unit| !units.contains(unit)).collect();
        let only = |outputs: &[f64]| kept.iter().map(|&unit| outputs[unit]).collect::<Vec<f64>>();
        let rows: Vec<Vec<f64>> = calibration.points().map(|point| only(point.outputs)).collect();
        let points = calibration.points().zip(&rows).map(|(point, outputs)| CalibrationPoint { outputs, ..point });
        let fewer = Calibration::new(&points.collect::<Vec<_>>()).unwrap();
        let fewer = if self.in_newtons { fewer } else { fewer.with_unknown_forces() };
        let layout = self.layout.as_ref().map(|layout| layout.only(&kept));
        let without = Model::fit(BEST, fewer, &Setting::of_layout(layout.as_ref())).unwrap();
        let (mut workspace, mut errors_mm) = (Workspace::default(), [0.0; 2]);
        for (place, _, outputs) in self.contacts.iter().take(200) {
            let found = [session.solve(outputs).ok(), without.fitted().solve(&only(outputs), &mut workspace).ok()];
            if let [Some(one), Some(other)] = found {
                errors_mm[0] += one.place.distance_mm(*place);
                errors_mm[1] += other.place.distance_mm(*place);
            }
        }
        let ratio = errors_mm[0] / errors_mm[1];
        println!("{} {fault}: error {ratio:.3} of that of {}", self.name, without.fitted().name());
        assert!(ratio <= 1.1, "{}: {fault}", self.name);
    }

    /// Asserts that good contacts name no unit.
    fn assert_silent(&self) {
        for part in self.contacts.chunks(CLEAN) {
            let mut session = Session::sharing(self.fits.clone());
            part.iter().for_each(|(_, _, outputs)| _ = session.solve(outputs));
            assert_eq!(session.changes(), [], "{}", self.name);
        }
        // contacts in a ninth of the area
        let range = |of: fn(&Row) -> f64| {
            let (least, most) = self
                .contacts
                .iter()
                .map(of)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), mm| (least.min(mm), most.max(mm)));
            move |row: &Row| (3.0 * (of(row) - least) / (most - least)).min(2.0) as usize
        };
        let (column, line) = (range(|row| row.0.x_mm), range(|row| row.0.y_mm));
        for part in 0..9 {
            let mut session = Session::sharing(self.fits.clone());
            let within = self.contacts.iter().filter(|row| column(row) + 3 * line(row) == part);
            within.for_each(|(_, _, outputs)| _ = session.solve(outputs));
            assert_eq!(session.changes(), [], "{}, part {part}", self.name);
        }
    }
}

/// Asserts that so many of 100 faults are named in time.
fn assert_named(until: &[(String, Option<usize>)], of_100: usize) {
    let named = until.iter().filter(|(_, felt)| felt.is_some_and(|felt| felt <= NAMED_WITHIN)).count();
    println!("{named} of {} named within {NAMED_WITHIN} contacts", until.len());
    assert!(100 * named >= of_100 * until.len(), "{named} of {}", until.len());
}

#[test]
fn units_at_fault_are_named_and_good_ones_are_not() {
    let skins = [(3, 3, 1.5), (4, 4, 1.5), (6, 6, 2.0), (10, 10, 3.0), (16, 12, 3.0)];
    let mut until = Vec::new();
    for (columns, rows, spacing_mm) in skins.into_iter().take(campaign::size(1, skins.len())) {
        let skin = Calibrated::simulated(columns, rows, spacing_mm);
        skin.assert_silent();
        until.extend(skin.until_named(campaign::size(1, 3)));
    }
    assert_named(&until, 95);
}

#[test]
fn a_stuck_output_is_named_where_the_others_explain_every_reading() {
    const HALF_MM: f64 = 15.0;
    let mut rng = stream(5, 0, "corners");
    // a plate on four cells: any three of them determine a contact
    let mut press = |x_mm: f64, y_mm: f64, force_n: f64| -> Row {
        let part = |mm: f64, is_positive: bool| 0.5 + if is_positive { 0.5 } else { -0.5 } * mm / HALF_MM;
        let share = |unit: usize| part(x_mm, unit % 2 == 1) * part(y_mm, unit / 2 == 1);
        let outputs = (0..4).map(|unit| 10.0 * force_n * share(unit) + rng.random_range(-0.03..0.03)).collect();
        (Place::new(x_mm, y_mm), force_n, outputs)
    };
    let at = |index: usize| (index as f64 / 7.0 - 1.0) * HALF_MM;
    let presses: Vec<Row> = (0..225).map(|i| press(at(i % 15), at(i / 15), 1.0)).collect();
    let mut places = stream(6, 0, "contacts");
    let mut anywhere = || press(places.random_range(-HALF_MM..HALF_MM), places.random_range(-HALF_MM..HALF_MM), 1.2);
    let contacts: Vec<Row> = (0..60).map(|_| anywhere()).collect();
    let skin = Calibrated::new("plate", &presses, true, contacts, None);
    for value in [0.0, 3.125] {
        let mut session = Session::sharing(skin.fits.clone());
        for (_, _, outputs) in &skin.contacts {
            let mut outputs = outputs.clone();
            outputs[2] = value;
            session.solve(&outputs).unwrap();
        }
        assert_eq!(session.at_fault().iter().map(|faulty| faulty.unit).collect::<Vec<_>>(), [2], "{value}");
    }
}

#[test]
fn a_unit_that_works_again_is_used_again() {
    let skin = Calibrated::simulated(3, 3, 1.5);
    let mut session = Session::sharing(skin.fits.clone());
    let mut changed_at = Vec::new();
    for (index, (_, _, outputs)) in skin.contacts.iter().enumerate() {
        let mut outputs = outputs.clone();
        if index < 200 {
            outputs[4] = 0.0;
        }
        session.solve(&outputs).unwrap();
        changed_at.resize(session.changes().len(), index);
    }
    println!("{:?} at {changed_at:?}", session.changes());
    assert!(matches!(session.changes()[..], [FaultChange::LeftOut(faulty), FaultChange::Back(4)] if faulty.unit == 4));
    assert!(changed_at[0] < 100 && (260..500).contains(&changed_at[1]), "{changed_at:?}");
    assert_eq!(session.broken(), []);
}

#[test]
fn a_search_changes_nothing_until_it_is_accepted() {
    let skin = Calibrated::simulated(3, 3, 1.5);
    let [mut apart, mut never] = [(); 2].map(|()| Session::sharing(skin.fits.clone()).deferring());
    for (_, _, outputs) in skin.contacts.iter().take(200) {
        let mut outputs = outputs.clone();
        outputs[4] = 0.0;
        if apart.changes().is_empty() {
            assert_eq!(apart.solve(&outputs), never.solve(&outputs));
        }
        if let Some(search) = apart.search() {
            assert!(apart.search().is_none(), "one at a time");
            apart.accept(search.run());
        }
    }
    assert_eq!((apart.at_fault().len(), never.at_fault().len()), (1, 0));
    // the result of a search from before a restart says nothing about the readings after it
    let mut restarted = Session::sharing(skin.fits.clone()).deferring();
    let mut earlier = None;
    for (_, _, outputs) in skin.contacts.iter().cycle() {
        let mut outputs = outputs.clone();
        outputs[4] = 0.0;
        restarted.solve(&outputs).unwrap();
        match (restarted.search(), earlier.take()) {
            (Some(search), None) => {
                earlier = Some(search.run());
                restarted.restart();
            }
            (Some(_), Some(result)) => {
                restarted.accept(result);
                assert!(restarted.search().is_none(), "the search after the restart isn't over");
                break;
            }
            (None, kept) => earlier = kept,
        }
    }
}

#[test]
#[ignore = "needs the published tables: PALPATE_DATA names their folder"]
fn units_of_real_skins_at_fault_are_named_and_good_ones_are_not() {
    let data = std::env::var_os("PALPATE_DATA").expect("PALPATE_DATA names the folder that has the published tables");
    let rows = |table: &str| -> Vec<Row> {
        let presses = read_table(&Path::new(&data).join(table), &Mapping::default()).unwrap().presses;
        presses.iter().map(|press| (press.place(), press.force_n.unwrap_or(1.0), press.outputs.clone())).collect()
    };
    let shuffled = |mut rows: Vec<Row>| {
        let mut rng = stream(3, 0, "contacts");
        let count = rows.len();
        (0..count).for_each(|first| rows.swap(first, rng.random_range(first..count)));
        rows.truncate(4 * CLEAN);
        rows
    };
    let every_second = |rows: &[Row]| -> Vec<Row> {
        rows.iter().filter(|row| (row.0.x_mm.round() + row.0.y_mm.round()) as i64 % 2 == 0).cloned().collect()
    };
    let [fixed, random, pad] = ["eflesh/fixed_depth.csv", "eflesh/random_depth.csv", "sdu/pad_2d.csv"].map(rows);
    let passes = |of: &[Row], presses: usize, contacts: &[Row]| {
        (every_second(&of[..presses * 961]), shuffled(contacts.to_vec()))
    };
    let is_even = |row: &&Row| [row.0.x_mm, row.0.y_mm].iter().all(|mm| (mm / 2.0).round() as i64 % 2 == 0);
    let (even, odd): (Vec<&Row>, Vec<&Row>) = pad.iter().partition(is_even);
    let of = |rows: Vec<&Row>| rows.into_iter().cloned().collect::<Vec<Row>>();
    let mut until = Vec::new();
    for (name, (presses, contacts), in_newtons) in [
        ("fixed depth", passes(&fixed, 1, &fixed[3 * 961..]), false),
        ("random depth", passes(&random, 3, &random[3 * 961..]), false),
        ("another session", passes(&fixed, 1, &random), false),
        ("another session, back", passes(&random, 3, &fixed), false),
        ("fluid pad", (of(even), shuffled(of(odd))), true),
    ] {
        let skin = Calibrated::new(name, &presses, in_newtons, contacts, None);
        skin.assert_silent();
        until.extend(skin.until_named(3));
    }
    // a weak output of the pad is within the spread of its presses
    assert_named(&until, 95);
}
