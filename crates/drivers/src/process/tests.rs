//! Drivers of programs against answers from a script.

use super::*;
use crate::script::{Script, made_ready, scripted, usage, ways};
use palpate_core::quantity::Axis;
use palpate_link::device::{LoadCell, MotionOrders, SensorArray, Stage};
use palpate_link::time::Instant;
use palpate_link::wire::Connector;
use std::time::Duration;

const START: Duration = Duration::from_secs(10);

#[tokio::test(start_paused = true)]
async fn a_program_that_is_slow_to_start_is_awaited() {
    for (start_s, is_in_time) in [(10, true), (5, false)] {
        let (near, mut far) = tokio::io::duplex(4096);
        let near = std::sync::Mutex::new(Some(near));
        let link = Connector::in_memory(move || near.lock().unwrap().take().expect("one connection"));
        let program = tokio::spawn(async move {
            palpate_link::time::sleep(Duration::from_secs(7)).await; // its libraries are loaded
            let answer = b"{\"id\": 1, \"role\": \"stage\", \"protocol\": 2, \"identity\": \"mine\"}\n";
            let _ = tokio::io::AsyncWriteExt::write_all(&mut far, answer).await;
            far
        });
        let mut stage = ProcessStage::new(link, "script".to_owned(), Duration::from_secs(start_s));
        let identified = stage.identify(&usage()).await;
        assert_eq!(identified.is_ok(), is_in_time, "{identified:?}");
        program.abort();
    }
}

#[tokio::test(start_paused = true)]
async fn stage_is_prepared_moved_and_stopped_as_documented() {
    let (link, device) = scripted(&[
        (
            b"{\"do\":\"identify\",\"id\":1}\n",
            b"{\"id\": 1, \"role\": \"stage\", \"protocol\": 2, \"identity\": \"mine, SN 7\"}\n",
        ),
        (
            b"{\"acceleration_mm_s2\":100.0,\"away\":1.0,\"do\":\"prepare\",\"home_speed_mm_s\":2.0,\"id\":2,\"speed_mm_s\":10.0,\
              \"travel_mm\":{\"x\":[-12.5,12.5],\"y\":[-12.5,12.5],\"z\":[-12.5,12.5]}}\n",
            b"{\"id\": 2}\n",
        ),
        (
            b"{\"do\":\"status\",\"id\":3}\n",
            b"{\"id\": 3, \"moving\": false, \"position_mm\": {\"x\": 0.0, \"y\": 0, \"z\": 12.5}}\n",
        ),
        (
            b"{\"do\":\"status\",\"id\":4}\n",
            b"{\"id\": 4, \"moving\": false, \"position_mm\": {\"x\": 0.0, \"y\": 0, \"z\": 0.0}}\n",
        ),
        (
            b"{\"by_mm\":{\"z\":-0.25},\"do\":\"move\",\"from_mm\":{\"z\":0.0},\"id\":5,\"speed_mm_s\":1.5}\n",
            b"{\"id\": 5}\n",
        ),
        (b"{\"do\":\"stop\"}\n", b""),
        (
            b"{\"do\":\"status\",\"id\":6}\n",
            b"{\"id\": 5, \"moving\": true}\nwhat?\n\
              {\"id\": 6, \"moving\": false, \"position_mm\": {\"x\": 0.0, \"y\": 0, \"z\": 0.5}}\n",
        ),
    ]);
    let mut stage = ProcessStage::new(link, "script".to_owned(), START);
    let orders = MotionOrders::default();
    assert_eq!(made_ready(&mut stage, &usage(), &orders).await.unwrap().identity, "mine, SN 7");
    stage.begin(&ways(&[(Axis::Z, -0.25)]), 1.5, &MotionOrders::default()).await.unwrap();
    orders.stop();
    let places_mm = stage.follow(&[Axis::Z], Duration::from_secs(8), &orders).await.unwrap();
    assert_eq!(places_mm, [0.5], "a late answer and what isn't one are passed over");
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn readers_accept_only_complete_finite_answers() {
    let (link, device) = scripted(&[
        (b"{\"do\":\"read\",\"id\":1}\n", b"{\"id\": 1, \"force_n\": 0.0132, \"saturated\": true}\n"),
        (b"{\"do\":\"read\",\"id\":2}\n", b"{\"id\": 2, \"force_n\": 2.5, \"saturated\": 1, \"fault\": 0}\n"),
        (b"{\"do\":\"read\",\"id\":3}\n", b"{\"id\": 3, \"force\": 0.0132}\n"),
        (b"{\"do\":\"read\",\"id\":4}\n", b"{\"id\": 4, \"error\": \"no bridge\"}\n"),
    ]);
    let mut cell = ProcessLoadCell::new(link, "script".to_owned(), START, 200.0, Instant::now());
    let reading = cell.read().await.unwrap();
    assert!(reading.force_n == 0.0132 && reading.health.saturated && !reading.health.fault);
    let reading = cell.read().await.unwrap();
    assert!(reading.health.saturated && !reading.health.fault, "1 is true, and 0 is false");
    assert!(cell.read().await.unwrap_err().to_string().contains("expected \"force_n\", a number"));
    assert!(cell.read().await.unwrap_err().to_string().contains("it reports: no bridge"));
    drop(cell);
    device.await.unwrap();

    for answer in ["[1.0, 2.0]", "[1.0, null, 3.0]", "[1.0, 2.0, 1e999]", "3.0"] {
        let answer = format!("{{\"id\": 1, \"outputs\": {answer}}}\n").into_bytes();
        let script: Script =
            Box::leak(Box::new([(b"{\"do\":\"read\",\"id\":1}\n".as_slice(), &*Box::leak(answer.into_boxed_slice()))]));
        let (link, device) = scripted(script);
        let mut array = ProcessArray::new(link, "script".to_owned(), START, 3);
        assert!(array.read(&mut [0.0; 3]).await.is_err());
        drop(array);
        device.abort();
    }
}

#[tokio::test(start_paused = true)]
async fn a_program_of_another_role_and_one_that_ended_are_reported() {
    let identify = b"{\"do\":\"identify\",\"id\":1}\n".as_slice();
    let script: Script = Box::leak(Box::new([(
        identify,
        b"{\"id\": 1, \"role\": \"array\", \"protocol\": 1, \"identity\": \"mine\"}\n".as_slice(),
    )]));
    let (link, device) = scripted(script);
    let mut cell = ProcessLoadCell::new(link, "script".to_owned(), START, 200.0, Instant::now());
    assert!(cell.prepare().await.unwrap_err().to_string().contains("expected \"role\": \"load_cell\""));
    drop(cell);
    device.await.unwrap();

    let (near, far) = tokio::io::duplex(64);
    drop(far);
    let near = std::sync::Mutex::new(Some(near));
    let dial = move || near.lock().unwrap().take().expect("it isn't started again");
    let link = palpate_link::wire::Connector::in_memory(dial);
    let mut cell = ProcessLoadCell::new(link, "script".to_owned(), START, 200.0, Instant::now());
    assert!(cell.read().await.is_err());
    assert!(cell.read().await.unwrap_err().to_string().contains("the program has ended"));
}
