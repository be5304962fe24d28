//! The `retrace` command.
//!
//! Invariant: the exit code is one of the interface's five; an error message says what is wrong, where, and what to do.
#![forbid(unsafe_code)]
// A binary has no outside; `pub` says what a room offers to the others.
#![allow(unreachable_pub)]

#[macro_use]
mod out;
mod page_session;

mod args;
mod canon;
mod card;
#[cfg(unix)]
mod card_serve;
#[cfg(not(unix))]
#[path = "card_serve_elsewhere.rs"]
mod card_serve;
mod check;
mod check_progress;
mod check_report;
mod command_failure;
mod console;
mod consumable_counter;
mod consumables;
mod contour_report;
mod cut_progress;
mod cutting_report;
mod cycles;
mod decoder;
mod diagnostic_json;
mod doctor;
mod draw;
mod draw_job;
mod escape;
mod files;
mod greeted_card;
mod homing_notes;
mod job_runner;
mod job_script;
mod job_spec;
mod jobs;
mod journaled_job;
mod known_boards;
mod linked_card;
mod machine;
mod machine_tables;
mod manual;
mod manual_inputs;
mod materials;
mod operate;
mod probe;
mod probing_card;
mod program;
mod program_check;
mod program_stream;
mod reported_state;
mod resume;
mod resume_from_line;
mod resume_summary;
mod run;
mod run_outputs;
mod saved_materials;
mod send;
#[cfg(feature = "shop")]
mod send_job;
mod serial_source;
mod serve;
mod shell_files;
#[cfg(feature = "shop")]
mod shop;
#[cfg(feature = "shop")]
mod shop_job_start;
#[cfg(feature = "shop")]
mod shop_piece;
mod sim_wiring;
mod simulated_work;
mod size;
mod socket;
#[cfg(unix)]
mod state_socket;
#[cfg(not(unix))]
#[path = "state_socket_elsewhere.rs"]
mod state_socket;
mod step_test;
mod stop_signals;
mod subprogram_folders;
mod table_files;
mod terminal_operator;
mod wait_notice;

use std::process::ExitCode;

use clap::Parser;

use crate::args::{Cli, Command};
use crate::command_failure::CommandFailure;

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        #[cfg(feature = "shop")]
        Command::Run(args) if args.shop.job.is_some() => shop_job_start::run(args),
        #[cfg(feature = "shop")]
        Command::Serve(args) if args.shop.job.is_some() => Err(shop_job_start::page_refusal().into()),
        Command::Run(args) if args.page.serve => serve::run(args),
        Command::Run(args) => run::run(args),
        Command::Serve(args) => serve::run(args),
        Command::Resume(args) if args.page.serve => serve::resume(&args),
        #[cfg(feature = "shop")]
        Command::Resume(args) => shop_job_start::resume(&args),
        #[cfg(not(feature = "shop"))]
        Command::Resume(args) => resume::run(&args),
        Command::Check(args) => check::run(&args).map(|()| 0),
        Command::Canon(args) => canon::run(&args).map(|()| 0),
        Command::Plot(args) => draw::run(&args).map(|()| 0),
        Command::Cycles(args) => cycles::run(&args).map(|()| 0),
        Command::Card(args) => card::run(&args).map(|()| 0),
        Command::Doctor(args) => doctor::run(&args).map(|()| 0),
        #[cfg(feature = "shop")]
        Command::Send(args) if args.job.is_some() => {
            let job = args.job.clone().unwrap_or_default();
            send_job::run(&args, &job).map_err(CommandFailure::from).map(|()| 0)
        }
        Command::Send(args) => send::run(&args).map_err(CommandFailure::from).map(|()| 0),
        Command::Home(args) => manual::home(&args),
        Command::Jog(args) => manual::jog(&args),
        Command::Mdi(args) => manual::mdi(&args.block, &args.options),
        Command::Probe(args) => probe::run(&args),
        Command::Machine(args) => machine::run(&args),
        Command::Consumables(args) => consumables::run(&args).map(|()| 0),
        Command::Materials(args) => materials::run(&args).map_err(CommandFailure::from).map(|()| 0),
        Command::Jobs(args) => jobs::run(&args).map_err(CommandFailure::from).map(|()| 0),
        Command::Size(args) => size::run(&args).map_err(CommandFailure::from).map(|()| 0),
        #[cfg(feature = "shop")]
        Command::Shop(args) => shop::run(&args).map_err(CommandFailure::from).map(|()| 0),
        Command::ShellFiles(args) => shell_files::run(&args).map_err(CommandFailure::from).map(|()| 0),
    };
    let code = match done {
        Ok(code) => code,
        Err(CommandFailure::Program) => 1,
        Err(CommandFailure::Card(refusal)) => {
            eprintln!("{}", escape::lines(&refusal.to_string()));
            3
        }
        Err(CommandFailure::Input(refusal)) => {
            eprintln!("{}", escape::lines(&refusal.to_string()));
            2
        }
    };
    // The work is done; the exit code must still report that output was lost.
    match out::lost() {
        Some(refusal) => {
            eprintln!("{}", escape::lines(&refusal.to_string()));
            ExitCode::from(if code == 0 { 2 } else { code })
        }
        None => ExitCode::from(code),
    }
}
