//! Mutated messages for every parser of a link: none panics, and none takes more memory than a message needs.
//!
//! `PALPATE_TESTS=full` tries 100,000 inputs of each.

use crate::HEAP;
use palpate_core::quantity::{Axis, stream};
use palpate_drivers::grbl::{Build, parse_report};
use palpate_drivers::lines::{Finder, LineProfile};
use palpate_drivers::modbus::{Function, ModbusClient, Profile, Transport};
use palpate_drivers::process::answer_in;
use palpate_drivers::xps::parse_answer;
use palpate_drivers::{AnyStage, Esp301};
use palpate_link::device::{MotionOrders, Stage};
use palpate_link::wire::Connector;
use palpate_run::rig;
use palpate_sim::emulator::{INBOX_MOST, Instrument};
use palpate_testing::alone::ran_alone;
use palpate_testing::campaign;
use palpate_testing::mutation::{INPUT_MOST, mutated};
use std::hint::black_box;
use std::sync::{Arc, Mutex};
use std::time::Instant as Wall;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};

/// Inputs of each parser: quick and full.
const INPUTS: (usize, usize) = (2_000, 100_000);

/// Largest memory for parsing one message, bytes: several times the longest message.
const HELD_MOST: usize = 1 << 20;

/// Largest memory of the process, bytes: an emulated rig and one message.
const EVER_HELD_MOST: usize = 16 << 20;

/// Answers of real devices and requests to them (PROTOCOLS).
const ESP301_ANSWERS: &[&str] = &[
    "-10.2370\r\n",
    "1\r\n0.0000\r\n",
    "0, -2139482948, NO ERROR DETECTED\r\n",
    "104, 2141749940, AXIS-1 POSITIVE HARDWARE LIMIT DETECTED\r\n",
    "ESP301 Version 1.1.1 16/01/14\r\n",
    "ILS100CCL, SNB171743\r\n",
    "-12.0015, 49.3300, 0.000\r\n",
];
const XPS_ANSWERS: &[&str] = &[
    "0,,",
    "0,XPS-DRV03;VP-25XL,",
    "0,-1.25,3.5e-05,0.0049999999,",
    "-17,GroupMoveAbsolute (Axis.Pos,380),",
    "-20,GroupPositionCurrentGet(Group1,double *),",
];
const XPS_CALLS: &[&str] = &[
    "GroupMoveAbsolute (Axis.Pos,380)",
    "GroupPositionCurrentGet(Group1,double *)",
    "GroupPositionCurrentGet(XYZ,double *,double *,double *)",
    "GroupKill(XYZ)",
];
const GRBL_VERSIONS: &[&str] = &[
    "[VER:1.1h.20190825:]\n[OPT:V,15,128]",
    "[VER:1.1f.20230610:]\n[OPT:VNMSL,100,1024,3,0]\n[FIRMWARE:grblHAL]",
    "[VER:3.7 FluidNC v3.7.16:]\n[OPT:MPHS]",
];
/// Lines or frames that boards send on their own, and their profiles.
const LINES: [(&str, &str, &[&[u8]]); 4] = [
    (
        "lines of text",
        "name = \"a\"\n[text]\nbefore = \"F,\"\ncolumns = 4\n",
        &[b"F,0.012,513,498,505\r\n", b"F,-1.5,0,1023,7\r\nF,1", b",2,3,4\n"],
    ),
    ("lines of tabs", "name = \"a\"\n[text]\nseparator = \"\\t\"\ncolumns = 3\n", &[b"500.00\t-1.5\t27.35\t\r\n"]),
    (
        "frames with a tail",
        "name = \"a\"\n[frame]\nnumbers = [\"3 f32\"]\ntail = \"0D 0A\"\n",
        &[b"\0\0\xC8\x41\0\0\xFA\x43\0\0\0\xBF\r\n\0\0\xC8\x41\0\0\xFA\x43\0\0\0\xBF\r\n"],
    ),
    (
        "frames with a check sum",
        "name = \"a\"\n[frame]\nhead = \"AA\"\nnumbers = [\"u16\", \"skip\", \"2 i8\"]\nchecksum = \"crc16-modbus\"\n",
        &[b"\xAA\x01\x02\0\xFF\x7F\x18\x68\xAA\x01\x02\0\xFF\x7F\x18\x68"],
    ),
];
const GRBL_ANSWERS: &[&str] = &[
    "ok",
    "error:9",
    "ALARM:3",
    "<Idle|MPos:0.000,0.000,0.000|FS:0,0>",
    "<Hold:1|WPos:1.000,-2.500,0.010|F:500|WCO:0.000,0.000,0.000>",
    "$110=500.000",
    "Grbl 1.1h ['$' for help]",
    "[VER:1.1h.20190825:]",
];
const PROCESS_ANSWERS: &[&str] = &[
    r#"{"id": 7, "error": "what happened, in words"}"#,
    r#"{"id": 7, "moving": false, "position_mm": {"x": 0.0, "y": 0.0, "z": -0.25}}"#,
    r#"{"id": 7, "outputs": [0.011, 0.012, 0.3]}"#,
    r#"{"id": 7, "role": "stage", "protocol": 1, "identity": "model and serial number"}"#,
];
const ESP301_REQUESTS: &[&str] = &[
    "1PA1.5;2PA-0.5\r",
    "1MD?;2MD?;1TP\r",
    "VE?\r\n",
    "1OR1\r1WS0\r1MD?\r",
    "1SL-12.5;1SR12.5;1AC50;1AG50\r",
    "TB?\r",
    "01TP?\r",
];
const XPS_REQUESTS: &[&str] = &[
    "GroupMoveAbsolute(XYZ,1,2,3)",
    "GroupInitialize(XYZ)",
    "GroupPositionCurrentGet(XYZ,double *,double *,double *)",
    "EventExtendedConfigurationTriggerSet(GPIO2.ADC1.ADCHighLimit,2,0,0,0,XYZ.SGamma.MotionState,0,0,0,0)",
    "EventExtendedConfigurationTriggerSet(GPIO2.ADC1.ADCHighLimit,3,0,0,0)EventExtendedStart(int *)",
    "GPIOAnalogGet(GPIO2.ADC1,double *)",
];
const GRBL_REQUESTS: &[&str] =
    &["$J=G90 G21 G53 X1.5 F600\n", "$X\n", "$$\n", "?", "G1 X2 Y3 F100\n", "$110=500\n", "G4P0.1\n", "!~\u{18}"];
const PROCESS_REQUESTS: &[&str] = &[
    "{\"id\": 3, \"do\": \"move\", \"to_mm\": {\"z\": -0.25}, \"speed_mm_s\": 1.5}\n",
    "{\"id\": 4, \"do\": \"status\"}\n",
    "{\"id\": 2, \"do\": \"prepare\", \"travel_mm\": {\"x\": [-12.5, 12.5], \"y\": [-12.5, 12.5], \"z\": [-12.5, 12.5]}, \"away\": 1, \"speed_mm_s\": 10.0, \"acceleration_mm_s2\": 100.0}\n",
    "{\"do\": \"stop\"}\n{\"do\": \"speed\", \"speed_mm_s\": 0.5}\n",
];
const RTU: &[&[u8]] = &[
    &[0x01, 0x03, 0x04, 0x00, 0x00, 0x00, 0x84, 0xFA, 0x50],
    &[0x01, 0x03, 0x00, 0x50, 0x00, 0x02, 0xC4, 0x1A],
    &[0x01, 0x83, 0x02, 0xC0, 0xF1],
    &[0x01, 0x10, 0x00, 0x54, 0x00, 0x02, 0x04, 0x7F, 0xFF, 0xFF, 0xFF],
];
const TCP: &[&[u8]] = &[
    &[0, 0, 0, 0, 0, 7, 1, 3, 4, 0x3F, 0x80, 0, 0],
    &[0, 1, 0, 0, 0, 6, 1, 3, 0, 26, 0, 2],
    &[0, 2, 0, 0, 0, 3, 1, 0x83, 2],
    &[0, 0, 0, 0, 0, 11, 1, 0x10, 0, 0, 0, 2, 4, 0, 0, 0, 0],
];

/// Corrects the check sum of every second frame: a parser ignores the others early.
fn sealed(frame: &[u8], nth: &mut usize) -> Vec<u8> {
    *nth += 1;
    if nth.is_multiple_of(2) || frame.len() < 2 {
        return frame.to_vec();
    }
    let body = &frame[..frame.len() - 2];
    let mut sum = 0xFFFFu16;
    for byte in body {
        sum ^= u16::from(*byte);
        for _ in 0..8 {
            sum = if sum & 1 == 1 { sum >> 1 ^ 0xA001 } else { sum >> 1 };
        }
    }
    [body, &sum.to_le_bytes()].concat()
}

fn bytes<'a>(seeds: &[&'a str]) -> Vec<&'a [u8]> {
    seeds.iter().map(|seed| seed.as_bytes()).collect()
}

/// Feeds a parser, and prints speed and number of inputs.
fn fuzz(name: &str, seeds: &[&[u8]], mut parse: impl FnMut(&[u8])) {
    let inputs = campaign::size(INPUTS.0, INPUTS.1);
    let mut rng = stream(1, 0, name);
    let mut input = Vec::with_capacity(2 * INPUT_MOST);
    parse(seeds[0]); // permanent memory is allocated by now
    let (before, began) = (HEAP.allocated(), Wall::now());
    for n in 0..inputs {
        mutated(seeds, &mut rng, &mut input);
        parse(&input);
        if n % 64 == 0 {
            let held = HEAP.allocated().saturating_sub(before);
            assert!(held < HELD_MOST, "{name} holds {held} bytes after {n} inputs, the last {input:?}");
        }
    }
    assert!(HEAP.max_allocated() < EVER_HELD_MOST, "{name} held {} bytes at most", HEAP.max_allocated());
    let took_s = began.elapsed().as_secs_f64();
    println!("{name}: {inputs} inputs in {took_s:.1} s, {:.0} a second", inputs as f64 / took_s);
}

/// Links whose far ends answer every request with the same bytes, and then close.
fn answered(input: Arc<Mutex<Vec<u8>>>) -> Connector {
    Connector::in_memory(move || {
        let (near, far) = duplex(4096);
        tokio::spawn(answer(far, input.lock().expect("a test that goes on").clone()));
        near
    })
}

async fn answer(mut far: DuplexStream, input: Vec<u8>) {
    let mut request = [0; 256];
    if far.read(&mut request).await.is_ok() {
        let _ = far.write_all(&input).await; // a client that is gone needs no answer
    }
}

/// Framing and parser of an emulator on a running scene. It is restarted now and then.
fn fuzz_emulator(
    name: &str,
    text: &str,
    seeds: &[&[u8]],
    pick: impl Fn(&rig::SimulatedRig) -> Arc<Mutex<dyn Instrument>>,
) {
    let spec = rig::parse(name, text, &|_| unreachable!("no map of its own")).expect("the shipped rig").simulated();
    let begin = || {
        let rig = spec.emulators(1).expect("emulators");
        let device = pick(&rig);
        (device, rig.scene)
    };
    let (mut device, mut scene) = begin();
    let (mut fed, mut nth, mut now_s) = (0, 0, 0.0);
    let mut inbox = Vec::with_capacity(2 * INBOX_MOST);
    fuzz(name, seeds, |input| {
        fed += 1;
        if fed % 1000 == 0 {
            (device, scene) = begin();
            now_s = 0.0;
            inbox.clear();
        }
        now_s += 0.001;
        if name == "rtu requests" {
            inbox.extend_from_slice(&sealed(input, &mut nth));
        } else {
            inbox.extend_from_slice(input);
        }
        inbox.truncate(INBOX_MOST);
        let (mut device, mut scene) = (device.lock().expect("no panic"), scene.lock().expect("no panic"));
        while let Some(request) = device.take_request(&mut inbox) {
            black_box(device.answer(&request, &mut scene, now_s));
        }
        if inbox.len() == INBOX_MOST || device.silence().is_some() {
            if let Some(request) = device.fall_silent(&mut inbox) {
                black_box(device.answer(&request, &mut scene, now_s));
            }
            inbox.clear();
        }
        black_box(device.owed(&mut scene, now_s));
    });
}

#[test]
fn parsers_survive_arbitrary_messages() {
    if ran_alone("fuzz::parsers_survive_arbitrary_messages") {
        return;
    }
    fuzz("grbl answers", &bytes(GRBL_ANSWERS), |input| {
        black_box(parse_report(&String::from_utf8_lossy(input)));
    });
    fuzz("grbl versions", &bytes(GRBL_VERSIONS), |input| {
        let texts: Vec<String> = String::from_utf8_lossy(input).lines().map(str::to_owned).collect();
        black_box(Build::read(&texts));
    });
    for (name, profile, seeds) in LINES {
        let profile = LineProfile::parse(name, profile).expect("a profile");
        let mut finder = Finder::new(profile.framing, false);
        fuzz(name, seeds, |input| {
            finder.take(input);
            while let Some(found) = finder.find() {
                let _ = black_box(found);
            }
        });
    }
    let mut call = 0;
    fuzz("xps answers", &bytes(XPS_ANSWERS), |input| {
        call = (call + 1) % XPS_CALLS.len();
        black_box(parse_answer(&String::from_utf8_lossy(input), XPS_CALLS[call]));
    });
    fuzz("process answers", &bytes(PROCESS_ANSWERS), |input| {
        black_box(answer_in(&String::from_utf8_lossy(input), 7));
    });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build().unwrap();
    let input = Arc::new(Mutex::new(Vec::new()));
    fuzz("esp301 answers", &bytes(ESP301_ANSWERS), |bytes| {
        *input.lock().expect("no panic") = bytes.to_vec();
        runtime.block_on(async {
            let mut stage = AnyStage::Esp301(Esp301::new(answered(input.clone()), "fuzz".into()));
            black_box(stage.position_mm(Axis::Z, &MotionOrders::default()).await.is_ok());
        });
    });
    for (name, map, transport, seeds) in
        [("rtu client", "generic-rs485", Transport::Rtu, RTU), ("tcp client", "labjack-t7", Transport::Tcp, TCP)]
    {
        let profile = Profile::shipped(map).expect("it is shipped");
        let mut nth = 0;
        fuzz(name, seeds, |bytes| {
            let rtu = transport == Transport::Rtu;
            *input.lock().expect("no panic") = if rtu { sealed(bytes, &mut nth) } else { bytes.to_vec() };
            runtime.block_on(async {
                let mut client = ModbusClient::new(answered(input.clone()), transport, &profile, "fuzz", "fuzz");
                black_box(client.read("fuzzing", Function::Holding, 80, 2).await.is_ok());
            });
        });
    }
    let grbl = include_str!("../../rigs/grbl.toml");
    fuzz_emulator("esp301 requests", include_str!("../../rigs/esp301.toml"), &bytes(ESP301_REQUESTS), |rig| {
        rig.stage.instrument().expect("it has a link").clone()
    });
    fuzz_emulator("xps requests", include_str!("../../rigs/xps.toml"), &bytes(XPS_REQUESTS), |rig| {
        rig.stage.instrument().expect("it has a link").clone()
    });
    fuzz_emulator("grbl requests", grbl, &bytes(GRBL_REQUESTS), |rig| {
        rig.stage.instrument().expect("it has a link").clone()
    });
    fuzz_emulator("process requests", include_str!("../../rigs/process.toml"), &bytes(PROCESS_REQUESTS), |rig| {
        rig.stage.instrument().expect("it has a link").clone()
    });
    fuzz_emulator("rtu requests", grbl, RTU, |rig| rig.load_cell.instrument().expect("it has a link").clone());
    fuzz_emulator("tcp requests", grbl, TCP, |rig| rig.array.instrument().expect("it has a link").clone());
}
