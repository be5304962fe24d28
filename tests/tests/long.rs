//! A long job: planned and played in memory that does not grow with it. How long planning takes is measured by
//! `cargo xtask bench motion`, and held against a limit nowhere here: beside other processes it is many times longer.

use retrace_tests::command::Bench;
use retrace_tests::programs::long_job;

#[test]
fn an_hour_takes_no_more_memory_than_its_history() {
    let bench = Bench::new();
    let program = bench.file("long.ngc", long_job(60));
    let result = bench.retrace(["run".as_ref(), program.as_os_str(), "--json".as_ref()]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    let report: serde_json::Value =
        serde_json::from_str(result.out.lines().last().unwrap_or_default()).expect("a report");
    let (motion_s, wall_s) = (report["motion_s"].as_f64().expect("motion"), report["wall_s"].as_f64().expect("wall"));
    println!("{motion_s} s of motion in {wall_s} s");
    assert!(motion_s > 3600.0, "{report}");
    assert_eq!((&report["limit_violations"], &report["underruns"]), (&0.into(), &0.into()));
    // The history of half an hour takes 27.5 MiB; an hour must not take more than that and the look-ahead.
    assert!(report["peak_rss_mib"].as_f64().is_none_or(|mib| mib < 100.0), "{report}");
}

#[test]
fn drip_feed_takes_no_more_memory_for_a_longer_program() {
    let peak = |minutes: u32| {
        let bench = Bench::new();
        let machine = bench.file("m.toml", "history_hours = 0.01\n");
        let arguments = ["run", "-", "--json", "--machine", &machine.to_string_lossy()];
        let result = bench.retrace_reading(arguments, long_job(minutes).as_bytes());
        assert_eq!(result.code, Some(0), "{}", result.err);
        let report: serde_json::Value =
            serde_json::from_str(result.out.lines().last().unwrap_or_default()).expect("a report");
        report["peak_rss_mib"].as_f64()
    };
    if let (Some(short), Some(long)) = (peak(5), peak(30)) {
        assert!(long < short + 4.0, "{short} MiB for 5 minutes, {long} MiB for half an hour");
    }
}
