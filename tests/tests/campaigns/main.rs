//! Random jobs, and those of every kind: slices of the campaigns (`cargo xtask campaign`), and what is tested beside
//! them.
//!
//! Invariant: the tests share nothing but the command that they run. One program of them all is built and linked once,
//! and they wait beside each other.

mod any_program;
mod blending;
mod cut;
mod cut_acceptance;
mod cut_cycle;
mod cut_day;
mod cut_ends;
mod cut_heights;
mod drip;
mod drip_canon;
mod kill;
mod kill_probing;
mod limits;
mod off;
mod operator;
mod operator_threads;
mod power_cuts;
mod programs;
mod recovery;
mod shift_limits;
mod shop_away;
mod shop_broker;
mod shop_jobs;
mod shop_messages;
mod sparkplug_host;
mod stops;
