//! The robot, port by port.

use super::*;
use crate::emulator::serve;
use crate::emulator::tests::{STIFFNESS_N_MM, pressed, scene, shared};
use palpate_core::quantity::Axis;
use palpate_link::time::{Instant, sleep, timeout};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};

/// Program with one motion to a height of the stage, mm, with 10 mm/s and 100 mm/s^2, between writings of register 3.
fn to_z(z_mm: f64) -> String {
    let pose = format!("p[0.299, -0.198, {}, 3.141592653589793, 0, 0]", 0.1 + z_mm / 1000.0);
    let write = "write_output_integer_register";
    format!("def go():\n  {write}(3, 1)\n  movel({pose}, a=0.1, v=0.01) # down\n  {write}(3, 2)\nend\n")
}

fn arm(faults: &[(f64, UrFaultKind)]) -> UrArm {
    let faults = faults.iter().map(|&(from_s, kind)| UrFault { from_s, kind }).collect();
    UrArm { faults, force_error_n: 0.0, pose_noise: (0.0, 0.0), ..UrArm::default() }
}

/// A robot and its scene, talked to at given times, and one link to each port: RTDE, secondary, dashboard.
struct UrBench {
    robot: UrEmulator,
    scene: Scene,
    links: [Shared<dyn Instrument>; 3],
    now_s: f64,
}

impl UrBench {
    fn new(faults: &[(f64, UrFaultKind)], scene: Scene) -> UrBench {
        let robot = UrEmulator::new(arm(faults), &scene);
        let links = [RTDE_PORT, SECONDARY_PORT, DASHBOARD_PORT].map(|port| robot.at_port(port).expect("a port"));
        UrBench { robot, scene, links, now_s: 0.0 }
    }

    /// Checks how the answer begins that a link gives at once to bytes at a time.
    fn ask(&mut self, link: usize, at_s: f64, bytes: &[u8], expected: &[u8]) {
        self.until(at_s);
        let (mut inbox, mut answers) = (bytes.to_vec(), Vec::new());
        let mut link = lock(&self.links[link]);
        while let Some(request) = link.take_request(&mut inbox) {
            answers.extend(link.answer(&request, &mut self.scene, at_s));
        }
        let [answers, expected] = [&answers, expected].map(|bytes| bytes.escape_ascii().to_string());
        assert!(answers.starts_with(&expected), "{answers:?}, expected {expected:?} at {at_s} s");
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

    /// Sends a program at a time, s, and checks the runtime state, register 3 and the height of the stage, mm.
    fn goes(&mut self, from_s: f64, program: &str, states: &[(f64, u32, i32, f64)]) {
        self.ask(1, from_s, program.as_bytes(), b"");
        for &(at_s, runtime, register, z_mm) in states {
            let found_mm = self.readings(at_s)[0][2] * 1000.0 - 100.0;
            let robot = lock(&self.robot.robot);
            assert_eq!((robot.runtime as u32, robot.registers[3]), (runtime, register), "{at_s} s");
            assert!((found_mm - z_mm).abs() < 1e-6, "{found_mm} mm at {at_s} s");
        }
    }

    /// Pose, planned pose, speed and force.
    fn readings(&mut self, at_s: f64) -> [[f64; 6]; 4] {
        self.until(at_s);
        let robot = lock(&self.robot.robot);
        let now = robot.readings(at_s, &mut self.scene, at_s);
        [now.pose, now.planned_pose, now.speed, now.force]
    }
}

/// Setup of outputs at 125 Hz in version 2.
fn outputs(names: &str) -> Vec<u8> {
    let size = (11 + names.len()) as u16;
    [&size.to_be_bytes()[..], b"O\x40\x5f\x40\0\0\0\0\0", names.as_bytes()].concat()
}

#[test]
fn handshake_is_that_of_the_guide_and_what_cannot_be_set_up_is_refused() {
    let mut bench = UrBench::new(&[], scene());
    bench.ask(0, 0.001, &outputs("timestamp"), b"\0\x22M\x18only version 2 is spoken\x04RTDE\x01");
    bench.ask(0, 0.001, b"\0\x05V\0\x03\0\x05V\0\x02", b"\0\x04V\0\0\x04V\x01");
    bench.ask(0, 0.001, b"\0\x03v", b"\0\x13v\0\0\0\x05\0\0\0\x0b\0\0\0\x09\0\x0f\x6b\x14");
    bench.ask(0, 0.001, &outputs("payload,output_int_register_48"), b"\0\x14O\0DOUBLE,NOT_FOUND");
    bench.ask(0, 0.001, b"\0\x03S", b"\0\x04S\0\0\x1dM\x13no recipe is set up\x04RTDE\x01");
    bench.ask(0, 0.001, &outputs("timestamp,runtime_state,"), b"\0\x11O\x01DOUBLE,UINT32");
    bench.ask(0, 1.001, b"\0\x03S", b"\0\x04S\x01");
    let packages = bench.until(1.0241);
    assert_eq!(packages[0].1, [&b"\0\x10U\x01"[..], &1.008_f64.to_be_bytes(), b"\0\0\0\x01"].concat());
    assert!(packages.iter().map(|(at_s, _)| *at_s).eq([1.008, 1.016, 1.024]));
    bench.ask(0, 1.1, b"\0\x03P", b"\0\x04P\x01");
    assert!(bench.until(2.0).is_empty());
    bench.ask(0, 2.0, b"\0\x03X\0\x02", b"\0\x26M\x1cunknown or malformed package\x04RTDE\x01");
    assert_eq!(lock(&bench.links[0]).owed(&mut bench.scene, 2.0), Owed::HungUp, "a size below that of a header");
}

#[test]
fn default_list_of_a_public_client_is_accepted() {
    let names = "timestamp,target_q,target_qd,target_qdd,target_current,target_moment,actual_q,actual_qd,\
        actual_current,joint_control_output,actual_TCP_pose,actual_TCP_speed,actual_TCP_force,target_TCP_pose,\
        target_TCP_speed,actual_digital_input_bits,joint_temperatures,actual_execution_time,robot_mode,joint_mode,\
        safety_mode,actual_tool_accelerometer,speed_scaling,target_speed_fraction,actual_momentum,actual_main_voltage,\
        actual_robot_voltage,actual_robot_current,actual_joint_voltage,actual_digital_output_bits,runtime_state,\
        standard_analog_input0,standard_analog_input1,standard_analog_output0,standard_analog_output1,\
        robot_status_bits,safety_status_bits,ft_raw_wrench,payload,payload_cog,payload_inertia,output_int_register_2,\
        output_int_register_43,output_double_register_12";
    let mut bench = UrBench::new(&[], scene());
    bench.ask(0, 0.0, &[b"\0\x05V\0\x02", &outputs(names)[..], b"\0\x03S"].concat(), b"\0\x04V\x01\x01");
    assert_eq!(bench.until(0.009)[0].1.len(), 4 + 18 * 48 + 2 * 24 + 24 + 14 * 8 + 2 * 8 + 7 * 4);
}

#[test]
fn motion_ends_on_time_where_asked_and_the_slider_and_a_new_program_change_it() {
    let mut bench = UrBench::new(&[(8.25, UrFaultKind::SpeedSlider(0.5))], scene());
    // 0.1 s to the first statement, then 0.3 s for 2 mm
    bench.goes(
        1.0,
        &to_z(6.0).replace('\n', "\r\n"),
        &[(1.05, 1, 0, 8.0), (1.07, 2, 0, 8.0), (1.1, 2, 1, 8.0), (1.25, 2, 1, 7.0), (1.399, 2, 1, 6.00005)],
    );
    bench.goes(1.4, "", &[(1.405, 0, 2, 6.0), (1.42, 1, 2, 6.0)]);
    let (pose, pi) = (bench.readings(2.0)[1], std::f64::consts::PI);
    assert!(pose.iter().zip([0.299, -0.198, 0.106, pi, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{pose:?}");
    bench.ask(1, 3.0, to_z(-14.0).as_bytes(), b"");
    // 10 mm/s at 4.06 s, and 4 m/s^2
    bench.goes(4.0, &to_z(8.0), &[(4.05, 2, 1, -3.0), (4.065, 0, 1, -3.1125), (4.11, 2, 1, -3.1125), (7.0, 1, 2, 8.0)]);
    bench.goes(8.0, &to_z(6.0), &[(8.25, 2, 1, 7.0)]);
    assert!((bench.readings(8.34)[2][2] + 0.005).abs() < 1e-9);
    // twice as long as at full speed
    bench.goes(10.0, &to_z(8.0), &[(10.4, 2, 1, 7.0), (10.698, 2, 1, 7.99995), (10.702, 0, 2, 8.0)]);
    // the recipe of the slider isn't the first of ur_rtde
    let inputs = b"\0\x05V\0\x02\0\x1bItool_digital_output_mask\0\x2bIspeed_slider_mask,speed_slider_fraction,";
    bench.ask(0, 11.0, inputs, b"\0\x04V\x01\0\x09I\x01UINT8\0\x11I\x02UINT32,DOUBLE");
    bench.ask(0, 11.0, &[&b"\0\x10U\x02\0\0\0\x01"[..], &0.25_f64.to_be_bytes()].concat(), b"");
    assert_eq!(lock(&bench.robot.robot).slider, 0.25);
}

#[test]
fn what_cannot_run_moves_nothing() {
    let mut bench = UrBench::new(&[], scene());
    for (from, to) in [("def go()", "def go"), ("a=", "speed="), ("  movel(p", "  movej("), ("0.299, ", "")] {
        bench.ask(1, 1.0, to_z(6.0).replace(from, to).as_bytes(), b"");
    }
    bench.goes(4.0, &to_z(900.0), &[(4.0, 1, 0, 8.0), (5.0, 1, 1, 8.0)]);
    let ask = "def ask():\n if (not is_within_safety_limits(p[9,0,0,0,0,0])): # beside\n";
    let ask = format!("{ask}  write_output_integer_register(3, 7)\n  stopl(1)\n else:\n  sleep(9)\n end\nend\n");
    bench.goes(6.0, &ask, &[(7.0, 1, 7, 8.0)]);
}

/// A program of another client.
const TCP_10_MM_OFF: &str = "sec tool():\n set_tcp(p[0,0,0.01,0,0,0])\nend\n";

#[test]
fn another_client_sets_a_tcp_in_the_midst_of_a_program_of_ours_or_moves_the_arm() {
    let program = to_z(6.0);
    for bytes in [1, program.len() as u64 / 2, program.len() as u64] {
        let fault = UrFaultAfterBytes { bytes, kind: UrFaultKind::Other(TCP_10_MM_OFF) };
        let scene = scene();
        let robot = UrEmulator::new(UrArm { faults_after_bytes: vec![fault], ..arm(&[]) }, &scene);
        let links = [RTDE_PORT, SECONDARY_PORT, DASHBOARD_PORT].map(|port| robot.at_port(port).expect("a port"));
        let mut bench = UrBench { robot, scene, links, now_s: 0.0 };
        bench.goes(1.0, &program, &[(3.5, 1, 2, 6.0)]);
        // its TCP is at 6, so its tip is higher
        assert!((bench.scene.axis(Axis::Z, 3.5).0 - 16.0).abs() < 1e-9, "{bytes}");
    }
    let jog = "def jog():\n movel(pose_add(get_actual_tcp_pose(), p[0,0,-0.001,0,0,0]), a=1, v=0.1)\nend\n";
    let mut bench = UrBench::new(&[(1.2, UrFaultKind::Other(jog)), (5.0, UrFaultKind::Other(TCP_10_MM_OFF))], scene());
    // ours has gone 0.5 mm, brakes, and is never ended
    bench.goes(1.0, &to_z(6.0), &[(1.19, 2, 1, 7.595), (4.0, 1, 1, 6.487), (5.1, 1, 1, -3.513)]);
}

/// A program that goes by a distance from where the arm is, mm, if that is near where it is expected, mm.
fn by_z(way_mm: f64, expected_mm: f64) -> String {
    let expected = format!("p[0.299, -0.198, {}, 3.141592653589793, 0, 0]", 0.1 + expected_mm / 1000.0);
    format!(
        "def palpate():
  start = get_actual_tcp_pose()
  sum = 0
  n = 0
  while n < 25:
    sum = sum + get_actual_tcp_pose()[2]
    n = n + 1
    sync()
  end
  write_output_float_register(4, sum / n - start[2])
  off = pose_sub(get_target_tcp_pose(), {expected})
  if norm(off) > 0.00002:
    textmsg(\"um off: \", floor(norm(off) * 1000000 + 0.5))
    write_output_integer_register(3, 7)
  elif not is_within_safety_limits(start):
    write_output_integer_register(3, 8)
  else:
    movel(pose_add(start, p[0, 0, {}, 0, 0, 0]), a=0.1, v=0.01)
    write_output_integer_register(3, 2)
  end
end
",
        way_mm / 1000.0
    )
}

#[test]
fn a_program_goes_by_a_distance_and_only_from_where_it_is_expected() {
    let mut bench = UrBench::new(&[], scene());
    // 0.1 s to the first statement, 0.05 s to look, 0.3 s for 2 mm; the arm has stage steps of 1 um
    bench.goes(
        1.0,
        &by_z(-2.0, 8.0),
        &[(1.14, 2, 0, 8.0), (1.448, 2, 0, 6.0002), (1.456, 0, 2, 6.0), (2.0, 1, 2, 6.0)],
    );
    bench.goes(3.0, &by_z(-1.0, 5.9), &[(4.0, 1, 7, 6.0)]);
    assert_eq!(lock(&bench.robot.robot).messages, ["um off: 100"]);
    bench.goes(5.0, &by_z(-1.0, 6.015), &[(7.0, 1, 2, 5.0)]);
}

#[test]
fn another_tcp_moves_every_pose_and_no_way() {
    let mut bench = UrBench::new(&[], scene());
    // a secondary program changes it at once, and ends nothing
    bench.goes(1.0, &to_z(6.0), &[(1.2, 2, 1, 7.5)]);
    bench.ask(1, 1.2, b"sec tool():\n set_tcp(p[0,0,0.01,0,0,0])\n set_payload(1.5)\nend\n", b"");
    bench.ask(0, 1.2, &[b"\0\x05V\0\x02", &outputs("tcp_offset,payload")[..], b"\0\x03S"].concat(), b"\0\x04V\x01");
    let package = bench.until(1.3).remove(0).1;
    assert_eq!([&package[4 + 16..4 + 24], &package[4 + 48..]], [0.01_f64, 1.5].map(f64::to_be_bytes));
    // the tool points down
    bench.goes(3.0, "", &[(3.0, 1, 2, -4.0)]);
    assert_eq!(bench.scene.axis(Axis::Z, 3.0).0, 6.0);
    // a way is the same, a pose is another place
    bench.goes(4.0, &by_z(1.0, -4.0), &[(6.0, 1, 2, -3.0)]);
    assert!((bench.scene.axis(Axis::Z, 6.0).0 - 7.0).abs() < 1e-9);
    bench.goes(7.0, &to_z(-2.0), &[(9.0, 1, 2, -2.0)]);
    assert!((bench.scene.axis(Axis::Z, 9.0).0 - 8.0).abs() < 1e-9);
}

#[test]
fn a_program_that_makes_no_sense_ends_there() {
    let mut bench = UrBench::new(&[], scene());
    let program = |lines: &str| {
        format!("def go():\n write_output_integer_register(3, 1)\n{lines}\n write_output_integer_register(3, 9)\nend\n")
    };
    for (nth, lines) in [
        " movel(start)",
        " while True:\n end",
        " halt()",
        " x = p[1,0,0,0,0,0] + 1",
        " movel(p[0.299,-0.198,0.1,3.14,0,0], v=0)",
    ]
    .into_iter()
    .enumerate()
    {
        let from_s = 1.0 + nth as f64;
        bench.goes(from_s, &program(lines), &[(from_s + 0.9, 1, 1, 8.0)]);
    }
    // it isn't even compiled
    bench.goes(9.0, &program(" dance()"), &[(9.9, 1, 1, 8.0)]);
}

#[test]
fn protective_stop_halts_the_arm_until_it_is_unlocked_and_local_control_ignores_programs() {
    let mut bench = UrBench::new(&[(1.25, UrFaultKind::ProtectiveStop), (9.5, UrFaultKind::LocalControl)], scene());
    bench.goes(1.0, &to_z(6.0), &[(1.2505, 3, 1, 6.99625), (1.27, 4, 1, 6.995)]);
    bench.ask(2, 2.0, b"safetystatus\r\nprogramState\n", b"Safetystatus: PROTECTIVE_STOP\nPAUSED <unnamed>\n");
    bench.goes(3.0, &to_z(6.0), &[(4.0, 1, 1, 6.995)]);
    bench.ask(2, 6.2, b"unlock protective stop\n", b"Cannot unlock protective stop until 5s");
    bench.ask(2, 6.3, b"unlock protective stop\n", b"Protective stop releasing\n");
    bench.goes(7.0, &to_z(6.0), &[(7.0, 1, 1, 6.995), (9.0, 1, 2, 6.0)]);
    bench.ask(2, 9.0, b"stop\ndance\n", b"Failed to execute: stop\ncould not understand: dance\n");
    bench.goes(10.0, &to_z(8.0), &[(12.0, 1, 2, 6.0)]);
    bench.ask(2, 12.0, b"stop\n", b"Command is not allowed due to safety reasons");
}

#[test]
fn deviations_end_on_the_line_and_the_force_pushes_back() {
    let bent = [(0.5, UrFaultKind::Sideways { mm: 0.2 }), (0.5, UrFaultKind::Tilt { rad: 0.01 })];
    let mut bench = UrBench::new(&bent, scene());
    bench.goes(1.0, &to_z(6.0), &[]);
    let ends = [bench.readings(1.25), bench.readings(2.0)].map(|at| [0, 3].map(|n| at[0][n].abs() - at[1][n].abs()));
    assert!(ends.as_flattened().iter().zip([2e-4, -0.01, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-8), "{ends:?}");
    let force = UrBench::new(&[], pressed(0.5 * STIFFNESS_N_MM)).readings(1.0)[3];
    assert!((force[2] - 0.5 * STIFFNESS_N_MM).abs() < 1e-9 && force[0].abs() < 1e-9, "{force:?}");
}

#[test]
fn a_resting_pose_has_the_noise_of_a_real_arm_and_the_planned_one_has_none() {
    let scene = scene();
    let robot = UrEmulator::new(UrArm { pose_noise: UrArm::POSE_NOISE, ..UrArm::default() }, &scene);
    let links = [RTDE_PORT, SECONDARY_PORT, DASHBOARD_PORT].map(|port| robot.at_port(port).expect("a port"));
    let mut bench = UrBench { robot, scene, links, now_s: 0.0 };
    let readings: Vec<[[f64; 6]; 2]> = (0..5000)
        .map(|cycle| {
            let [pose, planned, ..] = bench.readings(f64::from(cycle) * 0.002);
            [pose, planned]
        })
        .collect();
    assert_eq!(bench.readings(9.998)[0], readings[4999][0], "the same cycle");
    let sd = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    };
    for n in 0..3 {
        let um: Vec<f64> = readings.iter().map(|[pose, planned]| 1e6 * (pose[n] - planned[n])).collect();
        let means: Vec<f64> = um.chunks(25).map(|chunk| chunk.iter().sum::<f64>() / 25.0).collect();
        let next: f64 = um.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / (um.len() as f64 * 169.0);
        let found = (sd(&um), sd(&means), next);
        assert!((12.0..14.0).contains(&found.0) && (2.2..3.0).contains(&found.1) && next.abs() < 0.05, "{found:?}");
        assert!(readings.iter().all(|[_, planned]| planned[n] == readings[0][1][n]));
    }
}

fn served(robot: &UrEmulator, port: u16, scene: &Shared<Scene>, origin: Instant) -> DuplexStream {
    let (near, far) = tokio::io::duplex(1024);
    tokio::spawn(serve(far, robot.at_port(port).expect("a port"), scene.clone(), origin));
    near
}

#[tokio::test(start_paused = true)]
async fn links_are_greeted_and_fed_and_hung_up() {
    let (scene, origin) = (shared(scene()), Instant::now());
    let robot = UrEmulator::new(arm(&[(1.0, UrFaultKind::RtdeLost), (5.0, UrFaultKind::RtdeSilent)]), &lock(&scene));
    let mut dashboard = served(&robot, DASHBOARD_PORT, &scene, origin);
    dashboard.write_all(b"quit\r\n").await.expect("open");
    let mut text = String::new();
    dashboard.read_to_string(&mut text).await.expect("an orderly end");
    assert_eq!(text, "Connected: Universal Robots Dashboard Server\nDisconnected\n");
    let start = [b"\0\x05V\0\x02", &outputs("runtime_state")[..], b"\0\x03S"].concat();
    let (mut rtde, mut stream) = (served(&robot, RTDE_PORT, &scene, origin), Vec::new());
    rtde.write_all(&start).await.expect("open");
    rtde.read_to_end(&mut stream).await.expect("an end");
    // from 8 ms on, every 8 ms until 1 s
    assert_eq!(stream.len(), 4 + 10 + 4 + 8 * 124);
    assert_eq!(served(&robot, RTDE_PORT, &scene, origin).read(&mut [0]).await.expect("an end"), 0);
    sleep(Duration::from_millis(2500)).await;
    let mut rtde = served(&robot, RTDE_PORT, &scene, origin);
    rtde.write_all(&start).await.expect("open");
    let (mut script, mut state) = (served(&robot, SECONDARY_PORT, &scene, origin), [0; 10]);
    script.read_exact(&mut state).await.expect("a state");
    assert_eq!(state, *b"\0\0\0\x34\x10\0\0\0\x2f\0");
    // a client that doesn't read the states can still send programs
    sleep(Duration::from_secs(9)).await;
    script.write_all(to_z(6.0).as_bytes()).await.expect("open");
    while timeout(Duration::from_secs(1), rtde.read_u8()).await.is_ok() {}
    assert_eq!(lock(&scene).axis(Axis::Z, 20.0).0, 6.0);
}
