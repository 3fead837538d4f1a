//! Variables of RTDE: names, types and values (document: "RTDE guide"). Names are resolved once, when a recipe is set
//! up.
//!
//! What the emulator doesn't model has a constant value: joint angles, currents, voltages and temperatures.

use super::readings::Readings;
use super::robot::{Robot, RobotMode};

/// Joint angles of every pose, rad: the kinematics isn't modelled.
const JOINTS_RAD: [f64; 6] = [0.0, -1.3, 1.8, -2.1, -1.6, 0.0];
/// Joint mode of a joint that is running.
const JOINT_RUNS: i32 = 253;

/// Variable that the controller sends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Output {
    Timestamp,
    Pose,
    PlannedPose,
    Speed,
    PlannedSpeed,
    Force,
    ForceSize,
    SpeedFraction,
    RobotMode,
    Safety,
    SafetyBits,
    RobotBits,
    Runtime,
    TcpOffset,
    Payload,
    CentreOfGravity,
    DigitalOutputs,
    Integer(usize),
    Double(usize),
    Bit(usize),
    /// 32 bits from this one on.
    Bits(usize),
    JointModes,
    /// Values that stay: a number or a vector.
    Fixed(&'static [f64]),
    FixedSigned,
    FixedUnsigned,
    FixedLong,
}

/// Variables whose values are modelled.
const OUTPUTS: [(&str, Output); 21] = [
    ("timestamp", Output::Timestamp),
    ("actual_TCP_pose", Output::Pose),
    ("target_TCP_pose", Output::PlannedPose),
    ("actual_TCP_speed", Output::Speed),
    ("target_TCP_speed", Output::PlannedSpeed),
    ("actual_TCP_force", Output::Force),
    ("ft_raw_wrench", Output::Force),
    ("tcp_force_scalar", Output::ForceSize),
    ("target_speed_fraction", Output::SpeedFraction),
    ("robot_mode", Output::RobotMode),
    ("safety_mode", Output::Safety),
    ("safety_status", Output::Safety),
    ("safety_status_bits", Output::SafetyBits),
    ("robot_status_bits", Output::RobotBits),
    ("runtime_state", Output::Runtime),
    ("tcp_offset", Output::TcpOffset),
    ("payload", Output::Payload),
    ("payload_cog", Output::CentreOfGravity),
    ("actual_digital_output_bits", Output::DigitalOutputs),
    ("output_bit_registers0_to_31", Output::Bits(0)),
    ("output_bit_registers32_to_63", Output::Bits(32)),
];

/// Variables whose values stay. `speed_scaling` is that of the trajectory limiter, which doesn't act here; clients
/// multiply it by the fraction of the slider.
const FIXED_OUTPUTS: [(&str, Output); 15] = [
    ("target_q actual_q", Output::Fixed(&JOINTS_RAD)),
    ("target_qd actual_qd target_qdd target_current actual_current target_moment", Output::Fixed(&[0.0; 6])),
    ("joint_control_output payload_inertia", Output::Fixed(&[0.0; 6])),
    ("actual_current_window", Output::Fixed(&[0.5; 6])),
    ("joint_temperatures", Output::Fixed(&[30.0; 6])),
    ("actual_joint_voltage", Output::Fixed(&[48.0; 6])),
    ("joint_mode", Output::JointModes),
    ("actual_tool_accelerometer", Output::Fixed(&[0.0, 0.0, 9.81])),
    ("elbow_position elbow_velocity", Output::Fixed(&[0.0; 3])),
    ("speed_scaling actual_robot_current actual_execution_time", Output::Fixed(&[1.0])),
    ("actual_main_voltage actual_robot_voltage tool_temperature", Output::Fixed(&[48.0])),
    (
        "standard_analog_input0 standard_analog_input1 standard_analog_output0 standard_analog_output1 io_current \
        tool_analog_input0 tool_analog_input1 tool_output_current actual_momentum collision_detection_ratio",
        Output::Fixed(&[0.0]),
    ),
    ("tool_output_voltage", Output::FixedSigned),
    ("analog_io_types tool_mode tool_analog_input_types script_control_line", Output::FixedUnsigned),
    ("actual_digital_input_bits", Output::FixedLong),
];

impl Output {
    /// Finds a variable by its name.
    pub(super) fn named(name: &str) -> Option<Output> {
        let register = |prefix: &str, count: usize| numbered(name, prefix, 0..count);
        OUTPUTS
            .iter()
            .chain(&FIXED_OUTPUTS)
            .find(|(names, _)| names.split(' ').any(|known| known == name))
            .map(|&(_, output)| output)
            .or_else(|| register("output_int_register_", 48).map(Output::Integer))
            .or_else(|| register("output_double_register_", 48).map(Output::Double))
            .or_else(|| register("output_bit_register_", 128).map(Output::Bit))
    }

    /// Name of the type.
    pub(super) fn kind(self) -> &'static str {
        match self {
            Output::Pose | Output::PlannedPose | Output::Speed | Output::PlannedSpeed => "VECTOR6D",
            Output::Force | Output::TcpOffset => "VECTOR6D",
            Output::CentreOfGravity => "VECTOR3D",
            Output::Fixed(values) => match values.len() {
                6 => "VECTOR6D",
                3 => "VECTOR3D",
                _ => "DOUBLE",
            },
            Output::Timestamp | Output::ForceSize | Output::SpeedFraction => "DOUBLE",
            Output::Payload | Output::Double(_) => "DOUBLE",
            Output::RobotMode | Output::Safety | Output::Integer(_) | Output::FixedSigned => "INT32",
            Output::SafetyBits | Output::RobotBits | Output::Runtime => "UINT32",
            Output::Bits(_) | Output::FixedUnsigned => "UINT32",
            Output::DigitalOutputs | Output::FixedLong => "UINT64",
            Output::Bit(_) => "BOOL",
            Output::JointModes => "VECTOR6INT32",
        }
    }

    /// Appends the value.
    pub(super) fn write(self, robot: &Robot, readings: &Readings, at_s: f64, package: &mut Vec<u8>) {
        let (bits, force) = (robot.registers.bits, &readings.force);
        match self {
            Output::Timestamp => doubles(&[at_s], package),
            Output::Pose => doubles(&readings.pose, package),
            Output::PlannedPose => doubles(&readings.planned_pose, package),
            Output::Speed => doubles(&readings.speed, package),
            Output::PlannedSpeed => doubles(&readings.planned_speed, package),
            Output::Force => doubles(force, package),
            Output::ForceSize => doubles(&[force[..3].iter().map(|n| n * n).sum::<f64>().sqrt()], package),
            Output::SpeedFraction => doubles(&[robot.slider], package),
            Output::TcpOffset => doubles(&robot.tcp, package),
            Output::Payload => doubles(&[robot.payload_kg], package),
            Output::CentreOfGravity => doubles(&robot.cog_m, package),
            Output::Double(n) => doubles(&[robot.registers.doubles[n]], package),
            Output::Fixed(values) => doubles(values, package),
            Output::RobotMode => package.extend((robot.mode as i32).to_be_bytes()),
            Output::Safety => package.extend(robot.safety_status().0.to_be_bytes()),
            Output::SafetyBits => package.extend(safety_bits(robot).to_be_bytes()),
            Output::RobotBits => package.extend(robot_bits(robot).to_be_bytes()),
            Output::Runtime => package.extend((robot.runtime as u32).to_be_bytes()),
            Output::Integer(n) => package.extend(robot.registers.integers[n].to_be_bytes()),
            Output::Bit(n) => package.push((bits >> n & 1) as u8),
            Output::Bits(from) => package.extend(((bits >> from) as u32).to_be_bytes()),
            Output::DigitalOutputs => package.extend(robot.digital_outputs.to_be_bytes()),
            Output::JointModes => (0..6).for_each(|_| package.extend(JOINT_RUNS.to_be_bytes())),
            Output::FixedSigned | Output::FixedUnsigned => package.extend([0; 4]),
            Output::FixedLong => package.extend([0; 8]),
        }
    }
}

/// Variable that a client sends. Those that nothing here reads are accepted and have no effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Input {
    SliderMask,
    SliderFraction,
    /// Mask of eight digital outputs from this one on, and their values.
    OutputMask(u8),
    OutputBits(u8),
    /// A variable with this name in `OTHER_INPUTS`.
    Other(usize),
    Integer(usize),
    Double(usize),
    Bit(usize),
}

/// Inputs without an effect here, and their types.
const OTHER_INPUTS: [(&str, &str); 9] = [
    ("input_bit_registers0_to_31", "UINT32"),
    ("input_bit_registers32_to_63", "UINT32"),
    ("standard_analog_output_mask", "UINT8"),
    ("standard_analog_output_type", "UINT8"),
    ("standard_analog_output_0", "DOUBLE"),
    ("standard_analog_output_1", "DOUBLE"),
    ("external_force_torque", "VECTOR6D"),
    ("tool_digital_output_mask", "UINT8"),
    ("tool_digital_output", "UINT8"),
];

impl Input {
    /// Finds a variable by its name.
    pub(super) fn named(name: &str) -> Option<Input> {
        match name {
            "speed_slider_mask" => return Some(Input::SliderMask),
            "speed_slider_fraction" => return Some(Input::SliderFraction),
            "standard_digital_output_mask" => return Some(Input::OutputMask(0)),
            "standard_digital_output" => return Some(Input::OutputBits(0)),
            "configurable_digital_output_mask" => return Some(Input::OutputMask(8)),
            "configurable_digital_output" => return Some(Input::OutputBits(8)),
            _ => {}
        }
        let other = OTHER_INPUTS.iter().position(|(known, _)| *known == name).map(Input::Other);
        other
            .or_else(|| numbered(name, "input_int_register_", 0..48).map(Input::Integer))
            .or_else(|| numbered(name, "input_double_register_", 0..48).map(Input::Double))
            .or_else(|| numbered(name, "input_bit_register_", 64..128).map(Input::Bit))
    }

    /// Name of the type, and its length, bytes.
    pub(super) fn kind(self) -> (&'static str, usize) {
        match self {
            Input::SliderMask => ("UINT32", 4),
            Input::SliderFraction | Input::Double(_) => ("DOUBLE", 8),
            Input::OutputMask(_) | Input::OutputBits(_) => ("UINT8", 1),
            Input::Integer(_) => ("INT32", 4),
            Input::Bit(_) => ("BOOL", 1),
            Input::Other(n) => match OTHER_INPUTS[n].1 {
                kind @ "UINT8" => (kind, 1),
                kind @ "UINT32" => (kind, 4),
                kind @ "VECTOR6D" => (kind, 48),
                kind => (kind, 8),
            },
        }
    }
}

/// Number of a register whose name has this prefix.
fn numbered(name: &str, prefix: &str, range: std::ops::Range<usize>) -> Option<usize> {
    let number = name.strip_prefix(prefix)?;
    let value = number.parse().ok().filter(|value| range.contains(value))?;
    (number == value.to_string()).then_some(value)
}

fn doubles(values: &[f64], package: &mut Vec<u8>) {
    values.iter().for_each(|value| package.extend(value.to_be_bytes()));
}

/// Bits: normal, reduced, protective stop, recovery, safeguard stop, emergency stop of the system, of the robot, of
/// any, violation, fault, stopped due to safety.
fn safety_bits(robot: &Robot) -> u32 {
    match robot.safety_status().0 {
        1 => 1,
        3 => 1 << 2 | 1 << 10,
        _ => 1 << 6 | 1 << 7 | 1 << 10,
    }
}

/// Bits: power on, program running, teach button, power button.
fn robot_bits(robot: &Robot) -> u32 {
    u32::from(robot.mode != RobotMode::PowerOff) | u32::from(robot.is_running()) << 1
}
