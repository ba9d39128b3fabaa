//! Disjoint sets (union-find).

/// Disjoint sets, with path halving.
pub struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// `count` sets of one item each.
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The representative of `item`'s set.
    pub fn find(&mut self, mut item: u32) -> u32 {
        while self.0[item as usize] != item {
            self.0[item as usize] = self.0[self.0[item as usize] as usize];
            item = self.0[item as usize];
        }
        item
    }

    /// Merges two sets. The smaller representative is kept, so that results do not depend on the order of merging.
    pub fn merge(&mut self, a: u32, b: u32) {
        if self.0[a as usize] == self.0[b as usize] {
            return;
        }
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
