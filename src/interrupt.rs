//! SIGINT (Ctrl-C) and SIGTERM: the first ends a run in good order, the second ends it at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use crate::embedded::Host;

/// The signal that came, if one did.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt {
    came: Arc<AtomicU8>,
    /// Who has this program inside, and listens itself.
    host: Option<Arc<Host>>,
}

/// Who wants an end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Signal {
    /// SIGINT.
    Interrupt = 1,
    /// SIGTERM.
    Terminate,
}

impl Interrupt {
    /// What came since [`Interrupt::listen`].
    pub(crate) fn signal(&self) -> Option<Signal> {
        if self.host.as_ref().is_some_and(|host| host.wants_end()) {
            return Some(Signal::Interrupt);
        }
        match self.came.load(Ordering::Relaxed) {
            0 => None,
            1 => Some(Signal::Interrupt),
            _ => Some(Signal::Terminate),
        }
    }

    /// From now on signals are heard. On systems without them, and where no thread can be had, the
    /// first ends the program at once as it did before.
    #[cfg(unix)]
    pub(crate) fn listen() -> Interrupt {
        use signal_hook::consts::{SIGINT, SIGTERM};
        use signal_hook::iterator::Signals;

        let interrupt = Interrupt { host: crate::console::host(), ..Interrupt::default() };
        if interrupt.host.is_some() {
            return interrupt;
        }
        let heard = interrupt.clone();
        let Ok(mut signals) = Signals::new([SIGINT, SIGTERM]) else { return interrupt };
        let listen = move || {
            for signal in signals.forever() {
                if heard.signal().is_some() {
                    piola_runtime::output::atomic::abandon();
                    std::process::exit(128 + signal);
                }
                heard.came.store(if signal == SIGINT { 1 } else { 2 }, Ordering::Relaxed);
                crate::console::say(
                    "interrupted: what has converged is being written; interrupt again to end at once\n",
                );
            }
        };
        // A program without this thread would not hear its signals any more.
        std::thread::Builder::new().spawn(listen).expect("a program that runs can start a thread");
        interrupt
    }

    #[cfg(not(unix))]
    pub(crate) fn listen() -> Interrupt {
        Interrupt { host: crate::console::host(), ..Interrupt::default() }
    }
}
