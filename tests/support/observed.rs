//! An instrument whose messages a test observes, on every link that it has.

use palpate_link::wire::SerialLine;
use palpate_sim::emulator::{Instrument, Owed, Shared};
use palpate_sim::scene::{Scene, SceneDevice};
use std::sync::{Arc, Mutex};
use tokio::sync::Notify;

/// What a test does with the messages of an instrument. All links share it.
pub trait Observer: Clone + Send + 'static {
    /// Has the instrument answer a request.
    fn answer(&self, own: &mut dyn Instrument, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8>;

    /// Has the instrument send what it owes.
    fn owed(&self, own: &mut dyn Instrument, scene: &mut Scene, now_s: f64) -> Owed;
}

/// Returns an instrument with an observer.
pub fn observed(own: Shared<dyn Instrument>, observer: impl Observer) -> Shared<dyn Instrument> {
    Arc::new(Mutex::new(Observed { own, observer }))
}

struct Observed<O> {
    own: Shared<dyn Instrument>,
    observer: O,
}

impl<O: Observer> Instrument for Observed<O> {
    fn device(&self) -> SceneDevice {
        self.own.lock().expect("a device that lives").device()
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.own.lock().expect("a device that lives").take_request(inbox)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        self.observer.answer(&mut *self.own.lock().expect("a device that lives"), request, scene, now_s)
    }

    fn deaf_until_s(&self) -> f64 {
        self.own.lock().expect("a device that lives").deaf_until_s()
    }

    fn on_line(&mut self, line: SerialLine) -> bool {
        self.own.lock().expect("a device that lives").on_line(line)
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        let link = self.own.lock().expect("a device that lives").accept()?;
        Some(observed(link, self.observer.clone()))
    }

    fn at_port(&self, port: u16) -> Option<Shared<dyn Instrument>> {
        let link = self.own.lock().expect("a device that lives").at_port(port)?;
        Some(observed(link, self.observer.clone()))
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        self.own.lock().expect("a device that lives").bell()
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        self.observer.owed(&mut *self.own.lock().expect("a device that lives"), scene, now_s)
    }
}
