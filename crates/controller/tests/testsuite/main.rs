//! The integration tests of `retrace-controller`, in one binary, which links once.

mod baud;
mod frame;
mod hold;
mod interruption;
mod json_events;
mod kinds;
mod line;
mod motion_path;
mod operation;
mod order;
mod pico;
mod rate_law;
mod surface_speed;
mod threads;
mod torch;
mod track;
mod wheel;
mod wired;

// Shared with the end-to-end tests, which use all of it.
#[path = "../../../../tests/src/json_page.rs"]
#[allow(dead_code, unreachable_pub)]
mod json_page;
#[path = "../../../../tests/src/limits.rs"]
#[allow(dead_code, unreachable_pub)]
mod limits;
#[path = "../../../../tests/src/records.rs"]
#[allow(dead_code, unreachable_pub)]
mod records;
