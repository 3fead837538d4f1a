//! The devices of a rig on links on which one of them is lost.

use palpate_core::quantity::stream;
use palpate_link::wire::SerialLine;
use palpate_run::rig::SimulatedRig;
use palpate_sim::emulator::{Instrument, Owed, Shared};
use palpate_sim::scene::{Scene, SceneDevice};
use palpate_testing::phases::Watcher;
use rand::RngExt;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::Notify;

/// How a device is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum FarEndLoss {
    /// Its link is closed, and so is every link that is opened again.
    Unplugged,
    /// It accepts everything and answers nothing.
    Silenced,
    /// Every answer is damaged; in every second case its line ends aren't.
    Garbled,
}

impl FarEndLoss {
    pub(super) const ALL: [FarEndLoss; 3] = [FarEndLoss::Unplugged, FarEndLoss::Silenced, FarEndLoss::Garbled];
}

/// The lost device, the way of its loss, and the number of the message.
#[derive(Clone, Copy, Debug)]
pub(super) struct FarEndFate {
    pub device: SceneDevice,
    pub loss: FarEndLoss,
    pub at: usize,
}

/// Connects every device of a rig by an observed link, and loses one of them.
pub(super) fn beset(rig: &mut SimulatedRig, watcher: &Shared<Watcher>, fate: Option<FarEndFate>) {
    let lost = Arc::new(Mutex::new(Lost { at: fate.map(|fate| fate.at), struck: false, bells: Vec::new() }));
    let shared = rig.load_cell.is_same(&rig.stage);
    for (device, role) in [
        (&mut rig.stage, SceneDevice::Stage),
        (&mut rig.load_cell, SceneDevice::LoadCell),
        (&mut rig.array, SceneDevice::Array),
    ] {
        let Some(instrument) = device.instrument().cloned() else { continue };
        let loss = fate.filter(|fate| {
            fate.device == role || shared && fate.device == SceneDevice::Stage && role != SceneDevice::Array
        });
        device.replace(Far::put(instrument, watcher.clone(), lost.clone(), loss));
    }
}

/// Shared state of the links of a rig.
struct Lost {
    at: Option<usize>,
    struck: bool,
    /// Wakes waiting links, so that they are closed.
    bells: Vec<Arc<Notify>>,
}

/// A device on a link on which it may be lost.
struct Far {
    device: Shared<dyn Instrument>,
    watcher: Shared<Watcher>,
    lost: Shared<Lost>,
    /// How this device is lost, if it is the lost one.
    fate: Option<FarEndFate>,
    bell: Arc<Notify>,
}

impl Far {
    fn put(
        device: Shared<dyn Instrument>,
        watcher: Shared<Watcher>,
        lost: Shared<Lost>,
        fate: Option<FarEndFate>,
    ) -> Shared<dyn Instrument> {
        let bell = device.lock().expect("a device that lives").bell().unwrap_or_default();
        lost.lock().expect("a test that goes on").bells.push(bell.clone());
        Arc::new(Mutex::new(Far { device, watcher, lost, fate, bell }))
    }

    fn device<R>(&self, ask: impl FnOnce(&mut dyn Instrument) -> R) -> R {
        ask(&mut *self.device.lock().expect("a device that lives"))
    }

    /// A message has arrived, and maybe the loss begins.
    fn heard(&self, message: Option<Vec<u8>>) -> Option<Vec<u8>> {
        let message = message?;
        let mut watcher = self.watcher.lock().expect("a test that goes on");
        let mut lost = self.lost.lock().expect("a test that goes on");
        if lost.at == Some(watcher.phases.len()) {
            lost.struck = true;
            lost.bells.iter().for_each(|bell| bell.notify_waiters());
        }
        watcher.hears(self.device(|device| device.device()));
        Some(message)
    }

    fn loss(&self) -> Option<FarEndFate> {
        self.fate.filter(|_| self.lost.lock().expect("a test that goes on").struck)
    }

    /// Lets the device work; the watcher observes a stage.
    fn act<R>(&self, scene: &mut Scene, now_s: f64, act: impl FnOnce(&mut dyn Instrument, &mut Scene) -> R) -> R {
        let mut watcher = self.watcher.lock().expect("a test that goes on");
        self.device(|device| match device.device() {
            SceneDevice::Stage => watcher.acts(scene, now_s, |scene| act(device, scene)),
            _ => act(device, scene),
        })
    }

    /// The part of an answer that arrives.
    fn arrives(&self, answer: Vec<u8>) -> Vec<u8> {
        match self.loss() {
            None => answer,
            Some(FarEndFate { loss: FarEndLoss::Garbled, at, .. }) => damaged(answer, at),
            Some(_) => Vec::new(),
        }
    }
}

impl Instrument for Far {
    fn device(&self) -> SceneDevice {
        self.device(|device| device.device())
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.heard(self.device(|device| device.take_request(inbox)))
    }

    fn silence(&self) -> Option<Duration> {
        self.device(|device| device.silence())
    }

    fn fall_silent(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.heard(self.device(|device| device.fall_silent(inbox)))
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        self.arrives(self.act(scene, now_s, |device, scene| device.answer(request, scene, now_s)))
    }

    fn deaf_until_s(&self) -> f64 {
        self.device(|device| device.deaf_until_s())
    }

    fn on_line(&mut self, line: SerialLine) -> bool {
        self.device(|device| device.on_line(line))
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        let own = self.device(|device| device.accept())?;
        Some(Far::put(own, self.watcher.clone(), self.lost.clone(), self.fate))
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        if self.loss().is_some_and(|fate| fate.loss == FarEndLoss::Unplugged) {
            return Owed::HungUp;
        }
        match self.act(scene, now_s, |device, scene| device.owed(scene, now_s)) {
            Owed::Ready(answer) => Owed::Ready(self.arrives(answer)),
            owed => owed,
        }
    }
}

/// An answer whose bytes all differ, except for line ends in every second case.
fn damaged(mut answer: Vec<u8>, at: usize) -> Vec<u8> {
    let mut rng = stream(1, (at + answer.len()) as u64, "damage");
    let keeps_lines = at.is_multiple_of(2);
    for byte in answer.iter_mut().filter(|byte| !(keeps_lines && b"\r\n".contains(byte))) {
        *byte ^= 0x80 | rng.random::<u8>(); // never text again
    }
    answer
}
