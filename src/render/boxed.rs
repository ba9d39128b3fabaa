//! Futures behind a pointer.
//!
//! The body of an `async fn` is compiled anew in every crate that polls it. Public functions return their futures boxed instead, so that
//! the engine is compiled once, for all programs, tests and benchmarks that use it.

use std::pin::Pin;

/// A future behind a pointer.
pub type BoxFuture<'a, T> = Pin<Box<dyn Future<Output = T> + 'a>>;
