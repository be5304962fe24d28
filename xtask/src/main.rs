//! Developer tasks of retrace: `cargo xtask test` is what a change must pass, here and in continuous integration.
//!
//! Invariant: a task that cannot be done says so and fails; no step reports a success that it has not seen.
#![forbid(unsafe_code)]

mod campaign;
mod suite;
mod tidy;
mod tree;

use std::path::PathBuf;
use std::process::ExitCode;

/// Wrong usage, or a task that does not exist yet.
const USAGE_ERROR: u8 = 2;

const HELP: &str = "\
Developer tasks of retrace.

Usage: cargo xtask <TASK>

Tasks:
  test   everything a change must pass: format, tidy, clippy, tests, doc tests, rustdoc
           --list          name the steps and leave
           --only STEP     run this step only; may be given more than once
  tidy   the project's own rules, which no other tool knows
           --list          name the checks and leave
  campaign NAME   a random end-to-end test with its own seed and more cases; results go into docs/campaigns.md
           --full          the full size
           --seed N        the seed, 1 without it
           --list          name the campaigns and leave
  help   this text

Tasks that come with a later issue: verify, bench, firmware.

Exit codes: 0 all passed, 1 something failed, 2 wrong usage.

Example: cargo xtask test --only fmt --only clippy
";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.split_first() {
        None | Some((&("help" | "--help" | "-h"), _)) => {
            print!("{HELP}");
            ExitCode::SUCCESS
        }
        Some((&"test", options)) => test(options),
        Some((&"tidy", options)) => tidy(options),
        Some((&"campaign", options)) => campaign(options),
        Some((&task @ ("verify" | "bench" | "firmware"), _)) => {
            refuse(&format!("`{task}` comes with a later issue; nothing was done"))
        }
        Some((&unknown, _)) => refuse(&format!("there is no task `{unknown}`; see `cargo xtask help`")),
    }
}

fn test(options: &[&str]) -> ExitCode {
    let mut only: Vec<&str> = Vec::new();
    let mut rest = options.iter();
    while let Some(&option) = rest.next() {
        match option {
            "--help" | "-h" => {
                print!("{HELP}");
                return ExitCode::SUCCESS;
            }
            "--list" => {
                for step in suite::STEPS {
                    println!("{:<8} {}", step.name, step.purpose);
                }
                return ExitCode::SUCCESS;
            }
            "--only" => match rest.next() {
                Some(&name) if suite::STEPS.iter().any(|step| step.name == name) => only.push(name),
                Some(name) => return refuse(&format!("there is no step `{name}`; see `cargo xtask test --list`")),
                None => return refuse("--only needs the name of a step; see `cargo xtask test --list`"),
            },
            other => return refuse(&format!("`test` knows no `{other}`; see `cargo xtask help`")),
        }
    }
    with_root(|root| suite::run(&root, &only))
}

fn tidy(options: &[&str]) -> ExitCode {
    match options {
        [] => with_root(|root| tidy::run(&root)),
        ["--list"] => {
            for check in tidy::CHECKS {
                println!("{:<13} {}", check.name, check.rule);
            }
            ExitCode::SUCCESS
        }
        ["--help" | "-h"] => {
            print!("{HELP}");
            ExitCode::SUCCESS
        }
        [other, ..] => refuse(&format!("`tidy` knows no `{other}`; see `cargo xtask help`")),
    }
}

fn campaign(options: &[&str]) -> ExitCode {
    let Some((&name, mut rest)) = options.split_first() else {
        return refuse("a campaign needs its name; see `cargo xtask campaign --list`");
    };
    if name == "--list" {
        for campaign in campaign::CAMPAIGNS {
            println!("{:<10} {}", campaign.name, campaign.purpose);
        }
        return ExitCode::SUCCESS;
    }
    let Some(campaign) = campaign::CAMPAIGNS.iter().find(|campaign| campaign.name == name) else {
        return refuse(&format!("there is no campaign `{name}`; see `cargo xtask campaign --list`"));
    };
    let (mut full, mut seed) = (false, 1);
    loop {
        match rest {
            [] => break,
            ["--full", more @ ..] => (full, rest) = (true, more),
            ["--seed", number, more @ ..] => match number.parse() {
                Ok(number) => (seed, rest) = (number, more),
                Err(_) => return refuse(&format!("`{number}` is no seed: a whole number")),
            },
            [other, ..] => return refuse(&format!("`campaign` knows no `{other}`; see `cargo xtask help`")),
        }
    }
    with_root(|root| campaign::run(&root, campaign, full, seed))
}

/// Runs a task at the workspace's root and turns its verdict into an exit code.
fn with_root(task: impl FnOnce(PathBuf) -> bool) -> ExitCode {
    let here = std::env::current_dir().unwrap_or_default();
    match here.ancestors().find(|folder| folder.join("xtask/Cargo.toml").is_file()) {
        Some(root) if task(root.to_path_buf()) => ExitCode::SUCCESS,
        Some(_) => ExitCode::FAILURE,
        None => refuse("run this inside the retrace checkout"),
    }
}

fn refuse(reason: &str) -> ExitCode {
    eprintln!("xtask: {reason}");
    ExitCode::from(USAGE_ERROR)
}
