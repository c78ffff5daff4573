//! Further work of the background thread.

use std::fmt::Debug;

use oqtal_runtime::background::BackgroundWorker;

/// Work of a protocol or transport on the background thread.
pub trait Chore: BackgroundWorker + Debug + Send {}

impl<W: BackgroundWorker + Debug + Send> Chore for W {}
