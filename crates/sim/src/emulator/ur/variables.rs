//! Variables of RTDE: names, types and values (document: "RTDE guide"). They are those that the public client ur_rtde
//! asks for. What the emulator doesn't model has a constant value: joint angles, currents, voltages, temperatures,
//! inputs and outputs.

use super::robot::Robot;
use crate::scene::Scene;
use palpate_core::quantity::Axis;

/// Joint angles of every pose, rad: the kinematics isn't modelled.
const JOINTS_RAD: [f64; 6] = [0.0, -1.3, 1.8, -2.1, -1.6, 0.0];
/// Joint mode of a joint that is running.
const JOINT_RUNS: i32 = 253;

/// What a data package is made of. The vectors are in m, rad, m/s, rad/s, N and N m, in the base frame.
pub(super) struct Readings<'a> {
    robot: &'a Robot,
    at_s: f64,
    pub pose: [f64; 6],
    pub planned_pose: [f64; 6],
    pub speed: [f64; 6],
    pub planned_speed: [f64; 6],
    pub force: [f64; 6],
}

type Read = fn(&Readings<'_>, usize) -> Vec<u8>;

/// Variable that the controller sends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Output {
    /// Name of the type.
    pub kind: &'static str,
    /// Returns the bytes of the value. Its second argument is the number of the register.
    pub read: Read,
    pub register: usize,
}

/// Names, type and reading of each variable. A `#` stands for the number of a register. `speed_scaling` is that of the
/// trajectory limiter, which doesn't act here; clients multiply it by the fraction of the slider. The bits of the
/// robot: power on, program running, teach button, power button.
const OUTPUTS: [(&str, &str, Read); 30] = [
    ("timestamp", "DOUBLE", |now, _| doubles(&[now.at_s])),
    ("actual_TCP_pose", "VECTOR6D", |now, _| doubles(&now.pose)),
    ("target_TCP_pose", "VECTOR6D", |now, _| doubles(&now.planned_pose)),
    ("actual_TCP_speed", "VECTOR6D", |now, _| doubles(&now.speed)),
    ("target_TCP_speed", "VECTOR6D", |now, _| doubles(&now.planned_speed)),
    ("actual_TCP_force ft_raw_wrench", "VECTOR6D", |now, _| doubles(&now.force)),
    ("target_speed_fraction", "DOUBLE", |now, _| doubles(&[now.robot.slider])),
    ("robot_mode", "INT32", |now, _| whole(now.robot.mode().0)),
    ("safety_mode", "INT32", |now, _| whole(now.robot.safety_status().0)),
    ("runtime_state", "UINT32", |now, _| whole(now.robot.runtime as i32)),
    ("robot_status_bits", "UINT32", |now, _| {
        whole(i32::from(now.robot.is_on) | i32::from(now.robot.is_running()) << 1)
    }),
    ("safety_status_bits", "UINT32", |now, _| whole(now.robot.safety_status().1)),
    ("output_int_register_#", "INT32", |now, register| whole(now.robot.registers[register])),
    ("target_q actual_q", "VECTOR6D", |_, _| doubles(&JOINTS_RAD)),
    ("target_qd actual_qd target_qdd target_current target_moment", "VECTOR6D", |_, _| doubles(&[0.0; 6])),
    ("actual_current joint_control_output payload_inertia", "VECTOR6D", |_, _| doubles(&[0.0; 6])),
    ("joint_temperatures", "VECTOR6D", |_, _| doubles(&[30.0; 6])),
    ("actual_joint_voltage", "VECTOR6D", |_, _| doubles(&[48.0; 6])),
    ("actual_tool_accelerometer", "VECTOR3D", |_, _| doubles(&[0.0, 0.0, 9.81])),
    ("payload_cog", "VECTOR3D", |_, _| doubles(&[0.0; 3])),
    ("speed_scaling actual_robot_current actual_execution_time", "DOUBLE", |_, _| doubles(&[1.0])),
    ("actual_main_voltage actual_robot_voltage", "DOUBLE", |_, _| doubles(&[48.0])),
    ("joint_mode", "VECTOR6INT32", |_, _| whole(JOINT_RUNS).repeat(6)),
    ("actual_digital_input_bits actual_digital_output_bits", "UINT64", |_, _| vec![0; 8]),
    ("tcp_offset", "VECTOR6D", |now, _| doubles(&now.robot.tcp)),
    ("payload", "DOUBLE", |now, _| doubles(&[now.robot.payload_kg])),
    ("output_double_register_#", "DOUBLE", |now, register| doubles(&[now.robot.float_registers[register]])),
    ("actual_momentum", "DOUBLE", |_, _| doubles(&[0.0])),
    ("standard_analog_input0 standard_analog_input1", "DOUBLE", |_, _| doubles(&[0.0])),
    ("standard_analog_output0 standard_analog_output1", "DOUBLE", |_, _| doubles(&[0.0])),
];

impl Output {
    /// Finds a variable by its name.
    pub(super) fn named(name: &str) -> Option<Output> {
        let (name, register) = numbered(name);
        let found = OUTPUTS.into_iter().find(|(names, ..)| names.split(' ').any(|known| known == name));
        found.map(|(_, kind, read)| Output { kind, read, register })
    }
}

/// Returns the type of a variable that a client sends, and its length, bytes. Only those of the speed slider have an
/// effect.
pub(super) fn input(name: &str) -> Option<(&'static str, usize)> {
    let kinds = [
        ("speed_slider_fraction input_double_register_# standard_analog_output_#", ("DOUBLE", 8)),
        ("speed_slider_mask", ("UINT32", 4)),
        ("input_int_register_#", ("INT32", 4)),
        ("standard_analog_output_mask standard_analog_output_type", ("UINT8", 1)),
        ("standard_digital_output_mask configurable_digital_output_mask tool_digital_output_mask", ("UINT8", 1)),
        ("standard_digital_output configurable_digital_output tool_digital_output", ("UINT8", 1)),
    ];
    let name = numbered(name).0;
    kinds.into_iter().find(|(names, _)| names.split(' ').any(|known| known == name)).map(|(_, kind)| kind)
}

/// Replaces the number of a register by a `#`, and returns it, too; 0 without one.
fn numbered(name: &str) -> (String, usize) {
    let digits = name.rsplit('_').next().unwrap_or("");
    let number = digits.parse().ok().filter(|number: &usize| *number < 48 && number.to_string() == digits);
    number.map_or((name.to_owned(), 0), |number| (name[..name.len() - digits.len()].to_owned() + "#", number))
}

impl Robot {
    /// Present values. `at_s` is the time that the package states.
    pub(super) fn readings(&self, at_s: f64, scene: &mut Scene, now_s: f64) -> Readings<'_> {
        let axes = Axis::ALL.map(|axis| scene.axis(axis, now_s));
        let [planned_mm_s, turning_rad_s] = self.path.speeds(now_s);
        let speed = |stage_mm_s| six(self.arm.along(stage_mm_s).map(|mm_s| mm_s / 1000.0), turning_rad_s);
        Readings {
            robot: self,
            at_s,
            pose: self.actual_pose(scene, now_s),
            planned_pose: self.target_pose(now_s),
            speed: speed(axes.map(|(_, speed_mm_s)| speed_mm_s)),
            planned_speed: speed(planned_mm_s),
            force: six(self.arm.reported_n(scene.true_force_n(now_s), now_s), [0.0; 3]),
        }
    }
}

fn six([a, b, c]: [f64; 3], [d, e, f]: [f64; 3]) -> [f64; 6] {
    [a, b, c, d, e, f]
}

fn doubles(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_be_bytes()).collect()
}

fn whole(value: i32) -> Vec<u8> {
    value.to_be_bytes().to_vec()
}
