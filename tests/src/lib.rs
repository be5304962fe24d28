//! Library of the end-to-end tests: runs the `retrace` command, reads its output, and checks it independently.
//!
//! Invariant: nothing of retrace itself is used here; only the command's output is checked.
#![forbid(unsafe_code)]

pub mod browser;
pub mod case_runner;
pub mod command;
pub mod cut_judge;
pub mod cut_part;
pub mod cutter_observer;
pub mod geared_job;
pub mod json_page;
pub mod limits;
pub mod mqtt_client;
pub mod not_run;
pub mod page_client;
pub mod page_user;
pub mod pause;
pub mod pins;
pub mod programs;
pub mod records;
pub mod run;
pub mod sender;
pub mod sensing_torch;
pub mod served;
pub mod shdr_checker;
pub mod shop_broker;
pub mod sparkplug_checker;
pub mod sparkplug_node;
pub mod terminal;
pub mod trace;
