//! `docs/cycles.md` matches the cycles: its example runs, and its signatures and alarms are those of the cycles.
//!
//! Invariant: every check is made in both directions.

use crate::common;

use common::{Recorder, halted, run};
use retrace_cycles::{CycleLibrary, alarm_text, shipped_source};

const DOCUMENT: &str = include_str!("../../../../docs/cycles.md");

#[test]
fn the_example_of_a_users_cycle_runs() {
    let begin = DOCUMENT.find("    ;POCKET").expect("the example");
    let source: String = DOCUMENT[begin..]
        .lines()
        .take_while(|line| line.starts_with("    "))
        .map(|line| format!("{}\n", line.trim()))
        .collect();
    let library = CycleLibrary::of_sources(&[("POCKET", &source)]);
    assert_eq!(library.findings(), [], "{source}");
    let mut host = Recorder { position: [1.0, 2.0, 0.0], ..Recorder::default() };
    assert_eq!(run(&library, "POCKET(10,20,4,2)", &mut host), Ok(()));
    let pass = |z: &str| [z, "G1 X11", "G1 Y22", "G1 X1", "G1 Y2"].map(str::to_owned);
    assert_eq!(host.lines, [pass("G1 G90 Z-2"), pass("G1 G90 Z-4")].concat());
    let alarm = halted(run(&library, "POCKET(0,20)", &mut Recorder::default()));
    assert_eq!(alarm.text, "POCKET: no size, WIDTH=0 HEIGHT=20");
}

#[test]
fn every_cycle_is_written_with_its_parameters() {
    for (_, cycle) in CycleLibrary::shipped().iter() {
        let parameters: Vec<&str> = cycle.parameters().iter().map(|parameter| parameter.name.as_str()).collect();
        // Parameters that are ignored are listed elsewhere.
        let parameters: Vec<&str> =
            parameters.into_iter().filter(|name| !["_GMODE", "_DMODE"].contains(name)).collect();
        let head = format!("{}({})", cycle.name(), parameters.join(","));
        assert!(DOCUMENT.contains(&head), "{head}");
    }
}

/// Returns the numbers that a cycle uses in SETAL.
fn raised(source: &str) -> impl Iterator<Item = u32> {
    source.match_indices("SETAL(").filter_map(|(at, mark)| source[at + mark.len()..].split(',').next()?.parse().ok())
}

#[test]
fn every_alarm_is_in_the_table_and_in_the_document() {
    let documented = |number: u32| DOCUMENT.contains(&format!("\n| {number} | "));
    for (_, cycle) in CycleLibrary::shipped().iter() {
        for number in raised(shipped_source(cycle.name()).expect("a source")) {
            assert!(alarm_text(number).is_some() && documented(number), "{number} of {}", cycle.name());
        }
    }
    let rows = DOCUMENT.lines().filter_map(|line| line.strip_prefix("| ")?.split(' ').next()?.parse::<u32>().ok());
    let rows: Vec<u32> = rows.filter(|number| *number > 1000).collect();
    assert!(rows.len() > 20 && rows.iter().all(|number| alarm_text(*number).is_some()), "{rows:?}");
}
