//! Modbus at both ends: an emulated transmitter reads arbitrary requests, and the client arbitrary answers.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_drivers::modbus::{Function, ModbusClient, Profile, Transport};
use palpate_link::wire::Connector;
use palpate_run::rig;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, duplex};

fuzz_target!(|bytes: &[u8]| {
    let spec =
        rig::parse("grbl.toml", include_str!("../../rigs/grbl.toml"), &|_| Err(std::io::ErrorKind::NotFound.into()));
    let rig = spec.expect("a shipped rig").simulated().emulators(1).expect("emulators");
    let mut device = rig.load_cell.instrument().expect("it has a link").lock().expect("no panic");
    let mut inbox = bytes.to_vec();
    let mut scene = rig.scene.lock().expect("no panic");
    while let Some(request) = device.take_request(&mut inbox) {
        device.answer(&request, &mut scene, 0.0);
    }
    drop((device, scene));

    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build().expect("a runtime");
    let answer = bytes.to_vec();
    let connector = Connector::in_memory(move || {
        let (near, mut far) = duplex(4096);
        let answer = answer.clone();
        tokio::spawn(async move {
            let mut request = [0; 256];
            if far.read(&mut request).await.is_ok() {
                let _ = far.write_all(&answer).await; // a client that is gone needs no answer
            }
        });
        near
    });
    runtime.block_on(async {
        let profile = Profile::shipped("generic-rs485").expect("a shipped map");
        let mut client = ModbusClient::new(connector, Transport::Rtu, &profile, "fuzz", "fuzz");
        if let Ok(registers) = client.read("fuzzing", Function::Holding, 80, 2).await {
            assert_eq!(registers.len(), 2);
        }
    });
});
