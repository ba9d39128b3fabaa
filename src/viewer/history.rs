//! States to go back to.

/// The number of states that are kept.
const MOST: usize = 200;

/// Earlier states, and those that were taken back.
#[derive(Clone, Debug)]
pub struct History<T> {
    earlier: Vec<T>,
    later: Vec<T>,
}

impl<T> Default for History<T> {
    fn default() -> Self {
        Self { earlier: Vec::new(), later: Vec::new() }
    }
}

impl<T: Clone> History<T> {
    /// Notes a state that is about to change.
    pub fn note(&mut self, state: &T) {
        if self.earlier.len() == MOST {
            self.earlier.remove(0);
        }
        self.earlier.push(state.clone());
        self.later.clear();
    }

    /// The state before the current one.
    pub fn undo(&mut self, current: &T) -> Option<T> {
        let state = self.earlier.pop()?;
        self.later.push(current.clone());
        Some(state)
    }

    /// The state after the current one.
    pub fn redo(&mut self, current: &T) -> Option<T> {
        let state = self.later.pop()?;
        self.earlier.push(current.clone());
        Some(state)
    }

    pub fn can_undo(&self) -> bool {
        !self.earlier.is_empty()
    }

    pub fn can_redo(&self) -> bool {
        !self.later.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_edit_forgets_what_was_taken_back() {
        let mut history = History::default();
        (0..3).for_each(|k| history.note(&k));
        assert_eq!(history.undo(&3), Some(2));
        assert_eq!(history.undo(&2), Some(1));
        assert_eq!(history.redo(&1), Some(2));
        history.note(&2);
        assert!(!history.can_redo() && history.can_undo());
        (0..500).for_each(|k| history.note(&k));
        assert_eq!(std::iter::from_fn(|| history.undo(&0)).count(), MOST);
    }
}
