//! Arbitrary bytes to the emulated GRBL board, in pieces, with time between them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_run::rig;
use palpate_sim::emulator::INBOX_MOST;

fuzz_target!(|bytes: &[u8]| {
    let spec =
        rig::parse("grbl.toml", include_str!("../../rigs/grbl.toml"), &|_| Err(std::io::ErrorKind::NotFound.into()));
    let rig = spec.expect("a shipped rig").simulated().emulators(1).expect("emulators");
    let mut device = rig.stage.instrument().expect("it has a link").lock().expect("no panic");
    let mut scene = rig.scene.lock().expect("no panic");
    let mut inbox = Vec::new();
    for (nth, piece) in bytes.chunks(16).enumerate() {
        inbox.extend_from_slice(piece);
        inbox.truncate(INBOX_MOST);
        while let Some(request) = device.take_request(&mut inbox) {
            device.answer(&request, &mut scene, 0.05 * nth as f64);
        }
        device.owed(&mut scene, 0.05 * nth as f64);
    }
});
