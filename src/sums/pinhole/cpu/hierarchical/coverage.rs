//! What the blocks of a tile see of the samples that have visibility maps, found when it is first needed and kept while the block
//! and those within it are gathered.

use super::super::visibility::Coverage;
use super::blocks::FINEST;

/// Coverage by level and sample.
#[derive(Debug, Default)]
pub struct CoverageCache {
    samples: usize,
    /// Of the current block of each level.
    levels: [Vec<Option<Coverage>>; FINEST],
}

impl CoverageCache {
    /// Knows nothing yet of so many samples.
    pub fn new(samples: usize) -> Self {
        Self { samples, levels: Default::default() }
    }

    /// Forgets the previous block of a level.
    pub fn enter(&mut self, level: usize) {
        let states = &mut self.levels[level];
        states.clear();
        states.resize(self.samples, None);
    }

    /// Coverage of the current block of a level, if it is known: what an enclosing block sees wholly, or not at all, so do the
    /// blocks within it.
    pub fn known(&mut self, level: usize, sample: u32) -> Option<Coverage> {
        let sample = sample as usize;
        if let known @ Some(_) = self.levels[level][sample] {
            return known;
        }
        let of_enclosing = (0..level).rev().find_map(|outer| self.levels[outer][sample]);
        match of_enclosing {
            Some(coverage @ (Coverage::Full | Coverage::None)) => {
                self.levels[level][sample] = Some(coverage);
                Some(coverage)
            }
            Some(Coverage::Partial) | None => None,
        }
    }

    /// Keeps the coverage of the current block of a level.
    pub fn keep(&mut self, level: usize, sample: u32, coverage: Coverage) {
        self.levels[level][sample as usize] = Some(coverage);
    }
}
