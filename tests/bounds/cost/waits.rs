//! Counts the threads that the program begins and its waits for a time, with strace. Neither is many instructions, and a user of live
//! readings pays for both.

use super::feed::{Feed, feed};
use std::path::Path;
use std::process::{Command, Stdio};

/// System calls that begin a thread, and those that can wait for a time.
const CALLS: &str =
    "trace=clone,clone3,futex,nanosleep,clock_nanosleep,poll,ppoll,select,pselect6,epoll_wait,epoll_pwait,epoll_pwait2";

/// Threads and waits of a run.
#[derive(Debug, Default, PartialEq)]
pub(super) struct SystemCalls {
    pub threads: usize,
    pub waits: usize,
}

impl SystemCalls {
    /// Those of the program while it answers lines through a pipe. `file` lists them afterwards.
    pub(super) fn of(
        program: &Path,
        words: &str,
        folder: &Path,
        lines: &[String],
        file: &Path,
    ) -> Result<SystemCalls, String> {
        let mut command = Command::new("strace");
        command.args(["-f", "-qq", "-e", CALLS, "-e", "signal=none", "-o"]).arg(file);
        command.arg(program).args(words.split_whitespace()).current_dir(folder).stderr(Stdio::null());
        let status = feed(command, Feed::Pipe, lines, folder, "strace");
        if !status.success() {
            return Err(format!("palpate {words}: {status}"));
        }
        let text = std::fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))?;
        Ok(SystemCalls::listed(&text))
    }

    fn listed(text: &str) -> SystemCalls {
        // a call that others interrupt has a second line without its arguments
        let calls: Vec<&str> = text.lines().filter(|line| !line.contains(" resumed>")).collect();
        let count = |is: fn(&str) -> bool| calls.iter().filter(|call| is(call)).count();
        SystemCalls { threads: count(|call| call.contains(" clone")), waits: count(is_timed) }
    }
}

/// Whether a call waits for at most a time that isn't 0. A time in a structure has its seconds in the list.
fn is_timed(call: &str) -> bool {
    if call.contains("nanosleep(") || (call.contains("WAIT") && call.contains("tv_sec=")) {
        return true;
    }
    let is_poll = ["poll(", "epoll_wait(", "epoll_pwait("].iter().any(|name| call.contains(name));
    let has_structure =
        call.contains("tv_sec=") && !call.contains("tv_sec=0, tv_nsec=0}") && !call.contains("tv_usec=0}");
    let milliseconds = call.split(") = ").next().and_then(|call| call.rsplit(", ").next()?.parse::<i64>().ok());
    (call.contains("select") || is_poll) && (has_structure || (is_poll && milliseconds.is_some_and(|ms| ms > 0)))
}

#[test]
fn threads_and_timed_waits_are_counted_and_other_calls_are_not() {
    let list = "\
10 poll([{fd=0, events=0}, {fd=1, events=0}], 2, 0) = 0 (Timeout)
10 clone3({flags=CLONE_VM|CLONE_FS, exit_signal=0, stack=0x7f}, 88) = 11
10 futex(0x7f, FUTEX_WAIT_BITSET_PRIVATE, 0, {tv_sec=5, tv_nsec=2000000}, FUTEX_BITSET_MATCH_ANY <unfinished ...>
11 futex(0x7f, FUTEX_WAKE_PRIVATE, 1) = 1
10 <... futex resumed>) = -1 ETIMEDOUT (Connection timed out)
10 futex(0x7f, FUTEX_WAIT_PRIVATE, 4, NULL) = 0
10 clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, {tv_sec=9, tv_nsec=0}, NULL) = 0
10 epoll_wait(3, [], 1024, 20) = 0
10 epoll_wait(3, [], 1024, -1) = 1
";
    assert_eq!(SystemCalls::listed(list), SystemCalls { threads: 1, waits: 3 });
}
