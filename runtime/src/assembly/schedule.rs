//! When which slab is assembled.
//!
//! A slab writes to its own rows and to those of the next. Even slabs share none; an odd one waits for
//! its two neighbours and for no other, so that threads are seldom idle, and each row gets what its
//! even slab has for it before what its odd slab has: the same sums for any number of threads.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard};

use rayon::Scope;

/// Runs all of `n` slabs, each odd one after its neighbours; what became of them, in their order.
pub(super) fn even_before_odd<T: Send>(n: usize, run: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let schedule = Schedule {
        run,
        awaited: (0..n).map(|slab| AtomicUsize::new(if slab + 1 < n { 2 } else { 1 })).collect(),
        done: (0..n).map(|_| Mutex::new(None)).collect(),
    };
    rayon::scope(|scope| {
        for slab in (0..n).step_by(2) {
            let schedule = &schedule;
            scope.spawn(move |scope| schedule.visit(slab, scope));
        }
    });
    let done = schedule.done.into_iter();
    done.filter_map(|outcome| outcome.into_inner().unwrap_or_else(|e| e.into_inner())).collect()
}

/// What a mutex holds; a panic elsewhere ends the whole schedule anyway.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|e| e.into_inner())
}

struct Schedule<T, F> {
    run: F,
    /// How many neighbours an odd slab waits for.
    awaited: Vec<AtomicUsize>,
    done: Vec<Mutex<Option<T>>>,
}

impl<T: Send, F: Fn(usize) -> T + Sync> Schedule<T, F> {
    fn visit<'s>(&'s self, slab: usize, scope: &Scope<'s>) {
        let outcome = (self.run)(slab);
        *lock(&self.done[slab]) = Some(outcome);
        if slab % 2 == 1 {
            return;
        }
        let before = slab.checked_sub(1);
        for odd in before.into_iter().chain([slab + 1]).filter(|&odd| odd < self.done.len()) {
            if self.awaited[odd].fetch_sub(1, Ordering::AcqRel) == 1 {
                scope.spawn(move |scope| self.visit(odd, scope));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_runs_once_and_odd_ones_after_their_neighbours() {
        for n in 0..12 {
            let order = Mutex::new(Vec::new());
            let outcomes = even_before_odd(n, |slab| {
                order.lock().unwrap().push(slab);
                slab
            });
            assert_eq!(outcomes, (0..n).collect::<Vec<_>>());
            let order = order.into_inner().unwrap();
            let at = |slab: usize| order.iter().position(|&other| other == slab);
            for odd in (1..n).step_by(2) {
                // Of a slab that there is not the place is `None`, less than any.
                assert!(at(odd - 1) < at(odd) && at(odd + 1) < at(odd), "{order:?}");
            }
        }
    }
}
