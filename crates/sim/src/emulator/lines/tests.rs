//! What all boards share: opening, rates, the time of a line, faults, and clients that don't read.

use super::*;
use crate::emulator::tests::{Wire, pressed, scene, scene_with, shared};
use crate::scene::{FaultKind, SceneFault, Trajectory};
use palpate_core::quantity::Axis;
use palpate_link::time::Instant;
use proptest::prelude::*;
use std::time::Duration;
use tokio::io::AsyncReadExt;

/// Opens a link.
pub(super) fn opened<F: BoardFirmware>(mut board: SerialBoard<F>) -> SerialBoard<F> {
    assert!(board.accept().is_none());
    board
}

/// The bytes that a board pushes from one time to another, with the times at which they arrive; it is asked each millisecond.
pub(super) fn listen<F: BoardFirmware>(
    board: &mut SerialBoard<F>,
    scene: &mut Scene,
    from_s: f64,
    to_s: f64,
) -> Vec<(f64, Vec<u8>)> {
    let mut heard = Vec::new();
    for ms in (from_s * 1000.0).round() as u64..(to_s * 1000.0).round() as u64 {
        let now_s = ms as f64 / 1000.0;
        while let Owed::Pushed(bytes) = board.owed(scene, now_s) {
            heard.push((now_s, bytes));
        }
    }
    heard
}

fn text(heard: &[(f64, Vec<u8>)]) -> String {
    let bytes: Vec<u8> = heard.iter().flat_map(|(_, bytes)| bytes.clone()).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

fn bare(rate_hz: f64) -> SerialBoard<Hx711> {
    SerialBoard::new(Hx711::new(Hx711Sketch::Bare, rate_hz))
}

fn fault(kind: LineFaultKind, at_s: f64, for_s: f64) -> LineFault {
    LineFault { kind, at_s, for_s }
}

/// The lines with the times at which their last bytes arrived.
fn arrivals(heard: &[(f64, Vec<u8>)]) -> Vec<(f64, String)> {
    let (mut arrivals, mut line) = (Vec::new(), String::new());
    for (at_s, bytes) in heard {
        for &byte in bytes {
            line.push(byte.into());
            if let Some(whole) = line.strip_suffix("\r\n") {
                arrivals.push((*at_s, whole.to_owned()));
                line.clear();
            }
        }
    }
    arrivals
}

/// Whole lines of a text; the rest that has no end yet is left out.
fn lines(text: &str) -> Vec<&str> {
    text.split_inclusive("\r\n").filter_map(|line| line.strip_suffix("\r\n")).collect()
}

#[test]
fn opening_resets_an_uno_which_is_silent_while_it_boots_then_greets_then_reads() {
    let mut board = opened(SerialBoard::new(Hx711::new(Hx711Sketch::Demo, 10.0)));
    let heard = listen(&mut board, &mut scene(), 0.0, 2.5);
    assert!(heard[0].0 > 1.7);
    let (greeted_s, _) = arrivals(&heard)[0];
    // the greeting has 18 bytes at 9600 baud
    assert!((greeted_s - 1.7 - 18.0 * 10.0 / 9600.0).abs() < 0.002, "{greeted_s}");
    let text = text(&heard);
    assert_eq!(lines(&text)[..3], ["HX711 scale demo", "Readings:", "Reading: 0.0 lbs"]);
}

#[test]
fn a_board_is_silent_until_it_is_opened_and_opening_it_again_resets_it() {
    let mut scene = scene();
    let mut board = bare(80.0);
    assert_eq!(board.owed(&mut scene, 1.0), Owed::Nothing);
    let mut board = opened(board);
    assert!(!listen(&mut board, &mut scene, 1.0, 4.0).is_empty());
    let mut board = opened(board);
    let heard = listen(&mut board, &mut scene, 4.0, 6.0);
    assert!((heard[0].0 - 4.0 - 1.7 - 1.0 / 80.0).abs() < 0.003, "{}", heard[0].0);
    assert!(text(&heard).starts_with("84000\r\n"), "a whole line after a reset");
}

#[test]
fn a_board_without_a_reset_is_joined_in_the_middle_of_a_line() {
    let mut scene = scene();
    let mut board = opened(SerialBoard::new(ReSkin::new(100.0)));
    let first = listen(&mut board, &mut scene, 0.0, 0.2);
    assert!((first[0].0 - 0.035 - 0.01).abs() < 0.002 && first[0].1.len() == 3 * 16 + 2, "{first:?}");
    let frame = first[0].1.clone();
    let mut lengths = Vec::new();
    for opening in 1..20 {
        board = opened(board);
        let from_s = 0.2 * f64::from(opening);
        let heard = listen(&mut board, &mut scene, from_s, from_s + 0.2);
        assert!(heard[0].0 < from_s + 0.011 && frame.ends_with(&heard[0].1));
        assert_eq!(heard[1].1, frame);
        lengths.push(heard[0].1.len());
    }
    lengths.sort_unstable();
    lengths.dedup();
    assert!(lengths.len() > 8, "{lengths:?}");
}

#[test]
fn readings_come_at_the_rate_of_the_board_whatever_the_rate() {
    for rate_hz in [10.0, 80.0, 79.3, 1000.0] {
        let mut board = opened(bare(rate_hz).on(Port::native_usb(0.0)));
        let heard = text(&listen(&mut board, &mut scene(), 0.0, 10.0));
        let expected = (rate_hz * 10.0) as i64;
        assert!((lines(&heard).len() as i64 - expected).abs() <= 1, "{rate_hz}: {}", lines(&heard).len());
    }
}

#[test]
fn the_last_byte_of_a_line_arrives_after_the_time_of_its_bytes() {
    let mut board = opened(bare(10.0).on(Port::serial(1200.0)));
    let heard = arrivals(&listen(&mut board, &mut scene(), 0.0, 0.27));
    let line_s = 7.0 * 10.0 / 1200.0;
    assert_eq!(heard.len(), 2);
    for ((at_s, line), sent) in heard.iter().zip(board.sent()) {
        assert_eq!(line, "84000");
        assert!((sent.last_byte_s - sent.read_s - line_s).abs() < 1e-9, "{sent:?}");
        assert!(*at_s >= sent.last_byte_s - 1e-6 && *at_s < sent.last_byte_s + 0.001, "{at_s} {sent:?}");
    }
}

#[test]
fn a_line_that_is_under_way_arrives_byte_by_byte() {
    let mut scene = scene();
    let mut board = opened(bare(10.0).on(Port::serial(1000.0)));
    assert_eq!(board.owed(&mut scene, 0.0), Owed::At(0.1));
    assert_eq!(board.owed(&mut scene, 0.125), Owed::Pushed(b"84".to_vec()));
    assert_eq!(board.owed(&mut scene, 0.125), Owed::At(0.1 + 0.07));
    assert_eq!(board.owed(&mut scene, 0.17), Owed::Pushed(b"000\r\n".to_vec()));
    assert_eq!(board.owed(&mut scene, 0.17), Owed::At(0.2));
}

#[test]
fn a_sketch_that_prints_more_than_its_line_carries_waits_for_the_line() {
    let mut board = opened(bare(80.0).on(Port::serial(300.0)));
    let heard = listen(&mut board, &mut scene(), 0.0, 20.0);
    assert_eq!(text(&heard).len(), 600 - 1, "30 bytes per second after the first 12.5 ms");
    let last = board.sent().next_back().expect("a line");
    assert!(last.last_byte_s - last.read_s < (64.0 + 7.0) * 10.0 / 300.0 + 1e-6, "{last:?}");
}

#[test]
fn lines_that_are_due_at_one_call_come_in_order_and_what_is_too_late_is_lost() {
    let mut scene = scene();
    let mut board = opened(bare(1000.0).on(Port::native_usb(0.0)));
    assert_eq!(board.owed(&mut scene, 0.0), Owed::At(0.001));
    let Owed::Pushed(bytes) = board.owed(&mut scene, 0.003) else { panic!("three lines") };
    assert_eq!(bytes, b"84000\r\n".repeat(3));
    let Owed::Pushed(bytes) = board.owed(&mut scene, 100.0) else { panic!("some lines") };
    assert_eq!(bytes, b"84000\r\n".repeat(101));
}

#[test]
fn the_log_holds_the_readings_that_were_sent_and_not_more_than_its_bound() {
    let mut scene = pressed(0.25);
    let mut board = opened(bare(1000.0).on(Port::native_usb(0.0)));
    listen(&mut board, &mut scene, 0.0, 1.0);
    let last = board.sent().next_back().expect("a line");
    assert_eq!((last.reading.as_slice(), last.whole), ([184_000.0].as_slice(), true));
    assert!((last.read_s - 0.999).abs() < 1e-9);
    listen(&mut board, &mut scene, 1.0, 6.0);
    assert_eq!(board.sent().len(), SENT_MOST);
}

#[test]
fn board_that_stalls_sends_nothing_and_then_new_readings() {
    let mut scene = scene();
    let mut board = opened(bare(100.0).on(Port::native_usb(0.0)).with_fault(fault(LineFaultKind::Stops, 1.0, 2.0)));
    assert_eq!(lines(&text(&listen(&mut board, &mut scene, 0.0, 1.0))).len(), 99);
    assert_eq!(listen(&mut board, &mut scene, 1.0, 2.0), []);
    scene.set_motion(Axis::X, Trajectory::at_rest(0.0), 2.0);
    scene.set_motion(Axis::Y, Trajectory::at_rest(0.0), 2.0);
    scene.set_motion(Axis::Z, Trajectory::at_rest(-0.125), 2.0);
    assert_eq!(listen(&mut board, &mut scene, 2.0, 3.0), []);
    let heard = text(&listen(&mut board, &mut scene, 3.0, 4.0));
    assert_eq!(lines(&heard).len(), 100);
    assert!(lines(&heard).iter().all(|line| *line == "184000"), "{heard}");
}

#[test]
fn adapter_that_buffers_delivers_every_byte_later() {
    let mut scene = scene();
    let mut board = opened(bare(100.0).on(Port::native_usb(0.0)).with_fault(fault(LineFaultKind::Withholds, 1.0, 2.0)));
    listen(&mut board, &mut scene, 0.0, 1.0);
    assert_eq!(listen(&mut board, &mut scene, 1.0, 3.0), []);
    let heard = listen(&mut board, &mut scene, 3.0, 3.001);
    assert_eq!(lines(&text(&heard)).len(), 201, "those of two seconds and the one that is due now");
    assert_eq!(lines(&text(&listen(&mut board, &mut scene, 3.001, 4.0))).len(), 99);
}

#[test]
fn a_reset_cuts_the_line_under_way_and_starts_the_sketch_again() {
    let mut scene = scene();
    let mut board = opened(SerialBoard::new(Hx711::new(Hx711Sketch::Demo, 10.0)));
    listen(&mut board, &mut scene, 0.0, 3.0);
    // "Reading: 0.0 lbs" with its end takes 18.75 ms from 3.0 s on
    board.fail(fault(LineFaultKind::Resets, 3.01, 1.5));
    let heard = listen(&mut board, &mut scene, 3.0, 6.0);
    let text = text(&heard);
    assert_eq!(lines(&text)[..2], ["Reading: HX711 scale demo", "Readings:"], "{text}");
    let (greeted_s, _) = arrivals(&heard)[0];
    assert!((greeted_s - 4.51 - 18.0 * 10.0 / 9600.0).abs() < 0.002, "{greeted_s}");
}

#[test]
fn damage_affects_the_stated_fraction_of_lines_in_each_kind() {
    for kind in DamageKind::ALL {
        let damage = Damage { fraction: 0.2, kinds: vec![kind], seed: 3 };
        let mut board = opened(bare(1000.0).on(Port::native_usb(0.0)).damaged(damage));
        let heard = text(&listen(&mut board, &mut scene(), 0.0, 4.0));
        let damaged = board.sent().filter(|sent| !sent.whole).count();
        assert!((700..900).contains(&damaged), "{kind:?}: {damaged} of 4000");
        let wrong = lines(&heard).iter().filter(|line| **line != "84000").count();
        assert!(wrong > 500 && wrong <= 2 * damaged, "{kind:?}: {wrong} wrong lines of {damaged} damaged");
        if kind == DamageKind::Cut {
            assert!(lines(&heard).iter().all(|line| "84000".starts_with(line)));
        }
        if kind == DamageKind::Merged {
            assert!(lines(&heard).iter().all(|line| line.replace("84000", "").is_empty()));
        }
    }
}

#[test]
fn damage_is_the_same_for_the_same_seed() {
    let damage = |seed| Damage { fraction: 0.5, kinds: DamageKind::ALL.to_vec(), seed };
    let sent = |seed| {
        let mut board = opened(bare(1000.0).on(Port::native_usb(0.0)).damaged(damage(seed)));
        listen(&mut board, &mut scene(), 0.0, 1.0)
    };
    assert_eq!(sent(1), sent(1));
    assert_ne!(sent(1), sent(2));
}

/// Reads what is there now.
async fn heard(wire: &mut Wire) -> Vec<u8> {
    let mut bytes = vec![0; 1 << 16];
    let mut count = 0;
    while let Ok(read) =
        palpate_link::time::timeout(Duration::from_micros(1), wire.stream().read(&mut bytes[count..])).await
    {
        count += read.expect("the far end is open");
    }
    bytes.truncate(count);
    bytes
}

#[tokio::test(start_paused = true)]
async fn unread_lines_are_lost_without_slowing_the_board() {
    let board = shared(bare(1000.0).on(Port::native_usb(0.0)));
    let mut wire = Wire::to(board.clone(), shared(scene()), Instant::now());
    palpate_link::time::sleep(Duration::from_secs(60)).await;
    // the wire holds 8192 bytes, and some lines come while they are read
    let kept = heard(&mut wire).await.len();
    assert!((8192..8192 + 50 * 7).contains(&kept), "{kept}");
    let last_s = board.lock().expect("a board").sent().next_back().expect("a line").read_s;
    assert!(last_s > 59.9, "{last_s}");
    palpate_link::time::sleep(Duration::from_millis(50)).await;
    let fresh = String::from_utf8(heard(&mut wire).await).expect("text");
    assert!(fresh.ends_with("84000\r\n") && fresh.len() > 40 * 7, "{fresh:?}");
}

#[tokio::test(start_paused = true)]
async fn a_served_board_pushes_on_time_and_a_lost_link_is_silent() {
    let lost = SceneFault { kind: FaultKind::Stale, from_s: 5.0, value: None };
    let scene = shared(scene_with(|spec| spec.faults.push(lost)));
    let origin = Instant::now();
    let mut wire = Wire::to(shared(bare(80.0)), scene, origin);
    for line in 1..=100 {
        assert_eq!(wire.ask(b"", 7).await, b"84000\r\n");
        let took_s = origin.elapsed().as_secs_f64();
        let due_s = 1.7 + f64::from(line) / 80.0 + 7.0 * 10.0 / 57_600.0;
        assert!(took_s > due_s - 1e-6 && took_s < due_s + 0.0021, "line {line}: {took_s} {due_s}");
    }
    palpate_link::time::sleep(Duration::from_secs(3)).await;
    heard(&mut wire).await;
    assert!(wire.is_silent().await);
}

#[tokio::test(start_paused = true)]
async fn sixty_four_channels_are_served_at_a_kilohertz() {
    use crate::scene::{Elastomer, SkinSpec};
    let mut scene = crate::emulator::tests::scene_of(palpate_core::quantity::ArrayLayout::grid(8, 8, 4.5), |spec| {
        spec.skin = SkinSpec { elastomer: Some(Elastomer::half_space(5.0)), ..SkinSpec::default() };
    });
    for (axis, place_mm) in [(Axis::X, 0.0), (Axis::Y, 0.0), (Axis::Z, -0.5)] {
        scene.set_motion(axis, Trajectory::at_rest(place_mm), 0.0);
    }
    let frame = 22 * 16 + 2; // 64 outputs are those of 22 chips
    let origin = Instant::now();
    let began = std::time::Instant::now();
    let mut wire = Wire::to(shared(SerialBoard::new(ReSkin::new(1000.0))), shared(scene), origin);
    for _ in 0..10_000 {
        assert!(wire.ask(b"", frame).await.ends_with(b"\r\n"));
    }
    let virtual_s = origin.elapsed().as_secs_f64();
    println!("10000 frames of 64 channels: {virtual_s} s of the board, {:?} of this machine", began.elapsed());
    assert!((virtual_s - 10.035).abs() < 0.01, "{virtual_s}");
}

fn upset<F: BoardFirmware>(firmware: F, chunks: &[Vec<u8>]) {
    let mut scene = scene();
    let mut board = opened(SerialBoard::new(firmware).on(Port::serial(115_200.0)));
    let mut inbox = Vec::new();
    for (ms, chunk) in (0..).zip(chunks) {
        let now_s = f64::from(ms) / 100.0;
        inbox.extend_from_slice(chunk);
        while let Some(request) = board.take_request(&mut inbox) {
            assert_eq!(board.answer(&request, &mut scene, now_s), b"");
        }
        while let Owed::Pushed(bytes) = board.owed(&mut scene, now_s) {
            assert!(!bytes.is_empty());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn board_survives_arbitrary_bytes(chunks in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 0..20)) {
        upset(Hx711::new(Hx711Sketch::Demo, 80.0), &chunks);
        upset(Mark10::new(10.0), &chunks);
        upset(NetFt::new(400.0, 2.0, STRAIGHT), &chunks);
        upset(Gsv8::new(400.0, 2.0, STRAIGHT), &chunks);
        upset(Bota::new(400.0, 2.0, STRAIGHT), &chunks);
        upset(ReSkin::new(400.0), &chunks);
        upset(ReSkin::text(400.0), &chunks);
        upset(Velostat::new(b'\t', 9600.0), &chunks);
    }

    #[test]
    fn gauge_survives_arbitrary_lines(words in prop::collection::vec("(AOUT|IPOL|OPOL|\\?|N|MN|Z|NUM|LIST|)[0-9A-Zé]{0,5}\r\n?", 0..20)) {
        upset(Mark10::new(10.0), &words.into_iter().map(String::into_bytes).collect::<Vec<_>>());
    }
}
