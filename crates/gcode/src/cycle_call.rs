//! A call of a cycle, and its arguments.
//!
//! Invariant: the cycle is known, and has no fewer parameters than the call has arguments.

use crate::diag::Span;
use retrace_cycles::CycleId;
use std::sync::Arc;

/// Value that a call gives for one parameter.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum CycleArgument {
    Missing,
    /// The next calculated value.
    Number,
    Text(Arc<str>),
}

/// A call of a cycle.
#[derive(Clone, Debug)]
pub(crate) struct CycleCall {
    pub(crate) id: CycleId,
    /// Name, in capitals.
    pub(crate) name: Arc<str>,
    pub(crate) arguments: Arc<[CycleArgument]>,
    pub(crate) at: Span,
}
