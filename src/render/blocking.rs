//! Blocks on the library's futures, for programs that may block: the command line, tests, benchmarks.

use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, Wake, Waker};
use std::thread::{self, Thread};

use crate::Device;

/// Runs a future to completion on this thread. Between polls the thread sleeps until the device has finished the
/// submitted work, or until the future is woken.
///
/// ```
/// assert_eq!(pinspot::blocking::wait(None, async { 1 + 1 }), 2);
/// ```
pub fn wait<F: Future>(device: Option<&Device>, future: F) -> F::Output {
    wait_with(future, || {
        device.inspect(|device| poll(device));
        // Returns immediately if the future has been woken since it was polled.
        thread::park();
    })
}

/// Like [`wait`], for a device with which another thread draws windows: it is asked every millisecond whether it has finished, as
/// wgpu presents nothing while a thread waits within it.
pub fn wait_sharing<F: Future>(device: Option<&Device>, future: F) -> F::Output {
    match device {
        Some(_) => wait_with(future, || thread::sleep(std::time::Duration::from_millis(1))),
        None => wait(None, future),
    }
}

fn wait_with<F: Future>(future: F, rest: impl Fn()) -> F::Output {
    let mut future = pin!(future);
    let waker = Waker::from(Arc::new(Unpark(thread::current())));
    let mut context = Context::from_waker(&waker);
    loop {
        if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
            return output;
        }
        rest();
    }
}

/// Sleeps until the device has finished what was submitted. The future finds out by itself what goes wrong here.
#[cfg(feature = "gpu")]
fn poll(device: &Device) {
    let _ = device.poll(wgpu::PollType::wait_indefinitely());
}

#[cfg(not(feature = "gpu"))]
fn poll(device: &Device) {
    match *device {}
}

struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

#[cfg(test)]
mod tests {
    use std::future::poll_fn;
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_future_woken_by_another_thread_completes() {
        let mut polls = 0;
        let polled = wait(
            None,
            poll_fn(|context| {
                polls += 1;
                if polls == 3 {
                    return Poll::Ready(polls);
                }
                let waker = context.waker().clone();
                thread::spawn(move || {
                    thread::sleep(Duration::from_millis(5));
                    waker.wake();
                });
                Poll::Pending
            }),
        );
        assert_eq!(polled, 3);
    }
}
