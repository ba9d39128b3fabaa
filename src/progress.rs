//! How far long work is. Knows no work.

/// Is told how far long work is. Called from any thread.
pub trait Progress: Sync {
    /// A stage begins; it will take `total` steps.
    fn begin(&self, stage: &str, total: u64);
    /// More steps of the stage are done.
    fn advance(&self, steps: u64);
}

/// Progress that nobody looks at.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
}
