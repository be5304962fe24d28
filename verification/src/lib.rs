//! Skeleton: the proofs, models and mutants of `retrace-core` come here; nothing is proved yet.
#![forbid(unsafe_code)]
