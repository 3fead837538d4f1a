//! A serial line between a client and an emulated device: each byte takes its time, both ways.

use super::{Instrument, Shared, serve};
use crate::scene::Scene;
use palpate_core::parallel::lock;
use palpate_core::quantity::seconds;
use palpate_link::time::{Instant, sleep_until};
use palpate_link::wire::{SerialLine, in_memory};
use std::future::pending;
use std::io;
use std::pin::pin;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, split};

/// Largest number of bytes that arrive together, once the last of them is there. A frame of Modbus RTU has at most as many, and a
/// gap within one would end it.
const PIECE_BYTES: usize = 256;

/// Half the resolution of timers, which round up: so each time is the nearest, and the short ones of a quick line don't add up.
const HALF_A_GRAIN: Duration = Duration::from_micros(500);

/// Number of bytes that wait at the device's end, as behind any link in memory.
const WAITING_BYTES: usize = 4096;

/// Serves one link as [`serve`] does, over a serial line if the link names one. A request arrives when its last byte does, and
/// so does an answer. The two directions don't delay each other. A device that times its own bytes isn't delayed twice.
///
/// # Errors
/// Those of [`serve`].
pub async fn serve_on<S, I>(
    line: Option<SerialLine>,
    stream: S,
    instrument: Shared<I>,
    scene: Shared<Scene>,
    origin: Instant,
) -> io::Result<()>
where
    S: AsyncRead + AsyncWrite + Unpin,
    I: Instrument + ?Sized,
{
    let Some(line) = line else { return serve(stream, instrument, scene, origin).await };
    let is_timed = lock(&instrument).on_line(line);
    let (from_client, to_client) = split(stream);
    let (near, far) = in_memory(WAITING_BYTES);
    let (from_device, to_device) = split(near);
    let carried = |count: usize| line.time_s(count);
    let answered = |count: usize| if is_timed { 0.0 } else { line.time_s(count) };
    let asked = async {
        carry(from_client, to_device, carried).await;
        pending::<()>().await // the last requests are still to be answered
    };
    let mut answers = pin!(carry(from_device, to_client, answered));
    let served = {
        let mut served = pin!(serve(far, instrument, scene, origin));
        tokio::select! {
            biased;
            served = &mut served => served,
            () = asked => Ok(()),
            () = &mut answers => return Ok(()), // the client has gone
        }
    };
    answers.await;
    served
}

/// Carries what one end sends to the other, until either has gone: the other then reads the end of the stream.
async fn carry<R: AsyncRead + Unpin, W: AsyncWrite + Unpin>(mut from: R, mut to: W, time_s: impl Fn(usize) -> f64) {
    let mut piece = [0; PIECE_BYTES];
    let mut free = Instant::now();
    while let Ok(count @ 1..) = from.read(&mut piece).await {
        // what came while the line was busy follows without a gap
        free = free.max(Instant::now()) + seconds(time_s(count));
        sleep_until(free - HALF_A_GRAIN).await;
        if to.write_all(&piece[..count]).await.is_err() || to.flush().await.is_err() {
            break;
        }
    }
    // if it has gone, nothing is left to end
    let _ = to.shutdown().await;
}

#[cfg(test)]
mod tests {
    use super::super::lines::{Hx711, Hx711Sketch, Mark10, SerialBoard};
    use super::super::tests::{pressed, scene, shared};
    use super::super::{Modbus, Transmitter};
    use super::*;
    use palpate_link::time::run_virtually;
    use palpate_link::wire::MemoryStream;

    /// Answer of a transmitter to a read of two registers.
    const READ: [u8; 8] = [1, 3, 0, 80, 0, 2, 0xC4, 0x1A];
    const ANSWER_BYTES: usize = 9;

    /// Latency of the emulator itself, and resolution of each of the two waits for the line, s.
    const LATENCY_S: f64 = 0.001;
    const OFF_MOST_S: f64 = 0.0011;

    fn line(baud: u32, bits: u8) -> SerialLine {
        SerialLine { baud, bits }
    }

    fn wired<I: Instrument + 'static>(line: Option<SerialLine>, instrument: I, scene: Scene) -> MemoryStream {
        let (near, far) = in_memory(WAITING_BYTES);
        let served = serve_on(line, far, shared(instrument), shared(scene), Instant::now());
        drop(palpate_link::time::spawn(served));
        near
    }

    async fn asked_s(near: &mut MemoryStream, request: &[u8], count: usize) -> f64 {
        let began = Instant::now();
        near.write_all(request).await.expect("the far end is open");
        near.read_exact(&mut vec![0; count]).await.expect("an answer");
        began.elapsed().as_secs_f64()
    }

    #[test]
    fn an_exchange_takes_the_time_of_its_bytes_both_ways() {
        for (rate, expected_s) in [
            (Some(line(2400, 10)), 17.0 * 10.0 / 2400.0),
            (Some(line(9600, 10)), 17.0 * 10.0 / 9600.0),
            (Some(line(115_200, 10)), 17.0 * 10.0 / 115_200.0),
            (Some(line(9600, 11)), 17.0 * 11.0 / 9600.0),
            (None, 0.0),
        ] {
            run_virtually(async {
                let mut near = wired(rate, Modbus::rtu(Transmitter::new(5.0), 1), scene());
                for _ in 0..3 {
                    let took_s = asked_s(&mut near, &READ, ANSWER_BYTES).await;
                    assert!((took_s - expected_s - LATENCY_S).abs() < OFF_MOST_S, "{rate:?}: {took_s} {expected_s}");
                    palpate_link::time::sleep(seconds(0.1)).await;
                }
            });
        }
    }

    #[test]
    fn the_lines_of_a_board_and_its_answers_take_the_time_of_the_link_once() {
        run_virtually(async {
            let board = SerialBoard::new(Hx711::new(Hx711Sketch::Bare, 10.0));
            let mut near = wired(Some(line(1200, 10)), board, scene());
            let origin = Instant::now();
            for nth in 1..=20 {
                near.read_exact(&mut [0; 7]).await.expect("a line");
                let due_s = 1.7 + 0.1 * f64::from(nth) + 7.0 * 10.0 / 1200.0;
                let off_s = origin.elapsed().as_secs_f64() - due_s;
                assert!(off_s.abs() < OFF_MOST_S, "line {nth}: {off_s}");
            }
        });
        run_virtually(async {
            let mut near = wired(Some(line(2400, 10)), SerialBoard::new(Mark10::new(10.0)), pressed(1.0));
            let took_s = asked_s(&mut near, b"?\r", b"1.000 N\r\n".len()).await;
            let expected_s = (2 + 9) as f64 * 10.0 / 2400.0;
            assert!((took_s - expected_s - LATENCY_S).abs() < OFF_MOST_S, "{took_s} {expected_s}");
        });
    }

    #[test]
    fn a_request_that_comes_before_the_client_goes_is_answered() {
        run_virtually(async {
            let (mut near, far) = in_memory(WAITING_BYTES);
            let instrument = shared(Modbus::rtu(Transmitter::new(5.0), 1));
            let served = serve_on(Some(line(9600, 10)), far, instrument, shared(scene()), Instant::now());
            let served = palpate_link::time::spawn(served);
            near.write_all(&READ).await.expect("the far end is open");
            near.shutdown().await.expect("a link in memory");
            near.read_exact(&mut [0; ANSWER_BYTES]).await.expect("an answer");
            assert_eq!(near.read(&mut [0]).await.expect("an orderly end"), 0);
            assert!(served.is_finished());
        });
    }
}
