//! Every program reaches its end exactly, within the limits, and with the same result in every run.

use retrace_tests::command::{Bench, root};
use retrace_tests::not_run::not_run;
use retrace_tests::programs::examples;
use retrace_tests::run::Run;
use std::path::PathBuf;

#[test]
fn every_example_ends_exactly_and_within_the_limits() {
    let examples = examples();
    assert!(examples.len() >= 7, "{examples:?}");
    for program in examples {
        let bench = Bench::new();
        let run = Run::of(&bench, &program, &[]);
        run.assert_exact_and_legal();
        assert_eq!(run.number("underruns"), 0.0, "{}", program.display());
        assert!(run.number("motion_s") > 0.0 && run.number("retrace_s") == 0.0, "{}", program.display());
    }
}

/// Files next to an example, under its name with another ending: its operator, its machine.
#[test]
fn every_example_ends_where_it_would_have_on_its_own_machine_and_with_its_own_operator() {
    let mut operated = 0;
    for program in examples() {
        let beside = |ending: &str| Some(program.with_extension(ending)).filter(|path| path.is_file());
        let given = |flag: &str, path: &Option<PathBuf>| -> Vec<String> {
            path.iter().flat_map(|path| [flag.to_owned(), path.to_string_lossy().into_owned()]).collect()
        };
        let (machine, operator) = (beside("toml"), beside("op"));
        if machine.is_none() && operator.is_none() {
            continue;
        }
        let alone = given("--machine", &machine);
        let with = [alone.clone(), given("--operator", &operator)].concat();
        let run = |options: &[String]| {
            let options: Vec<&str> = options.iter().map(String::as_str).collect();
            Run::of(&Bench::new(), &program, &options)
        };
        let (alone, with) = (run(&alone), run(&with));
        alone.assert_exact_and_legal();
        if operator.is_some() && with.report["outcome"] != "stopped" {
            with.assert_exact_and_legal();
            assert_eq!(with.counts(), alone.counts(), "{}", program.display());
            operated += 1;
        }
    }
    assert!(operated >= 3, "{operated}");
}

#[test]
fn a_program_runs_the_same_every_time_and_from_standard_input() -> std::io::Result<()> {
    let mut compared = 0;
    for program in examples() {
        let text = std::fs::read(&program)?;
        let records = |run: Run| run.records;
        let first = records(Run::of(&Bench::new(), &program, &[]));
        // Two lists of records are too long to be shown.
        assert!(first == records(Run::of(&Bench::new(), &program, &[])), "{}", program.display());
        // Text behind its call, or in another file, does not arrive in time.
        let text_of = String::from_utf8_lossy(&text);
        if !["call", "M98", "CYCLE95"].iter().any(|word| text_of.contains(word)) {
            assert!(first == records(Run::of_input(&Bench::new(), &text, &[])), "{}", program.display());
            compared += 1;
        }
    }
    assert!(compared > 7, "{compared} examples came from standard input");
    Ok(())
}

#[test]
fn every_place_of_a_forward_run_is_visited_once_and_in_order() {
    let bench = Bench::new();
    let run = Run::of(&bench, &examples()[0], &[]);
    let places: Vec<_> = run.records.rows.iter().map(|row| (row.record, row.fraction)).collect();
    assert!(places.is_sorted());
    assert!(run.records.rows.iter().all(|row| row.fraction == 0), "undisturbed, a period is a record");
}

/// Programs of others, which may not be published here: `RETRACE_PROGRAMS` names a folder of them.
#[test]
fn programs_of_others_end_exactly_and_within_the_limits() -> std::io::Result<()> {
    let Some(folder) = std::env::var_os("RETRACE_PROGRAMS") else {
        not_run("programs_of_others_end_exactly_and_within_the_limits", "RETRACE_PROGRAMS names no folder of programs");
        return Ok(());
    };
    let mut programs: Vec<PathBuf> = std::fs::read_dir(folder)?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    programs.retain(|path| path.extension().is_some_and(|ending| ending == "ngc"));
    programs.sort();
    assert!(!programs.is_empty());
    for program in programs {
        let bench = Bench::new();
        let result = bench.retrace(["check".as_ref(), program.as_os_str()]);
        if result.code == Some(1) {
            // Refused with an error number before anything moves, which is required where words are not supported yet.
            assert!(result.err.contains("error[E1"), "{}: {}", program.display(), result.err);
            println!("{:<28} refused: {}", name(&program), result.err.lines().next().unwrap_or_default());
            continue;
        }
        let run = Run::of(&bench, &program, &[]);
        run.assert_exact_and_legal();
        println!(
            "{:<28} {:>9.3} s of motion in {:>7.3} s",
            name(&program),
            run.number("motion_s"),
            run.number("wall_s")
        );
    }
    Ok(())
}

fn name(program: &std::path::Path) -> String {
    program.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Programs as common CAM posts write them. Their golden files were reviewed, and equal the output of LinuxCNC's `rs274
/// -g` for them; `RETRACE_BLESS=1` rewrites them.
#[test]
fn programs_of_common_cam_posts_are_read_as_they_were_and_machined_exactly() {
    let folder = root().join("tests/posts");
    let tools = folder.join("tool.tbl").display().to_string();
    let files = std::fs::read_dir(&folder).expect("the folder").map(|entry| entry.expect("an entry").path());
    let mut programs: Vec<PathBuf> = files.filter(|path| path.extension().is_some_and(|end| end == "ngc")).collect();
    programs.sort();
    assert_eq!(programs.len(), 20);
    for program in programs {
        let (bench, name) = (Bench::new(), program.display().to_string());
        let canon = bench.retrace(["canon", "--tools", &tools, &name]);
        assert_eq!(canon.code, Some(0), "{name}: {}", canon.err);
        let golden = program.with_extension("canon");
        if std::env::var_os("RETRACE_BLESS").is_some() {
            std::fs::write(&golden, &canon.out).expect("a golden");
        }
        let wanted = std::fs::read_to_string(&golden).expect("a golden");
        let differs = wanted.lines().zip(canon.out.lines()).find(|(wanted, is)| wanted != is);
        assert_eq!((differs, wanted.lines().count()), (None, canon.out.lines().count()), "{name}");
        let run = Run::of(&bench, &program, &["--tools", &tools]);
        run.assert_exact_and_legal();
        assert!(run.number("motion_s") > 0.0, "{name}");
    }
}
