//! The error of an option out of its range, which scene descriptions and all stages share.

/// An invalid option. The command adds its flags to the message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OptionError {
    /// A value outside its range.
    #[error("{key} is {value}, but must be {expected}")]
    OutOfRange {
        /// The option, as scene files call it.
        key: &'static str,
        /// What was given.
        value: String,
        /// What can be given.
        expected: String,
    },
    /// A value that another option rules out.
    #[error("{key} {reason}")]
    Conflict {
        /// The option, as scene files call it.
        key: &'static str,
        /// Why it cannot be.
        reason: String,
        /// Options and values, any of which would do.
        remedies: &'static [(&'static str, &'static str)],
    },
}

impl OptionError {
    /// A value that cannot be, for this reason.
    pub fn invalid(key: &'static str, reason: impl Into<String>) -> Self {
        Self::Conflict { key, reason: reason.into(), remedies: &[] }
    }

    /// The option, as scene files call it.
    pub fn key(&self) -> &'static str {
        match self {
            Self::OutOfRange { key, .. } | Self::Conflict { key, .. } => key,
        }
    }
}
