//! The worker's device is lost while the window is open.

use std::time::{Duration, Instant};

use crate::blocking::wait;
use crate::viewer::worker::{Message, Quality, View, Worker};
use crate::{BackendChoice, load};
use pinspot_render::gpu::Gpu;

/// Pipelines are compiled twice, by a software adapter perhaps.
const PATIENCE: Duration = Duration::from_mins(4);

fn view(number: u64) -> View {
    let (scene, options) = load("mirror-sphere").unwrap();
    let options = options.with_size([64, 48]).with_samples(40);
    // While the animation plays, nothing is refined.
    View { number, radiance: number, scene, options, kept: None, is_playing: true, frame_seconds: 0.05 }
}

/// What the worker says until it is this.
fn messages_until(worker: &Worker, is_last: impl Fn(&Message) -> bool) -> Vec<Message> {
    let (began, mut messages) = (Instant::now(), Vec::new());
    loop {
        while let Some(message) = worker.message() {
            messages.push(message);
            if is_last(&messages[messages.len() - 1]) {
                return messages;
            }
        }
        assert!(began.elapsed() < PATIENCE, "not in time: {messages:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn is_preview_of(number: u64) -> impl Fn(&Message) -> bool {
    move |message| match message {
        Message::Picture(picture) => picture.view == number && matches!(picture.quality, Quality::Preview(_)),
        _ => false,
    }
}

/// The window is told, another device is opened, and the view is shown without being sent again.
#[test]
fn a_lost_device_is_opened_again() {
    let gpu = wait(None, Gpu::open(None)).unwrap();
    let (device, name) = (gpu.device.clone(), gpu.adapter.name.clone());
    let worker = Worker::start(BackendChoice::Gpu(None), Some(gpu), || {});
    worker.show(view(1));
    let first = messages_until(&worker, is_preview_of(1));
    assert!(!first.iter().any(|message| matches!(message, Message::Failed(..))), "{first:?}");
    device.destroy();
    worker.show(view(2));
    let second = messages_until(&worker, is_preview_of(2));
    let is_loss = |message: &Message| matches!(message, Message::Failed(2, reason) if reason.contains("lost"));
    assert!(second.iter().any(is_loss), "{second:?}");
    let is_other = |message: &Message| matches!(message, Message::Backend(backend) if backend.contains(&name));
    assert!(second.iter().any(is_other), "{second:?}");
}
