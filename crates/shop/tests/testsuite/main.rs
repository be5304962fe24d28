//! Tests of the crate from outside.
#![cfg(unix)]

mod mtconnect;
#[expect(unreachable_pub, reason = "it is shared with the end-to-end tests, of which it is a library")]
#[path = "../../../../tests/src/shdr_checker.rs"]
mod shdr_checker;
mod sparkplug;
#[expect(unreachable_pub, reason = "it is shared with the end-to-end tests, of which it is a library")]
#[path = "../../../../tests/src/sparkplug_checker.rs"]
mod sparkplug_checker;
