//! The driver of an arm against answers from a script. The bytes are written by hand from the RTDE guide.

use super::{RobotLinks, RobotSettings, TaughtFrame, Ur};
use crate::script::usage;
use palpate_core::quantity::Axis;
use palpate_link::device::{AxisWay, MotionOrders, Stage};
use palpate_link::wire::Connector;
use std::f64::consts::PI;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};

/// An arm that follows its programs at once: where its tip is, mm in the stage's frame, and what it received.
#[derive(Clone)]
struct FakeArm {
    at_mm: [f64; 3],
    rotation_rad: [f64; 3],
    force_n: f64,
    pace: f64,
    safety_mode: i32,
    runtime: u32,
    begun: i32,
    ended: i32,
    outside: i32,
    programs: Vec<String>,
    /// Whether it carries programs out.
    obeys: bool,
    /// How far it is off its way while it moves, mm, and by how much its force then rises, N.
    off_mm: f64,
    rise_n: f64,
    remote: &'static str,
    /// Whether its programs end after they began.
    is_cut: bool,
}

/// Zero of the stage's axes in the base, mm; its axes are those of the base.
const ORIGIN_MM: [f64; 3] = [300.0, -200.0, 100.0];
const TOOL_RAD: [f64; 3] = [0.0, PI, 0.0];

impl Default for FakeArm {
    fn default() -> Self {
        FakeArm {
            at_mm: [0.0, 0.0, 2.0],
            rotation_rad: TOOL_RAD,
            force_n: 3.0,
            pace: 1.0,
            safety_mode: 1,
            runtime: 1,
            begun: 4,
            ended: 4,
            outside: 0,
            programs: Vec::new(),
            obeys: true,
            off_mm: 0.0,
            rise_n: 0.0,
            remote: "true",
            is_cut: false,
        }
    }
}

impl FakeArm {
    fn package(&self) -> Vec<u8> {
        let mut bytes = vec![0, 188, b'U', 7];
        let pose = (0..3).map(|axis| (ORIGIN_MM[axis] + self.at_mm[axis]) / 1000.0).chain(self.rotation_rad);
        let force = [0.0, 0.0, self.force_n, 0.0, 0.0, 0.0];
        for number in pose.chain([0.0; 6]).chain(force).chain([self.pace, 1.0]) {
            bytes.extend(number.to_be_bytes());
        }
        for number in [7, self.safety_mode, self.runtime as i32, self.begun, self.ended, self.outside] {
            bytes.extend(number.to_be_bytes());
        }
        bytes
    }

    /// Carries out a program: a motion ends at once.
    fn run(&mut self, program: &str) {
        self.programs.push(program.to_owned());
        if !self.obeys {
            return;
        }
        let number = |text: &str| text.trim_matches(|c: char| !c.is_ascii_digit()).parse().unwrap();
        let numbers: Vec<i32> = program
            .lines()
            .filter_map(|line| line.split_once("_register(40, ").map(|(_, rest)| number(rest)))
            .collect();
        self.begun = numbers[0];
        if self.is_cut {
            return;
        }
        self.ended = numbers[0];
        let pose_in = |rest: &str| -> Vec<f64> {
            rest.split(']').next().unwrap().split(',').map(|each| each.parse().unwrap()).collect()
        };
        // the first motion from where the program expects the tool, the one after `else` from anywhere else
        let (_, condition) = program.split_once("point_dist(get_target_tcp_pose(), p[").unwrap_or_default();
        let branch = if condition.is_empty() {
            ""
        } else {
            let (from, most) = (pose_in(condition), condition.split_once(") < ").unwrap().1);
            let most_mm = 1000.0 * most.split(')').next().unwrap().parse::<f64>().unwrap();
            let off: [f64; 3] = std::array::from_fn(|axis| 1000.0 * from[axis] - ORIGIN_MM[axis] - self.at_mm[axis]);
            let is_there = super::frame::length(off) < most_mm;
            let (there, elsewhere) = condition.split_once("else:").unwrap_or((condition, ""));
            if is_there { there } else { elsewhere }
        };
        if let Some((motion, rest)) = branch.split_once("movel(").and_then(|(_, motion)| motion.split_once("p[")) {
            let pose = pose_in(rest);
            let zero_mm = match motion {
                "" => ORIGIN_MM.map(|mm| -mm),
                "pose_add(get_target_tcp_pose(), " => self.at_mm,
                other => panic!("{other}"),
            };
            self.at_mm = std::array::from_fn(|axis| 1000.0 * pose[axis] + zero_mm[axis]);
            self.at_mm[0] += self.off_mm;
            self.force_n += self.rise_n;
        }
    }
}

type Arm = Arc<Mutex<FakeArm>>;
type Change = fn(&mut FakeArm);

fn served(arm: &Arm, serve: impl AsyncFnOnce(Arm, DuplexStream) + Copy + Send + Sync + 'static) -> Connector {
    let arm = arm.clone();
    Connector::in_memory(move || {
        let (near, far) = duplex(4096);
        let arm = arm.clone();
        tokio::task::spawn_local(async move { serve(arm, far).await });
        near
    })
}

/// RTDE: a package in each 8 ms while it is started.
async fn rtde(arm: Arm, mut far: DuplexStream) {
    let mut is_started = false;
    loop {
        let mut head = [0; 3];
        let heard = tokio::time::timeout(Duration::from_millis(8), far.read_exact(&mut head)).await;
        match heard {
            Err(_) if is_started => {
                let package = arm.lock().unwrap().package();
                if far.write_all(&package).await.is_err() {
                    return;
                }
            }
            Err(_) => {}
            Ok(Err(_)) => return,
            Ok(Ok(_)) => {
                let mut rest = vec![0; usize::from(u16::from_be_bytes([head[0], head[1]])) - 3];
                far.read_exact(&mut rest).await.unwrap();
                let answer: &[u8] = match head[2] {
                    b'V' => {
                        assert_eq!(rest, [0, 2]);
                        b"\x00\x04V\x01"
                    }
                    b'O' => {
                        assert_eq!(rest[..8], 500f64.to_be_bytes());
                        assert!(rest[8..].starts_with(b"actual_TCP_pose,actual_TCP_speed,actual_TCP_force,"));
                        b"\x00\x51O\x07VECTOR6D,VECTOR6D,VECTOR6D,DOUBLE,DOUBLE,INT32,INT32,UINT32,INT32,INT32,INT32"
                    }
                    b'S' => {
                        is_started = true;
                        b"\x00\x04S\x01"
                    }
                    b'P' => {
                        is_started = false;
                        b"\x00\x04P\x01"
                    }
                    other => panic!("package {other}"),
                };
                far.write_all(answer).await.unwrap();
            }
        }
    }
}

async fn programs(arm: Arm, mut far: DuplexStream) {
    let mut text = String::new();
    let mut chunk = [0; 4096];
    while let Ok(count @ 1..) = far.read(&mut chunk).await {
        text += std::str::from_utf8(&chunk[..count]).unwrap();
        if text.ends_with("\nend\n") {
            arm.lock().unwrap().run(&std::mem::take(&mut text));
        }
    }
}

async fn dashboard(arm: Arm, mut far: DuplexStream) {
    far.write_all(b"Connected: Universal Robots Dashboard Server\n").await.unwrap();
    let remote = arm.lock().unwrap().remote;
    let answers = [
        ("get robot model\n", "UR5\n"),
        ("get serial number\n", "20195599999\n"),
        ("PolyscopeVersion\n", "URSoftware 5.11.0.108249 (Apr 21 2021)\n"),
        ("is in remote control\n", remote),
    ];
    for (question, answer) in answers {
        let mut heard = vec![0; question.len()];
        far.read_exact(&mut heard).await.unwrap();
        assert_eq!(heard, question.as_bytes());
        far.write_all(answer.as_bytes()).await.unwrap();
        if !answer.ends_with('\n') {
            far.write_all(b"\n").await.unwrap();
        }
    }
}

fn robot(arm: &Arm) -> Ur {
    let points_mm = [ORIGIN_MM, [400.0, -200.0, 100.0], [300.0, -100.0, 100.0]];
    let frame = TaughtFrame::new(points_mm, TOOL_RAD).unwrap();
    let links =
        RobotLinks { rtde: served(arm, rtde), programs: served(arm, programs), dashboard: served(arm, dashboard) };
    Ur::new(
        links,
        RobotSettings { frame, path_error_mm: 0.1, guard_n: 10.0, model: "UR5e".to_owned() },
        "script".to_owned(),
    )
}

/// Tests an arm that has been identified and homed, with no orders.
async fn with_arm(first: FakeArm, test: impl AsyncFnOnce(&Arm, &mut Ur, &MotionOrders)) {
    let local = tokio::task::LocalSet::new();
    let run = async {
        let arm = Arc::new(Mutex::new(first));
        let mut stage = robot(&arm);
        let identity = stage.identify(&usage()).await.unwrap();
        assert!(identity.identity.starts_with("UR5 20195599999, URSoftware 5.11.0.108249 (Apr 21 2021), frame "));
        stage.home(&usage(), &MotionOrders::default()).await.unwrap();
        test(&arm, &mut stage, &MotionOrders::default()).await;
    };
    local.run_until(run).await;
}

async fn moved(stage: &mut Ur, targets: &[(Axis, f64)], orders: &MotionOrders) -> Result<Vec<f64>, String> {
    let axes: Vec<Axis> = targets.iter().map(|(axis, _)| *axis).collect();
    let mut ways = Vec::new();
    for (axis, to_mm) in targets {
        let from_mm = stage.position_mm(*axis, orders).await.map_err(|error| error.to_string())?;
        ways.push(AxisWay::between(*axis, from_mm, *to_mm));
    }
    let begun = stage.begin(&ways, 2.0, orders).await;
    begun.map_err(|error| error.to_string())?;
    let ended = stage.follow(&axes, Duration::from_secs(1), orders).await;
    ended.map_err(|error| error.to_string())
}

#[tokio::test(start_paused = true)]
async fn each_motion_is_one_program_with_one_straight_line() {
    with_arm(FakeArm::default(), async |arm, stage, orders| {
        assert_eq!(moved(stage, &[(Axis::Z, -1.0)], orders).await.unwrap(), [-1.0]);
        let at_mm = moved(stage, &[(Axis::X, 3.0), (Axis::Y, 4.0)], orders).await.unwrap();
        assert!((at_mm[0] - 3.0).abs() < 1e-9 && (at_mm[1] - 4.0).abs() < 1e-9);
        let programs = arm.lock().unwrap().programs.clone();
        assert!(programs[0].contains("is_within_safety_limits(p[") && !programs[0].contains("movel"));
        let motion = "def palpate():\n  if (read_output_integer_register(40) < 6):\n  write_output_integer_register(40, 6)\n  \
                      if (point_dist(get_target_tcp_pose(), p[0.3000000,-0.2000000,0.1020000,0.000000,3.141593,0.000000]) < 0.000100):\n  \
                      movel(p[0.3000000,-0.2000000,0.0990000,0.000000,3.141593,0.000000], a=0.100000, v=0.002000)\n  end\n  \
                      write_output_integer_register(41, 6)\n  end\nend\n";
        assert_eq!(programs[1], motion);
        // along the diagonal, so that neither axis is faster than 2 mm/s
        assert!(programs[2].contains("a=0.125000, v=0.002500"), "{}", programs[2]);
        assert_eq!(moved(stage, &[(Axis::X, 3.0)], orders).await.unwrap().len(), 1);
        assert_eq!(arm.lock().unwrap().programs.len(), 3, "no way, no program");
    })
    .await;
}

#[tokio::test(start_paused = true)]
async fn what_prevents_a_motion_is_named() {
    let cases: [(Change, &str); 5] = [
        (|arm| arm.safety_mode = 3, "palpate never unlocks it"),
        (|arm| arm.pace = 0.0, "its speed slider is at 0 %"),
        (|arm| arm.rotation_rad = [0.0, PI - 0.02, 0.0], "its tool is tilted by 1.15 degrees"),
        (|arm| arm.at_mm[0] = 0.2, "its tool is 0.200 mm from where it came to rest"),
        (|arm| arm.obeys = false, "it doesn't begin a program: is it in remote control"),
    ];
    for (change, expected) in cases {
        with_arm(FakeArm::default(), async |arm, stage, orders| {
            change(&mut arm.lock().unwrap());
            let refused = moved(stage, &[(Axis::Z, -1.0)], orders).await.unwrap_err();
            assert!(refused.contains(expected), "{refused}");
        })
        .await;
    }
}

#[tokio::test(start_paused = true)]
async fn an_arm_off_its_way_or_that_feels_too_much_is_stopped() {
    let cases: [(Change, &str); 2] = [
        (|arm| arm.off_mm = 0.15, "its tool is 0.150 mm off its straight way"),
        (|arm| arm.rise_n = 11.0, "the robot's own force changed by 11.0 N in one motion, over 10.0 N"),
    ];
    for (change, expected) in cases {
        with_arm(FakeArm::default(), async |arm, stage, orders| {
            change(&mut arm.lock().unwrap());
            let refused = moved(stage, &[(Axis::Z, -1.0)], orders).await.unwrap_err();
            assert!(refused.contains(expected), "{refused}");
            let last = arm.lock().unwrap().programs.last().cloned().unwrap();
            assert!(last.contains("stopl(0.100000)"), "{last}");
            // the way out is open: it begins where it came to rest, and what was wrong stays so
            assert_eq!(moved(stage, &[(Axis::Z, 3.0)], orders).await.unwrap(), [3.0]);
            (arm.lock().unwrap().off_mm, arm.lock().unwrap().rise_n) = (0.0, 0.0);
        })
        .await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_stop_replaces_the_program_and_its_end_is_awaited() {
    with_arm(FakeArm::default(), async |arm, stage, _| {
        let orders = MotionOrders::default();
        arm.lock().unwrap().obeys = false;
        let way = [AxisWay::between(Axis::Z, 2.0, -1.0)];
        let begin = stage.begin(&way, 2.0, &orders);
        let stop = async {
            tokio::time::sleep(Duration::from_millis(100)).await;
            arm.lock().unwrap().obeys = true;
            orders.stop();
        };
        tokio::join!(begin, stop).0.unwrap();
        let at_mm = stage.follow(&[Axis::Z], Duration::from_secs(1), &orders).await.unwrap();
        assert!((at_mm[0] - 2.0).abs() < 1e-9, "it never moved: {at_mm:?}");
        let programs = arm.lock().unwrap().programs.clone();
        assert!(programs[programs.len() - 1].contains("write_output_integer_register(40, 7)\n  stopl(0.100000)"));
    })
    .await;
}

#[tokio::test(start_paused = true)]
async fn a_robot_that_may_not_be_used_is_refused_before_anything_moves() {
    let cases: [(Change, &str); 6] = [
        (|arm| arm.pace = f64::NAN, "a number that isn't finite"),
        (|arm| arm.remote = "false", "it is in local control"),
        (|arm| arm.runtime = 2, "a program runs on it"),
        (|arm| arm.safety_mode = 7, "its safety mode is 7"),
        (|arm| arm.at_mm[2] = 20.0, "z is at 20.000 mm, outside"),
        (|arm| (arm.outside, arm.at_mm[2]) = (2, 2.0), "can't reach x = 12.5, y = -12.5, z = -12.5 mm"),
    ];
    for (change, expected) in cases {
        let run = async {
            let mut first = FakeArm::default();
            change(&mut first);
            let arm = Arc::new(Mutex::new(first));
            let mut stage = robot(&arm);
            let refused = crate::script::made_ready(&mut stage, &usage(), &MotionOrders::default()).await;
            let refused = refused.unwrap_err().to_string();
            assert!(refused.contains(expected), "{refused}");
            assert!(arm.lock().unwrap().programs.iter().all(|program| !program.contains("movel")));
        };
        tokio::task::LocalSet::new().run_until(run).await;
    }
}

/// The tip isn't where it was sent, because the arm gives way: the way out goes straight from there.
#[tokio::test(start_paused = true)]
async fn the_way_out_begins_where_the_tip_is() {
    with_arm(FakeArm::default(), async |arm, stage, orders| {
        arm.lock().unwrap().at_mm[0] = 0.4;
        assert_eq!(moved(stage, &[(Axis::Z, 3.0)], orders).await.unwrap(), [3.0]);
        assert!((arm.lock().unwrap().at_mm[0] - 0.4).abs() < 1e-9, "nothing moved sideways");
    })
    .await;
}

/// A late program after another one does nothing, and one that somebody ended isn't awaited.
#[tokio::test(start_paused = true)]
async fn a_program_that_somebody_ended_is_named_at_once() {
    with_arm(FakeArm::default(), async |arm, stage, orders| {
        let begun = tokio::time::Instant::now();
        arm.lock().unwrap().is_cut = true;
        let refused = moved(stage, &[(Axis::X, 1.0)], orders).await.unwrap_err();
        assert!(refused.contains("its program was ended by somebody else"), "{refused}");
        assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
    })
    .await;
}
