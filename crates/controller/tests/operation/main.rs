//! Operation, from the operator's word to what the card did: the path's own threads, going back to a place, taking a job up where it was left.

#[path = "../wired/mod.rs"]
mod wired;

mod back;
mod index;
mod jobs;
mod resume;
mod still;
