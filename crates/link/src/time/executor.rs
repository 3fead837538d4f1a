//! Executes a simulated run in virtual time, in the order of tokio's paused clock.
//!
//! Tasks that are ready run in the order in which they were woken. When none is left, the run itself continues if it was woken.
//! Otherwise the clock jumps to the next deadline, and wakes those who wait for it in the order in which they began to wait.
//! Deadlines are rounded up to whole milliseconds after the start, as tokio's timers are.

use super::Instant;
use palpate_core::parallel::lock;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::fmt;
use std::future::Future;
use std::pin::{Pin, pin};
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Wake, Waker};
use std::thread::{self, Thread};

/// Number of tasks that run before the run itself is asked again, though others are ready: tokio's `event_interval` of a run.
const TASKS_MOST: usize = 1024;

type Work = Pin<Box<dyn Future<Output = ()> + Send>>;

thread_local! {
    /// The present moment, on a thread that executes a simulated run; else 0.
    static NOW_NS: Cell<u64> = const { Cell::new(0) };
    static CLOCK: RefCell<Clock> = const { RefCell::new(Clock::new()) };
    /// The run that this thread executes, and its number; 0 without a run.
    static RUN: RefCell<Option<Arc<SimulatedRun>>> = const { RefCell::new(None) };
    static RUN_NUMBER: Cell<u64> = const { Cell::new(0) };
    /// All tasks, and those that were woken on this thread.
    static TASKS: RefCell<Vec<Arc<ExecutorTask>>> = const { RefCell::new(Vec::new()) };
    static READY: RefCell<VecDeque<Arc<ExecutorTask>>> = const { RefCell::new(VecDeque::new()) };
}

/// Start of virtual time, ns: a moment like any other, so that nothing relies on it.
const START_NS: u64 = 3_600_000_000_000;
const MS: u64 = 1_000_000;

/// Returns the present moment of virtual time; `None` on a thread that has none.
pub(super) fn now() -> Option<Instant> {
    let now = NOW_NS.get();
    (now > 0).then_some(Instant(now))
}

/// A wait that has begun, and who waits. Those of one moment are numbered in the order in which they began.
struct Waiting {
    moment_ns: u64,
    number: u64,
    who: Waker,
}

/// The waits, the next one last. There are a few at a time.
struct Clock {
    begun: u64,
    waiting: Vec<Waiting>,
}

impl Clock {
    const fn new() -> Self {
        Clock { begun: 0, waiting: Vec::new() }
    }

    /// Returns the index of a wait, or the one at which it belongs. Those that are asked for are mostly near the end.
    fn find(&self, moment_ns: u64, number: u64) -> Result<usize, usize> {
        let is_before = |wait: &Waiting| (wait.moment_ns, wait.number) < (moment_ns, number);
        let at = self.waiting.iter().rposition(|wait| !is_before(wait)).map_or(0, |at| at + 1);
        at.checked_sub(1).filter(|at| self.waiting[*at].number == number).ok_or(at)
    }

    /// Jumps to the next deadline. Returns whether there is one.
    fn jump(&mut self) -> bool {
        self.waiting.last().inspect(|next| NOW_NS.set(next.moment_ns)).is_some()
    }

    /// Takes the first of those whose moment has come.
    fn next_due(&mut self) -> Option<Waker> {
        self.waiting.pop_if(|next| next.moment_ns <= NOW_NS.get()).map(|due| due.who)
    }
}

/// A moment of virtual time that is waited for.
#[derive(Debug)]
pub(super) struct Deadline {
    moment_ns: u64,
    /// Number of the wait, once it has begun, and who waits.
    begun: Option<(u64, WhoWaits)>,
}

/// Addresses of a waker's data and functions. The clock keeps the waker, so no other one has them meanwhile.
type WhoWaits = [usize; 2];

impl Deadline {
    /// Returns a deadline on a thread that has virtual time.
    pub(super) fn at(Instant(moment_ns): Instant) -> Option<Deadline> {
        // virtual time begins at a whole millisecond
        (NOW_NS.get() > 0).then(|| Deadline { moment_ns: moment_ns.div_ceil(MS).saturating_mul(MS), begun: None })
    }

    pub(super) fn poll(&mut self, context: &Context<'_>) -> Poll<()> {
        if self.moment_ns <= NOW_NS.get() {
            return Poll::Ready(());
        }
        let waker = context.waker();
        let who = [waker.data().addr(), ptr::from_ref(waker.vtable()).addr()];
        if self.begun.is_some_and(|(_, waits)| waits == who) {
            return Poll::Pending; // a future is polled much more often than its deadline comes
        }
        CLOCK.with_borrow_mut(|clock| {
            let number = self.begun.map_or(clock.begun + 1, |(number, _)| number);
            clock.begun = clock.begun.max(number);
            self.begun = Some((number, who));
            match clock.find(self.moment_ns, number) {
                Ok(at) => clock.waiting[at].who.clone_from(waker),
                Err(at) => {
                    let wait = Waiting { moment_ns: self.moment_ns, number, who: waker.clone() };
                    clock.waiting.insert(at, wait);
                }
            }
            Poll::Pending
        })
    }
}

impl Drop for Deadline {
    fn drop(&mut self) {
        let Some((number, _)) = self.begun.filter(|_| self.moment_ns > NOW_NS.get()) else { return };
        CLOCK.with_borrow_mut(|clock| {
            if let Ok(at) = clock.find(self.moment_ns, number) {
                clock.waiting.remove(at);
            }
        });
    }
}

/// A task that was begun in virtual time.
#[derive(Debug)]
pub(super) struct VirtualTask(Arc<ExecutorTask>);

impl VirtualTask {
    pub(super) fn is_finished(&self) -> bool {
        self.0.is_finished.load(Ordering::Acquire)
    }

    pub(super) fn abort(&self) {
        self.0.is_aborted.store(true, Ordering::Release);
        self.0.wake_by_ref();
    }
}

struct ExecutorTask {
    work: Mutex<Option<Work>>,
    is_ready: AtomicBool,
    is_aborted: AtomicBool,
    is_finished: AtomicBool,
    run: Arc<SimulatedRun>,
}

impl fmt::Debug for ExecutorTask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Task").field("is_finished", &self.is_finished).finish_non_exhaustive()
    }
}

impl Wake for ExecutorTask {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        if self.is_ready.swap(true, Ordering::AcqRel) {
            return;
        }
        if self.run.is_here() {
            READY.with_borrow_mut(|ready| ready.push_back(self.clone()));
        } else {
            lock(&self.run.from_elsewhere).push_back(self.clone());
            self.run.has_elsewhere.store(true, Ordering::Release);
            self.run.thread.unpark();
        }
    }
}

impl ExecutorTask {
    fn advance(self: Arc<Self>) {
        self.is_ready.store(false, Ordering::Release);
        let mut work = lock(&self.work);
        let Some(going) = work.as_mut() else { return };
        let waker = Waker::from(self.clone());
        let mut context = Context::from_waker(&waker);
        if self.is_aborted.load(Ordering::Acquire) || going.as_mut().poll(&mut context).is_ready() {
            *work = None;
            self.is_finished.store(true, Ordering::Release);
        }
    }
}

/// Begins a task on a thread that has virtual time.
pub(super) fn spawn(work: Work) -> VirtualTask {
    let run = RUN.with_borrow(Clone::clone).unwrap_or_else(|| unreachable!("the thread has virtual time"));
    let [is_ready, is_aborted, is_finished] = [false; 3].map(AtomicBool::new);
    let task = Arc::new(ExecutorTask { work: Mutex::new(Some(work)), is_ready, is_aborted, is_finished, run });
    TASKS.with_borrow_mut(|tasks| {
        tasks.retain(|task| !task.is_finished.load(Ordering::Acquire));
        tasks.push(task.clone());
    });
    task.wake_by_ref();
    VirtualTask(task)
}

/// A simulated run, which is not a task itself.
struct SimulatedRun {
    number: u64,
    thread: Thread,
    is_woken: AtomicBool,
    /// Tasks that other threads have woken, and whether there are any.
    from_elsewhere: Mutex<VecDeque<Arc<ExecutorTask>>>,
    has_elsewhere: AtomicBool,
}

impl Wake for SimulatedRun {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        self.is_woken.store(true, Ordering::Release);
        if !self.is_here() {
            self.thread.unpark();
        }
    }
}

impl SimulatedRun {
    fn begin() -> Arc<SimulatedRun> {
        static RUNS: AtomicU64 = AtomicU64::new(1);
        let number = RUNS.fetch_add(1, Ordering::Relaxed);
        let (is_woken, has_elsewhere, from_elsewhere) =
            (AtomicBool::new(true), AtomicBool::new(false), Mutex::new(VecDeque::new()));
        let run = Arc::new(SimulatedRun { number, thread: thread::current(), is_woken, from_elsewhere, has_elsewhere });
        RUN_NUMBER.set(number);
        RUN.set(Some(run.clone()));
        NOW_NS.set(START_NS);
        run
    }

    /// Whether this thread executes the run.
    fn is_here(&self) -> bool {
        RUN_NUMBER.get() == self.number
    }

    fn next_task(&self) -> Option<Arc<ExecutorTask>> {
        READY.with_borrow_mut(|ready| {
            if self.has_elsewhere.load(Ordering::Acquire) && self.has_elsewhere.swap(false, Ordering::AcqRel) {
                ready.append(&mut lock(&self.from_elsewhere));
            }
            ready.pop_front()
        })
    }
}

/// Executes a simulated run in virtual time, with all tasks that it begins. They end with it.
///
/// # Panics
/// The thread executes a simulated run already.
pub fn run_virtually<T>(run: impl Future<Output = T>) -> T {
    assert!(now().is_none(), "a simulated run doesn't execute another one");
    let (state, _end, mut run) = (SimulatedRun::begin(), RunEnd, pin!(run));
    let waker = Waker::from(state.clone());
    let mut context = Context::from_waker(&waker);
    loop {
        if state.is_woken.swap(false, Ordering::AcqRel)
            && let Poll::Ready(result) = run.as_mut().poll(&mut context)
        {
            return result;
        }
        let tasks = std::iter::from_fn(|| state.next_task()).take(TASKS_MOST);
        let is_idle = tasks.map(ExecutorTask::advance).count() < TASKS_MOST;
        if is_idle && !state.is_woken.load(Ordering::Acquire) {
            let has_next = CLOCK.with_borrow_mut(Clock::jump);
            if !has_next && !state.has_elsewhere.load(Ordering::Acquire) {
                // only another thread can continue the run, for example with a stop
                thread::park();
            }
            while let Some(due) = CLOCK.with_borrow_mut(Clock::next_due) {
                due.wake();
            }
        }
    }
}

/// The end of a run: its tasks, which may wait, are dropped before its clock.
struct RunEnd;

impl Drop for RunEnd {
    fn drop(&mut self) {
        let tasks = TASKS.take();
        tasks.into_iter().for_each(|task| drop(lock(&task.work).take()));
        READY.take();
        RUN.take();
        RUN_NUMBER.set(0);
        NOW_NS.set(0);
        CLOCK.replace(Clock::new());
    }
}
