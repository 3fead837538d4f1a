//! Serves an instrument on a link: receives requests and sends each answer at its time.

use super::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
use palpate_core::parallel::lock;
use palpate_core::quantity::seconds;
use palpate_link::time::{Instant, sleep_until, timeout};
use std::future::pending;
use std::io;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::Notify;

/// Largest number of bytes that wait for a device on one link. The longest request of any protocol here has some 1000 bytes. A
/// client that sends more at once waits. If the full inbox contains no request, it is discarded.
pub const INBOX_MOST: usize = 1024;

/// Least time from a request to its answer. If a device answered in zero time, a polling client would spin for ever on a paused
/// clock. Tokio's timers have this resolution.
const LEAST_LATENCY: Duration = Duration::from_millis(1);

/// Longest time after which an owed answer is asked for again.
const OWED_MOST: Duration = Duration::from_secs(3600);

/// Longest time that pushed bytes wait for room on the link. After it the remaining bytes are lost.
const PUSH_MOST: Duration = Duration::from_millis(10);

/// Serves one link until its far end is closed. Requests are answered one after another, each after the scene's latency for the
/// device. Requests to a device whose link the scene has made silent are lost. An answer that the device owes is sent when it is
/// due, together with any requests meanwhile. Time zero of the scene is `origin`.
///
/// Nothing is locked during a wait, so other links and devices continue.
///
/// # Errors
/// Errors of the stream, and a device that hung up. A client that disconnected before its answer is one of these errors.
pub async fn serve<S, I>(stream: S, instrument: Shared<I>, scene: Shared<Scene>, origin: Instant) -> io::Result<()>
where
    S: AsyncRead + AsyncWrite + Unpin,
    I: Instrument + ?Sized,
{
    let own = lock(&instrument).accept();
    match own {
        Some(own) => Served::new(&*own, &scene, origin).serve(stream).await,
        None => Served::new(&*instrument, &scene, origin).serve(stream).await,
    }
}

/// Instrument on one link.
struct Served<'a, I: ?Sized> {
    instrument: &'a Mutex<I>,
    scene: &'a Mutex<Scene>,
    origin: Instant,
    device: SceneDevice,
    bell: Option<Arc<Notify>>,
}

impl<'a, I: Instrument + ?Sized> Served<'a, I> {
    fn new(instrument: &'a Mutex<I>, scene: &'a Mutex<Scene>, origin: Instant) -> Self {
        let own = lock(instrument);
        let (device, bell) = (own.device(), own.bell());
        drop(own);
        Served { instrument, scene, origin, device, bell }
    }

    async fn serve<S: AsyncRead + AsyncWrite + Unpin>(&self, mut stream: S) -> io::Result<()> {
        let silence = lock(self.instrument).silence();
        let mut inbox = Vec::with_capacity(INBOX_MOST);
        let mut chunk = [0; INBOX_MOST];
        let mut answered = None;
        loop {
            while let Some(request) = self.take_request(&mut inbox) {
                if let Some(at) = self.exchange(&mut stream, &request).await? {
                    answered = Some(at);
                    if silence.is_some() {
                        inbox.clear(); // it came before the answer
                    }
                }
            }
            if inbox.len() == INBOX_MOST {
                inbox.clear();
            }
            let chunk = &mut chunk[..INBOX_MOST - inbox.len()];
            let received = match silence {
                Some(silence) if !inbox.is_empty() => timeout(silence, stream.read(chunk)).await.ok(),
                _ => Some(self.hear(&mut stream, chunk).await),
            };
            match received {
                Some(Ok(0)) => return Ok(()),
                Some(count) => {
                    inbox.extend_from_slice(&chunk[..count?]);
                    if let Some((silence, answered)) = silence.zip(answered)
                        && answered + silence > Instant::now()
                    {
                        // no silence after the answer: the frame isn't recognised as one
                        until_silent(&mut stream, silence).await?;
                        inbox.clear();
                    }
                }
                None => {
                    if let Some(request) = self.fall_silent(&mut inbox) {
                        answered = self.exchange(&mut stream, &request).await?.or(answered);
                    }
                }
            }
        }
    }

    /// Acts on a request and sends its answer. Returns the time at which sending began; `None` without an answer.
    async fn exchange<S: AsyncWrite + Unpin>(&self, stream: &mut S, request: &[u8]) -> io::Result<Option<Instant>> {
        let deaf_until = self.origin + seconds(lock(self.instrument).deaf_until_s());
        let mut now = Instant::now();
        if deaf_until > now {
            self.pass(stream, deaf_until).await?;
            now = Instant::now();
        }
        let Some(latency) = self.latency(now) else { return Ok(None) };
        self.pass(stream, now + latency).await?;
        let answer = self.answer(request);
        // taken before it is sent: a busy system may continue this program only after the client has the answer
        let now = Instant::now();
        send(stream, &answer).await?;
        Ok((!answer.is_empty()).then_some(now))
    }

    /// Waits for bytes, and returns their number. Owed answers are sent during the wait.
    async fn hear<S: AsyncRead + AsyncWrite + Unpin>(&self, stream: &mut S, chunk: &mut [u8]) -> io::Result<usize> {
        let Some(bell) = &self.bell else { return stream.read(chunk).await };
        loop {
            // made before the delayed answers are looked up, so that an event in between isn't missed
            let rung = bell.notified();
            let again = self.settle(stream).await?;
            tokio::select! {
                biased;
                count = stream.read(chunk) => return count,
                () = rung => {}
                () = at(again) => {}
            }
        }
    }

    /// Waits until a time. Owed answers are sent during the wait.
    async fn pass<S: AsyncWrite + Unpin>(&self, stream: &mut S, until: Instant) -> io::Result<()> {
        let Some(bell) = &self.bell else {
            sleep_until(until).await;
            return Ok(());
        };
        loop {
            let rung = bell.notified();
            let again = self.settle(stream).await?;
            tokio::select! {
                biased;
                () = sleep_until(until) => return Ok(()),
                () = rung => {}
                () = at(again) => {}
            }
        }
    }

    /// Sends the answers that are owed now. Returns the time to ask again; `None` means not before the notification.
    async fn settle<S: AsyncWrite + Unpin>(&self, stream: &mut S) -> io::Result<Option<Instant>> {
        loop {
            match self.owed() {
                Owed::Nothing => return Ok(None),
                Owed::At(at_s) => {
                    let now = Instant::now();
                    let wait_s = (at_s - (now - self.origin).as_secs_f64()).min(OWED_MOST.as_secs_f64());
                    return Ok(Some(now + seconds(wait_s).max(LEAST_LATENCY)));
                }
                Owed::Ready(reply) => {
                    if self.latency(Instant::now()).is_some() {
                        send(stream, &reply).await?;
                    }
                }
                Owed::Pushed(bytes) => {
                    if self.latency(Instant::now()).is_some()
                        && let Ok(sent) = timeout(PUSH_MOST, send(stream, &bytes)).await
                    {
                        sent?;
                    }
                }
                Owed::HungUp => return Err(io::ErrorKind::ConnectionReset.into()),
            }
        }
    }

    // A guard that lives in an expression with an await lives across it: hence these take their locks in functions of their own.

    fn take_request(&self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        lock(self.instrument).take_request(inbox)
    }

    fn fall_silent(&self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        lock(self.instrument).fall_silent(inbox)
    }

    /// Latency of an answer. `None` if the link is silent: the request or the answer is lost.
    fn latency(&self, now: Instant) -> Option<Duration> {
        let now_s = (now - self.origin).as_secs_f64();
        let latency_s = lock(self.scene).latency_s(self.device, now_s)?;
        Some(seconds(latency_s).max(LEAST_LATENCY))
    }

    fn answer(&self, request: &[u8]) -> Vec<u8> {
        self.with_both(|instrument, scene, now_s| instrument.answer(request, scene, now_s))
    }

    fn owed(&self) -> Owed {
        self.with_both(|instrument, scene, now_s| instrument.owed(scene, now_s))
    }

    /// Locks the instrument before the scene. Nowhere else are both locked at once.
    fn with_both<T>(&self, act: impl FnOnce(&mut I, &mut Scene, f64) -> T) -> T {
        let mut instrument = lock(self.instrument);
        let mut scene = lock(self.scene);
        // read under both locks: links of one scene never set an earlier time after a later one
        let now_s = (Instant::now() - self.origin).as_secs_f64();
        act(&mut instrument, &mut scene, now_s)
    }
}

async fn send<S: AsyncWrite + Unpin>(stream: &mut S, reply: &[u8]) -> io::Result<()> {
    if !reply.is_empty() {
        stream.write_all(reply).await?;
        stream.flush().await?;
    }
    Ok(())
}

/// Discards what arrives until nothing has arrived for a time, or the far end is closed.
async fn until_silent<S: AsyncRead + Unpin>(stream: &mut S, silence: Duration) -> io::Result<()> {
    let mut stray = [0; INBOX_MOST];
    while let Ok(count) = timeout(silence, stream.read(&mut stray)).await {
        if count? == 0 {
            break;
        }
    }
    Ok(())
}

async fn at(instant: Option<Instant>) {
    match instant {
        Some(instant) => sleep_until(instant).await,
        None => pending().await,
    }
}

#[cfg(test)]
mod tests {
    use super::super::Esp301Emulator;
    use super::super::tests::{POWER_ON, Wire, scene, scene_with, shared};
    use super::*;
    use crate::scene::{FaultKind, SceneFault};
    use palpate_core::quantity::Axis;
    use palpate_link::time::sleep;

    /// Sends back each byte, and is deaf for a second after a `!`.
    struct ServeEcho {
        deaf_until_s: f64,
    }

    impl Instrument for ServeEcho {
        fn device(&self) -> SceneDevice {
            SceneDevice::Array
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
        let mut wire = Wire::to(shared(ServeEcho { deaf_until_s: 0.0 }), scene, origin);
        assert_eq!(wire.ask(b"a", 1).await, b"a");
        // the array of the test bed answers at once: what passes is the least latency
        let took = Instant::now() - origin;
        assert!(took >= Duration::from_millis(1) && took <= Duration::from_millis(2), "{took:?}");
        assert_eq!(wire.ask(b"bcd", 3).await, b"bcd");
        assert!(Instant::now() - origin >= Duration::from_millis(4));
    }

    #[tokio::test(start_paused = true)]
    async fn deaf_device_answers_late_on_every_link_and_others_continue() {
        let scene = shared(scene());
        let origin = Instant::now();
        let instrument = shared(ServeEcho { deaf_until_s: 0.0 });
        let mut first = Wire::to(instrument.clone(), scene.clone(), origin);
        let mut second = Wire::to(instrument, scene.clone(), origin);
        let mut other = Wire::to(shared(ServeEcho { deaf_until_s: 0.0 }), scene, origin);
        first.ask(b"!", 1).await;
        other.ask(b"a", 1).await;
        assert!(Instant::now() - origin < Duration::from_millis(10));
        second.ask(b"a", 1).await;
        assert!(Instant::now() - origin > Duration::from_secs(1));
    }

    #[tokio::test(start_paused = true)]
    async fn full_inbox_without_a_request_is_discarded() {
        /// Takes only a `.` at the front.
        struct Picky;
        impl Instrument for Picky {
            fn device(&self) -> SceneDevice {
                SceneDevice::Array
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
        let echo = shared(ServeEcho { deaf_until_s: 0.0 });
        assert!(serve(far, echo, shared(scene()), Instant::now()).await.is_ok());
    }

    #[tokio::test(start_paused = true)]
    async fn silent_link_loses_requests_and_others_continue() {
        let lost = SceneFault { kind: FaultKind::StageLost, from_s: 0.5, value: None };
        let scene = shared(scene_with(|spec| spec.faults.push(lost)));
        let origin = Instant::now();
        let esp = shared(Esp301Emulator::new(&lock(&scene)));
        let mut stage = Wire::to(esp, scene.clone(), origin);
        assert_eq!(stage.ask(b"1MO;1PA1;1MO?\r", 3).await, b"1\r\n");
        sleep(Duration::from_secs(1)).await;
        stage.send(b"1PA5;1MD?\r").await;
        assert!(stage.is_silent().await);
        let mut other = Wire::to(shared(ServeEcho { deaf_until_s: 0.0 }), scene.clone(), origin);
        assert_eq!(other.ask(b"a", 1).await, b"a");
        let way_mm = lock(&scene).axis(Axis::X, 60.0).0 - POWER_ON.x_mm;
        assert!((way_mm - 1.0).abs() < 1e-9, "it ended what it had begun, and began nothing: {way_mm} mm");
    }

    /// Owes each `w` its answer after a second, or at once when a `!` comes on any link; meanwhile a `w` gets a `-`.
    struct Late {
        called: Shared<bool>,
        bell: Arc<Notify>,
        due_s: Option<f64>,
    }

    impl Late {
        fn new(called: Shared<bool>, bell: Arc<Notify>) -> Self {
            Late { called, bell, due_s: None }
        }
    }

    impl Instrument for Late {
        fn device(&self) -> SceneDevice {
            SceneDevice::Stage
        }
        fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
            (!inbox.is_empty()).then(|| vec![inbox.remove(0)])
        }
        fn answer(&mut self, request: &[u8], _: &mut Scene, now_s: f64) -> Vec<u8> {
            match (request, self.due_s) {
                (b"w", None) => self.due_s = Some(now_s + 1.0),
                (b"!", _) => {
                    *lock(&self.called) = true;
                    self.bell.notify_waiters();
                }
                _ => return b"-".to_vec(),
            }
            Vec::new()
        }
        fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
            Some(shared(Late::new(self.called.clone(), self.bell.clone())))
        }
        fn bell(&self) -> Option<Arc<Notify>> {
            Some(self.bell.clone())
        }
        fn owed(&mut self, _: &mut Scene, now_s: f64) -> Owed {
            match self.due_s {
                None => Owed::Nothing,
                Some(due_s) if now_s < due_s && !*lock(&self.called) => Owed::At(due_s),
                Some(_) => {
                    self.due_s = None;
                    Owed::Ready(b"W".to_vec())
                }
            }
        }
    }

    #[tokio::test(start_paused = true)]
    async fn delayed_answer_comes_when_due_and_delays_no_other() {
        let scene = shared(scene());
        let origin = Instant::now();
        let late = shared(Late::new(shared(false), Arc::default()));
        let mut first = Wire::to(late.clone(), scene.clone(), origin);
        let mut second = Wire::to(late, scene.clone(), origin);
        first.send(b"w").await;
        // the state of a link is its own
        assert_eq!(first.ask(b"w", 1).await, b"-");
        second.send(b"w").await;
        assert!(Instant::now() - origin < Duration::from_millis(10));
        assert_eq!(first.ask(b"", 1).await, b"W");
        let took = Instant::now() - origin;
        assert!(took > Duration::from_secs(1) && took < Duration::from_millis(1010), "{took:?}");
        assert_eq!(second.ask(b"", 1).await, b"W");
        assert!(first.is_silent().await && second.is_silent().await);
    }

    #[tokio::test(start_paused = true)]
    async fn event_on_one_link_wakes_a_waiting_link() {
        let scene = shared(scene());
        let origin = Instant::now();
        let late = shared(Late::new(shared(false), Arc::default()));
        let mut first = Wire::to(late.clone(), scene.clone(), origin);
        let mut second = Wire::to(late, scene, origin);
        first.send(b"w").await;
        sleep(Duration::from_millis(100)).await;
        second.send(b"!").await;
        assert_eq!(first.ask(b"", 1).await, b"W");
        assert!(Instant::now() - origin < Duration::from_millis(110));
    }

    #[tokio::test(start_paused = true)]
    async fn delayed_answer_is_on_time_during_the_next_request_of_a_slow_link() {
        let scene = shared(scene_with(|spec| spec.latencies.stage_s = (0.8, 0.8)));
        let origin = Instant::now();
        let mut wire = Wire::to(shared(Late::new(shared(false), Arc::default())), scene, origin);
        wire.send(b"w").await;
        sleep(Duration::from_millis(1500)).await;
        // acted on at 0.8 s, due at 1.8 s; this one would be acted on at 2.3 s
        assert_eq!(wire.ask(b"?", 1).await, b"W");
        assert!((Instant::now() - origin).as_secs_f64() < 1.81);
        assert_eq!(wire.ask(b"", 1).await, b"-");
    }

    #[tokio::test(start_paused = true)]
    async fn delayed_answer_is_lost_with_its_link() {
        let lost = SceneFault { kind: FaultKind::StageLost, from_s: 0.5, value: None };
        let scene = shared(scene_with(|spec| spec.faults.push(lost)));
        let mut wire = Wire::to(shared(Late::new(shared(false), Arc::default())), scene, Instant::now());
        wire.send(b"w").await;
        assert!(wire.is_silent().await && wire.is_silent().await);
    }
}
