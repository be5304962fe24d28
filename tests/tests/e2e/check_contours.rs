//! What `retrace check` knows of a cutting program before it runs: times, contours, materials.

use retrace_tests::command::{Bench, assert_contains, root};
use serde_json::{Value, json};

fn last(text: &str) -> Value {
    serde_json::from_str(text.lines().next_back().unwrap_or_default()).unwrap_or_default()
}

fn number(of: &Value, key: &str) -> f64 {
    of[key].as_f64().unwrap_or_else(|| panic!("{key} of {of}"))
}

/// A torch with materials and an arc-ok contact, on X and Y; `start` has further keys.
fn machine(start: &str) -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 100\nmax_velocity_mm_per_s = 200\n\
                max_acceleration_mm_per_s2 = 2000\nmax_jerk_mm_per_s3 = 40000\ntravel_mm = [0, 500]\n"
        )
    };
    format!(
        "homed = true\n{}{}[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nspindle = 0\n\
            materials = \"materials.toml\"\nok = {{ input = 5 }}\nstart = {{ {start} }}\n",
        axis("x"),
        axis("y")
    )
}

const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n\
    [[material]]\nnumber = 1\nname = \"Steel\"\npierce_height_mm = 4\npierce_delay_s = 0.5\ncut_height_mm = 1.5\n\
    feed_mm_per_min = 1200\npause_at_end_s = 0.25\n\
    [[material]]\nnumber = 2\npierce_height_mm = 4\npierce_delay_s = 1\ncut_height_mm = 1.5\nfeed_mm_per_min = 600\n";

/// Three contours: of the main program, of a subprogram with another material, and with a temporary one.
const PROGRAM: &str = "o100 sub\nG0 X50 Y[#1]\nM3 $0 S1\nG1 X60 F600\nM5 $0\no100 endsub\n\
    G21 G90 G64 P0.01\nG10 L2 P1 X10 Y20\nF1200\nG0 X5 Y0\nM3\nG1 X35\nG2 X55 I10\nM5\nM190 P2\no100 call [30]\n\
    (o=0, na=Thin, ph=4, pd=0.2, ch=1.5, fr=1200)\nF1200\nG0 X5 Y5\nM3\nG1 X8 Y9\nM5\nM2\n";

fn cutting_bench(machine: &str) -> Bench {
    let bench = Bench::new();
    bench.file("m.toml", machine);
    bench.file("materials.toml", MATERIALS);
    bench.file("p.ngc", PROGRAM);
    bench
}

#[test]
fn contours_are_listed_with_their_material_and_places_before_the_run() {
    let bench = cutting_bench(&machine(""));
    let result = bench.retrace(["check", "p.ngc", "--machine", "m.toml", "--json"]);
    assert_eq!((result.code, result.err.as_str()), (Some(0), ""));
    let summary = last(&result.out);
    let contours = summary["contours"].as_array().expect("a list");
    let keys = |contour: &Value| {
        let keys = ["number", "line", "subprogram", "cutter", "material", "pierce_mm", "end_mm"];
        Value::Array(keys.map(|key| contour[key].clone()).into())
    };
    let found: Vec<Value> = contours.iter().map(keys).collect();
    // Machine positions: the origin of G54 is at 10, 20.
    let wanted = [
        json!([1, 11, null, "torch", 1, {"x": 15.0, "y": 20.0}, {"x": 65.0, "y": 20.0}]),
        json!([2, 3, "O100", "torch", 2, {"x": 60.0, "y": 50.0}, {"x": 70.0, "y": 50.0}]),
        json!([3, 20, null, "torch", 1_000_000, {"x": 15.0, "y": 25.0}, {"x": 18.0, "y": 29.0}]),
    ];
    assert_eq!(found, wanted);
    let lengths = [30.0 + 10.0 * std::f64::consts::PI, 10.0, 5.0];
    for (contour, length) in contours.iter().zip(lengths) {
        assert!((number(contour, "length_mm") - length).abs() < 0.01, "{contour}");
    }
    let location = contours[1]["location"].as_str().expect("a text");
    assert!(location.contains("line 3, in O100 called from line 16"), "{location}");
    assert_eq!((&summary["pierces"], &summary["contour_count"]), (&json!(3), &json!(3)));
    // Each start: 50 ms until the contact closes, 10 ms until it counts, and the pierce delay.
    assert!((number(&summary, "pierce_s") - (3.0 * 0.06 + 0.5 + 1.0 + 0.2)).abs() < 0.005, "{summary}");
    let materials = summary["materials"].as_array().expect("a list");
    let rapids = [25.0, 30.0_f64.hypot(5.0), 55.0_f64.hypot(25.0)];
    assert_eq!(materials.len(), 3, "{summary}");
    for ((material, length), (of, rapid)) in materials.iter().zip(lengths).zip([1, 2, 1_000_000].iter().zip(rapids)) {
        assert_eq!((&material["number"], &material["contours"]), (&json!(of), &json!(1)));
        assert!((number(material, "cut_mm") - length).abs() < 0.01, "{material}");
        let rapid_mm = number(material, "rapid_mm");
        assert!((rapid_mm - rapid).abs() < 0.01, "{material}: {rapid}");
    }
    assert!((number(&summary, "cutting_mm") - lengths.iter().sum::<f64>()).abs() < 0.01);
    let text = bench.retrace(["check", "p.ngc", "--machine", "m.toml"]).out;
    let parts = [
        "pierces 3, which take 1.880 s",
        "material 1 Steel: 1 contour · cut 0.061 m",
        "contour 2: line 3 in O100, torch, material 2, 10.000 mm, from X 60.000 Y 50.000 to X 70.000 Y 50.000",
        "contour 3: line 20, torch, temporary material Thin, 5.000 mm",
    ];
    assert_contains(&text, &parts);
    bench.file("many.ngc", format!("G21 F600\n{}M2\n", "M3\nG91 G1 X1\nM5\n".repeat(50)));
    let text = bench.retrace(["check", "many.ngc", "--machine", "m.toml"]).out;
    assert_eq!(text.matches("\n  contour ").count(), 20, "{text}");
    assert!(text.contains("and 30 contours more; --json lists them"), "{text}");
}

/// The time of a run without faults, with starts, pierces and the pause at the end of a cut.
#[test]
fn the_time_of_a_cutting_program_is_that_of_its_run() {
    let bench = cutting_bench(&machine(""));
    let examples = root().join("examples");
    let shipped =
        |program: &str, machine: &str| [program, machine].map(|file| examples.join(file).display().to_string());
    for [program, machine] in [
        ["p.ngc", "m.toml"].map(|file| bench.path(file).display().to_string()),
        shipped("15-plasma.ngc", "15-plasma.toml"),
        shipped("plasma/bracket.ngc", "plasma/metric.toml"),
    ] {
        let arguments = [program.as_str(), "--machine", &machine, "--json"];
        let checked = last(&bench.retrace(["check"].into_iter().chain(arguments)).out);
        let run = bench.retrace(["run"].into_iter().chain(arguments));
        assert_eq!(run.code, Some(0), "{program}: {}", run.err);
        let report = last(&run.out);
        let ran_s = number(&report, "periods") * number(&report, "period_ms") / 1000.0;
        let said_s = number(&checked, "total_s");
        assert!((said_s - ran_s).abs() <= 0.01 * ran_s, "{program}: {said_s} s, and the run took {ran_s} s");
        assert!((said_s - number(&checked, "pierce_s")) < 0.99 * ran_s, "the pierces of {program} are a part of it");
        assert_eq!(checked["contour_count"], report["contours"], "{program}");
        assert_eq!(checked["motion_s"], report["motion_s"], "{program}");
    }
    // A source that takes longer, and says so.
    bench.file("slow.toml", machine("usual_s = 0.8"));
    let slow = last(&bench.retrace(["check", "p.ngc", "--machine", "slow.toml", "--json"]).out);
    assert!((number(&slow, "pierce_s") - (1.88 + 3.0 * 0.75)).abs() < 0.005, "{slow}");
}
