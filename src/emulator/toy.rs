//! A toy array, as its manual has it.

use super::Instrument;
use crate::scene::{Device, Scene};

/// A toy array: its outputs are the scene's.
pub struct Toy;

impl Instrument for Toy {
    fn device(&self) -> Device {
        Device::Array
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        let end = inbox.iter().position(|&byte| byte == b'\r')?;
        Some(inbox.drain(..=end).filter(|&byte| byte != b'\r').collect())
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        match request {
            b"ID" => b"TOY 1\n".to_vec(),
            b"V" => {
                let mut outputs = vec![0.0; scene.taxels()];
                scene.outputs(now_s, &mut outputs);
                let outputs: Vec<String> = outputs.iter().map(|output| format!("{output:.6}")).collect();
                (outputs.join(" ") + "\n").into_bytes()
            }
            _ => b"?\n".to_vec(),
        }
    }
}
