//! One link of the secondary client interface: it takes programs, and sends the state of the robot (document: "Primary
//! and Secondary Interfaces"). States that a client doesn't read are lost, and the last one before may be cut off.

use super::Link;
use super::robot::{EARLY_S, Robot, Runtime};
use super::script::{read_program, take_program};
use crate::emulator::Owed;
use crate::scene::Scene;

/// Time from one state message to the next, s.
const PERIOD_S: f64 = 0.1;
/// Longest program, bytes. The end of a longer one is read as if nothing came before it.
const RECEIVED_MOST: usize = 1 << 15;
/// Time from the last byte of a program until it is compiled, s.
const COMPILE_S: f64 = 0.06;
/// Begin of a state message: its length, bytes, its type (16: state), and the length, bytes, and type (0: modes) of its
/// only part.
const HEADER: [u8; 10] = *b"\0\0\0\x34\x10\0\0\0\x2f\0";

/// One link.
#[derive(Default)]
pub(super) struct Secondary {
    received: Vec<u8>,
    /// Time of the next state message, s.
    next_s: Option<f64>,
}

impl Link for Secondary {
    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.received.append(inbox);
        if self.received.len() > RECEIVED_MOST {
            self.received.clear();
        }
        take_program(&mut self.received)
    }

    /// Takes a program. A robot in local control ignores it, and any robot one that it can't read.
    fn answer(&mut self, request: &[u8], robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Vec<u8> {
        if let Some(program) = read_program(request).filter(|_| robot.is_remote) {
            robot.take(program, now_s + COMPILE_S, scene, now_s);
        }
        Vec::new()
    }

    fn owed(&mut self, robot: &Robot, _: &mut Scene, now_s: f64) -> Owed {
        let next_s = *self.next_s.get_or_insert(now_s + PERIOD_S);
        if next_s > now_s + EARLY_S {
            return Owed::At(next_s);
        }
        self.next_s = Some((next_s + PERIOD_S).max(now_s + PERIOD_S / 2.0));
        Owed::Pushed(state(robot, now_s))
    }
}

/// Returns a state message that has the modes only. Its flags: connected, real, powered, emergency stop, protective
/// stop, program running, program paused.
fn state(robot: &Robot, now_s: f64) -> Vec<u8> {
    let (status, is_paused) = (robot.safety_status().0, robot.runtime == Runtime::Paused);
    let flags = [true, true, robot.is_on, status == 7, status == 3, robot.is_running(), is_paused];
    let mut message = HEADER.to_vec();
    message.extend(((now_s * 1e6) as u64).to_be_bytes());
    message.extend(flags.map(u8::from));
    // the control mode is that of positions
    message.extend([robot.mode().0 as u8, 0]);
    message.extend([robot.slider, 1.0, 1.0].map(f64::to_be_bytes).as_flattened());
    message.push(0);
    message
}
