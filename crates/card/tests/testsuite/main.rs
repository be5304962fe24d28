//! The integration tests of `retrace-card`, in one binary, which links once.

mod alarms;
mod any_commands;
mod beam_power;
mod common;
mod cutter_proof;
mod epochs;
mod height_control;
mod layer;
mod layer_beside;
mod order;
mod permit;
mod permit_phases;
mod probing;
mod pulses;
mod settings;
