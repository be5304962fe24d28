//! The command line of the judge: exit codes, output, and what it says of wrong arguments and files.
//!
//! Invariant: a refusal has exit code 2, nothing on standard output, and a cause with its remedy on standard error.

use crate::synthetic::{Random, Trace};
use crate::{cut_judge, figure, folder};
use std::fs;

#[test]
fn a_line_for_each_trace_and_an_exit_code_for_all_of_them() {
    let folder = folder("command");
    let file = |name: &str, trace: &Trace| {
        let path = folder.join(name);
        fs::write(&path, trace.vcd()).expect("a trace");
        path.display().to_string()
    };
    let (whole, good) = (file("whole.vcd", &Trace::whole()), file("good.vcd", &Trace::recovered(&mut Random::new(7))));
    let mut trace = Trace::recovered(&mut Random::new(7));
    trace.insert(trace.contour_end, 20, |_| {});
    let stands = file("stands.vcd", &trace);
    let mut trace = Trace::recovered(&mut Random::new(7));
    let last = trace.periods.len() - 1;
    trace.change(last..last + 1, |period| period.is_lit = true);
    let bad = file("bad.vcd", &trace);

    let output = cut_judge(&[&whole, &whole, &good]);
    let text = String::from_utf8(output.stdout).expect("text");
    let [first, second] = text.lines().collect::<Vec<_>>()[..] else { panic!("{text}") };
    assert_eq!((output.status.code(), output.stderr), (Some(0), Vec::new()));
    assert_eq!((figure(first, "ignitions"), figure(second, "ignitions")), ("2", "3"));
    // 200 and 60 records of 6 pulses at 200 pulses per mm
    assert!(figure(first, "cut_mm").parse::<f64>().is_ok_and(|mm| (mm - 7.8).abs() < 1e-9), "{first}");
    let begin = format!("{{\"trace\":\"{}\",\"good\":true,\"not_cut\":0,", good.replace('\\', "\\\\"));
    assert!(second.starts_with(&begin) && second.ends_with('}'), "{second}");

    // options before and between the files; each changes the verdict
    assert_eq!(cut_judge(&["--pierce-ms", "400", &whole, "--input", "5", &good]).status.code(), Some(0));
    assert_eq!(cut_judge(&[&whole, &good, "--pierce-ms", "401"]).status.code(), Some(1));
    assert_eq!(cut_judge(&[&whole, &good, "--pilot-ms", "299"]).status.code(), Some(1));
    assert_eq!(cut_judge(&[&whole, &good, "--period-ms", "0.5"]).status.code(), Some(1));
    assert_eq!(cut_judge(&[&whole, &stands, "--standing-ms", "20"]).status.code(), Some(0));
    assert_eq!(cut_judge(&[&whole, &stands, "--standing-ms", "19"]).status.code(), Some(1));
    assert_eq!(cut_judge(&[&whole, &good, &bad, &good]).status.code(), Some(1));
}

#[test]
fn what_cannot_be_judged_is_refused_with_cause_and_remedy() {
    let folder = folder("refusals");
    let path = |name: &str| folder.join(name).display().to_string();
    let whole = path("whole.vcd");
    let text = Trace::whole().vcd();
    for (name, text) in [
        ("whole.vcd", text.clone()),
        ("other-axes.vcd", text.replace("module z", "module w")),
        ("cut-off.vcd", text[..text.len() / 3].trim_end_matches(|letter| letter != '#').to_owned() + "12\nnoise"),
        ("text.vcd", "G0 X10\n".into()),
        ("empty.vcd", String::new()),
    ] {
        fs::write(folder.join(name), text).expect("a file");
    }
    fs::write(folder.join("binary.vcd"), [0xff, 0xfe, 0x00]).expect("a file");
    let [other, cut_off, text, empty, binary, none] =
        ["other-axes.vcd", "cut-off.vcd", "text.vcd", "empty.vcd", "binary.vcd", "none.vcd"].map(path);
    let whole = whole.as_str();
    for (arguments, cause, remedy) in [
        (&[][..], "compares two traces", "--help"),
        (&[whole], "compares two traces", "--help"),
        (&[whole, &none], "none.vcd", "check its name"),
        (&[whole, &text], "text.vcd: line 1", "--vcd FILE"),
        (&[whole, &empty], "not a value change dump", "--vcd FILE"),
        (&[whole, &binary], "not a text file", "--vcd FILE"),
        (&[whole, &cut_off], "cut-off.vcd: line", "--vcd FILE"),
        (&[whole, &other], "axes x, y, w, a", "same machine"),
        (&[whole, whole, "--fire", "out7"], "no output `out7`", "out0, spindle"),
        (&[whole, whole, "--fire", "out0"], "nothing is cut", "correct these two"),
        (&[whole, whole, "--input", "4"], "nothing is cut", "correct these two"),
        (&[whole, whole, "--input", "64"], "`64` is not the number of an input", "0 to 63"),
        (&[whole, whole, "--pierce-ms"], "--pierce-ms has no value", "behind the option"),
        (&[whole, whole, "--pilot-ms", "-1"], "`-1` of --pilot-ms", "correct it"),
        (&[whole, whole, "--period-ms", "NaN"], "`NaN` of --period-ms", "correct it"),
        (&[whole, whole, "--pulses-per-mm", "0"], "--pulses-per-mm is 0", "greater than 0"),
        (&[whole, whole, "--pulses"], "no option `--pulses`", "--help"),
    ] {
        let output = cut_judge(arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), output.stdout), (Some(2), Vec::new()), "{arguments:?} {message}");
        assert!(message.contains(cause) && message.contains(remedy), "{arguments:?} {message}");
    }
}

#[test]
fn the_help_names_every_option_and_figure() {
    let output = cut_judge(&["--help"]);
    let help = String::from_utf8(output.stdout).expect("text");
    assert_eq!(output.status.code(), Some(0));
    for word in
        ["--pulses-per-mm", "--fire", "--input", "--pierce-ms", "--pilot-ms", "--period-ms", "--standing-ms", "Example"]
    {
        assert!(help.contains(word), "{word}");
    }
    let file = folder("help").join("whole.vcd");
    fs::write(&file, Trace::whole().vcd()).expect("a trace");
    let file = file.display().to_string();
    let line = String::from_utf8(cut_judge(&[&file, &file]).stdout).expect("text");
    let names = line.split('"').skip(1).step_by(2).filter(|name| !name.contains("whole.vcd"));
    assert!(names.clone().count() == 16 && names.clone().all(|name| help.contains(&format!("\n  {name} "))), "{line}");
}
