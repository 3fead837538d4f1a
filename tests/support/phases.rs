//! Phase of a press, from the true state: positions and motions of the axes, contact, and requests.

use super::executions::WorstTruth;
use palpate_core::quantity::{Axis, Frame};
use palpate_link::time::Instant;
use palpate_sim::scene::{Scene, SceneDevice};
use std::sync::{Arc, Mutex};

/// Time for which a window counts as open after a request to the array, s: it is read every 5 ms, which takes 1 to 2 ms.
const WINDOW_S: f64 = 0.02;

/// Rest in contact without a reading of the force, s: a dwell.
const LOOK_MOST_S: f64 = 0.15;

/// Largest speed at rest, mm/s.
const REST_MM_S: f64 = 1e-9;

/// Phase of a press.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PressPhase {
    /// To the first place, from rest above the specimen.
    Travel,
    /// Reading the force without load.
    NoLoad,
    /// Toward the specimen.
    Approach,
    /// From the first contact to the first rest in it, with the reading of the force there.
    Touch,
    /// Steps in contact, with readings of the force between them.
    Correction,
    /// At rest in contact until the window is due.
    Dwell,
    /// Force and outputs are sampled.
    Window,
    /// Out of the contact, with the check that it is over.
    Retraction,
    /// Sideways while z still retracts or has retracted.
    LeavingContact,
}

impl PressPhase {
    pub const ALL: [PressPhase; 9] = [
        PressPhase::Travel,
        PressPhase::NoLoad,
        PressPhase::Approach,
        PressPhase::Touch,
        PressPhase::Correction,
        PressPhase::Dwell,
        PressPhase::Window,
        PressPhase::Retraction,
        PressPhase::LeavingContact,
    ];
}

/// Observes a scene during a run: the phase at each message, and the largest true values.
pub struct Watcher {
    scene: Arc<Mutex<Scene>>,
    frame: Frame,
    origin: Instant,
    /// The phase at each message of a press; none outside of one.
    pub phases: Vec<Option<PressPhase>>,
    pressing: bool,
    /// z at the first contact, mm.
    touched_mm: Option<f64>,
    /// Came to rest in contact, and moved on.
    stepped: bool,
    /// Since when it rests, and whether in contact.
    rest: Option<(f64, bool)>,
    array_asked_s: f64,
    /// The scene when a motion last began or changed.
    left: Option<Scene>,
    worst: WorstTruth,
}

impl Watcher {
    /// An observer of a scene whose time begins now.
    pub fn new(scene: Arc<Mutex<Scene>>, frame: Frame) -> Watcher {
        Watcher {
            scene,
            frame,
            origin: Instant::now(),
            phases: Vec::new(),
            pressing: false,
            touched_mm: None,
            stepped: false,
            rest: None,
            array_asked_s: f64::NEG_INFINITY,
            left: None,
            worst: WorstTruth::default(),
        }
    }

    /// A press begins; its phases are noted or not.
    pub fn begins(&mut self, output: bool) {
        (self.pressing, self.touched_mm, self.stepped, self.rest) = (output, None, false, None);
    }

    /// A device gets a message.
    pub fn hears(&mut self, device: SceneDevice) {
        let now_s = self.now_s();
        if device == SceneDevice::Array {
            self.array_asked_s = now_s;
        }
        let phase = self.phase(now_s);
        self.phases.push(phase.filter(|_| self.pressing));
    }

    /// The stage acts on a message, or on its own.
    pub fn acts<R>(&mut self, scene: &mut Scene, now_s: f64, act: impl FnOnce(&mut Scene) -> R) -> R {
        let motions = |scene: &Scene| Axis::ALL.map(|axis| scene.motion(axis).clone());
        let before = motions(scene);
        let acted = act(scene);
        if self.left.is_none() || motions(scene) != before {
            self.look(now_s);
            let mut left = scene.clone();
            left.take_truth(now_s);
            self.left = Some(left);
        }
        acted
    }

    /// The largest true values until all is at rest.
    pub fn worst(&mut self) -> WorstTruth {
        let now_s = self.now_s();
        self.look(now_s);
        let rest = self.scene().run_out(now_s);
        self.worst.take(rest);
        self.worst
    }

    /// z in the specimen frame, mm, and whether every axis is at rest.
    pub fn z_mm_and_rest(&self) -> (f64, bool) {
        let now_s = self.now_s();
        let mut scene = self.scene();
        let stands = Axis::ALL.iter().all(|&axis| scene.axis(axis, now_s).1.abs() < REST_MM_S);
        let stays = Axis::ALL.iter().all(|&axis| !scene.motion(axis).moving(now_s));
        (self.frame.z_from_stage(scene.axis(Axis::Z, now_s).0), stands && stays)
    }

    fn phase(&mut self, now_s: f64) -> Option<PressPhase> {
        let (speeds, force_n, z_mm, target_mm) = {
            let mut scene = self.scene();
            let speeds = Axis::ALL.map(|axis| scene.axis(axis, now_s).1);
            let [z_mm, target_mm] =
                [scene.axis(Axis::Z, now_s).0, scene.motion(Axis::Z).end_mm()].map(|mm| self.frame.z_from_stage(mm));
            (speeds, scene.true_force_n(now_s), z_mm, target_mm)
        };
        let [sideways, z] = [speeds[0].abs().max(speeds[1].abs()), speeds[2] * self.frame.down.sign()];
        let in_contact = force_n > 0.0;
        if in_contact && self.touched_mm.is_none() {
            self.touched_mm = Some(z_mm);
        }
        if sideways > REST_MM_S {
            return Some(if self.touched_mm.is_some() { PressPhase::LeavingContact } else { PressPhase::Travel });
        }
        if z.abs() > REST_MM_S {
            self.stepped |= self.rest.is_some_and(|(_, in_contact)| in_contact);
            self.rest = None;
            let leaves = z < 0.0 && self.touched_mm.is_some_and(|touched_mm| target_mm < touched_mm);
            return Some(match (in_contact, self.stepped) {
                _ if leaves => PressPhase::Retraction,
                (false, _) => PressPhase::Approach,
                (true, false) => PressPhase::Touch,
                (true, true) => PressPhase::Correction,
            });
        }
        let (since_s, _) = *self.rest.get_or_insert((now_s, in_contact));
        Some(match in_contact {
            _ if now_s - self.array_asked_s < WINDOW_S => PressPhase::Window,
            true if now_s - since_s > LOOK_MOST_S => PressPhase::Dwell,
            true if !self.stepped => PressPhase::Touch,
            true => PressPhase::Correction,
            false if self.touched_mm.is_some() => PressPhase::Retraction,
            false => PressPhase::NoLoad,
        })
    }

    /// Events since the last motion began or changed.
    fn look(&mut self, now_s: f64) {
        if let Some(mut scene) = self.left.take() {
            self.worst.take(scene.take_truth(now_s));
        }
    }

    fn scene(&self) -> std::sync::MutexGuard<'_, Scene> {
        self.scene.lock().expect("a scene that lives")
    }

    fn now_s(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }
}
