//! `retrace check` tells before a run what the run will come to.

use retrace_tests::command::Bench;
use retrace_tests::programs::examples;
use serde_json::Value;

fn last(text: &str) -> Value {
    serde_json::from_str(text.lines().next_back().unwrap_or_default()).unwrap_or_default()
}

#[test]
fn the_time_told_is_the_time_run_for_every_example() {
    let bench = Bench::new();
    let mut seen = 0;
    for path in examples() {
        let said = bench.retrace(["check".as_ref(), path.as_os_str(), "--json".as_ref()]);
        assert_eq!(said.code, Some(0), "{}", said.err);
        let told = last(&said.out);
        let ran = last(&bench.retrace(["run".as_ref(), path.as_os_str(), "--json".as_ref()]).out);
        for key in ["blocks", "motion_s", "dwell_s", "switch_s"] {
            assert_eq!(told[key], ran[key], "{key} of {}", path.display());
        }
        seen += 1;
    }
    assert!(seen > 10, "{seen}");
}

#[test]
fn extents_room_tools_ranges_and_barriers_are_told_in_both_forms() {
    let bench = Bench::new();
    bench.file("tools.tbl", "T1 P1 Z40 D6 ; end mill\nT2 P2 Z55.5 D3\n");
    bench.file("m.toml", "[code.M3]\nduration_ms = 250\n[code.M101]\noutput = 1\nin_reverse = \"barrier\"\n[[output]]\nnumber = 1\nname = \"air\"\n");
    let program = "G10 L2 P2 X100 Y-50\nT1 M6\nS8000 M3\nG55 G43 G0 X0 Y0 Z10\nG2 X20 I10 F600\nM101\nG4 P1.5\nM0\nT2 M6\nS3000\nG1 X-5 F90\nM2\n";
    bench.file("p.ngc", program);
    let with = ["p.ngc", "--tools", "tools.tbl", "--machine", "m.toml"];
    let said = bench.retrace([&["check", "--json"][..], &with].concat());
    assert_eq!((said.code, said.err.as_str()), (Some(0), ""));
    let told = last(&said.out);
    assert_eq!(told["extents_mm"]["x"], serde_json::json!([95.0, 120.0]));
    assert_eq!(told["extents_mm"]["y"], serde_json::json!([-50.0, -40.0]));
    assert_eq!(told["room_mm"]["x"], serde_json::json!([2095.0, 1880.0]));
    assert_eq!(told["work"][0]["system"], "G55");
    assert_eq!(told["work"][0]["extents_mm"]["y"], serde_json::json!([0.0, 10.0]));
    assert_eq!(told["work"][0]["extents_mm"]["x"], serde_json::json!([-5.0, 20.0]));
    assert_eq!(
        told["tools"][0],
        serde_json::json!({"number": 1, "name": "end mill", "length_mm": 40.0, "diameter_mm": 6.0})
    );
    assert_eq!((&told["tools"][1]["number"], &told["tools"][1]["name"]), (&Value::from(2), &Value::Null));
    assert_eq!(told["feed_mm_per_min"], serde_json::json!([90.0, 600.0]));
    assert_eq!(told["speed_rpm"], serde_json::json!([3000.0, 8000.0]));
    let barriers: Vec<_> =
        told["barriers"].as_array().expect("a list").iter().map(|b| (b["line"].clone(), b["code"].clone())).collect();
    assert_eq!(barriers, [(2.into(), "M6".into()), (6.into(), "M101".into()), (9.into(), "M6".into())]);
    assert_eq!(
        (&told["stops"], &told["dwell_s"], &told["switch_s"]),
        (&serde_json::json!([8]), &1.5.into(), &0.25.into())
    );
    let text = bench.retrace([&["check"][..], &with].concat()).out;
    for part in [
        "room 2095.000 below, 1880.000 above",
        "in G55: X -5.000 … 20.000",
        "T1 (end mill, length 40.000 mm, diameter 6.000 mm)",
        "feed 90.0 … 600.0 mm/min · spindle 3000.0 … 8000.0 turns/min",
        "cannot be passed backward: M6 of line 2, M101 of line 6, M6 of line 9",
        "stops: line 8",
    ] {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
    let refused = bench.retrace(["check", "-", "--json"]);
    assert_eq!((refused.code, refused.out.as_str()), (Some(2), ""));
}

#[test]
fn lengths_pierces_time_per_tool_and_feeds_beyond_the_machine_are_told() {
    let bench = Bench::new();
    bench.file("m.toml", "cutting_outputs = [3]\n");
    // 10 mm of rapid, 30 mm and a half circle of 10 mm radius of feed; the output goes on twice
    let program = "G21 G90\nT1 M6\nG0 X10\nM64 P3\nG1 X30 F600\nG3 X10 I-10 J0 F9000\nM65 P3\nT2 M6\nM64 P3\nM64 P3\nG1 X20\nM65 P3\nM2\n";
    bench.file("p.ngc", program);
    let said = bench.retrace(["check", "p.ngc", "--machine", "m.toml", "--json"]);
    assert_eq!(said.code, Some(0), "{}", said.err);
    let told = last(&said.out);
    let is = |key: &str, value: f64| {
        let found = told[key].as_f64().unwrap_or(f64::NAN);
        assert!((found - value).abs() < 1e-6, "{key}: {found}, not {value}: {told}");
    };
    is("rapid_mm", 10.0);
    is("cutting_mm", 30.0 + std::f64::consts::PI * 10.0);
    is("pierces", 2.0);
    let total = ["motion_s", "dwell_s", "switch_s"].map(|key| told[key].as_f64().expect(key)).iter().sum::<f64>();
    is("total_s", total);
    let tools = told["tool_motion_s"].as_object().expect("tools");
    let sum = tools.values().filter_map(Value::as_f64).sum::<f64>();
    assert!((sum - told["motion_s"].as_f64().expect("a time")).abs() < 1e-6 && tools.contains_key("2"), "{told}");
    assert_eq!(told["feed_beyond"], serde_json::json!({"line": 6, "feed_mm_per_min": 9000.0}));
    let text = bench.retrace(["check", "p.ngc", "--machine", "m.toml"]).out;
    for part in [
        "at 100 %: 0:00:",
        "pierces 2",
        "motion with each tool: T1 0:00:",
        "line 6 asks for a feed of 9000.0 mm/min; the machine moves at 6000.0",
    ] {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
}
