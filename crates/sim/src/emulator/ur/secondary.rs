//! One link of the secondary client interface: it takes programs, and sends the state of the robot (document: "Primary
//! and Secondary Interfaces"). States that a client doesn't read are lost, and the last one before may be cut off.

use super::link::Link;
use super::robot::{EARLY_S, Robot, RobotMode, Runtime};
use super::script::take_program;
use crate::emulator::Owed;
use crate::scene::Scene;

/// Time from one state message to the next, s.
const PERIOD_S: f64 = 0.1;
/// Longest program, bytes. The end of a longer one is read as if nothing came before it.
const RECEIVED_MOST: usize = 1 << 15;
/// Type of a message with the state, and of the part that states the modes, with its length, bytes.
const ROBOT_STATE: u8 = 16;
const MODE_DATA: u8 = 0;
const MODE_DATA_LENGTH: i32 = 47;

/// One link.
pub(super) struct Secondary {
    received: Vec<u8>,
    /// Time of the next state message, s.
    next_s: Option<f64>,
}

impl Link for Secondary {
    fn open(_: &mut Robot) -> Secondary {
        Secondary { received: Vec::new(), next_s: None }
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.received.append(inbox);
        if self.received.len() > RECEIVED_MOST {
            self.received.clear();
        }
        take_program(&mut self.received)
    }

    fn answer(&mut self, request: &[u8], robot: &mut Robot, _: &mut Scene, now_s: f64) -> Vec<u8> {
        robot.receive(request, now_s);
        Vec::new()
    }

    fn owed(&mut self, robot: &mut Robot, _: &mut Scene, now_s: f64) -> Owed {
        let next_s = *self.next_s.get_or_insert(now_s + PERIOD_S);
        if next_s > now_s + EARLY_S {
            return Owed::At(next_s);
        }
        self.next_s = Some((next_s + PERIOD_S).max(now_s + PERIOD_S / 2.0));
        Owed::Pushed(state(robot, now_s))
    }
}

/// Returns a state message that has the modes only.
fn state(robot: &Robot, now_s: f64) -> Vec<u8> {
    let status = robot.safety_status().0;
    let flags = [
        true,
        true,
        robot.mode != RobotMode::PowerOff,
        status == 7,
        status == 3,
        robot.is_running(),
        robot.runtime == Runtime::Paused,
    ];
    let mut message = (5 + MODE_DATA_LENGTH).to_be_bytes().to_vec();
    message.push(ROBOT_STATE);
    message.extend(MODE_DATA_LENGTH.to_be_bytes());
    message.push(MODE_DATA);
    message.extend(((now_s * 1e6) as u64).to_be_bytes());
    message.extend(flags.map(u8::from));
    // the control mode is that of positions
    message.extend([robot.mode as u8, 0]);
    for fraction in [robot.slider, 1.0, 1.0] {
        message.extend(fraction.to_be_bytes());
    }
    message.push(0);
    message
}
