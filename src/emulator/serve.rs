use super::{Instrument, Shared};
use crate::scene::Scene;
use std::io;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::time::{Instant, sleep, sleep_until, timeout};

/// Most bytes that wait for a device on one link. The longest request of any protocol here has 260 bytes; a client that
/// sends more at once waits, and what fills the inbox without holding one request is thrown away.
pub const INBOX_MOST: usize = 1024;

/// Least time from a request to its answer. A device that answered in no time would let a polling client spin for ever
/// on a paused clock, and tokio's timers have this grain.
const LEAST_LATENCY: Duration = Duration::from_millis(1);

/// Serves one link until its far end is closed: requests are answered one after another, each after the scene's latency
/// for the device; those to a device whose link the scene has gone silent are lost. `origin` is the instant the scene counts from.
///
/// Nothing is locked while this waits, so other links and other devices go on meanwhile.
///
/// # Errors
/// What the stream reports. That the client has gone while an answer was due is one of these.
pub async fn serve<S, I>(mut stream: S, instrument: Shared<I>, scene: Shared<Scene>, origin: Instant) -> io::Result<()>
where
    S: AsyncRead + AsyncWrite + Unpin,
    I: Instrument + ?Sized,
{
    let silence = lock(&instrument).silence();
    let mut inbox = Vec::with_capacity(INBOX_MOST);
    let mut chunk = [0; INBOX_MOST];
    loop {
        while let Some(request) = take_request(&instrument, &mut inbox) {
            exchange(&mut stream, &request, &instrument, &scene, origin).await?;
        }
        if inbox.len() == INBOX_MOST {
            inbox.clear();
        }
        let room = INBOX_MOST - inbox.len();
        let arrival = stream.read(&mut chunk[..room]);
        let received = match silence {
            Some(silence) if !inbox.is_empty() => timeout(silence, arrival).await.ok(),
            _ => Some(arrival.await),
        };
        match received {
            Some(Ok(0)) => return Ok(()),
            Some(count) => inbox.extend_from_slice(&chunk[..count?]),
            None => {
                if let Some(request) = fall_silent(&instrument, &mut inbox) {
                    exchange(&mut stream, &request, &instrument, &scene, origin).await?;
                }
            }
        }
    }
}

async fn exchange<S, I>(
    stream: &mut S,
    request: &[u8],
    instrument: &Mutex<I>,
    scene: &Mutex<Scene>,
    origin: Instant,
) -> io::Result<()>
where
    S: AsyncWrite + Unpin,
    I: Instrument + ?Sized,
{
    let deaf_until = origin + duration(lock(instrument).deaf_until_s());
    if deaf_until > Instant::now() {
        sleep_until(deaf_until).await;
    }
    let Some(latency) = latency(instrument, scene, origin) else { return Ok(()) };
    sleep(latency).await;
    let reply = answer(request, instrument, scene, origin);
    if !reply.is_empty() {
        stream.write_all(&reply).await?;
        stream.flush().await?;
    }
    Ok(())
}

// A guard that lives in an expression with an await lives across it: hence these take their locks in functions of their own.

fn take_request<I: Instrument + ?Sized>(instrument: &Mutex<I>, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
    lock(instrument).take_request(inbox)
}

fn fall_silent<I: Instrument + ?Sized>(instrument: &Mutex<I>, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
    lock(instrument).fall_silent(inbox)
}

/// None where the link is silent: the request is lost.
fn latency<I: Instrument + ?Sized>(instrument: &Mutex<I>, scene: &Mutex<Scene>, origin: Instant) -> Option<Duration> {
    let device = lock(instrument).device();
    let now_s = (Instant::now() - origin).as_secs_f64();
    let latency_s = lock(scene).latency_s(device, now_s)?;
    Some(duration(latency_s).max(LEAST_LATENCY))
}

/// The instrument is locked before the scene, here and nowhere else both at once.
fn answer<I: Instrument + ?Sized>(
    request: &[u8],
    instrument: &Mutex<I>,
    scene: &Mutex<Scene>,
    origin: Instant,
) -> Vec<u8> {
    let mut instrument = lock(instrument);
    let mut scene = lock(scene);
    // read under both locks: links of one scene never hand it an earlier time after a later one
    let now_s = (Instant::now() - origin).as_secs_f64();
    instrument.answer(request, &mut scene, now_s)
}

/// What no clock can wait for (negative, not finite, beyond the range) is no wait.
fn duration(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}

fn lock<T: ?Sized>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::super::Esp301;
    use super::super::testbed::{POWER_ON, Wire, scene, scene_with, shared};
    use super::*;
    use crate::quantity::Axis;
    use crate::scene::{Device, Fault, FaultKind};

    /// Sends back each byte, and is deaf for a second after a `!`.
    struct Echo {
        deaf_until_s: f64,
    }

    impl Instrument for Echo {
        fn device(&self) -> Device {
            Device::Array
        }
        fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
            (!inbox.is_empty()).then(|| vec![inbox.remove(0)])
        }
        fn answer(&mut self, request: &[u8], _: &mut Scene, now_s: f64) -> Vec<u8> {
            if request == b"!" {
                self.deaf_until_s = now_s + 1.0;
            }
            request.to_vec()
        }
        fn deaf_until_s(&self) -> f64 {
            self.deaf_until_s
        }
    }

    #[tokio::test(start_paused = true)]
    async fn each_answer_takes_the_latency_of_the_scene_and_at_least_a_millisecond() {
        let scene = shared(scene());
        let origin = Instant::now();
        let mut wire = Wire::to(shared(Echo { deaf_until_s: 0.0 }), scene, origin);
        assert_eq!(wire.ask(b"a", 1).await, b"a");
        // the array of the test bed answers at once: what passes is the least latency
        let took = Instant::now() - origin;
        assert!(took >= Duration::from_millis(1) && took <= Duration::from_millis(2), "{took:?}");
        assert_eq!(wire.ask(b"bcd", 3).await, b"bcd");
        assert!(Instant::now() - origin >= Duration::from_millis(4));
    }

    #[tokio::test(start_paused = true)]
    async fn a_deaf_device_answers_late_whatever_link_it_is_asked_on_and_others_go_on() {
        let scene = shared(scene());
        let origin = Instant::now();
        let instrument = shared(Echo { deaf_until_s: 0.0 });
        let mut first = Wire::to(instrument.clone(), scene.clone(), origin);
        let mut second = Wire::to(instrument, scene.clone(), origin);
        let mut other = Wire::to(shared(Echo { deaf_until_s: 0.0 }), scene, origin);
        first.ask(b"!", 1).await;
        other.ask(b"a", 1).await;
        assert!(Instant::now() - origin < Duration::from_millis(10));
        second.ask(b"a", 1).await;
        assert!(Instant::now() - origin > Duration::from_secs(1));
    }

    #[tokio::test(start_paused = true)]
    async fn an_inbox_that_is_full_of_nothing_is_thrown_away() {
        /// Takes only a `.` at the front.
        struct Picky;
        impl Instrument for Picky {
            fn device(&self) -> Device {
                Device::Array
            }
            fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
                (inbox.first() == Some(&b'.')).then(|| vec![inbox.remove(0)])
            }
            fn answer(&mut self, request: &[u8], _: &mut Scene, _: f64) -> Vec<u8> {
                request.to_vec()
            }
        }
        let mut wire = Wire::to(shared(Picky), shared(scene()), Instant::now());
        wire.send(&vec![b'x'; INBOX_MOST * 3]).await;
        assert_eq!(wire.ask(b".", 1).await, b".");
    }

    #[tokio::test(start_paused = true)]
    async fn serving_ends_with_the_link() {
        let (near, far) = tokio::io::duplex(64);
        drop(near);
        let echo = shared(Echo { deaf_until_s: 0.0 });
        assert!(serve(far, echo, shared(scene()), Instant::now()).await.is_ok());
    }

    #[tokio::test(start_paused = true)]
    async fn a_silent_link_loses_what_is_asked_and_others_go_on() {
        let lost = Fault { kind: FaultKind::StageLost, from_s: 0.5, value: None };
        let scene = shared(scene_with(|spec| spec.faults.push(lost)));
        let origin = Instant::now();
        let esp = shared(Esp301::new(&lock(&scene)));
        let mut stage = Wire::to(esp, scene.clone(), origin);
        assert_eq!(stage.ask(b"1MO;1PA1;1MO?\r", 3).await, b"1\r\n");
        sleep(Duration::from_secs(1)).await;
        stage.send(b"1PA5;1MD?\r").await;
        assert!(stage.is_silent().await);
        let mut other = Wire::to(shared(Echo { deaf_until_s: 0.0 }), scene.clone(), origin);
        assert_eq!(other.ask(b"a", 1).await, b"a");
        let way_mm = lock(&scene).axis(Axis::X, 60.0).0 - POWER_ON.x_mm;
        assert!((way_mm - 1.0).abs() < 1e-9, "it ended what it had begun, and began nothing: {way_mm} mm");
    }
}
