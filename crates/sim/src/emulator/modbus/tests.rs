//! Frames, exceptions and damage, over RTU and TCP.

use super::*;
use crate::emulator::tests::{Wire, pressed, scene, shared};
use palpate_link::time::Instant;
use proptest::prelude::*;

/// The manual's worked exchange: gross weight 132.
const READ_GROSS: [u8; 8] = [0x01, 0x03, 0x00, 0x50, 0x00, 0x02, 0xC4, 0x1A];
const GROSS_132: [u8; 9] = [0x01, 0x03, 0x04, 0x00, 0x00, 0x00, 0x84, 0xFA, 0x50];

fn transmitter() -> Modbus<Transmitter> {
    Modbus::rtu(Transmitter::new(5.0), 1)
}

/// An RTU frame: body and CRC.
fn rtu(body: &[u8]) -> Vec<u8> {
    let mut frame = Vec::new();
    let mut sealer = RequestFrame::new(0, &[], ModbusProto::Rtu, &mut frame);
    sealer.response.extend_from_slice(body);
    sealer.finalize_response().expect("fits");
    frame
}

/// A TCP frame of unit 255.
fn tcp(transaction: u8, pdu: &[u8]) -> Vec<u8> {
    [&[0, transaction, 0, 0, 0, pdu.len() as u8 + 1, 255], pdu].concat()
}

#[test]
fn the_worked_frame_is_answered_to_the_bit() {
    let answer = transmitter().answer(&READ_GROSS, &mut pressed(0.132), 1.0);
    assert_eq!(answer, GROSS_132);
}

#[test]
fn unserved_function_is_answered_with_its_exception() {
    let too_many_data = [&[16, 0, 84, 0, 2, 4], &[0; 5][..]].concat();
    for (pdu, exception) in [
        (&[1, 0, 0, 0, 1][..], 1),
        (&[5, 0, 0, 0xFF, 0][..], 1),
        (&[15, 0, 0, 0, 8, 1, 0], 1),
        (&[0x11], 1),
        (&[0x4C, 1, 2, 3], 1),
        (&[3, 0, 99, 0, 2], 2),
        (&[4, 0xFF, 0xFF, 0, 125], 2),
        (&[6, 0, 80, 0, 0], 2),
        (&[16, 0, 30, 0, 1, 2, 0, 0], 2),
        (&[3, 0, 80, 0, 0], 3),
        (&[3, 0, 0, 0, 126], 3),
        (&[3, 0, 0], 3),
        (&[6, 0, 94, 0, 2], 3),
        (&[16, 0, 84, 0, 2, 3, 0, 0, 0], 3),
        (&[16, 0, 84, 0, 0, 0], 3),
        (&too_many_data, 3),
    ] {
        let expected = [pdu[0] | 0x80, exception];
        let answer = transmitter().answer(&rtu(&[&[1], pdu].concat()), &mut scene(), 1.0);
        assert_eq!(answer, rtu(&[&[1], &expected[..]].concat()), "{pdu:02x?} over RTU");
        let answer = Modbus::tcp(Transmitter::new(5.0)).answer(&tcp(9, pdu), &mut scene(), 1.0);
        assert_eq!(answer, tcp(9, &expected), "{pdu:02x?} over TCP");
    }
}

#[test]
fn empty_write_is_refused_by_every_map() {
    let answer =
        Modbus::tcp(LabJackT7::new(SceneDevice::Array)).answer(&tcp(9, &[16, 0, 0, 0, 0, 0]), &mut scene(), 1.0);
    assert_eq!(answer, tcp(9, &[0x90, 3]));
}

#[test]
fn both_kinds_of_register_are_equal_with_both_framings() {
    for function in [3, 4] {
        let pdu = [function, 0, 80, 0, 2];
        let expected = [function, 4, 0, 0, 0, 132];
        let answer = transmitter().answer(&rtu(&[&[1], &pdu[..]].concat()), &mut pressed(0.132), 1.0);
        assert_eq!(answer, rtu(&[&[1], &expected[..]].concat()));
        let answer = Modbus::tcp(Transmitter::new(5.0)).answer(&tcp(3, &pdu), &mut pressed(0.132), 1.0);
        assert_eq!(answer, tcp(3, &expected));
    }
}

#[test]
fn requests_to_other_units_are_ignored_and_a_broadcast_is_not_answered() {
    let mut device = transmitter();
    let mut scene = pressed(0.132);
    for body in [&[2, 3, 0, 80, 0, 2][..], &[2, 6, 0, 94, 0, 1], &[0, 3, 0, 80, 0, 2], &[0, 1, 0, 0, 0, 1]] {
        assert_eq!(device.answer(&rtu(body), &mut scene, 1.0), [0; 0], "{body:02x?}");
    }
    assert_eq!(device.answer(&READ_GROSS, &mut scene, 1.0), GROSS_132);
    // zero, to all units
    assert_eq!(device.answer(&rtu(&[0, 6, 0, 94, 0, 1]), &mut scene, 1.0), [0; 0]);
    assert_eq!(device.answer(&READ_GROSS, &mut scene, 1.0), rtu(&[1, 3, 4, 0, 0, 0, 0]));
}

#[tokio::test(start_paused = true)]
async fn garbage_is_discarded_after_a_silence_and_the_next_frame_answered() {
    let mut wire = Wire::to(shared(transmitter()), shared(pressed(0.132)), Instant::now());
    let mut broken = READ_GROSS;
    broken[7] ^= 1;
    for garbage in [&broken[..], &[0xFF], &[1, 0x55, 3, 4, 5, 6, 7, 8], &READ_GROSS[..7], &[0x55; 600]] {
        wire.send(garbage).await;
        assert!(wire.is_silent().await);
        assert_eq!(wire.ask(&READ_GROSS, 9).await, GROSS_132, "after {garbage:02x?}");
    }
    // without a silence between, the frame is lost with what precedes it
    wire.send(&[&[0xFF], &READ_GROSS[..]].concat()).await;
    assert!(wire.is_silent().await);
    // a function of unknown length is ended by the silence
    assert_eq!(wire.ask(&rtu(&[1, 0x11]), 5).await, rtu(&[1, 0x91, 1]));
}

#[tokio::test(start_paused = true)]
async fn a_request_right_after_an_answer_is_lost_and_one_after_the_silence_is_answered() {
    for (waited_us, is_lost) in [(0, true), (1000, true), (2000, false), (5000, false)] {
        let mut wire = Wire::to(shared(transmitter()), shared(pressed(0.132)), Instant::now());
        assert_eq!(wire.ask(&READ_GROSS, 9).await, GROSS_132);
        palpate_link::time::sleep(Duration::from_micros(waited_us)).await;
        wire.send(&READ_GROSS).await;
        assert_eq!(wire.is_silent().await, is_lost, "{waited_us} us");
    }
    // two in one go: the second follows the answer to the first at once
    let mut wire = Wire::to(shared(transmitter()), shared(pressed(0.132)), Instant::now());
    assert_eq!(wire.ask(&[READ_GROSS, READ_GROSS].concat(), 9).await, GROSS_132);
    assert!(wire.is_silent().await);
}

#[tokio::test(start_paused = true)]
async fn pieces_of_a_frame_without_silence_are_one_frame() {
    let mut wire = Wire::to(shared(transmitter()), shared(pressed(0.132)), Instant::now());
    for byte in &READ_GROSS[..7] {
        wire.send(&[*byte]).await;
        tokio::task::yield_now().await;
    }
    assert_eq!(wire.ask(&READ_GROSS[7..], 9).await, GROSS_132);
}

#[tokio::test(start_paused = true)]
async fn pipelined_requests_are_answered_in_order_under_their_numbers() {
    let mut wire = Wire::to(shared(Modbus::tcp(LabJackT7::new(SceneDevice::Array))), shared(scene()), Instant::now());
    let product = [3, 0xEA, 0x60, 0, 2];
    let test = [3, 0xD7, 0x3C, 0, 2];
    let requests = [tcp(1, &product), tcp(2, &test), tcp(3, &product)[..5].to_vec()].concat();
    let answers = wire.ask(&requests, 26).await;
    assert_eq!(answers[..13], tcp(1, &[3, 4, 0x40, 0xE0, 0, 0]));
    assert_eq!(answers[13..], tcp(2, &[3, 4, 0x00, 0x11, 0x22, 0x33]));
    assert_eq!(wire.ask(&tcp(3, &product)[5..], 13).await[1], 3);
}

#[tokio::test(start_paused = true)]
async fn a_device_keeps_its_state_when_a_link_is_opened_again() {
    let (device, scene, origin) = (shared(transmitter()), shared(pressed(0.132)), Instant::now());
    let zero = rtu(&[1, 6, 0, 94, 0, 1]);
    assert_eq!(Wire::to(device.clone(), scene.clone(), origin).ask(&zero, 8).await, zero);
    let answer = Wire::to(device, scene, origin).ask(&READ_GROSS, 9).await;
    assert_eq!(answer, rtu(&[1, 3, 4, 0, 0, 0, 0]));
}

proptest! {
    #[test]
    fn emulator_survives_arbitrary_bytes(body in prop::collection::vec(any::<u8>(), 0..300), function in 0u8..20) {
        let mut scene = scene();
        let mut rtu_device = transmitter();
        let mut tcp_device = Modbus::tcp(LabJackT7::new(SceneDevice::Array));
        let mut bytes = body;
        if let [unit, code, ..] = bytes.as_mut_slice() {
            (*unit, *code) = (1, function);
        }
        let _ = rtu_device.answer(&bytes, &mut scene, 1.0);
        let _ = tcp_device.answer(&bytes, &mut scene, 1.0);
        if bytes.len() <= 253 {
            let sealed = rtu(&bytes);
            let _ = rtu_device.answer(&sealed, &mut scene, 1.0);
            let _ = rtu_device.take_request(&mut sealed.clone());
            if bytes.len() >= 2 {
                let _ = tcp_device.answer(&tcp(1, &bytes[1..]), &mut scene, 1.0);
            }
        }
        let mut inbox = bytes;
        while tcp_device.take_request(&mut inbox).is_some() {}
        prop_assert!(rtu_device.fall_silent(&mut inbox).is_none() && inbox.is_empty());
    }
}
