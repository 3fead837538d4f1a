//! What the tests of this room share: a scene, and the near end of a wire to an instrument.

use super::{Instrument, Shared, serve};
use crate::scene::{ContactLaw, Elastomer, LoadCellScene, Scene, SceneSpec, SkinSpec, Surroundings, Trajectory};
use palpate_core::quantity::{ArrayLayout, Axis, Down, Frame, Position};
use palpate_link::time::{Instant, timeout};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};

/// Where the axes stand when the controller of [`scene`] is switched on, true mm.
pub(super) const POWER_ON: Position = Position { x_mm: -1.0, y_mm: 2.0, z_mm: 8.0 };

/// Stiffness of the contact of [`scene`], N/mm: no toe, nothing quadratic, nothing that relaxes.
pub(super) const STIFFNESS_N_MM: f64 = 2.0;

/// A quiet scene but for its load cell's noise.
pub(super) fn noisy() -> Scene {
    scene_with(|spec| spec.load_cell = Some(LoadCellScene { noise_n: 0.1, ..LoadCellScene::default() }))
}

/// A quiet scene: surface at true z = 0, pressed toward -z, nine taxels under 5 mm, no noise, no latency.
pub(super) fn scene() -> Scene {
    scene_with(|_| {})
}

/// A quiet scene but for what is changed.
pub(super) fn scene_with(change: impl FnOnce(&mut SceneSpec)) -> Scene {
    scene_of(ArrayLayout::grid(3, 3, 4.5), change)
}

/// A quiet scene with other taxels, but for what is changed.
pub(super) fn scene_of(layout: ArrayLayout, change: impl FnOnce(&mut SceneSpec)) -> Scene {
    let skin = SkinSpec { elastomer: Some(Elastomer::half_space(5.0)), ..SkinSpec::default() };
    let contact = ContactLaw { linear_n_mm: STIFFNESS_N_MM, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
    let mut spec = SceneSpec::of(skin, contact);
    change(&mut spec);
    let frame = Frame::level(0.0, 0.3, Down::Minus);
    let setting = Surroundings {
        frame,
        layout,
        full_scale_n: 1.0,
        half_extent_mm: 6.0,
        power_on: POWER_ON,
        conversions_hz: 1000.0,
        latencies: spec.latencies,
    };
    Scene::new(spec, setting, 1)
}

/// Shares what a test builds.
pub(super) fn shared<T>(value: T) -> Shared<T> {
    Arc::new(Mutex::new(value))
}

/// The near end of a wire at whose far end an instrument is served.
pub(super) struct Wire {
    stream: DuplexStream,
}

impl Wire {
    pub(super) fn to<I: Instrument + 'static>(instrument: Shared<I>, scene: Shared<Scene>, origin: Instant) -> Self {
        let (stream, far) = tokio::io::duplex(8192);
        tokio::spawn(async move { serve(far, instrument, scene, origin).await });
        Wire { stream }
    }

    pub(super) async fn send(&mut self, bytes: &[u8]) {
        self.stream.write_all(bytes).await.expect("the far end is open");
    }

    /// Sends, and reads as many bytes as are expected.
    pub(super) async fn ask(&mut self, bytes: &[u8], count: usize) -> Vec<u8> {
        self.send(bytes).await;
        let mut reply = vec![0; count];
        timeout(Duration::from_secs(3600), self.stream.read_exact(&mut reply))
            .await
            .unwrap_or_else(|_| panic!("no answer to {bytes:02x?}"))
            .expect("the far end is open");
        reply
    }

    /// The near end itself.
    pub(super) fn stream(&mut self) -> &mut DuplexStream {
        &mut self.stream
    }

    /// Whether nothing comes within a second.
    pub(super) async fn is_silent(&mut self) -> bool {
        timeout(Duration::from_secs(1), self.stream.read_u8()).await.is_err()
    }
}

/// A scene in which the tip presses with `force_n` in the middle, from 0 s on.
pub(super) fn pressed(force_n: f64) -> Scene {
    let mut scene = scene();
    scene.set_motion(Axis::X, Trajectory::at_rest(0.0), 0.0);
    scene.set_motion(Axis::Y, Trajectory::at_rest(0.0), 0.0);
    scene.set_motion(Axis::Z, Trajectory::at_rest(-force_n / STIFFNESS_N_MM), 0.0);
    scene
}
