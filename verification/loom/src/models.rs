//! Models of the threads that ship: each runs real files of a crate, compiled again over `sync`.

pub mod blocks;
pub mod commands;
pub mod jog;
pub mod journal;
