//! Virtual time against tokio's paused clock: the same tasks, in the same order, at the same moments.

use super::*;
use crate::wire::{Duplex, in_memory};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, duplex};
use tokio::sync::Notify;

fn paused<T>(future: impl Future<Output = T>) -> T {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build();
    runtime.unwrap().block_on(future)
}

/// What happened, and when, us after the start.
#[derive(Clone)]
struct Log(Arc<Mutex<Vec<(u128, String)>>>, Instant);

impl Log {
    fn begin() -> Self {
        Log(Arc::default(), Instant::now())
    }

    fn add(&self, text: String) {
        self.0.lock().unwrap().push((self.1.elapsed().as_micros(), text));
    }

    fn end(self) -> Vec<(u128, String)> {
        std::mem::take(&mut self.0.lock().unwrap())
    }
}

/// Number of bytes that wait on the link of [`tasks`]: so few that its writers wait too.
const LINK_BYTES: usize = 2;

/// Some tasks that wait, notify each other and exchange bytes, at times of which many are equal or not whole milliseconds.
async fn tasks<S: Duplex + 'static>(seed: u64, (mut near, mut far): (S, S)) -> Vec<(u128, String)> {
    let (log, bell, mut random) = (Log::begin(), Arc::new(Notify::new()), Pcg64Mcg::seed_from_u64(seed));
    let mut spawned = Vec::new();
    for task in 0..8 {
        let (log, bell, waits) = (log.clone(), bell.clone(), [(); 40].map(|()| random.random_range(0..6000_u64)));
        spawned.push(spawn(async move {
            for (turn, wait) in waits.into_iter().enumerate() {
                // a third of the waits have equal times
                let time = Duration::from_micros(if wait % 3 == 0 { wait / 1000 * 1000 } else { wait });
                match wait % 4 {
                    0 => sleep(time).await,
                    1 => {
                        let is_late = timeout(time, bell.notified()).await.is_err();
                        log.add(format!("{task}.{turn} late {is_late}"));
                    }
                    2 => bell.notify_waiters(),
                    _ => tokio::select! {
                        biased;
                        () = bell.notified() => log.add(format!("{task}.{turn} bell")),
                        () = sleep_until(Instant::now() + time) => {}
                    },
                }
                log.add(format!("{task}.{turn}"));
            }
        }));
    }
    let echo = spawn(async move {
        let mut byte = [0];
        while far.read_exact(&mut byte).await.is_ok() {
            sleep(Duration::from_micros(u64::from(byte[0]) * 7)).await;
            if far.write_all(&byte).await.is_err() {
                break;
            }
        }
    });
    for turn in 0..60 {
        near.write_all(&[random.random()]).await.unwrap();
        let answered = timeout(Duration::from_micros(1500), near.read_u8()).await;
        log.add(format!("run {turn} {answered:?}", answered = answered.map(Result::unwrap)));
    }
    spawned[0].abort();
    sleep(Duration::from_millis(1)).await;
    log.add(format!("ended {}", spawned[0].is_finished()));
    drop(near);
    sleep(Duration::from_secs(1)).await;
    log.add(format!("echo {}", echo.is_finished()));
    log.end()
}

#[test]
fn order_and_times_equal_those_of_tokios_paused_clock() {
    for seed in 0..40 {
        let (ours, tokios) =
            (run_virtually(tasks(seed, in_memory(LINK_BYTES))), paused(tasks(seed, duplex(LINK_BYTES))));
        assert!(ours.len() > 300 && ours.last().is_some_and(|last| last.1 == "echo true"));
        assert_eq!(ours, tokios, "seed {seed}");
    }
}

#[test]
fn hours_pass_at_once_and_a_short_wait_lasts_a_millisecond() {
    let passed = run_virtually(async {
        let began = Instant::now();
        sleep(Duration::from_nanos(1)).await;
        let short = began.elapsed();
        sleep(Duration::from_secs(36_000)).await;
        (short, began.elapsed())
    });
    assert_eq!(passed, (Duration::from_millis(1), Duration::from_secs(36_000) + Duration::from_millis(1)));
}

#[test]
fn another_thread_wakes_a_run_that_waits_for_nothing_else() {
    let (bell, is_rung) = (Arc::new(Notify::new()), Arc::new(AtomicBool::new(false)));
    let (there, flag) = (bell.clone(), is_rung.clone());
    let ringer = thread::spawn(move || {
        flag.store(true, Ordering::SeqCst);
        there.notify_one();
    });
    let woken = run_virtually(async move {
        let (task, done) = (bell.clone(), Arc::new(Notify::new()));
        let ended = done.clone();
        drop(spawn(async move {
            task.notified().await;
            done.notify_one();
        }));
        ended.notified().await;
        is_rung.load(Ordering::SeqCst)
    });
    ringer.join().unwrap();
    assert!(woken);
}

#[test]
fn a_run_that_ends_drops_its_tasks_and_leaves_real_time_behind() {
    let held = Arc::new(());
    let inner = held.clone();
    run_virtually(async move {
        drop(spawn(async move {
            sleep(Duration::from_secs(3600)).await;
            drop(inner);
        }));
        sleep(Duration::from_millis(1)).await;
    });
    assert_eq!(Arc::strong_count(&held), 1);
    assert_eq!(paused(async { timeout(Duration::from_millis(5), std::future::pending::<()>()).await }), Err(Elapsed));
    let again = std::panic::catch_unwind(|| run_virtually(async { panic!("ended") }));
    assert!(again.is_err() && run_virtually(async { 7 }) == 7);
}
