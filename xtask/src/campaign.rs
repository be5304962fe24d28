//! `cargo xtask campaign`: the random tests, in a size that the test suite has no time for.
//!
//! Invariant: a campaign is one of the tests of the suite with more cases and a seed of its own; the suite runs a slice
//! of it.

use crate::firmware;
use retrace_task_support::process;
use std::path::Path;

/// One campaign.
pub(crate) struct Campaign {
    pub(crate) name: &'static str,
    pub(crate) purpose: &'static str,
    /// Its test: package, test binary, and name.
    test: [&'static str; 3],
    /// Environment variables with the number of cases, and the seed.
    asked: [&'static str; 2],
    /// Cases of a full run, and without `--full`.
    full: u32,
    slice: u32,
}

/// Variables of the end-to-end tests.
const END_TO_END: [&str; 2] = ["RETRACE_CASES", "PROPTEST_RNG_SEED"];

/// Variables of tests that draw each case from a seed of its own, one after the other.
const BY_SEED: [&str; 2] = ["RETRACE_CASES", "RETRACE_FIRST_SEED"];

/// The campaign that needs an image and its emulator.
const PICO: &str = "pico";

/// The campaign that needs a host application of others.
const SPARKPLUG: &str = "sparkplug-host";

/// Names that host application to its test.
pub(crate) const SPARKPLUG_HOST: &str = "RETRACE_SPARKPLUG_HOST";

/// Every campaign.
pub(crate) const CAMPAIGNS: &[Campaign] = &[
    Campaign {
        name: "operator",
        purpose: "whatever an operator does, the job ends exactly and within the limits",
        test: ["retrace-tests", "campaigns", "operator::whatever_the_operator_does_the_job_ends_exactly"],
        asked: END_TO_END,
        full: 3000,
        slice: 24,
    },
    Campaign {
        name: "operator-threads",
        purpose: "the same in a program of threads, which are passed backward and cut again",
        test: [
            "retrace-tests",
            "campaigns",
            "operator_threads::whatever_the_operator_does_in_threads_the_job_ends_exactly",
        ],
        asked: END_TO_END,
        full: 1000,
        slice: 8,
    },
    Campaign {
        name: "program",
        purpose: "any program ends exactly and within the limits",
        test: ["retrace-tests", "campaigns", "any_program::any_program_ends_exactly_and_within_the_limits"],
        asked: END_TO_END,
        full: 3000,
        slice: 24,
    },
    Campaign {
        name: "differential",
        purpose: "random programs give the canonical functions of LinuxCNC's rs274, call by call",
        test: ["retrace-gcode", "testsuite", "differential::random_programs_give_the_canonical_functions_of_rs274"],
        asked: ["RETRACE_DIFFERENTIAL", "RETRACE_DIFFERENTIAL_FIRST"],
        full: 100_000,
        slice: 400,
    },
    Campaign {
        name: "macros",
        purpose: "random programs of GOTO, IF and WHILE go from line to line as a small machine of the test's own does",
        test: [
            "retrace-gcode",
            "testsuite",
            "macro_words::random_programs_go_from_line_to_line_as_a_machine_of_their_own_does",
        ],
        asked: END_TO_END,
        full: 200_000,
        slice: 2000,
    },
    Campaign {
        name: "motion",
        purpose: "any path in any mode at any override: the limits, the ends, the tolerance, the optimum of corners",
        test: ["retrace-motion", "testsuite", ""],
        asked: END_TO_END,
        full: 1000,
        slice: 40,
    },
    Campaign {
        name: "line",
        purpose: "whatever the line does, a job ends exactly or in a latched alarm, on the path; and every single \
            fault at every frame",
        test: ["retrace-controller", "testsuite", "line::"],
        asked: BY_SEED,
        full: 1000,
        slice: 100,
    },
    Campaign {
        name: "order",
        purpose: "no motion is executed on the wrong side of an instruction, for any delay of the line; with the \
            source's literal gates it is",
        test: ["retrace-controller", "testsuite", "order::"],
        asked: BY_SEED,
        full: 10_000,
        slice: 500,
    },
    Campaign {
        name: "wheel",
        purpose: "whatever the handwheel is turned like, motion follows the mean of its counts between the ends of \
            the history, within the limits",
        test: ["retrace-controller", "testsuite", "wheel::"],
        asked: BY_SEED,
        full: 3000,
        slice: 200,
    },
    Campaign {
        name: "drip",
        purpose: "a program from a socket that stalls, is cut and reconnects: bounded memory, exact counts, pauses \
            resumed exactly",
        test: ["retrace-tests", "campaigns", "drip::"],
        asked: BY_SEED,
        full: 1_000_000,
        slice: 100_000,
    },
    Campaign {
        name: "dnc",
        purpose: "every sequence of up to so many words of a pause: what the order allows is done and ends exactly, \
            all else is refused",
        test: ["retrace-controller", "testsuite", "interruption::"],
        asked: ["RETRACE_WORDS", "RETRACE_FIRST_SEED"],
        full: 6,
        slice: 4,
    },
    Campaign {
        name: "kill",
        purpose: "a host killed at any moment of a job: resumed, the job ends exactly, every instruction once, or is \
            refused with the reason",
        test: ["retrace-tests", "campaigns", "kill::"],
        asked: BY_SEED,
        full: 1000,
        slice: 30,
    },
    Campaign {
        name: "shop-jobs",
        purpose: "submitter, agent and runs of a shop's jobs killed at any moment: every job is cut in its quantity, \
            none twice, none lost; 8 jobs a case",
        test: ["retrace-tests", "campaigns", "shop_jobs::"],
        asked: BY_SEED,
        full: 125,
        slice: 2,
    },
    Campaign {
        name: "shop-broker",
        purpose: "jobs of a shop of half as many machines, at most 50, around a nats-server; server, host, agents, \
            runs and machines killed at any moment: every job is cut in its quantity by one machine",
        test: ["retrace-tests", "campaigns", "shop_broker::"],
        asked: BY_SEED,
        full: 1000,
        slice: 4,
    },
    Campaign {
        name: "shop-away",
        purpose: "a run on a served card while the broker is away for so many seconds: nothing is late, and everything \
            follows",
        test: ["retrace-tests", "campaigns", "shop_away::"],
        asked: BY_SEED,
        full: 600,
        slice: 3,
    },
    Campaign {
        name: "shop-messages",
        purpose: "everything that an agent reads from the broker, filled with random and changed messages: nothing \
            starts, and only what was signed reaches the inbox",
        test: ["retrace-tests", "campaigns", "shop_messages::"],
        asked: BY_SEED,
        full: 100_000,
        slice: 1500,
    },
    Campaign {
        name: SPARKPLUG,
        purpose: "sessions of a Sparkplug node that is killed, judged by the host application srad over mosquitto: \
            births, deaths by will, data in sequence, rebirths on request",
        test: ["retrace-tests", "campaigns", "sparkplug_host::"],
        asked: BY_SEED,
        full: 1000,
        slice: 10,
    },
    Campaign {
        name: "spindle-faults",
        purpose: "every fault of the encoder and the spindle in a thread is an alarm",
        test: ["retrace-hal-sim", "testsuite", "threads::no_fault_of_the_encoder_is_silent"],
        asked: BY_SEED,
        full: 20_000,
        slice: 60,
    },
    Campaign {
        name: "kill-probing",
        purpose: "a host killed at any moments of a job that probes: resumed, it ends exactly, with the same points, \
            and no answer in its journal twice",
        test: ["retrace-tests", "campaigns", "kill_probing::a_host_that_is_killed_while_it_probes"],
        asked: BY_SEED,
        full: 200,
        slice: 10,
    },
    Campaign {
        name: "kill-threads",
        purpose: "a host killed at any moments of a job that cuts threads: resumed, it goes on in the groove and ends \
            exactly",
        test: ["retrace-tests", "campaigns", "kill_probing::a_host_that_is_killed_in_a_thread"],
        asked: BY_SEED,
        full: 200,
        slice: 6,
    },
    Campaign {
        name: "off",
        purpose: "jobs on jet, plasma, laser and router, stopped, held, paused, killed, cut off and resumed: the \
            cutter is off outside of a cut",
        test: ["retrace-tests", "campaigns", "off::"],
        asked: BY_SEED,
        full: 2000,
        slice: 30,
    },
    Campaign {
        name: "recovery",
        purpose: "cuts that are lost, held and put out at random and recovered: the sheet and every count are those of \
            the job that was not interrupted",
        test: ["retrace-tests", "campaigns", "recovery::"],
        asked: BY_SEED,
        full: 1000,
        slice: 8,
    },
    Campaign {
        name: "cut-day",
        purpose: "a day of cutting, 20 000 pierces with failed starts, losses and chatter, also with height control \
            over a warped sheet, and in part over a line with faults: all is cut, memory does not grow",
        test: ["retrace-tests", "campaigns", "cut_day::"],
        asked: BY_SEED,
        full: 20_000,
        slice: 150,
    },
    Campaign {
        name: "cut-heights",
        purpose: "random contours with height control over a warped sheet, with failed starts, losses, chatter, \
            corners and known kerfs: a separate judge finds every height, every pulse and the layer right",
        test: ["retrace-tests", "campaigns", "cut_heights::"],
        asked: BY_SEED,
        full: 10_000,
        slice: 24,
    },
    Campaign {
        name: "power-cuts",
        purpose: "power failures in a cut, host and card gone and the tail of the journal missing: the end of the cut \
            is known within a second, and the part is whole",
        test: ["retrace-tests", "campaigns", "power_cuts::"],
        asked: BY_SEED,
        full: 120,
        slice: 12,
    },
    Campaign {
        name: "cut-ends",
        purpose: "jobs on a torch that end in twelve ways at any moment, each: the torch is off behind the end, or \
            within the watchdog where the host or the line is gone",
        test: ["retrace-tests", "campaigns", "cut_ends::"],
        asked: BY_SEED,
        full: 100,
        slice: 1,
    },
    Campaign {
        name: "starts",
        purpose: "cutters whose attempts fail with a probability: three attempts at most, as many starts without an \
            arc as the cube of it, and no feed before a start is complete",
        test: ["retrace-tests", "campaigns", "cut_cycle::starts_are_repeated_three_times_and_nothing_is_fed_before"],
        asked: BY_SEED,
        full: 10_000,
        slice: 400,
    },
    Campaign {
        name: "losses",
        purpose: "cuts that are lost at any place: the place that is told is that of the loss, within a record",
        test: ["retrace-tests", "campaigns", "cut_cycle::a_loss_is_told_where_it_happened"],
        asked: BY_SEED,
        full: 10_000,
        slice: 200,
    },
    Campaign {
        name: "jets",
        purpose: "jets with any delay, lag and purge: the abrasive never without water, and off at its lag",
        test: ["retrace-tests", "campaigns", "cut_cycle::the_abrasive_follows_the_water_and_ends_before_it"],
        asked: BY_SEED,
        full: 1000,
        slice: 100,
    },
    Campaign {
        name: "cut",
        purpose: "a journal cut at every write and every byte of its last records: the job is resumed and ends exactly",
        test: ["retrace-tests", "campaigns", "cut::"],
        asked: BY_SEED,
        full: 1000,
        slice: 20,
    },
    Campaign {
        name: "page-requests",
        purpose: "hostile requests to the page's server change nothing, and its memory is bounded",
        test: ["retrace-tests", "page_hostile", "hostile_requests_change_nothing"],
        asked: BY_SEED,
        full: 10_000,
        slice: 200,
    },
    Campaign {
        name: "page-dead",
        purpose: "a page that dies while it holds a jog: the axis brakes within 200 ms of its last beat, by the wires",
        test: ["retrace-tests", "page_dead", "a_dead_page_stops_its_jog"],
        asked: BY_SEED,
        full: 200,
        slice: 20,
    },
    Campaign {
        name: "page-late",
        purpose: "five more pages, one of which reads nothing, on two busy cores in real time: no control period later",
        test: ["retrace-tests", "page_late", "pages_do_not_make_the_motion_late"],
        asked: BY_SEED,
        full: 11,
        slice: 1,
    },
    Campaign {
        name: "page",
        purpose: "a long program on the page in a browser: first picture, pictures a second, memory, from finger to \
            hold",
        test: ["retrace-tests", "browser", "million::"],
        asked: END_TO_END,
        full: 1_000_000,
        slice: 100_000,
    },
    Campaign {
        name: PICO,
        purpose: "random jobs on the Pico's image in its emulator: the pins do what the card crate orders, in every \
            control period; the cases are periods",
        test: ["retrace-controller", "testsuite", "pico::"],
        asked: BY_SEED,
        full: 1_000_000,
        slice: 10_000,
    },
    Campaign {
        name: "decoder",
        purpose: "any bytes and any damaged frames: no panic, and no false frame beyond the checksum's odds",
        test: ["retrace-link", "testsuite", "decoder::"],
        asked: BY_SEED,
        full: 100_000_000,
        slice: 1_000_000,
    },
];

/// Runs a campaign and returns whether it passed.
pub(crate) fn run(root: &Path, campaign: &Campaign, full: bool, seed: u64) -> bool {
    let [package, file, test] = campaign.test;
    let cases = if full { campaign.full } else { campaign.slice };
    println!("campaign {}: {} ({cases} cases, seed {seed})", campaign.name, campaign.purpose);
    let arguments =
        ["test", "--release", "--package", package, "--test", file, "--", test, "--nocapture", "--include-ignored"];
    let mut command = process::cargo(root, &arguments);
    let [count, first] = campaign.asked;
    command.env(count, cases.to_string()).env(first, seed.to_string()).env_remove("RETRACE_BIN");
    let environment = match campaign.name {
        PICO => firmware::comparison_environment(root).map(Some),
        SPARKPLUG => sparkplug_host(root).map(|path| Some((SPARKPLUG_HOST, path))),
        _ => Ok(None),
    };
    match environment {
        Ok(environment) => command.envs(environment),
        Err(reason) => {
            eprintln!("xtask: {reason}");
            return false;
        }
    };
    match command.status() {
        Ok(status) => status.success(),
        Err(error) => {
            eprintln!("xtask: cargo could not be run: {error}");
            false
        }
    }
}

/// Builds the host application, which is a workspace of its own, and returns where it is.
fn sparkplug_host(root: &Path) -> Result<String, String> {
    let folder = root.join("tests/sparkplug-host");
    let mut command = process::cargo(&folder, &["build", "--locked", "--message-format", "json-render-diagnostics"]);
    // a folder of its own: the same one would wait for a build of the workspace
    let target = firmware::target_folder(root).join("sparkplug-host");
    Ok(process::build(command.env("CARGO_TARGET_DIR", target))?.display().to_string())
}
