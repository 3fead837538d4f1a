//! A press as a state machine, with specimens that keep the rig's declarations and drivers that answer anything: every motion keeps the
//! permit's promise, every press ends, and no answer causes a panic.

use palpate_control::{
    Branch, ContactMap, Context, ForceLoop, LearnedContact, LoopCommand, LoopEvent, Moment, NO_LOAD_READINGS,
    NoLoadReadings, OverTime, Permit, Permitted, PressLevel, PressTask, SafetyRule, SetPoint, Shot, Softest, Steer,
    Strategy, Timing, Zero, safe_speed_mm_s,
};
use palpate_core::quantity::{Axis, Limits, Place, RandomStream, StageBounds, Steps, stream};
use palpate_testing::campaign;
use rand::RngExt;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread;

/// Steps with each of the two drivers.
fn steps_wanted() -> u64 {
    campaign::size(100_000, 4_000_000) as u64
}
/// Threads; each has its own seeds.
const THREADS: u64 = 2;

/// Largest number of commands of a press, for each level, and the rest.
const COMMANDS_A_LEVEL: usize = 8_000;
const COMMANDS_MORE: usize = 10;

/// Largest age of a force that permits a motion toward the specimen, s (I4).
const FRESH_S: f64 = 0.25;
/// Rounding of a motion that doesn't count, mm or N.
const ROUNDING: f64 = 1e-6;
/// Longest dwell that makes sense, s.
const DWELL_MOST_S: f64 = 100.0;

/// A press with random knowledge.
struct MachineDraw {
    press: ForceLoop,
    context: Context,
    task: PressTask,
    /// Reaction time of the rig, s.
    reaction_s: f64,
}

/// What a press has learned so far.
#[derive(Clone, Copy, Debug)]
struct MachineTranscript {
    z_mm: f64,
    force_n: f64,
    age_s: f64,
    now_s: f64,
    /// Deepest surface that the press has assumed, mm.
    surface_mm: f64,
}

impl MachineTranscript {
    fn at(z_mm: f64) -> MachineTranscript {
        let surface_mm = f64::NEG_INFINITY;
        MachineTranscript { z_mm, force_n: 0.0, age_s: 0.0, now_s: 0.0, surface_mm }
    }

    /// Updates the surface that the press assumes, if it states one.
    fn note_surface(&mut self, draw: &MachineDraw) {
        let touched_mm = draw.press.touched_mm().filter(|mm| mm.is_finite()).unwrap_or(f64::NEG_INFINITY);
        self.surface_mm = self.surface_mm.max(touched_mm).max(draw.context.expected.first_mm);
    }
}

/// Fraction of the force limit that a step may add; every second seed has a stage with steps.
const STEP_SHARE: f64 = 0.05;

fn draw(seed: u64, rng: &mut RandomStream, truthful: bool) -> MachineDraw {
    let limits = Limits {
        force_n: rng.random_range(0.5..5.0),
        depth_mm: rng.random_range(0.3..3.0),
        stiffness_n_mm: 10f64.powf(rng.random_range(-0.5..1.7)),
    };
    let sigma_n = limits.force_n * 10f64.powf(rng.random_range(-4.0..-1.8));
    let frozen_after = rng.random_bool(0.5).then_some(20);
    let zero = Zero { offset_sigma_n: sigma_n / 10.0, frozen_after, ..Zero::with_noise(sigma_n) };
    let (reaction_s, acceleration_mm_s2) = (rng.random_range(0.01..0.3), rng.random_range(20.0..500.0));
    let share = STEP_SHARE * 10f64.powf(stream(seed, 0, "steps").random_range(-2.0..0.0));
    let step_mm = (share * limits.force_n / limits.stiffness_n_mm).min(0.05);
    let steps = if seed % 4 < 2 { Steps::FINE } else { Steps { mm: [0.0, 0.0, step_mm], ..Steps::FINE } };
    let permit = Permit::new(limits, StageBounds { steps, ..StageBounds::fine(acceleration_mm_s2) }, reaction_s, &zero);
    let place = Place::new(rng.random_range(-6.0..6.0), rng.random_range(-6.0..6.0));
    let task = task(rng, &limits);
    let map = learned_curve(rng, &limits, truthful);
    let expected = map.expect(place);
    let asks = task.strategy == Strategy::Map && task.levels.len() == 1;
    let shot: Option<Shot> = asks.then(|| map.shot(place, task.most_n(), &limits)).flatten();
    let context = Context {
        place,
        limits,
        permit,
        zero,
        zero_age_s: 0.0,
        expected,
        shot,
        softest: Softest {
            declared_n_mm: None,
            learned_curve: map.learned_curve(place),
            doubted: map.doubted(place, task.most_n()).map(|known| (known, 1.13 * task.most_n())),
        },
        clear_mm: expected.first_mm - rng.random_range(0.05..0.5),
        approach_mm_s: 2.0,
        speed_mm_s: 10f64.powf(rng.random_range(-1.0..1.4)),
        timing: Timing {
            exchange_s: rng.random_range(0.001..0.2),
            settle_s: rng.random_range(0.0..0.05),
            lag_s: 0.0,
            conversion_s: 10f64.powf(rng.random_range(-3.5..-1.0)),
            acceleration_mm_s2,
            reaction_s,
        },
    };
    MachineDraw { press: ForceLoop::new(task.clone(), context), context, task, reaction_s }
}

fn task(rng: &mut RandomStream, limits: &Limits) -> PressTask {
    let force_n = limits.force_n * rng.random_range(0.02..1.0);
    let depth_mm = limits.depth_mm * rng.random_range(0.02..1.0);
    let is_light = force_n < 0.4 * limits.force_n && depth_mm * limits.stiffness_n_mm < 0.6 * limits.force_n;
    let levels = match rng.random_range(0..5) {
        0 => PressTask::staircase(force_n, force_n / f64::from(rng.random_range(1..4))),
        // anything
        1 => (0..rng.random_range(0..4))
            .map(|_| PressLevel {
                set: match rng.random_range(0..10) {
                    0..3 => SetPoint::Force(0.0),
                    3..8 => SetPoint::Force(limits.force_n * rng.random_range(0.01..1.0)),
                    _ => SetPoint::Depth(limits.depth_mm * rng.random_range(0.01..1.0)),
                },
                branch: if rng.random_bool(0.5) { Branch::Loading } else { Branch::Unloading },
            })
            .collect(),
        2 => PressTask::one(SetPoint::Depth(depth_mm)),
        _ => PressTask::press(force_n),
    };
    let follow_s = if rng.random_bool(0.8) { 0.0 } else { rng.random_range(0.0..9.0) };
    PressTask {
        levels,
        force_tolerance_n: limits.force_n * 10f64.powf(rng.random_range(-3.0..-1.0)),
        depth_tolerance_mm: depth_mm * 10f64.powf(rng.random_range(-2.0..-0.5)),
        hold_s: if rng.random_bool(0.5) { 0.0 } else { rng.random_range(0.0..2.0) },
        sample_s: rng.random_range(0.01..0.5),
        strategy: Strategy::ALL[rng.random_range(0..3)],
        sample_after_s: rng.random_bool(0.3).then(|| rng.random_range(0.1..3.0)),
        over_time: Some(Arc::new(OverTime {
            holds_force: follow_s > 4.5,
            follow_s: vec![follow_s; 4],
            // of a heavy press the way back is out of reach by the declared stiffness
            ramps_mm_s: (0..if is_light { rng.random_range(0..3) } else { 0 })
                .map(|_| 10f64.powf(rng.random_range(-2.0..1.0)))
                .collect(),
        })),
        drag: None,
    }
}

/// A map learned from presses on a plane with a parabolic curve, or from anything.
fn learned_curve(rng: &mut RandomStream, limits: &Limits, truthful: bool) -> ContactMap {
    let mut map = ContactMap::new(0.3);
    let n_mm = limits.stiffness_n_mm * rng.random_range(0.2..0.6);
    let surface_mm = rng.random_range(-0.15..0.15);
    for _ in 0..rng.random_range(0..9) {
        let place = Place::new(rng.random_range(-6.0..6.0), rng.random_range(-6.0..6.0));
        let at = |force_n: f64| surface_mm + force_n / n_mm;
        let wild = if truthful { 0.0 } else { 0.3 };
        let mut any = |mm: f64| mm + rng.random_range(-1.0..=1.0) * (0.003 + wild);
        let touch_mm = any(surface_mm);
        let path = [0.1, 0.3, 0.6, 0.9].map(|share| share * limits.force_n).map(|n| (any(at(n)), n)).to_vec();
        map.learn(&LearnedContact::Touch { place, z_mm: touch_mm, path });
        if !truthful && rng.random_bool(0.3) {
            let (force_n, expected_n) = (any_of(rng), any_of(rng));
            map.learn(&LearnedContact::Shot {
                place,
                z_mm: at(1.0),
                force_n,
                expected_n,
                faded: rng.random_range(-0.1..0.1),
            });
        }
    }
    map
}

fn any_of(rng: &mut RandomStream) -> f64 {
    rng.random_range(0.0..3.0)
}

/// A number that a broken driver could answer.
fn garbage(rng: &mut RandomStream) -> f64 {
    match rng.random_range(0..20) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => f64::NEG_INFINITY,
        3 => 1e300,
        4 => -1e300,
        5 => 0.0,
        6 => 1e-300,
        7..10 => rng.random_range(-100.0..100.0),
        _ => rng.random_range(-3.0..3.0),
    }
}

/// How a motion breaks the permit's promise, given what the press knew. Only the surface that the loop assumes after the touch is taken
/// from it.
fn broken_promise(draw: &MachineDraw, output: &MachineTranscript, granted: &Permitted) -> Option<&'static str> {
    let MachineDraw { context, reaction_s, .. } = draw;
    let (limits, z_mm, speed_mm_s) = (&context.limits, granted.z_mm(), granted.speed_mm_s());
    if !z_mm.is_finite() {
        return Some("an end point is no number");
    }
    let is_a_speed = speed_mm_s > 0.0 && speed_mm_s <= context.speed_mm_s + ROUNDING;
    if !is_a_speed {
        return Some("a speed isn't one of this stage");
    }
    if z_mm <= output.z_mm + ROUNDING {
        return None; // away, or no motion
    }
    let force_n = output.force_n;
    // a stage with steps may end deeper, and may be deeper than it reports
    let z_mm = z_mm + context.permit.steps().reserve_mm();
    let at_most_n = force_n + limits.stiffness_n_mm * (z_mm - output.z_mm.max(output.surface_mm));
    let (room_n, a) = (limits.force_n - context.zero.detect_n(), context.timing.acceleration_mm_s2);
    let fastest_mm_s = safe_speed_mm_s(room_n, limits.stiffness_n_mm, *reaction_s, a);
    // written as the positive condition, so NaN fails
    let rules = [
        ("I1: the force", at_most_n <= limits.force_n + ROUNDING),
        ("I2: the depth", z_mm <= output.surface_mm + limits.depth_mm + ROUNDING),
        ("I3: the speed", speed_mm_s <= fastest_mm_s + ROUNDING),
        ("I4: the age of the force", output.age_s <= FRESH_S),
    ];
    rules.into_iter().find(|(_, holds)| !holds).map(|(rule, _)| rule)
}

fn broken_steer(granted: &Permitted, steer: Steer) -> Option<&'static str> {
    match steer {
        Steer::Speed(mm_s) if !(mm_s > 0.0 && mm_s <= granted.speed_mm_s() + ROUNDING) => Some("a speed under way"),
        _ => None,
    }
}

/// Whether a dwell or a window can be waited for.
fn broken_wait(seconds: f64) -> Option<&'static str> {
    (!(0.0..DWELL_MOST_S).contains(&seconds)).then_some("a wait that has no end")
}

fn is_out_of_turn(command: &LoopCommand) -> bool {
    matches!(command, LoopCommand::Trip(trip) if trip.rule == SafetyRule::NotPermitted && trip.unit == "event out of turn")
}

/// Whether an event is an answer to a command.
fn answers(command: &LoopCommand, event: &LoopEvent) -> bool {
    matches!(
        (command, event),
        (LoopCommand::Average(_), LoopEvent::Averaged { .. })
            | (LoopCommand::Move(_) | LoopCommand::Ramp(_) | LoopCommand::LeaveContact(_), LoopEvent::Moved { .. })
            | (LoopCommand::Follow(_), LoopEvent::Followed { .. })
            | (LoopCommand::Dwell(_), LoopEvent::Dwelt)
            | (LoopCommand::Sample(_), LoopEvent::Sampled { .. })
    )
}

fn most_commands(task: &PressTask) -> usize {
    COMMANDS_MORE + COMMANDS_A_LEVEL * task.levels.len() + 8 * task.ramps_mm_s().len()
}

/// The specimen of a plausible driver: no stiffer than declared, its surface no earlier than expected, depths within reach.
struct Specimen {
    surface_mm: f64,
    linear_n_mm: f64,
    quadratic_n_mm2: f64,
}

impl Specimen {
    fn under(draw: &MachineDraw, rng: &mut RandomStream) -> Specimen {
        let Context { expected, limits, .. } = &draw.context;
        let surface_mm = rng.random_range(expected.first_mm..=expected.last_mm.max(expected.first_mm));
        let stiffest_n_mm = limits.stiffness_n_mm * rng.random_range(0.05..1.0);
        let linear_n_mm = stiffest_n_mm * rng.random_range(0.3..1.0);
        let quadratic_n_mm2 = (stiffest_n_mm - linear_n_mm) / (2.0 * limits.depth_mm);
        Specimen { surface_mm, linear_n_mm, quadratic_n_mm2 }
    }

    fn force_n(&self, z_mm: f64) -> f64 {
        let s = (z_mm - self.surface_mm).max(0.0);
        s * (self.linear_n_mm + self.quadratic_n_mm2 * s)
    }
}

/// Result of a press on a specimen.
struct MachineDriven {
    seed: u64,
    end: LoopCommand,
    /// Distance of the deepest end point from the depth limit, mm.
    over_mm: f64,
    broken: Vec<&'static str>,
}

/// Drives one press on a specimen as declared: noise within three sd, and motions that end on their target, where the press stops them or
/// between. Returns the number of steps and the end.
fn drive_plausibly(seed: u64) -> (u64, MachineDriven) {
    let mut rng = stream(seed, 0, "plausible");
    let mut draw = draw(seed, &mut rng, true);
    let (steps_of_z, mut off) = (draw.context.permit.steps(), stream(seed, 0, "off"));
    let specimen = Specimen::under(&draw, &mut rng);
    let limits = draw.context.limits;
    let sigma_n = draw.context.zero.sigma_n;
    let stops_anywhere = rng.random_bool(0.3);
    let start_mm = draw.context.clear_mm;
    let mut output = MachineTranscript::at(start_mm);
    let mut event = LoopEvent::Begin {
        z_mm: start_mm,
        no_load: NoLoadReadings {
            mean_n: 0.0,
            sigma_n,
            readings: NO_LOAD_READINGS,
            age_s: 0.0,
            ..NoLoadReadings::default()
        },
    };
    let (mut steps, mut deepest) = (0, f64::NEG_INFINITY);
    let mut broken = Vec::new();
    for _ in 0..most_commands(&draw.task) {
        output.now_s += 0.05;
        let command = draw.press.next(event, Moment { now_s: output.now_s, age_s: output.age_s });
        steps += 1;
        if is_out_of_turn(&command) {
            broken.push("an answer is out of turn");
        }
        let mut noise_n = |readings: u32| rng.random_range(-2.9..2.9) * draw.context.zero.sigma_mean_n(readings);
        event = match &command {
            LoopCommand::AverageAxes(_) | LoopCommand::Drag(_) => unreachable!("no task here has a drag"),
            LoopCommand::Average(readings) => {
                output.force_n = specimen.force_n(output.z_mm) + noise_n(*readings);
                LoopEvent::Averaged { force_n: output.force_n }
            }
            LoopCommand::Sample(_) => {
                output.force_n = specimen.force_n(output.z_mm) + noise_n(16);
                LoopEvent::Sampled { force_n: output.force_n }
            }
            LoopCommand::Dwell(seconds) => {
                broken.extend(broken_wait(*seconds));
                output.now_s += seconds;
                LoopEvent::Dwelt
            }
            LoopCommand::Follow(seconds) => {
                broken.extend(broken_wait(*seconds));
                output.now_s += seconds;
                output.force_n = specimen.force_n(output.z_mm) + noise_n(20);
                LoopEvent::Followed { force_n: output.force_n }
            }
            LoopCommand::Move(granted) | LoopCommand::Ramp(granted) | LoopCommand::LeaveContact(granted) => {
                output.note_surface(&draw);
                broken.extend(broken_promise(&draw, &output, granted));
                if granted.z_mm() > output.z_mm {
                    let beyond_mm = if steps_of_z.is_fine() { 0.0 } else { steps_of_z.in_position_mm(Axis::Z) };
                    let deepest_mm = granted.z_mm() + beyond_mm;
                    let end_n = if deepest_mm > output.z_mm { specimen.force_n(deepest_mm) } else { 0.0 };
                    broken.extend((end_n > limits.force_n + ROUNDING).then_some("the force of an end point"));
                    let over_mm = deepest_mm - specimen.surface_mm - limits.depth_mm;
                    deepest = deepest.max(over_mm);
                }
                let (from_mm, way_mm) = (output.z_mm, granted.z_mm() - output.z_mm);
                let until = if stops_anywhere { rng.random_range(0..=20) } else { 20 };
                let mut at_mm = granted.z_mm();
                for tick in 0..=until {
                    at_mm = from_mm + way_mm * f64::from(tick) / 20.0;
                    output.now_s += way_mm.abs() / granted.speed_mm_s() / 20.0;
                    let force_n = specimen.force_n(at_mm) + rng.random_range(-2.9..2.9) * sigma_n;
                    let steer = draw.press.see(force_n, output.now_s);
                    steps += 1;
                    broken.extend(broken_steer(granted, steer));
                    if steer == Steer::Stop && matches!(command, LoopCommand::Move(_) | LoopCommand::Ramp(_)) {
                        break;
                    }
                }
                // it ends on the nearest of its steps, and reports them
                output.z_mm = at_mm + off.random_range(-0.5..0.5) * steps_of_z.along(Axis::Z);
                LoopEvent::Moved { z_mm: output.z_mm }
            }
            LoopCommand::Done | LoopCommand::Doubt(_) | LoopCommand::Trip(_) => {
                return (steps, MachineDriven { seed, end: command, over_mm: deepest, broken });
            }
        };
    }
    panic!("seed {seed}: the press has no end: {:?}", draw.task);
}

/// Drives one press with answers that mostly have the right kind, and any value. Returns the number of steps.
fn drive_with_garbage(seed: u64) -> (u64, MachineDraw, MachineTranscript, Vec<&'static str>) {
    let mut rng = stream(seed, 0, "garbage");
    let mut draw = draw(seed, &mut rng, false);
    let mut output = MachineTranscript::at(f64::NAN);
    // most answers are plausible, because the press would end early otherwise
    let specimen = Specimen::under(&draw, &mut rng);
    let sane = 1.0 - rng.random_range(0.0..0.4f64).powi(2);
    let (mut steps, mut broken) = (0, Vec::new());
    let begin = |rng: &mut RandomStream, draw: &MachineDraw| {
        let sound = rng.random_bool(0.9);
        let mean_n = if sound { rng.random_range(-0.015..0.015) } else { garbage(rng) };
        let sigma_n = if sound { draw.context.zero.sigma_n } else { garbage(rng) };
        let z_mm = if sound { draw.context.clear_mm } else { garbage(rng) };
        LoopEvent::Begin {
            z_mm,
            no_load: NoLoadReadings {
                mean_n,
                sigma_n,
                readings: if sound { NO_LOAD_READINGS } else { 0 },
                age_s: 0.0,
                ..NoLoadReadings::default()
            },
        }
    };
    let mut before: Option<LoopCommand> = None;
    let mut event = begin(&mut rng, &draw);
    for _ in 0..most_commands(&draw.task) {
        if let LoopEvent::Begin { z_mm, .. } = event {
            output.z_mm = z_mm;
        }
        output.now_s += rng.random_range(0.0..1.0);
        output.age_s = if rng.random_bool(0.995) { rng.random_range(0.0..0.2) } else { garbage(&mut rng) };
        let command = draw.press.next(event, Moment { now_s: output.now_s, age_s: output.age_s });
        steps += 1;
        let fits = before.as_ref().map_or(matches!(event, LoopEvent::Begin { .. }), |before| answers(before, &event));
        if !fits && !matches!(command, LoopCommand::Trip(_)) {
            broken.push("an event out of turn is taken");
        }
        let mut value = |sane_value: f64| if rng.random_bool(sane) { sane_value } else { garbage(&mut rng) };
        event = match &command {
            LoopCommand::AverageAxes(_) | LoopCommand::Drag(_) => unreachable!("no task here has a drag"),
            LoopCommand::Average(_) => {
                output.force_n = value(specimen.force_n(output.z_mm));
                LoopEvent::Averaged { force_n: output.force_n }
            }
            LoopCommand::Sample(_) => {
                output.force_n = value(specimen.force_n(output.z_mm));
                LoopEvent::Sampled { force_n: output.force_n }
            }
            LoopCommand::Dwell(seconds) => {
                broken.extend(broken_wait(*seconds));
                LoopEvent::Dwelt
            }
            LoopCommand::Follow(seconds) => {
                broken.extend(broken_wait(*seconds));
                output.force_n = value(specimen.force_n(output.z_mm));
                LoopEvent::Followed { force_n: output.force_n }
            }
            LoopCommand::Move(granted) | LoopCommand::Ramp(granted) | LoopCommand::LeaveContact(granted) => {
                output.note_surface(&draw);
                broken.extend(broken_promise(&draw, &output, granted));
                for _ in 0..3 {
                    let sound = rng.random_bool(0.99);
                    let force_n = if sound { specimen.force_n(output.z_mm) } else { garbage(&mut rng) };
                    broken.extend(broken_steer(granted, draw.press.see(force_n, output.now_s)));
                    steps += 1;
                }
                output.z_mm = if rng.random_bool(sane) {
                    let share = if rng.random_bool(0.5) { 1.0 } else { rng.random_range(0.0..=1.0) };
                    output.z_mm + (granted.z_mm() - output.z_mm) * share
                } else {
                    garbage(&mut rng)
                };
                LoopEvent::Moved { z_mm: output.z_mm }
            }
            LoopCommand::Done | LoopCommand::Doubt(_) | LoopCommand::Trip(_) => return (steps, draw, output, broken),
        };
        before = Some(command);
        if rng.random_bool(0.005) {
            event = [
                begin(&mut rng, &draw),
                LoopEvent::Averaged { force_n: output.force_n },
                LoopEvent::Moved { z_mm: output.z_mm },
                LoopEvent::Dwelt,
                LoopEvent::Sampled { force_n: output.force_n },
            ][rng.random_range(0..5)];
        }
    }
    panic!("seed {seed}: the press has no end: {:?}", draw.task);
}

/// Runs presses of successive seeds until there are enough steps; returns the sums.
fn until_enough<T: Send>(drive: impl Fn(u64) -> (u64, T) + Sync) -> (u64, Vec<T>) {
    let part = |thread: u64| {
        let (mut steps, mut ends, mut seed) = (0, Vec::new(), thread);
        while steps < steps_wanted() / THREADS {
            let (more, end) = drive(seed);
            steps += more;
            ends.push(end);
            seed += THREADS;
        }
        (steps, ends)
    };
    thread::scope(|scope| {
        let part = &part;
        let threads: Vec<_> = (0..THREADS).map(|thread| scope.spawn(move || part(thread))).collect();
        threads.into_iter().fold((0, Vec::new()), |(steps, mut ends), thread| {
            let (more, other) = thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            ends.extend(other);
            (steps + more, ends)
        })
    })
}

/// Nothing was broken; otherwise what, how often, and in which press first.
fn must_be_none<'a>(presses: impl Iterator<Item = (u64, &'a Vec<&'static str>)>) {
    let mut counts = BTreeMap::<&str, (usize, u64)>::new();
    for (seed, broken) in presses {
        for what in broken {
            counts.entry(what).or_insert((0, seed)).0 += 1;
        }
    }
    let output = counts.iter().map(|(what, (count, seed))| format!("{what}: {count} times, first in seed {seed}"));
    assert!(counts.is_empty(), "{}", output.collect::<Vec<_>>().join("; "));
}

#[test]
fn press_on_a_declared_specimen_ends_within_every_limit() {
    let (steps, ends) = until_enough(drive_plausibly);
    let mut kinds = BTreeMap::<&str, usize>::new();
    for MachineDriven { end, seed, .. } in &ends {
        let kind = if let LoopCommand::Trip(trip) = end { trip.rule.name() } else { "done" };
        *kinds.entry(kind).or_default() += 1;
        // of a press on a declared specimen, the loop requests nothing that the permit refuses
        assert_ne!(kind, SafetyRule::NotPermitted.name(), "seed {seed}");
    }
    println!("{steps} steps, {} presses: {kinds:?}", ends.len());
    assert!(kinds.get("done").is_some_and(|done| 2 * done > ends.len()), "most presses are done: {kinds:?}");
    must_be_none(ends.iter().map(|driven| (driven.seed, &driven.broken)));
    let deep: Vec<&MachineDriven> = ends.iter().filter(|driven| driven.over_mm > 0.0).collect();
    let worst = deep.iter().max_by(|a, b| a.over_mm.total_cmp(&b.over_mm));
    let output = worst.map(|worst| format!("the worst by {:.3} mm, seed {}", worst.over_mm, worst.seed));
    assert!(deep.is_empty(), "{} end points of {} presses below the depth limit, {output:?}", deep.len(), ends.len());
}

#[test]
fn press_ends_within_its_permit_for_every_reading() {
    let (steps, ends) = until_enough(|seed| {
        let (steps, _, _, broken) = drive_with_garbage(seed);
        (steps, (seed, broken))
    });
    println!("{steps} steps, {} presses", ends.len());
    must_be_none(ends.iter().map(|(seed, broken)| (*seed, broken)));
}

#[test]
fn finished_press_requests_no_motion() {
    for seed in 0..steps_wanted() / 1000 {
        let (_, mut draw, output, _) = drive_with_garbage(seed);
        let (z_mm, force_n) = (draw.context.clear_mm, 0.3 * draw.context.limits.force_n);
        let no_load = NoLoadReadings {
            mean_n: 0.0,
            sigma_n: draw.context.zero.sigma_n,
            readings: NO_LOAD_READINGS,
            age_s: 0.0,
            ..NoLoadReadings::default()
        };
        for event in [
            LoopEvent::Averaged { force_n },
            LoopEvent::Moved { z_mm },
            LoopEvent::Dwelt,
            LoopEvent::Sampled { force_n },
            LoopEvent::Followed { force_n },
            LoopEvent::Begin { z_mm, no_load },
        ] {
            draw.press.see(force_n, output.now_s);
            let command = draw.press.next(event, Moment { now_s: output.now_s, age_s: 0.0 });
            if let LoopCommand::Move(granted) | LoopCommand::Ramp(granted) | LoopCommand::LeaveContact(granted) =
                command
            {
                assert!(granted.z_mm() <= z_mm + ROUNDING, "seed {seed}: it is over, and {event:?} has it {granted:?}");
            }
        }
    }
}
