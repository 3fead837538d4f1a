//! Safety of the drivers, each with an emulated device or a scripted far end, in virtual time. True positions come from the scene.

use palpate_core::quantity::{Axis, Down, StageAbilities, Steps};
use palpate_drivers::Esp301;
use palpate_drivers::modbus::{ModbusLoadCell, Profile, Transport};
use palpate_link::device::{AxisWay, HomeSearch, LoadCell as _, MotionOrders, Stage, StageUse};
use palpate_link::time::{Instant, sleep};
use palpate_link::wire::Connector;
use palpate_run::rig::{RigSpec, SimulatedRig};
use palpate_sim::emulator::{Instrument, Shared, serve};
use palpate_sim::scene::{Scene, Trajectory};
use palpate_testing::executions::run_virtually;
use palpate_testing::made_ready;
use palpate_testing::safety::{rig_with, truthful};
use std::future::Future;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};
use tokio::sync::mpsc;

// ---- the stage's driver against its emulator -----------------------------------------------------------------------

/// The emulated stage of a rig with a driver, and access to its scene.
struct StageBench {
    driver: Esp301,
    instrument: Shared<dyn Instrument>,
    scene: Shared<Scene>,
    usage: StageUse,
    origin: Instant,
}

impl StageBench {
    fn new(spec: &RigSpec) -> StageBench {
        let origin = Instant::now();
        let SimulatedRig { scene, stage, .. } = spec.emulators(1).unwrap();
        let instrument = stage.instrument().expect("it has a link").clone();
        let (far_instrument, far_scene) = (instrument.clone(), scene.clone());
        let dial = move || {
            let (near, far) = duplex(4096);
            let (instrument, scene) = (far_instrument.clone(), far_scene.clone());
            palpate_link::time::spawn(async move { serve(far, instrument, scene, origin).await });
            near
        };
        let usage = StageUse {
            travel: spec.permitted_travel(),
            away: -spec.frame.down.sign(),
            speed_mm_s: spec.stage.speed_mm_s,
            acceleration_mm_s2: spec.stage.acceleration_mm_s2,
            home_speed_mm_s: 5.0,
            home_z_mm: -12.5 * spec.frame.down.sign(),
            homed: false,
            z_holds_unpowered: false,
            by_hand: false,
            steps: Steps::FINE,
            home_search: HomeSearch::Away,
            abilities: StageAbilities::FULL,
        };
        let driver = Esp301::new(Connector::in_memory(dial), "bench".to_owned());
        StageBench { driver, instrument, scene, usage, origin }
    }

    fn now_s(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }

    /// A command of another client of the controller, carried out at once.
    fn command(&self, line: &str) {
        let now_s = self.now_s();
        self.instrument.lock().unwrap().answer(line.as_bytes(), &mut self.scene.lock().unwrap(), now_s);
    }

    fn at_mm(&self, axis: Axis) -> f64 {
        let now_s = self.now_s();
        self.scene.lock().unwrap().axis(axis, now_s).0
    }
}

/// Whether x or y moved while z was near the specimen, checked each ms.
async fn sideways_in_contact(scene: Shared<Scene>, origin: Instant, contact_below_mm: f64) -> bool {
    let look = || {
        let now_s = origin.elapsed().as_secs_f64();
        let mut scene = scene.lock().unwrap();
        Axis::ALL.map(|axis| scene.axis(axis, now_s))
    };
    let mut seen = false;
    loop {
        let [x, y, z] = look();
        seen |= (x.1 != 0.0 || y.1 != 0.0) && z.0 < contact_below_mm;
        if seen {
            return true;
        }
        sleep(Duration::from_millis(1)).await;
    }
}

#[test]
fn after_a_crash_in_contact_x_and_y_wait_until_z_is_clear() {
    // z was homed and still presses; the x motor is off (a following error, or the front panel)
    run_virtually(async {
        let spec = rig_with(|_, _| {});
        let mut bench = StageBench::new(&spec);
        made_ready(&mut bench.driver, &bench.usage, &MotionOrders::default()).await.unwrap();
        let top_mm = bench.driver.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap();
        let down = AxisWay::between(Axis::Z, top_mm, -1.0);
        bench.driver.begin(&[down], 10.0, &MotionOrders::default()).await.unwrap();
        bench.driver.follow(&[Axis::Z], Duration::from_secs(2), &MotionOrders::default()).await.unwrap();
        bench.command("1PA3");
        sleep(Duration::from_secs(2)).await;
        bench.command("1MF");
        assert!(bench.at_mm(Axis::Z) < -0.9, "pressing");
        let watch = sideways_in_contact(bench.scene.clone(), bench.origin, 0.3);
        // it may home x after its own retraction or refuse to continue
        let never = MotionOrders::default();
        let moved = tokio::select! {
            biased;
            moved = watch => moved,
            _ = made_ready(&mut bench.driver, &bench.usage, &never) => false,
        };
        assert!(!moved, "x moved with the indenter {} mm in the specimen", -bench.at_mm(Axis::Z));
    });
}

#[test]
fn a_stage_that_still_moves_when_a_program_starts_is_brought_to_rest_first() {
    // a killed program left a motion; the next one must not take a moving position for the final one
    run_virtually(async {
        let spec = rig_with(|_, _| {});
        let mut bench = StageBench::new(&spec);
        made_ready(&mut bench.driver, &bench.usage, &MotionOrders::default()).await.unwrap();
        let top_mm = bench.driver.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap();
        let down = AxisWay::between(Axis::Z, top_mm, -1.0);
        bench.driver.begin(&[down], 1.0, &MotionOrders::default()).await.unwrap();
        made_ready(&mut bench.driver, &bench.usage, &MotionOrders::default()).await.unwrap();
        let here_mm = bench.driver.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap();
        sleep(Duration::from_secs(1)).await;
        assert!((bench.at_mm(Axis::Z) - here_mm).abs() < 0.001, "from {here_mm} mm to {} mm", bench.at_mm(Axis::Z));
    });
}

#[test]
fn an_indenter_that_presses_at_power_up_is_homed_away_from_the_specimen() {
    for down in [Down::Minus, Down::Plus] {
        run_virtually(async {
            let spec = rig_with(|spec, _| spec.frame.down = down);
            let bench = StageBench::new(&spec);
            let into = down.sign();
            bench.scene.lock().unwrap().set_motion(Axis::Z, Trajectory::at_rest(into), 0.0);
            // the controller is switched on there
            let StageBench { scene, usage, origin, .. } = bench;
            let instrument: Shared<dyn Instrument> =
                Arc::new(Mutex::new(palpate_sim::emulator::Esp301Emulator::new(&scene.lock().unwrap())));
            let far_scene = scene.clone();
            let dial = move || {
                let (near, far) = duplex(4096);
                let (instrument, scene) = (instrument.clone(), far_scene.clone());
                palpate_link::time::spawn(async move { serve(far, instrument, scene, origin).await });
                near
            };
            let mut driver = Esp301::new(Connector::in_memory(dial), "bench".to_owned());
            let deepest = async {
                let mut deepest_mm = f64::NEG_INFINITY;
                let mut sideways = false;
                loop {
                    let now_s = origin.elapsed().as_secs_f64();
                    let [x, _, z] = Axis::ALL.map(|axis| scene.lock().unwrap().axis(axis, now_s));
                    deepest_mm = deepest_mm.max(z.0 * into);
                    sideways |= x.1 != 0.0 && z.0 * into > -0.3;
                    assert!(deepest_mm <= 1.0 && !sideways, "{down:?}: {deepest_mm} mm");
                    sleep(Duration::from_millis(2)).await;
                }
            };
            let never = MotionOrders::default();
            tokio::select! {
                biased;
                () = deepest => {}
                prepared = made_ready(&mut driver, &usage, &never) => drop(prepared.unwrap()),
            }
        });
    }
}

/// A driver with a scripted far end, line by line.
fn scripted<F: Future<Output = ()> + Send + 'static>(backlash: impl FnOnce(DuplexStream) -> F) -> Esp301 {
    let (near, far) = duplex(4096);
    palpate_link::time::spawn(backlash(far));
    let near = Mutex::new(Some(near));
    Esp301::new(Connector::in_memory(move || near.lock().unwrap().take().unwrap()), "script".to_owned())
}

async fn line_from(far: &mut DuplexStream) -> Option<String> {
    let mut line = Vec::new();
    while line.last() != Some(&b'\r') {
        line.push(far.read_u8().await.ok()?);
    }
    Some(String::from_utf8(line).unwrap().trim().to_owned())
}

#[test]
fn repeated_answer_is_not_taken_for_the_next() {
    run_virtually(async {
        let mut driver = scripted(|mut far| async move {
            let mut first = true;
            while let Some(line) = line_from(&mut far).await {
                let answer: &[u8] = match line.as_str() {
                    // the line stutters once
                    "3MD?;3TP;TB?" if std::mem::take(&mut first) => b"1\r\n1\r\n-0.4321\r\n0, 1, NO ERROR DETECTED\r\n",
                    "3MD?;3TP;TB?" => b"1\r\n-0.4321\r\n0, 2, NO ERROR DETECTED\r\n",
                    "3TP" => b"-0.4321\r\n",
                    "VE?" => b"ESP301 Version 1.1.1 16/01/14\r\n",
                    _ => b"",
                };
                far.write_all(answer).await.unwrap();
            }
        });
        assert_eq!(driver.follow(&[Axis::Z], Duration::ZERO, &MotionOrders::default()).await.unwrap(), [-0.4321]);
        assert_eq!(driver.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap(), -0.4321);
    });
}

#[test]
fn stop_is_sent_at_once_during_resynchronisation() {
    run_virtually(async {
        let stopped_s = Arc::new(Mutex::new(None));
        let (output, began) = (stopped_s.clone(), Instant::now());
        let mut driver = scripted(move |mut far| async move {
            let mut garbled = false;
            while let Some(line) = line_from(&mut far).await {
                let answer: &[u8] = match line.as_str() {
                    "3MD?;3TP;TB?" if garbled => b"1\r\n-0.4321\r\n0, 1, NO ERROR DETECTED\r\n",
                    "3MD?;3TP;TB?" => {
                        garbled = true;
                        b"E what?\r\n-0.4321\r\n0, 1, NO ERROR DETECTED\r\n"
                    }
                    "VE?" => {
                        sleep(Duration::from_secs(1)).await;
                        b"ESP301 Version 1.1.1 16/01/14\r\n"
                    }
                    "ST" => {
                        *output.lock().unwrap() = Some(began.elapsed().as_secs_f64());
                        b""
                    }
                    _ => b"",
                };
                far.write_all(answer).await.unwrap();
            }
        });
        let orders = MotionOrders::default();
        let ask_for_it = async {
            sleep(Duration::from_millis(30)).await;
            orders.stop();
        };
        let (followed, ()) = tokio::join!(driver.follow(&[Axis::Z], Duration::ZERO, &orders), ask_for_it);
        followed.unwrap();
        let stopped_s = stopped_s.lock().unwrap().expect("ST was sent");
        assert!(stopped_s < 0.05, "asked for at 0.03 s, sent at {stopped_s} s");
    });
}

// ---- the load cell's driver ----------------------------------------------------------------------------------------

/// Opens a serial line that persists, as a real one does: the device answers one request after another, to the program that has the port
/// open by then. `late` delays the answer to each request.
fn serial_line(
    instrument: Shared<dyn Instrument>,
    scene: Shared<Scene>,
    origin: Instant,
    late: impl Fn(usize) -> Duration + Send + 'static,
) -> Connector {
    let (requests, mut requested) = mpsc::unbounded_channel::<Vec<u8>>();
    let port: Arc<tokio::sync::Mutex<Option<tokio::io::WriteHalf<DuplexStream>>>> = Arc::default();
    let (device, writer) = (instrument.clone(), port.clone());
    palpate_link::time::spawn(async move {
        let mut count = 0;
        while let Some(request) = requested.recv().await {
            let now_s = origin.elapsed().as_secs_f64();
            let answer = device.lock().unwrap().answer(&request, &mut scene.lock().unwrap(), now_s);
            sleep(Duration::from_millis(2) + late(count)).await;
            count += 1;
            if let Some(writer) = writer.lock().await.as_mut() {
                // a program that closed the port misses the answer
                let _ = writer.write_all(&answer).await;
            }
        }
    });
    Connector::in_memory(move || {
        let (near, far) = duplex(4096);
        let (mut reader, writer) = tokio::io::split(far);
        *port.try_lock().unwrap() = Some(writer);
        let (instrument, requests) = (instrument.clone(), requests.clone());
        palpate_link::time::spawn(async move {
            let mut inbox = Vec::new();
            while let Ok(byte) = reader.read_u8().await {
                inbox.push(byte);
                while let Some(request) = instrument.lock().unwrap().take_request(&mut inbox) {
                    let _ = requests.send(request);
                }
            }
        });
        near
    })
}

#[test]
fn reading_beyond_the_range_is_named_with_its_value() {
    run_virtually(async {
        let spec = rig_with(|_, scene| truthful(scene));
        let origin = Instant::now();
        let SimulatedRig { scene, load_cell, .. } = spec.emulators(1).unwrap();
        let line = serial_line(load_cell.instrument().expect("it has a link").clone(), scene.clone(), origin, |_| {
            Duration::ZERO
        });
        let profile = Profile::shipped("generic-rs485").expect("a register map");
        let mut cell = ModbusLoadCell::new(line, Transport::Rtu, profile, "line", 200.0, origin).unwrap();
        cell.prepare().await.unwrap();
        cell.read().await.unwrap();
        let now_s = origin.elapsed().as_secs_f64();
        scene.lock().unwrap().set_motion(Axis::Z, Trajectory::at_rest(-6.0), now_s);
        sleep(Duration::from_millis(20)).await;
        // a mean of four, as for the decision about a step: at least its last reading shows it
        let mut health = Default::default();
        for _ in 0..4 {
            health = cell.read().await.unwrap().health;
        }
        assert!(health.saturated, "four readings of a saturated cell passed for good ones");
    });
}

#[test]
fn late_answer_of_the_load_cell_is_not_taken_for_a_new_force() {
    run_virtually(async {
        let spec = rig_with(|_, scene| truthful(scene));
        let origin = Instant::now();
        let SimulatedRig { scene, load_cell, .. } = spec.emulators(1).unwrap();
        // the fifth answer comes after the driver gave up (200 ms) and found the line quiet
        let late = |count| Duration::from_millis(if count == 4 { 240 } else { 0 });
        let line = serial_line(load_cell.instrument().expect("it has a link").clone(), scene.clone(), origin, late);
        let profile = Profile::shipped("generic-rs485").expect("a register map");
        let mut cell = ModbusLoadCell::new(line, Transport::Rtu, profile, "line", 200.0, origin).unwrap();
        cell.prepare().await.unwrap(); // three requests
        assert_eq!(cell.read().await.unwrap().force_n, 0.0);
        let press = async {
            sleep(Duration::from_millis(100)).await;
            let now_s = origin.elapsed().as_secs_f64();
            scene.lock().unwrap().set_motion(Axis::Z, Trajectory::at_rest(-1.0), now_s);
        };
        let (reading, ()) = tokio::join!(cell.read(), press);
        // refusing it is right, and so is the present force; the earlier force isn't
        for reading in [reading, cell.read().await, cell.read().await].into_iter().flatten() {
            assert!(reading.force_n > 0.5, "{} N at {} s, after 1 mm at 0.1 s", reading.force_n, reading.at_s);
        }
    });
}
