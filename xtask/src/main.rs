//! Developer tasks of retrace: `cargo xtask test` is what a change must pass, here and in continuous integration.
//!
//! Invariant: a task that cannot be executed says so and fails; no step reports a success that it has not observed.
#![forbid(unsafe_code)]

mod campaign;
mod figures;
mod firmware;
mod fuzz;
mod mutants;
mod release;
mod suite;
mod test_output;
mod tidy;

use retrace_bench as bench;
use retrace_verify as verify;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Wrong usage, or a task that does not exist yet.
const USAGE_ERROR: u8 = 2;

const HELP: &str = "\
Developer tasks of retrace.

Usage: cargo xtask <TASK>

Tasks:
  test   everything a change must pass: format, tidy, clippy, tests, the page in a browser, doc tests, rustdoc
           --list          name the steps and leave
           --only STEP     run this step only; may be given more than once
           --require peers a test whose peer (rs274, programs of others, a browser) is missing fails; else it is NOT RUN
  tidy   the project's own rules, which no other tool knows
           --list          name the checks and leave
  campaign NAME   a random end-to-end test with its own seed and more cases; results go into docs/campaigns.md
           --full          the full size
           --seed N        the seed, 1 without it
           --resume        of `mutants`: what an earlier run of the same sample has completed is not run again
           --page          of `mutants`: writes the figures of what is complete, and runs nothing
           --list          name the campaigns and leave
  verify   every property of verification/ by every engine that is here; docs/verification.md says what that shows
           --quick         what a test run has time for; without it the ledger verification/LEDGER.md is written
           --engine NAME   this engine only; may be given more than once or as a list: native, stub, loom, shuttle, \
           cbmc, kani,
                           mutants, cbmc-mutants
           --require NAMES engines whose absence is a failure: kani,cbmc; `current`: a row of the ledger that is of
                           other sources is one, too
           --row NAME      this row only; may be given more than once
           --update        write the rows of this run to the ledger, without a full run
           --list          name the rows and their checks and leave
           --replay HARNESS=1,2,3   run a harness over the numbers of a counterexample
  bench NAME   measure; the figures go into docs/
           --full          the full sizes
           --list          name the benches and leave
  figures [FILE …]   make every picture of README and docs anew, or those that are named
           --list          name them and leave
  firmware WHAT   the card on a microcontroller; docs/firmware.md
           build           compile it: f405, f401, f411, pico and pico2
           size            the same, and hold flash and RAM to their budgets
           --board NAME    this one only; may be given more than once
           --crystal MHZ   the board's crystal, 8 or 25; without it the internal oscillator
           emulate         run it in QEMU, with its line at a terminal, until interrupted
           test            everything that can be tested here; what is missing is named
  book   the documentation as one book with a search, in target/book/html; needs mdbook
  dist   archives with a static binary, completions and manual pages, in target/dist
  package    package every crate that could be published; publishes nothing
  licences   hold the licences of all dependencies to deny.toml
  help   this text

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
        Some((&"verify", options)) => verify(options),
        Some((&"bench", options)) => bench(options),
        Some((&"figures", words)) => figures(words),
        Some((&"firmware", words)) => match firmware::Order::read(words) {
            Ok(order) => with_root(|root| firmware::run(&root, &order)),
            Err(reason) => refuse(&reason),
        },
        Some((&"book", options)) => plain(options, "book", release::book::run),
        Some((&"dist", options)) => plain(options, "dist", release::dist::run),
        Some((&"package", options)) => plain(options, "package", release::package::run),
        Some((&"licences", options)) => plain(options, "licences", release::licences::run),
        Some((&unknown, _)) => refuse(&format!("there is no task `{unknown}`; see `cargo xtask help`")),
    }
}

/// Runs a task that has no options.
fn plain(options: &[&str], name: &str, task: fn(&Path) -> bool) -> ExitCode {
    match options {
        [] => with_root(|root| task(&root)),
        ["--help" | "-h"] => {
            print!("{HELP}");
            ExitCode::SUCCESS
        }
        [other, ..] => refuse(&format!("`{name}` knows no `{other}`; see `cargo xtask help`")),
    }
}

fn test(options: &[&str]) -> ExitCode {
    let (mut only, mut settings): (Vec<&str>, _) = (Vec::new(), suite::Settings::default());
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
            "--require" => match rest.next() {
                Some(&"peers") => settings.require_peers = true,
                _ => return refuse("--require needs `peers`; see `cargo xtask help`"),
            },
            other => return refuse(&format!("`test` knows no `{other}`; see `cargo xtask help`")),
        }
    }
    with_root(|root| suite::run(&root, &only, &settings))
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
        println!("{:<10} {}", "fuzz", fuzz::PURPOSE);
        println!("{:<10} {}", "mutants", mutants::PURPOSE);
        return ExitCode::SUCCESS;
    }
    let campaign = campaign::CAMPAIGNS.iter().find(|campaign| campaign.name == name);
    if campaign.is_none() && name != "fuzz" && name != "mutants" {
        return refuse(&format!("there is no campaign `{name}`; see `cargo xtask campaign --list`"));
    }
    let (mut full, mut seed, mut reuse) = (false, 1, mutants::Reuse::Nothing);
    loop {
        match rest {
            [] => break,
            ["--full", more @ ..] => (full, rest) = (true, more),
            ["--resume", more @ ..] if name == "mutants" => (reuse, rest) = (mutants::Reuse::Resume, more),
            ["--page", more @ ..] if name == "mutants" => (reuse, rest) = (mutants::Reuse::PageOnly, more),
            ["--seed", number, more @ ..] => match number.parse() {
                Ok(number) => (seed, rest) = (number, more),
                Err(_) => return refuse(&format!("`{number}` is not a seed: a whole number")),
            },
            [other, ..] => return refuse(&format!("`campaign` knows no `{other}`; see `cargo xtask help`")),
        }
    }
    with_root(|root| match campaign {
        Some(campaign) => campaign::run(&root, campaign, full, seed),
        None if name == "mutants" => mutants::run(&root, full, seed, reuse),
        None => fuzz::run(&root, full, seed),
    })
}

fn bench(options: &[&str]) -> ExitCode {
    let (name, full) = match options {
        ["--list"] => {
            for bench in bench::BENCHES {
                println!("{:<10} {}", bench.name, bench.purpose);
            }
            return ExitCode::SUCCESS;
        }
        ["--help" | "-h"] => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        [name] | ["--full", name] if *name == "--full" => {
            return refuse("a bench needs its name; see `cargo xtask bench --list`");
        }
        [name] => (*name, false),
        [name, "--full"] | ["--full", name] => (*name, true),
        [] => return refuse("a bench needs its name; see `cargo xtask bench --list`"),
        [_, other, ..] => return refuse(&format!("`bench` knows no `{other}`; see `cargo xtask help`")),
    };
    match bench::BENCHES.iter().find(|bench| bench.name == name) {
        Some(bench) => with_root(|root| bench::run(&root, bench, full)),
        None => refuse(&format!("there is no bench `{name}`; see `cargo xtask bench --list`")),
    }
}

fn figures(words: &[&str]) -> ExitCode {
    match words {
        ["--help" | "-h"] => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        ["--list"] => {
            for figure in figures::FIGURES {
                println!("{}", figure.file);
            }
            return ExitCode::SUCCESS;
        }
        _ => {}
    }
    match words.iter().find(|name| !figures::FIGURES.iter().any(|figure| figure.file == **name)) {
        Some(unknown) => refuse(&format!("there is no figure `{unknown}`; see `cargo xtask figures --list`")),
        None => with_root(|root| figures::run(&root, words)),
    }
}

fn verify(options: &[&str]) -> ExitCode {
    if matches!(options, ["--help" | "-h", ..]) {
        print!("{HELP}");
        return ExitCode::SUCCESS;
    }
    let options = match verify::Options::read(options) {
        Ok(options) => options,
        Err(reason) => return refuse(&reason),
    };
    let mut refused = None;
    let code = with_root(|root| match verify::run(&root, &options) {
        Ok(summary) => summary.passed,
        Err(reason) => {
            refused = Some(reason);
            false
        }
    });
    refused.map_or(code, |reason| refuse(&reason))
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
