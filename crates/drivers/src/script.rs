//! Counterpart for a driver's tests: the far end of a link. It expects the sent bytes exactly, and answers as defined in a
//! script.

use palpate_core::quantity::{Axis, Range, StageAbilities, Steps, Travel};
use palpate_link::device::{AxisWay, DeviceError, HomeSearch, Identity, MotionOrders, Stage, StageUse};
use palpate_link::wire::Connector;
use std::sync::Mutex;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};
use tokio::sync::mpsc::unbounded_channel;
use tokio::task::JoinHandle;

/// Sent bytes and their answers, in this order.
pub(crate) type Script = &'static [(&'static [u8], &'static [u8])];

/// Creates a link whose far end follows a script. The task fails if other bytes are sent, no bytes are sent, or bytes are left
/// over.
pub(crate) fn scripted(script: Script) -> (Connector, JoinHandle<()>) {
    let (near, mut far) = duplex(4096);
    let near = Mutex::new(Some(near));
    let dial = move || near.lock().unwrap().take().expect("the link is opened once");
    let device = tokio::spawn(async move {
        run_script(&mut far, script).await;
        let mut rest = Vec::new();
        far.read_to_end(&mut rest).await.unwrap();
        assert_eq!(shown(&rest), "", "sent beyond the script");
    });
    (Connector::in_memory(dial), device)
}

/// Creates a link whose far end follows a separate script at each opening of the link, and then closes it. The task fails like
/// the task of [`scripted`], or if the link is opened more or less often.
pub(crate) fn closing(scripts: &'static [Script]) -> (Connector, JoinHandle<()>) {
    let (ends, mut opened) = unbounded_channel();
    let dial = move || {
        let (near, far) = duplex(4096);
        ends.send(far).expect("the link is opened no more often");
        near
    };
    let device = tokio::spawn(async move {
        for script in scripts {
            let mut far = opened.recv().await.expect("the link is opened as often");
            run_script(&mut far, script).await;
        }
        assert!(opened.recv().await.is_none(), "the link is opened no more often");
    });
    (Connector::in_memory(dial), device)
}

async fn run_script(far: &mut DuplexStream, script: Script) {
    for (sent, answered) in script {
        let mut came = vec![0; sent.len()];
        let read = far.read_exact(&mut came).await;
        assert!(read.is_ok(), "{:?} was never sent whole: {:?}", shown(sent), shown(&came));
        assert_eq!(shown(&came), shown(sent));
        far.write_all(answered).await.unwrap();
    }
}

fn shown(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Creates a link that must not be opened.
pub(crate) fn unused() -> Connector {
    Connector::in_memory(|| -> DuplexStream { unreachable!("nothing is to be sent here") })
}

/// Use of a stage like the paper's stage.
pub(crate) fn usage() -> StageUse {
    let travel = Travel { axes: [Range { min: -12.5, max: 12.5 }; 3] };
    StageUse {
        travel,
        away: 1.0,
        speed_mm_s: 10.0,
        acceleration_mm_s2: 100.0,
        home_speed_mm_s: 2.0,
        home_z_mm: 12.5,
        homed: false,
        z_holds_unpowered: false,
        by_hand: false,
        steps: Steps::FINE,
        home_search: HomeSearch::Away,
        abilities: StageAbilities::FULL,
    }
}

/// Returns the ways from 0 mm to these places, mm.
pub(crate) fn ways(targets: &[(Axis, f64)]) -> Vec<AxisWay> {
    targets.iter().map(|(axis, to_mm)| AxisWay::between(*axis, 0.0, *to_mm)).collect()
}

/// Identifies and homes a stage.
pub(crate) async fn made_ready(
    stage: &mut impl Stage,
    usage: &StageUse,
    orders: &MotionOrders,
) -> Result<Identity, DeviceError> {
    let identity = stage.identify(usage).await?;
    stage.home(usage, orders).await.map(|()| identity)
}
