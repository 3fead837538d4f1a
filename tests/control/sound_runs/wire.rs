//! What a stage receives in a sound run, and its read-back while it rests.

use palpate_core::quantity::Axis;
use palpate_run::rig::SimulatedRig;
use palpate_sim::emulator::{Instrument, Owed, Shared};
use palpate_sim::scene::{Scene, Trajectory};
use palpate_testing::observed::{Observer, observed};
use std::f64::consts::TAU;

/// What a family has on its wire.
#[derive(Clone, Copy)]
pub(super) struct Wire {
    /// Number of last resorts among what the stage received, without questions.
    pub(super) aborts: fn(&[Vec<u8>]) -> usize,
    /// Whether this only asks where the stage is.
    is_question: fn(&[u8]) -> bool,
    /// A request that states where z is, for a stage whose read-back is this much more than its place, mm.
    counted: fn(&[u8], f64) -> Vec<u8>,
}

/// Other requests state no place.
fn unchanged(request: &[u8], _: f64) -> Vec<u8> {
    request.to_vec()
}

/// The same end from where z is. What wanders is the read-back at rest, so the place of the end counts.
fn from_its_place(request: &[u8], by_mm: f64) -> Vec<u8> {
    let Ok(mut request) = serde_json::from_slice::<serde_json::Value>(request) else { return request.to_vec() };
    let [from_mm, way_mm] = ["from_mm", "by_mm"].map(|key| request[key]["z"].as_f64());
    if let (Some(from_mm), Some(way_mm)) = (from_mm, way_mm) {
        request["from_mm"]["z"] = (from_mm - by_mm).into();
        request["by_mm"]["z"] = (way_mm + by_mm).into();
    }
    [request.to_string().as_bytes(), b"\n"].concat()
}

pub(super) const MARLIN: Wire = Wire {
    aborts: |all| count(all, b"M410"),
    is_question: |bytes| has(bytes, b"M114") || has(bytes, b"M400"),
    counted: unchanged,
};
pub(super) const GRBL: Wire =
    Wire { aborts: |all| count(all, b"!"), is_question: |bytes| bytes == b"?", counted: unchanged };
pub(super) const KLIPPER: Wire = Wire {
    aborts: |all| count(all, b"printer.emergency_stop"),
    is_question: |bytes| has(bytes, b"printer.objects.query"),
    counted: unchanged,
};
pub(super) const ESP301: Wire = Wire {
    aborts: |all| all.iter().filter(|bytes| bytes.trim_ascii() == b"AB").count(),
    is_question: |bytes| bytes.trim_ascii() == b"3TP",
    counted: unchanged,
};
/// A group is killed and initialised before it homes.
pub(super) const XPS: Wire = Wire {
    aborts: |all| count(all, b"GroupKill").saturating_sub(count(all, b"GroupInitialize")),
    is_question: |bytes| bytes.starts_with(b"GroupPositionCurrentGet"),
    counted: unchanged,
};
/// The dashboard has a port of its own. A package of RTDE begins with its length, which is small.
pub(super) const ARM: Wire = Wire {
    aborts: |all| all.iter().filter(|bytes| bytes.trim_ascii() == b"stop").count(),
    is_question: |bytes| bytes.first() == Some(&0),
    counted: unchanged,
};
/// Its last resort is one more stop.
pub(super) const PROGRAM: Wire = Wire {
    aborts: |all| all.windows(2).filter(|two| two.iter().all(|bytes| has(bytes, b"\"stop\""))).count(),
    is_question: |bytes| has(bytes, b"\"status\""),
    counted: from_its_place,
};

/// A read-back that wanders while z rests in contact.
#[derive(Clone, Copy)]
pub(super) struct Wander {
    pub(super) amplitude_mm: f64,
    pub(super) period_s: f64,
}

impl Wander {
    /// How much more than the place of z the read-back is, mm; `None` if z moves, or is free.
    fn by_mm(self, scene: &Scene, now_s: f64) -> Option<f64> {
        let z = scene.motion(Axis::Z);
        if z.moving(now_s) || scene.clone().true_force_n(now_s) == 0.0 {
            return None;
        }
        Some(self.amplitude_mm * (TAU * (now_s - z.end_s()) / self.period_s).sin())
    }

    /// The scene as the read-back has it.
    fn shown(self, scene: &Scene, now_s: f64) -> Option<Scene> {
        let by_mm = self.by_mm(scene, now_s)?;
        let (z, mut shown) = (scene.motion(Axis::Z), scene.clone());
        shown.set_motion(Axis::Z, Trajectory::at_rest(z.end_mm() + by_mm), now_s);
        Some(shown)
    }
}

/// What the stage received beside questions, and when the last of it came, s.
#[derive(Default)]
pub(super) struct Seen {
    pub(super) received: Vec<Vec<u8>>,
    last_s: f64,
}

/// Notes what the links of the stage receive, and lets its read-back wander.
#[derive(Clone)]
struct Tap {
    wire: Wire,
    wander: Option<Wander>,
    seen: Shared<Seen>,
}

/// Time after which what a stage received has begun, s.
const BEGUN_S: f64 = 0.2;

impl Tap {
    /// Lets the stage act: on the scene as its read-back has it, if nothing can begin a motion.
    fn act<T>(&self, scene: &mut Scene, now_s: f64, act: impl FnOnce(&mut Scene) -> T) -> T {
        let rests = now_s > self.seen.lock().expect("a device that lives").last_s + BEGUN_S;
        let shown = self.wander.filter(|_| rests).and_then(|wander| wander.shown(scene, now_s));
        match shown {
            Some(mut shown) => act(&mut shown),
            None => act(scene),
        }
    }
}

impl Observer for Tap {
    fn answer(&self, stage: &mut dyn Instrument, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        if (self.wire.is_question)(request) {
            return self.act(scene, now_s, |scene| stage.answer(request, scene, now_s));
        }
        let mut seen = self.seen.lock().expect("a device that lives");
        seen.received.push(request.to_vec());
        let rested = now_s > seen.last_s + BEGUN_S;
        seen.last_s = now_s;
        let by_mm = self.wander.filter(|_| rested).and_then(|wander| wander.by_mm(scene, now_s));
        stage.answer(&(self.wire.counted)(request, by_mm.unwrap_or(0.0)), scene, now_s)
    }

    fn owed(&self, stage: &mut dyn Instrument, scene: &mut Scene, now_s: f64) -> Owed {
        self.act(scene, now_s, |scene| stage.owed(scene, now_s))
    }
}

/// Taps the links of a rig's stage.
pub(super) fn tap(rig: &mut SimulatedRig, wire: Wire, wander: Option<Wander>, seen: &Shared<Seen>) {
    let stage = rig.stage.instrument().expect("it has a link").clone();
    rig.stage.replace(observed(stage, Tap { wire, wander, seen: seen.clone() }));
}

fn has(bytes: &[u8], word: &[u8]) -> bool {
    bytes.windows(word.len()).any(|window| window == word)
}

fn count(all: &[Vec<u8>], word: &[u8]) -> usize {
    all.iter().filter(|bytes| has(bytes, word)).count()
}
