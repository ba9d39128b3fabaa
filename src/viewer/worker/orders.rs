//! What the window orders of the thread, and how the thread waits for it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use glam::Vec2;

use super::View;
use crate::viewer::jobs::Job;
use crate::viewer::stopwatch::CurrentStage;

/// What is to be done. Newer views replace older ones.
#[derive(Debug, Default)]
pub struct Orders {
    pub view: Option<View>,
    /// A place in the picture, as fractions of its width and height.
    pub pick: Option<Vec2>,
    pub job: Option<Job>,
    pub is_over: bool,
}

#[derive(Debug, Default)]
pub struct Shared {
    orders: Mutex<Orders>,
    arrived: Condvar,
    /// Something was ordered that makes the picture being refined obsolete.
    pub is_outdated: AtomicBool,
    /// The job at hand is to end.
    pub is_aborted: AtomicBool,
    /// What the thread is doing for a picture.
    pub current_stage: CurrentStage,
}

impl Shared {
    pub fn orders(&self) -> MutexGuard<'_, Orders> {
        self.orders.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the orders, and ends what they make obsolete.
    pub fn order(&self, change: impl FnOnce(&mut Orders)) {
        let mut orders = self.orders();
        change(&mut orders);
        // With the lock held, so that the thread cannot take the order before.
        self.is_outdated.store(true, Ordering::Relaxed);
        drop(orders);
        self.arrived.notify_one();
    }

    /// Waits for orders, up to some time if there is something else to do. Takes them.
    pub fn next(&self, at_most: Option<Duration>) -> Orders {
        let is_idle = |orders: &mut Orders| {
            orders.view.is_none() && orders.pick.is_none() && orders.job.is_none() && !orders.is_over
        };
        let orders = self.orders();
        let mut orders = match at_most {
            None => self.arrived.wait_while(orders, is_idle).unwrap_or_else(PoisonError::into_inner),
            Some(time) => {
                self.arrived.wait_timeout_while(orders, time, is_idle).unwrap_or_else(PoisonError::into_inner).0
            }
        };
        self.is_outdated.store(false, Ordering::Relaxed);
        Orders { is_over: orders.is_over, ..std::mem::take(&mut *orders) }
    }
}
