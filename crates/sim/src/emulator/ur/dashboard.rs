//! One link of the dashboard (document: "Dashboard Server e-Series").

use super::link::Link;
use super::robot::{Robot, RobotMode, Runtime};
use super::{VERSION, VERSION_DATE};
use crate::emulator::Owed;
use crate::scene::Scene;

/// First line on a link.
const GREETING: &str = "Connected: Universal Robots Dashboard Server\n";
/// Longest line, bytes.
const LINE_MOST: usize = 4096;
/// Commands that only a robot in remote control carries out, and its answer in local control.
const REMOTE_ONLY: [&str; 7] =
    ["play", "stop", "pause", "power on", "power off", "brake release", "unlock protective stop"];
const NOT_REMOTE: &str = "Command is not allowed due to safety reasons, please switch robot to Remote Control mode and \
    reconnect to port 29999";
/// Answer to an unlocking that is too early.
const STILL_LOCKED: &str = "Cannot unlock protective stop until 5s after occurrence. \
    Always inspect cause of protective stop before unlocking";

/// One link.
#[derive(Default)]
pub(super) struct Dashboard {
    received: Vec<u8>,
    greeted: bool,
    quits: bool,
}

impl Link for Dashboard {
    fn open(_: &mut Robot) -> Dashboard {
        Dashboard::default()
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.received.append(inbox);
        let Some(end) = self.received.iter().position(|&byte| byte == b'\n') else {
            if self.received.len() > LINE_MOST {
                self.received.clear();
            }
            return None;
        };
        (!self.quits).then(|| self.received.drain(..=end).collect())
    }

    fn answer(&mut self, request: &[u8], robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let line = String::from_utf8_lossy(request);
        let command = line.trim();
        self.quits = command == "quit";
        let mut answer = reply(command, robot, scene, now_s);
        answer.push('\n');
        answer.into_bytes()
    }

    fn owed(&mut self, _: &mut Robot, _: &mut Scene, _: f64) -> Owed {
        if self.quits {
            return Owed::HungUp;
        }
        match std::mem::replace(&mut self.greeted, true) {
            true => Owed::Nothing,
            false => Owed::Ready(GREETING.into()),
        }
    }
}

fn reply(command: &str, robot: &mut Robot, scene: &mut Scene, now_s: f64) -> String {
    if !robot.is_remote && REMOTE_ONLY.contains(&command) {
        return NOT_REMOTE.into();
    }
    let [major, minor, fix, build] = VERSION;
    let tried = |done: bool, answer: &str| if done { answer.into() } else { format!("Failed to execute: {command}") };
    match command {
        "robotmode" => format!("Robotmode: {}", mode(robot)),
        "safetymode" => format!("Safetymode: {}", robot.safety_status().1),
        "safetystatus" => format!("Safetystatus: {}", robot.safety_status().1),
        "running" => format!("Program running: {}", robot.is_running()),
        "programState" => format!("{} <unnamed>", program(robot)),
        "PolyscopeVersion" => format!("URSoftware {major}.{minor}.{fix}.{build} ({VERSION_DATE})"),
        "version" => format!("{major}.{minor}.{fix}.{build}"),
        // the answer lacks the letter of the series
        "get robot model" => robot.arm.model.trim_end_matches('e').into(),
        "get serial number" => robot.arm.serial.clone(),
        "is in remote control" => robot.is_remote.to_string(),
        "get operational mode" => "NONE".into(),
        "isProgramSaved" => "false <unnamed>".into(),
        "get loaded program" => "No program loaded".into(),
        "stop" => tried(robot.stop(scene, now_s), "Stopped"),
        "pause" => tried(robot.pause(scene, now_s), "Pausing program"),
        "play" => tried(robot.resume(now_s), "Starting program"),
        "power on" => {
            robot.power_on(false, now_s);
            "Powering on".into()
        }
        "brake release" => {
            robot.power_on(true, now_s);
            "Brake releasing".into()
        }
        "power off" => {
            robot.power_off(scene, now_s);
            "Powering off".into()
        }
        "unlock protective stop" => match robot.unlock(now_s) {
            true => "Protective stop releasing".into(),
            false => STILL_LOCKED.into(),
        },
        "close popup" => "closing popup".into(),
        "close safety popup" => "closing safety popup".into(),
        "quit" => "Disconnected".into(),
        _ if command.starts_with("load ") => command.replacen("load", "File not found:", 1),
        _ if command.starts_with("popup ") => "showing popup".into(),
        _ if command.starts_with("addToLog ") => "Added log message".into(),
        _ => format!("could not understand: {command}"),
    }
}

fn mode(robot: &Robot) -> &'static str {
    match robot.mode {
        RobotMode::PowerOff => "POWER_OFF",
        RobotMode::PowerOn => "POWER_ON",
        RobotMode::Idle => "IDLE",
        RobotMode::Running => "RUNNING",
    }
}

fn program(robot: &Robot) -> &'static str {
    match robot.runtime {
        Runtime::Stopped | Runtime::Stopping => "STOPPED",
        Runtime::Playing | Runtime::Resuming => "PLAYING",
        Runtime::Pausing | Runtime::Paused => "PAUSED",
    }
}
