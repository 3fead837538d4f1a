//! The robot, port by port.

use super::*;
use crate::emulator::serve;
use crate::emulator::tests::{STIFFNESS_N_MM, pressed, scene, shared};
use palpate_core::quantity::Axis;
use palpate_link::time::{Instant, sleep, timeout};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};

/// Program with one motion to a height of the stage, mm, with 10 mm/s and 100 mm/s^2, between two writings of register
/// 3.
fn to_z(z_mm: f64) -> String {
    let pose = format!("p[0.299, -0.198, {}, 3.141592653589793, 0, 0]", 0.1 + z_mm / 1000.0);
    let write = "write_output_integer_register";
    format!("def go():\n  {write}(3, 1)\n  movel({pose}, a=0.1, v=0.01) # down\n  {write}(3, 2)\nend\n")
}

fn arm(faults: &[(f64, UrFaultKind)]) -> UrArm {
    let faults = faults.iter().map(|&(from_s, kind)| UrFault { from_s, kind }).collect();
    UrArm { faults, force_error_n: 0.0, ..UrArm::default() }
}

/// A robot and its scene, talked to at given times, and one link to each port: RTDE, secondary, dashboard.
struct UrBench {
    robot: UrEmulator,
    scene: Scene,
    links: [Shared<dyn Instrument>; 3],
    now_s: f64,
}

impl UrBench {
    fn new(faults: &[(f64, UrFaultKind)]) -> UrBench {
        UrBench::with(arm(faults), scene())
    }

    fn with(arm: UrArm, scene: Scene) -> UrBench {
        let robot = UrEmulator::new(arm, &scene);
        let links = [RTDE_PORT, SECONDARY_PORT, DASHBOARD_PORT].map(|port| robot.at_port(port).expect("a port"));
        UrBench { robot, scene, links, now_s: 0.0 }
    }

    /// What a link answers at once to bytes at a time.
    fn send(&mut self, link: usize, at_s: f64, bytes: &[u8]) -> Vec<u8> {
        self.until(at_s);
        let (mut inbox, mut answers) = (bytes.to_vec(), Vec::new());
        let mut link = lock(&self.links[link]);
        while let Some(request) = link.take_request(&mut inbox) {
            answers.extend(link.answer(&request, &mut self.scene, at_s));
        }
        answers
    }

    fn rtde(&mut self, at_s: f64, bytes: &[u8], expected: &[u8]) {
        assert_eq!(self.send(0, at_s, bytes).escape_ascii().to_string(), expected.escape_ascii().to_string());
    }

    fn script(&mut self, at_s: f64, program: &str) {
        assert!(self.send(1, at_s, program.as_bytes()).is_empty());
    }

    fn say(&mut self, at_s: f64, command: &str, expected: &str) {
        let answer = self.send(2, at_s, format!("{command}\n").as_bytes());
        assert_eq!(String::from_utf8_lossy(&answer), format!("{expected}\n"), "{command} at {at_s} s");
    }

    /// Data packages until a time, each with the time at which it came.
    fn until(&mut self, until_s: f64) -> Vec<(f64, Vec<u8>)> {
        let mut packages = Vec::new();
        loop {
            match lock(&self.links[0]).owed(&mut self.scene, self.now_s) {
                Owed::At(at_s) if at_s <= until_s => self.now_s = at_s,
                Owed::Ready(package) => packages.push((self.now_s, package)),
                _ => break,
            }
        }
        self.now_s = until_s;
        packages
    }

    /// Checks the runtime state, register 3 and the height of the stage, mm, at times, s.
    fn goes(&mut self, states: &[(f64, u32, i32, f64)]) {
        for &(at_s, runtime, register, z_mm) in states {
            let found_mm = self.readings(at_s).pose[2] * 1000.0 - 100.0;
            let robot = lock(&self.robot.rtde.robot);
            assert_eq!((robot.runtime as u32, robot.registers.integers[3]), (runtime, register), "{at_s} s");
            assert!((found_mm - z_mm).abs() < 1e-6, "{found_mm} mm at {at_s} s");
        }
    }

    fn readings(&mut self, at_s: f64) -> readings::Readings {
        self.until(at_s);
        lock(&self.robot.rtde.robot).readings(&mut self.scene, at_s)
    }
}

/// Setup of outputs at 125 Hz in version 2.
fn outputs(names: &str) -> Vec<u8> {
    let size = (11 + names.len()) as u16;
    [&size.to_be_bytes()[..], b"O\x40\x5f\x40\0\0\0\0\0", names.as_bytes()].concat()
}

#[test]
fn handshake_is_that_of_the_guide() {
    let mut bench = UrBench::new(&[]);
    bench.rtde(0.001, b"\0\x05V\0\x03\0\x05V\0\x02", b"\0\x04V\0\0\x04V\x01");
    bench.rtde(0.001, b"\0\x03v", b"\0\x13v\0\0\0\x05\0\0\0\x0b\0\0\0\x09\0\x0f\x6b\x14");
    bench.rtde(0.001, &outputs("timestamp,runtime_state,"), b"\0\x11O\x01DOUBLE,UINT32");
    assert!(bench.until(1.0).is_empty());
    bench.rtde(1.001, b"\0\x03S", b"\0\x04S\x01");
    let packages = bench.until(1.0241);
    assert_eq!(packages[0].1, [&b"\0\x10U\x01"[..], &1.008_f64.to_be_bytes(), b"\0\0\0\x01"].concat());
    let times_ms: Vec<f64> = packages.iter().map(|(at_s, _)| (at_s * 1e3).round()).collect();
    assert_eq!(times_ms, [1008.0, 1016.0, 1024.0]);
    bench.rtde(1.1, b"\0\x03P", b"\0\x04P\x01");
    assert!(bench.until(2.0).is_empty());
}

#[test]
fn version_1_has_no_frequency_and_no_number_of_a_recipe() {
    let mut bench = UrBench::new(&[]);
    bench.rtde(0.001, b"\0\x0dOrobot_mo", b"");
    bench.rtde(0.001, b"de\0\x03S\0\x03", b"\0\x08OINT32\0\x04S\x01");
    assert_eq!(bench.until(0.0161)[1].1, b"\0\x07U\0\0\0\x07");
    bench.rtde(0.02, b"X", b"\0\x20M\x02unknown or malformed package");
    bench.rtde(0.03, b"\0\x02V\0\x02", b"");
    assert_eq!(lock(&bench.links[0]).owed(&mut bench.scene, 0.03), Owed::HungUp, "a size below that of a header");
}

#[test]
fn names_that_are_unknown_or_in_use_are_named_and_the_recipe_is_refused() {
    let mut bench = UrBench::new(&[]);
    bench.rtde(0.0, b"\0\x05V\0\x02", b"\0\x04V\x01");
    bench.rtde(0.0, &outputs("payload,output_int_register_48"), b"\0\x14O\0DOUBLE,NOT_FOUND");
    bench.rtde(0.0, b"\0\x03S", b"\0\x04S\0\0\x1dM\x13no recipe is set up\x04RTDE\x01");
    bench.rtde(0.0, b"\0\x18Iinput_int_register_7,", b"\0\x09I\x01INT32");
    let other = bench.robot.accept().expect("a link");
    let first = std::mem::replace(&mut bench.links[0], other);
    bench.rtde(0.0, b"\0\x17Iinput_int_register_7", b"\0\x0aI\0IN_USE");
    drop(first);
    bench.rtde(0.0, b"\0\x17Iinput_int_register_7", b"\0\x09I\x01INT32");
}

#[test]
fn default_list_of_a_public_client_is_accepted() {
    let names = "timestamp,target_q,target_qd,target_qdd,target_current,target_moment,actual_q,actual_qd,\
        actual_current,joint_control_output,actual_TCP_pose,actual_TCP_speed,actual_TCP_force,target_TCP_pose,\
        target_TCP_speed,actual_digital_input_bits,joint_temperatures,actual_execution_time,robot_mode,joint_mode,\
        safety_mode,actual_tool_accelerometer,speed_scaling,target_speed_fraction,actual_momentum,actual_main_voltage,\
        actual_robot_voltage,actual_robot_current,actual_joint_voltage,actual_digital_output_bits,runtime_state,\
        standard_analog_input0,standard_analog_input1,standard_analog_output0,standard_analog_output1,\
        robot_status_bits,safety_status_bits,ft_raw_wrench,payload,payload_cog,payload_inertia,output_int_register_2,";
    let mut bench = UrBench::new(&[]);
    let kinds = bench.send(0, 0.0, &[b"\0\x05V\0\x02", &outputs(names)[..], b"\0\x03S"].concat());
    let lengths = kinds[8..kinds.len() - 4].split(|&byte| byte == b',').map(|kind| {
        let kinds = [(&b"VECTOR6D"[..], 48), (b"VECTOR3D", 24), (b"VECTOR6INT32", 24), (b"DOUBLE", 8), (b"UINT64", 8)];
        kinds.iter().find(|(known, _)| *known == kind).map_or(4, |(_, length)| *length)
    });
    assert_eq!(bench.until(0.009)[0].1.len(), 4 + lengths.sum::<usize>());
}

#[test]
fn motion_begins_after_compiling_and_ends_on_time_where_asked() {
    let mut bench = UrBench::new(&[]);
    bench.script(1.0, &to_z(6.0).replace('\n', "\r\n"));
    // 0.1 s to the first statement, then 0.3 s for 2 mm
    bench.goes(&[(1.05, 1, 0, 8.0), (1.07, 2, 0, 8.0), (1.1, 2, 1, 8.0), (1.25, 2, 1, 7.0), (1.399, 2, 1, 6.00005)]);
    bench.goes(&[(1.405, 0, 2, 6.0), (1.42, 1, 2, 6.0)]);
    let (pose, pi) = (bench.readings(2.0).planned_pose, std::f64::consts::PI);
    assert!(pose.iter().zip([0.299, -0.198, 0.106, pi, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{pose:?}");
}

#[test]
fn new_program_ends_the_old_one_and_the_arm_decelerates_first() {
    let mut bench = UrBench::new(&[]);
    bench.script(1.0, &to_z(-12.0));
    bench.script(2.0, &to_z(8.0));
    // 10 mm/s at 2.06 s, and 4 m/s^2
    bench.goes(&[(2.05, 2, 1, -1.0), (2.065, 0, 1, -1.1125), (2.11, 2, 1, -1.1125), (5.0, 1, 2, 8.0)]);
}

#[test]
fn slider_slows_a_motion_and_one_under_way() {
    let mut bench = UrBench::new(&[(1.25, UrFaultKind::SpeedSlider(0.5))]);
    bench.script(1.0, &to_z(6.0));
    assert!((bench.readings(1.34).speed[2] + 0.005).abs() < 1e-9);
    bench.script(3.0, &to_z(8.0));
    // twice as long as at full speed
    bench.goes(&[(3.4, 2, 1, 7.0), (3.698, 2, 1, 7.99995), (3.702, 0, 2, 8.0)]);
    bench.rtde(4.0, b"\0\x2bIspeed_slider_mask,speed_slider_fraction,", b"\0\x11I\x01UINT32,DOUBLE");
    bench.rtde(4.0, &[&b"\0\x10U\x01\0\0\0\x01"[..], &0.25_f64.to_be_bytes()].concat(), b"");
    assert_eq!(lock(&bench.robot.rtde.robot).slider, 0.25);
}

#[test]
fn protective_stop_halts_the_arm_until_it_is_unlocked_and_continued() {
    let mut bench = UrBench::new(&[(1.25, UrFaultKind::ProtectiveStop)]);
    bench.script(1.0, &to_z(6.0));
    // 10 m/s^2
    bench.goes(&[(1.2505, 3, 1, 6.99625), (1.26, 4, 1, 6.995)]);
    bench.say(2.0, "safetystatus", "Safetystatus: PROTECTIVE_STOP");
    let locked = "Cannot unlock protective stop until 5s after occurrence. \
        Always inspect cause of protective stop before unlocking";
    bench.say(6.2, "unlock protective stop", locked);
    bench.say(6.3, "unlock protective stop", "Protective stop releasing");
    bench.goes(&[(7.0, 4, 1, 6.995)]);
    bench.say(7.0, "play", "Starting program");
    bench.goes(&[(7.05, 5, 1, 6.995), (8.0, 1, 2, 6.0)]);
}

#[test]
fn what_cannot_run_moves_nothing() {
    let mut bench = UrBench::new(&[(10.0, UrFaultKind::ProtectiveStop)]);
    for (from, to) in [("def go()", "def go"), ("a=", "speed="), ("  movel(p", "  movej("), ("0.299, ", "")] {
        bench.script(1.0, &to_z(6.0).replace(from, to));
    }
    bench.script(4.0, &to_z(900.0));
    bench.goes(&[(4.0, 1, 0, 8.0), (5.0, 1, 1, 8.0)]);
    assert_eq!((bench.robot.syntax_errors(), bench.robot.runtime_errors()), (4, 1));
    let far = "is_within_safety_limits(p[9,0,0,0,0,0])";
    let ask = format!(" if (get_inverse_kin_has_solution(get_actual_tcp_pose()) and not {far}): # \"yes\"");
    let [yes, no] = ["  write_output_integer_register(3, 7)\n  textmsg(\"#\")", "  sleep(9)"];
    bench.script(6.0, &format!("def ask():\n{ask}\n{yes}\n else:\n{no}\n end\nend\n"));
    // the tool points down, so a point farther out is lower
    bench.script(7.0, "sec beside():\n set_payload(0.5, [0, 0, 0.1])\n set_tcp(p[0, 0, 0.02, 0, 0, 0])\nend\n");
    bench.goes(&[(7.0, 1, 7, 8.0), (8.0, 1, 7, -12.0)]);
    bench.script(11.0, &to_z(6.0));
    bench.goes(&[(12.0, 1, 7, -12.0)]);
    assert_eq!((bench.robot.syntax_errors(), bench.robot.runtime_errors()), (4, 2));
}

#[test]
fn dashboard_answers_as_its_document_says_and_local_control_ignores_programs() {
    let mut bench = UrBench::new(&[(2.0, UrFaultKind::LocalControl), (5.0, UrFaultKind::EmergencyStop)]);
    bench.say(1.0, "robotmode\r", "Robotmode: RUNNING");
    bench.say(1.0, "load a.urp", "File not found: a.urp");
    bench.say(1.0, "stop", "Failed to execute: stop");
    bench.say(1.0, "dance", "could not understand: dance");
    bench.script(3.0, &to_z(6.0));
    bench.goes(&[(4.0, 1, 0, 8.0)]);
    assert!(bench.send(2, 4.0, b"play\n").starts_with(b"Command is not allowed due to safety reasons"));
    bench.say(6.0, "safetymode", "Safetymode: ROBOT_EMERGENCY_STOP");
}

#[test]
fn deviations_end_on_the_line_and_the_force_pushes_back() {
    let bent = [(0.5, UrFaultKind::Sideways { mm: 0.2 }), (0.5, UrFaultKind::Tilt { rad: 0.01 })];
    let mut bench = UrBench::new(&bent);
    bench.script(1.0, &to_z(6.0));
    let ends = [bench.readings(1.25), bench.readings(2.0)]
        .map(|at| [0, 3].map(|n| at.pose[n].abs() - at.planned_pose[n].abs()));
    for (found, expected) in ends.as_flattened().iter().zip([2e-4, -0.01, 0.0, 0.0]) {
        assert!((found - expected).abs() < 1e-8, "{ends:?}");
    }
    let force = UrBench::with(arm(&[]), pressed(0.5 * STIFFNESS_N_MM)).readings(1.0).force;
    assert!((force[2] - 0.5 * STIFFNESS_N_MM).abs() < 1e-9 && force[0].abs() < 1e-9, "{force:?}");
}

/// The near end of a link that is served.
fn served(port: Option<Shared<dyn Instrument>>, scene: &Shared<Scene>, origin: Instant) -> DuplexStream {
    let (near, far) = tokio::io::duplex(1024);
    tokio::spawn(serve(far, port.expect("a port"), scene.clone(), origin));
    near
}

#[tokio::test(start_paused = true)]
async fn links_are_greeted_and_fed_and_hung_up() {
    let (scene, origin) = (shared(scene()), Instant::now());
    let robot = UrEmulator::new(arm(&[(1.0, UrFaultKind::RtdeLost), (5.0, UrFaultKind::RtdeSilent)]), &lock(&scene));
    let mut dashboard = served(robot.at_port(DASHBOARD_PORT), &scene, origin);
    dashboard.write_all(b"quit\r\n").await.expect("open");
    let mut text = String::new();
    dashboard.read_to_string(&mut text).await.expect("an orderly end");
    assert_eq!(text, "Connected: Universal Robots Dashboard Server\nDisconnected\n");

    let start = [b"\0\x05V\0\x02", &outputs("runtime_state")[..], b"\0\x03S"].concat();
    let (mut rtde, mut stream) = (served(robot.at_port(RTDE_PORT), &scene, origin), Vec::new());
    rtde.write_all(&start).await.expect("open");
    rtde.read_to_end(&mut stream).await.expect("an end");
    // from 8 ms on, every 8 ms until 1 s
    assert_eq!(stream.len(), 4 + 10 + 4 + 8 * 124);
    assert_eq!(served(robot.at_port(RTDE_PORT), &scene, origin).read(&mut [0]).await.expect("an end"), 0);
    sleep(Duration::from_millis(2500)).await;
    let mut rtde = served(robot.at_port(RTDE_PORT), &scene, origin);
    rtde.write_all(&start).await.expect("open");
    let (mut script, mut state) = (served(robot.at_port(SECONDARY_PORT), &scene, origin), [0; 10]);
    script.read_exact(&mut state).await.expect("a state");
    assert_eq!(state, *b"\0\0\0\x34\x10\0\0\0\x2f\0");
    // a client that doesn't read the states can still send programs
    sleep(Duration::from_secs(9)).await;
    script.write_all(to_z(6.0).as_bytes()).await.expect("open");
    while timeout(Duration::from_secs(1), rtde.read_u8()).await.is_ok() {}
    assert_eq!(lock(&scene).axis(Axis::Z, 20.0).0, 6.0);
}
