//! Times taken in turn.

use std::time::Instant;

/// Times of one candidate, in s, in the order in which they were taken.
#[derive(Clone, Debug, Default)]
pub(crate) struct Times(Vec<f64>);

impl Times {
    /// The shortest: what the least disturbed run took.
    pub(crate) fn least(&self) -> f64 {
        self.0.iter().copied().fold(f64::INFINITY, f64::min)
    }
}

/// Which clock.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Clock {
    /// Time on the wall.
    Wall,
    /// Time that the calling thread had a processor, where the system tells (Linux, to within a
    /// tick of some milliseconds); else time on the wall.
    Thread,
}

/// Candidates that are through sooner are run so long, in s, before each run that counts.
const WARMING: f64 = 2e-4;

/// Runs the candidates in turn, `rounds` times after one run each that is not counted: whatever
/// disturbs the machine disturbs all of them.
///
/// What takes less than [`WARMING`] is measured warm: with its code, its data and the predictions of
/// its branches where its own runs left them, whatever the other candidates did since. Else a kernel
/// would take thrice its time in turn with one that fills the caches. Longer runs begin as the others
/// left the caches.
pub(crate) fn in_turn<const N: usize>(
    rounds: usize,
    clock: Clock,
    mut candidates: [&mut dyn FnMut(); N],
) -> [Times; N] {
    let mut times = [const { Times(Vec::new()) }; N];
    for round in 0..=rounds {
        for (candidate, times) in candidates.iter_mut().zip(&mut times) {
            let taken = warm(clock, candidate);
            if round > 0 {
                times.0.push(taken);
            }
        }
    }
    times
}

/// What a run takes, after others if it is short.
fn warm(clock: Clock, run: &mut dyn FnMut()) -> f64 {
    let begun = Instant::now();
    let timed = |run: &mut dyn FnMut()| {
        let start = Now::new(clock);
        run();
        start.elapsed()
    };
    let mut taken = timed(run);
    if begun.elapsed().as_secs_f64() < WARMING {
        while begun.elapsed().as_secs_f64() < WARMING {
            run();
        }
        taken = timed(run);
    }
    taken
}

/// A moment on both clocks.
struct Now {
    wall: Instant,
    thread: Option<f64>,
}

impl Now {
    fn new(clock: Clock) -> Now {
        let thread = match clock {
            Clock::Wall => None,
            Clock::Thread => thread_time(),
        };
        Now { wall: Instant::now(), thread }
    }

    fn elapsed(&self) -> f64 {
        // Asking for the time of the thread takes microseconds: never within a time on the wall.
        let Some(start) = self.thread else {
            return self.wall.elapsed().as_secs_f64();
        };
        thread_time().map_or_else(|| self.wall.elapsed().as_secs_f64(), |end| end - start)
    }
}

/// Seconds that this thread has had a processor.
pub(crate) fn thread_time() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanoseconds: f64 = text.split_whitespace().next()?.parse().ok()?;
    Some(nanoseconds * 1e-9)
}
