//! Work arrays that outlive the passes which need them: a pass that takes them from here allocates
//! nothing after the first.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard};

/// Values that are free to be used. Two takers at once get two.
///
/// They are boxed: work arrays with buffers of fixed size are large, and bodies of a few hundred points
/// would spend a third of a pass on moving them.
pub(crate) struct Pool<T> {
    free: Mutex<Vec<Box<T>>>,
}

impl<T> Pool<T> {
    /// None yet.
    pub(crate) fn new() -> Pool<T> {
        Pool { free: Mutex::new(Vec::new()) }
    }

    /// One that was given back, or a new one.
    pub(crate) fn take(&self, make: impl FnOnce() -> T) -> Taken<'_, T> {
        let known = lock(&self.free).pop();
        Taken { pool: self, value: Some(known.unwrap_or_else(|| Box::new(make()))) }
    }

    /// Makes new ones until there is one for each thread: which threads will ask is chance.
    pub(crate) fn provide(&self, make: impl Fn() -> T) {
        let mut free = lock(&self.free);
        while free.len() < rayon::current_num_threads() {
            free.push(Box::new(make()));
        }
    }
}

/// A value of a [`Pool`], which goes back there in the end.
pub(crate) struct Taken<'a, T> {
    pool: &'a Pool<T>,
    /// There until it goes back.
    value: Option<Box<T>>,
}

impl<T> Deref for Taken<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.value.as_ref().expect("a value that is taken is there")
    }
}

impl<T> DerefMut for Taken<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        self.value.as_mut().expect("a value that is taken is there")
    }
}

impl<T> Drop for Taken<'_, T> {
    fn drop(&mut self) {
        lock(&self.pool.free).extend(self.value.take());
    }
}

/// What a mutex holds; a panic elsewhere ends the whole pass anyway.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|e| e.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_back_is_taken_again() {
        let pool = Pool::new();
        {
            let (mut first, second) = (pool.take(Vec::new), pool.take(Vec::new));
            first.push(1);
            assert!(second.is_empty(), "two at once are two");
            drop(second);
        }
        assert_eq!(*pool.take(Vec::new), [1]);
    }
}
