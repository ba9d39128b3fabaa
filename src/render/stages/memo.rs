//! A stage's latest result, kept until its inputs change. Independent of scenes and light.

use std::fmt;
use std::sync::{Arc, Weak};

use crate::progress::{Progress, Stage};

/// A stage's latest result and the inputs that it was made from. Counts how often it was made.
pub struct Memo<K, T> {
    stage: Stage,
    made: Option<(K, Arc<T>)>,
    times_made: u64,
}

impl<K, T> fmt::Debug for Memo<K, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Memo({}, made {} times)", self.stage, self.times_made)
    }
}

impl<K: PartialEq, T> Memo<K, T> {
    pub(crate) fn new(stage: Stage) -> Self {
        Self { stage, made: None, times_made: 0 }
    }

    pub(crate) fn stage(&self) -> Stage {
        self.stage
    }

    pub(crate) fn times_made(&self) -> u64 {
        self.times_made
    }

    /// The kept result, if it is for these inputs.
    pub fn kept(&self, key: &K) -> Option<Arc<T>> {
        self.made.as_ref().filter(|(known, _)| known == key).map(|(_, result)| result.clone())
    }

    /// The kept result, whatever its inputs.
    pub fn latest(&self) -> Option<Arc<T>> {
        self.made.as_ref().map(|(_, result)| result.clone())
    }

    /// The result for these inputs: the kept one if they are unchanged, else a new one.
    pub fn get(&mut self, key: K, progress: &dyn Progress, make: impl FnOnce() -> T) -> Arc<T> {
        let made: Result<_, std::convert::Infallible> = self.try_get(key, progress, || Ok(make()));
        made.unwrap_or_else(|never| match never {})
    }

    /// Like [`Self::get`], for results that are made from the one that was kept.
    pub fn get_by_update(&mut self, key: K, progress: &dyn Progress, make: impl FnOnce(Option<Arc<T>>) -> T) -> Arc<T> {
        let before = self.latest();
        self.get(key, progress, || make(before))
    }

    /// Like [`Self::get`], for results that can fail. A failure leaves the stage empty, so that the next call tries again.
    pub fn try_get<E>(
        &mut self,
        key: K,
        progress: &dyn Progress,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<Arc<T>, E> {
        if let Some(known) = self.known(&key) {
            return Ok(known);
        }
        progress.begin(self.stage, 1);
        let made = make();
        progress.end(self.stage);
        Ok(self.keep(key, made?, progress))
    }

    /// Like [`Self::try_get`], for asynchronous results; `steps` is the length of the progress bar.
    pub async fn wait_for<E>(
        &mut self,
        key: K,
        (steps, progress): (u64, &dyn Progress),
        make: impl AsyncFnOnce() -> Result<T, E>,
    ) -> Result<Arc<T>, E> {
        if let Some(known) = self.known(&key) {
            return Ok(known);
        }
        progress.begin(self.stage, steps);
        let made = make().await;
        progress.end(self.stage);
        Ok(self.keep(key, made?, progress))
    }

    /// The kept result, if it is for these inputs. Otherwise it is dropped before a new one is made, so that two results are
    /// never in memory together.
    fn known(&mut self, key: &K) -> Option<Arc<T>> {
        match &self.made {
            Some((known, result)) if known == key => Some(result.clone()),
            _ => {
                self.made = None;
                None
            }
        }
    }

    /// Keeps a result, unless it was cancelled and thus may be incomplete.
    fn keep(&mut self, key: K, made: T, progress: &dyn Progress) -> Arc<T> {
        let made = Arc::new(made);
        if !progress.is_cancelled() {
            self.times_made += 1;
            self.made = Some((key, made.clone()));
        }
        made
    }
}

/// The identity of a shared value, as an input of a stage: equal only for the very same value. Does not keep the value alive.
pub struct Id<T: ?Sized>(Weak<T>);

impl<T: ?Sized> Id<T> {
    pub(crate) fn of(value: &Arc<T>) -> Self {
        Self(Arc::downgrade(value))
    }
}

impl<T: ?Sized> fmt::Debug for Id<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Id({:p})", self.0.as_ptr())
    }
}

impl<T: ?Sized> Clone for Id<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T: ?Sized> PartialEq for Id<T> {
    fn eq(&self, other: &Self) -> bool {
        // A weak reference keeps its address from being reused.
        std::ptr::addr_eq(self.0.as_ptr(), other.0.as_ptr())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoProgress;

    #[test]
    fn a_result_is_kept_until_its_inputs_change() {
        let mut memo = Memo::new(Stage::Tree);
        let first = memo.get(1, &NoProgress, || "one");
        assert!(Arc::ptr_eq(&first, &memo.get(1, &NoProgress, || unreachable!("it is known"))));
        assert_eq!(*memo.get(2, &NoProgress, || "two"), "two");
        assert_eq!(memo.times_made(), 2);
    }

    #[test]
    fn a_failure_is_tried_again() {
        let mut memo: Memo<i32, i32> = Memo::new(Stage::Tree);
        assert_eq!(memo.try_get(1, &NoProgress, || Err("no")), Err("no"));
        assert_eq!(memo.try_get(1, &NoProgress, || Ok::<_, &str>(5)).map(|v| *v), Ok(5));
        assert_eq!(memo.times_made(), 1);
    }

    #[test]
    fn a_cancelled_result_is_not_kept() {
        struct Cancelled;
        impl Progress for Cancelled {
            fn begin(&self, _: Stage, _: u64) {}
            fn advance(&self, _: u64) {}
            fn end(&self, _: Stage) {}
            fn is_cancelled(&self) -> bool {
                true
            }
        }
        let mut memo = Memo::new(Stage::Tree);
        assert_eq!(*memo.get(1, &Cancelled, || "incomplete"), "incomplete");
        assert_eq!(*memo.get(1, &NoProgress, || "whole"), "whole");
        assert_eq!(memo.times_made(), 1);
    }

    #[test]
    fn an_identity_is_not_mistaken_for_a_later_one() {
        let ids: Vec<Id<u64>> = (0..100).map(|k| Id::of(&Arc::new(k))).collect();
        for (i, a) in ids.iter().enumerate() {
            assert!(ids.iter().enumerate().all(|(j, b)| (a == b) == (i == j)));
        }
    }
}
