//! A thread that takes what it is given, in order, while its giver goes on.

use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{Scope, ScopedJoinHandle};

/// Values that may wait while one is taken.
const WAITING: usize = 1;

/// The giver's end.
pub(super) struct Behind<'scope, T, E> {
    give: Sender<T>,
    taken: Receiver<Result<(), E>>,
    thread: Option<ScopedJoinHandle<'scope, ()>>,
    behind: usize,
}

impl<'scope, T: Send + 'scope, E: Send + 'scope> Behind<'scope, T, E> {
    /// Starts the thread. It ends with the first error.
    pub fn start(scope: &'scope Scope<'scope, '_>, take: impl FnMut(T) -> Result<(), E> + Send + 'scope) -> Self {
        let (give, given) = channel();
        let (tell, taken) = channel();
        let thread = scope.spawn(move || {
            for result in given.into_iter().map(take) {
                let failed = result.is_err();
                if tell.send(result).is_err() || failed {
                    break;
                }
            }
        });
        Self { give, taken, thread: Some(thread), behind: 0 }
    }

    /// Gives a value to be taken after all others. Waits if too many would wait; tells errors of earlier ones.
    pub fn give(&mut self, value: T) -> Result<(), E> {
        self.behind += 1;
        let _ = self.give.send(value); // why the thread has ended is told by what it says of earlier values
        self.until(1 + WAITING)
    }

    /// Waits until everything was taken.
    pub fn catch_up(&mut self) -> Result<(), E> {
        self.until(0)
    }

    fn until(&mut self, most: usize) -> Result<(), E> {
        while self.behind > most {
            match self.taken.recv() {
                Ok(result) => result?,
                Err(_) => {
                    // It says nothing of a value only if it panicked.
                    if let Some(Err(panic)) = self.thread.take().map(ScopedJoinHandle::join) {
                        resume_unwind(panic);
                    }
                }
            }
            self.behind -= 1;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::Mutex;

    fn run(count: usize, take: impl FnMut(usize) -> Result<(), usize> + Send) -> Result<usize, usize> {
        std::thread::scope(|scope| {
            let mut behind = Behind::start(scope, take);
            (0..count).try_for_each(|value| behind.give(value))?;
            behind.catch_up()?;
            Ok(count)
        })
    }

    #[test]
    fn everything_is_taken_in_order_before_it_is_caught_up() {
        let taken = Mutex::new(Vec::new());
        let ended = run(100, |value| {
            taken.lock().unwrap().push(value);
            Ok(())
        });
        assert_eq!((ended, taken.into_inner().unwrap()), (Ok(100), (0..100).collect()));
    }

    #[test]
    fn an_error_is_told_and_nothing_is_taken_after_it() {
        let mut taken = 0;
        let ended = run(100, |value| {
            taken += 1;
            if value == 5 { Err(value) } else { Ok(()) }
        });
        assert_eq!((ended, taken), (Err(5), 6));
    }

    #[test]
    fn the_giver_is_never_farther_ahead_than_what_may_wait() {
        let (given, ahead) = (Mutex::new(0), Mutex::new(0));
        std::thread::scope(|scope| {
            let mut behind = Behind::start(scope, |value: usize| {
                std::thread::yield_now();
                let mut ahead = ahead.lock().unwrap();
                *ahead = usize::max(*ahead, *given.lock().unwrap() - value);
                Ok::<(), ()>(())
            });
            for value in 0..50 {
                *given.lock().unwrap() = value + 1;
                behind.give(value).unwrap();
            }
        });
        assert!((1..=2 + WAITING).contains(&ahead.into_inner().unwrap()));
    }

    #[test]
    fn a_panic_goes_on_in_the_giver() {
        let panicked = catch_unwind(AssertUnwindSafe(|| run(100, |value| panic!("at {value}"))));
        assert_eq!(panicked.unwrap_err().downcast_ref::<String>().unwrap(), "at 0");
    }
}
