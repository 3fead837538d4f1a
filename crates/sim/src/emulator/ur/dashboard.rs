//! One link of the dashboard (document: "Dashboard Server e-Series").

use super::robot::{Robot, Runtime};
use super::{Link, VERSION, VERSION_DATE};
use crate::emulator::Owed;
use crate::scene::Scene;

/// First line on a link.
const GREETING: &str = "Connected: Universal Robots Dashboard Server\n";
/// Answer of a robot in local control to commands that only one in remote control carries out.
const NOT_REMOTE: &str = "Command is not allowed due to safety reasons, please switch robot to Remote Control mode and \
    reconnect to port 29999";
/// Answer to an unlocking that is too early.
const STILL_LOCKED: &str = "Cannot unlock protective stop until 5s after occurrence. \
    Always inspect cause of protective stop before unlocking";

/// One link.
#[derive(Default)]
pub(super) struct Dashboard {
    greeted: bool,
    quits: bool,
}

impl Link for Dashboard {
    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        let end = inbox.iter().position(|&byte| byte == b'\n').filter(|_| !self.quits)?;
        Some(inbox.drain(..=end).collect())
    }

    fn answer(&mut self, request: &[u8], robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let line = String::from_utf8_lossy(request);
        let command = line.trim();
        self.quits = command == "quit";
        reply(command, robot, scene, now_s).into_bytes().into_iter().chain([b'\n']).collect()
    }

    fn owed(&mut self, _: &Robot, _: &mut Scene, _: f64) -> Owed {
        match (self.quits, std::mem::replace(&mut self.greeted, true)) {
            (true, _) => Owed::HungUp,
            (false, true) => Owed::Nothing,
            (false, false) => Owed::Ready(GREETING.into()),
        }
    }
}

fn reply(command: &str, robot: &mut Robot, scene: &mut Scene, now_s: f64) -> String {
    let [major, minor, fix, build] = VERSION;
    match command {
        "robotmode" => format!("Robotmode: {}", robot.mode().1),
        "safetymode" => format!("Safetymode: {}", robot.safety_status().2),
        "safetystatus" => format!("Safetystatus: {}", robot.safety_status().2),
        "running" => format!("Program running: {}", robot.is_running()),
        "programState" => format!("{} <unnamed>", program(robot)),
        "PolyscopeVersion" => format!("URSoftware {major}.{minor}.{fix}.{build} ({VERSION_DATE})"),
        "version" => format!("{major}.{minor}.{fix}.{build}"),
        // the answer lacks the letter of the series
        "get robot model" => robot.arm.model.trim_end_matches('e').into(),
        "get serial number" => robot.arm.serial.clone(),
        "is in remote control" => robot.is_remote.to_string(),
        "stop" | "unlock protective stop" if !robot.is_remote => NOT_REMOTE.into(),
        "stop" if robot.stop(scene, now_s) => "Stopped".into(),
        "stop" => "Failed to execute: stop".into(),
        "unlock protective stop" if robot.unlock(now_s) => "Protective stop releasing".into(),
        "unlock protective stop" => STILL_LOCKED.into(),
        "close popup" => "closing popup".into(),
        "close safety popup" => "closing safety popup".into(),
        "quit" => "Disconnected".into(),
        _ => format!("could not understand: {command}"),
    }
}

fn program(robot: &Robot) -> &'static str {
    match robot.runtime {
        Runtime::Stopped | Runtime::Stopping => "STOPPED",
        Runtime::Playing => "PLAYING",
        Runtime::Pausing | Runtime::Paused => "PAUSED",
    }
}
