//! Setting up: jog, MDI, zero, programs of the folder, messages.

use std::time::{Duration, Instant};

use retrace_tests::command::Bench;
use retrace_tests::page_user::Screen;
use serde_json::{Value, json};

use super::{HOSTILE, Machine, browser, in_control, serve, zigzag};

/// A jog lasts as long as the finger is down.
#[test]
fn a_held_jog_button_moves_and_stops_on_release() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::DESK] {
        let bench = Bench::new();
        let server = serve(&bench, &zigzag(4), &[]);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        user.tap("[role=tab]", "Jog");
        let spot = user.find(".jog-key", "Jog X positive");
        user.press(spot.middle);
        machine.wait("5 mm", |report| report["live"]["mm"][0].as_f64() > Some(5.0));
        user.release(spot.middle);
        let released = machine.mm(0);
        let stood = machine.wait_for_rest();
        let braking = stood["live"]["mm"][0].as_f64().map(|mm| mm - released);
        println!("released at {released} mm, at rest {braking:?} mm later");
        assert!(braking < Some(25.0), "it stops on release: {stood:#}");
        user.picture(&format!("jog-{}", screen.width));
        // A step, by a tap.
        user.tap(".jog-steps [role=radio]", "1 mm");
        user.tap(".jog-key", "Jog Y positive");
        machine.wait("1 mm", |report| report["live"]["mm"][1] == 1.0);
        user.tap(".jog-steps [role=radio]", "held");
        // By a key of the keyboard.
        user.key_down("ArrowLeft");
        let from = stood["live"]["mm"][0].as_f64();
        machine.wait("motion back", |report| report["live"]["mm"][0].as_f64() < from.map(|from| from - 1.0));
        user.key_up("ArrowLeft");
        machine.wait_for_rest();
        // How fast a held jog goes, in the line for the last message: that of the jog has come by then.
        std::thread::sleep(Duration::from_millis(500));
        user.tap(".jog-steps [role=radio]", "held");
        user.wait_for_text("#message-line", "Jog: held to run, X Y Z 3000 mm/min");
        // Slowly, to an edge: also by `t`, the next of the choices.
        match screen.is_touch {
            true => user.tap(".jog-steps [role=radio]", "slow"),
            false => user.key("t"),
        }
        user.wait_for_text("#message-line", "Jog: held to run, X Y Z 300 mm/min");
        let spot = user.find(".jog-key", "Jog X positive");
        user.press(spot.middle);
        let feed = |report: &Value| report["live"]["feed"].as_f64().unwrap_or(f64::NAN);
        let moving = machine.wait("the slow speed", |report| {
            assert!(feed(report) <= 301.0, "a tenth of the jog speed: {report:#}");
            feed(report) > 250.0
        });
        user.release(spot.middle);
        let stood = machine.wait_for_rest();
        assert!(stood["live"]["mm"][0].as_f64() > moving["live"]["mm"][0].as_f64(), "{stood:#}");
        user.picture(&format!("jog-slow-{}", screen.width));
    }
}

/// A page whose main thread hangs sends no beat: the jog ends while the finger is still down, and does not begin again.
#[test]
fn a_page_that_hangs_stops_its_jog() {
    let Some(mut browser) = browser() else { return };
    for hang_ms in [600, 2500] {
        let bench = Bench::new();
        let server = serve(&bench, &zigzag(4), &[]);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, Screen::TABLET);
        user.wait_for_word("READY");
        user.tap("[role=tab]", "Jog");
        let spot = user.find(".jog-key", "Jog X positive");
        user.press(spot.middle);
        machine.wait("2 mm", |report| report["live"]["mm"][0].as_f64() > Some(2.0));
        let hang = format!("const until = Date.now() + {hang_ms}; while (Date.now() < until);");
        user.page().post("Runtime.evaluate", json!({"expression": hang}));
        let (begun, mut moved, mut stood) = (Instant::now(), Instant::now(), f64::NAN);
        while begun.elapsed() < Duration::from_millis(hang_ms) {
            let now = machine.mm(0);
            if now.to_bits() != stood.to_bits() {
                (moved, stood) = (Instant::now(), now);
            }
        }
        println!("main thread blocked: the last motion is seen {} ms later", (moved - begun).as_millis());
        if hang_ms > 1000 {
            assert_eq!(machine.report()["live"]["at_rest"], true, "it stands while the page hangs");
        }
        // The page is back, with the finger down all the time.
        user.wait("true");
        let at = machine.wait_for_rest()["live"]["mm"][0].as_f64();
        std::thread::sleep(Duration::from_millis(400));
        assert_eq!(machine.report()["live"]["mm"][0].as_f64(), at, "it does not begin again by itself");
        user.release(spot.middle);
    }
}

/// MDI by keys and by touch: a block is executed once, and Esc in its field is HOLD.
#[test]
fn a_block_is_executed_by_mdi() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::DESK] {
        let bench = Bench::new();
        let server = serve(&bench, &zigzag(4), &[]);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        user.tap("[role=tab]", "MDI");
        user.tap(".mdi-text", "");
        user.type_text("G0 X7 Y3");
        if screen.is_touch {
            user.tap("#panel-mdi button.main", "Execute");
        } else {
            user.key("Enter");
        }
        machine.wait("7, 3", |report| report["live"]["mm"][0] == 7.0 && report["live"]["mm"][1] == 3.0);
        user.wait("document.querySelector('.mdi-text').value === ''");
        user.wait_for_text(".mdi-history", "G0 X7 Y3");
        user.tap(".mdi-text", "");
        user.type_text("G1 F300 X500");
        user.key("Enter");
        machine.wait("motion", |report| report["live"]["mm"][0].as_f64() > Some(8.0));
        user.key("Escape");
        let stood = machine.wait_for_rest();
        assert!(stood["live"]["mm"][0].as_f64() < Some(400.0), "{stood:#}");
        user.picture(&format!("mdi-{}", screen.width));
    }
}

/// The work zero of an axis is set where the machine stands; of all axes after a question.
#[test]
fn the_work_zero_is_set() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(4), &[]);
    let machine = Machine::new(&server);
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.wait_for_word("READY");
    user.tap("[role=tab]", "MDI");
    user.tap(".mdi-text", "");
    user.type_text("G0 X7 Y3");
    user.key("Enter");
    machine.wait("7, 3", |report| report["live"]["mm"][0] == 7.0 && report["live"]["mm"][1] == 3.0);
    machine.wait_for_rest();
    user.tap("[role=tab]", "Zero");
    user.tap("#panel-zero button", "Zero X");
    machine.wait("zero of X", |report| report["live"]["work"][0] == 0.0 && report["live"]["mm"][0] == 7.0);
    user.tap("#panel-zero button", "Zero all here");
    user.tap(".dialog button", "Zero all");
    machine.wait("zero of Y", |report| report["live"]["work"][1] == 0.0 && report["live"]["mm"][1] == 3.0);
    user.tap("#panel-zero button", "Set Y to a value");
    user.wait("document.activeElement.matches('.dialog input')");
    user.evaluate("document.activeElement.select()");
    user.type_text("12.5");
    user.key("Enter");
    machine.wait("12.5", |report| report["live"]["work"][1] == 12.5);
    user.picture("zero");
}

/// A probing cycle is chosen, gets its lengths, and sets an offset; without a length nothing moves.
#[test]
fn a_surface_is_probed_and_becomes_the_zero() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::PHONE] {
        let bench = Bench::new();
        let server = serve(&bench, &zigzag(4), &["--work", "z<-5"]);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        user.tap("[role=tab]", "Probe");
        user.tap("#panel-probe button.main", "Probe");
        user.wait_for_text("#panel-probe [role=status]", "Enter a number: Max. travel");
        user.tap("#panel-probe input", "Max. travel");
        user.type_text("20");
        user.evaluate("document.querySelector('#panel-probe select[aria-label=\"Work offset\"]').value = 'G54'");
        user.picture(&format!("probe-{}", screen.width));
        user.tap("#panel-probe button.main", "Probe");
        machine.wait("the zero", |report| report["live"]["work"][2] == 1.0 && report["live"]["mm"][2] == -4.0);
        // Each cycle has its fields.
        for (word, label) in [("outside-corner", "Distance out"), ("calibrate", "Diameter"), ("tool-at-work", "Height")]
        {
            let select = format!(
                "window.cycle = document.querySelector('.probe-cycle'); cycle.value = '{word}'; \
                cycle.dispatchEvent(new Event('change'))"
            );
            user.evaluate(&select);
            user.wait_for_text("#panel-probe .zero-rows", label);
        }
        user.evaluate(
            "window.cycle = document.querySelector('.probe-cycle'); cycle.value = 'outside-corner'; \
            cycle.dispatchEvent(new Event('change'))",
        );
        user.picture(&format!("probe-corner-{}", screen.width));
    }
}

/// Offsets and tools are changed by a tap on a figure, and shown by what the machine has; inputs by name.
#[test]
fn offsets_and_tools_are_changed_by_a_tap() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::PHONE.light()] {
        let bench = Bench::new();
        let tools = bench.file("tools.tbl", "T1 P1 Z50 D6 ;end mill\nT2 P2 Z40 D3\n").display().to_string();
        let text = "[[card.input]]\nnumber = 2\nuse = \"door\"\n";
        let machine_file = bench.file("m.toml", text).display().to_string();
        let arguments = ["--tools", &tools, "--machine", &machine_file];
        let server = serve(&bench, &zigzag(4), &arguments);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        user.tap("[role=tab]", "Offsets");
        user.tap(".value", "G54 Y");
        user.wait("document.activeElement.matches('.dialog input')");
        user.evaluate("document.activeElement.select()");
        user.type_text("12.5");
        user.key("Enter");
        machine.wait("the offset", |report| report["live"]["work"][1] == -12.5);
        user.wait("findByEye('.value', 'G54 Y: 12.500') !== null");
        if screen.width > 600 {
            // What is changed elsewhere is shown in the table that is open.
            user.tap("[role=tab]", "MDI");
            user.tap(".mdi-text", "");
            user.type_text("G10 L2 P1 X7");
            user.key("Enter");
            user.wait("findByEye('.value', 'G54 X: 7.000') !== null");
        }
        user.picture(&format!("offsets-{}", screen.width));
        user.tap("[role=tab]", "Tools");
        user.tap(".value", "T2 length");
        user.wait("document.activeElement.matches('.dialog input')");
        user.evaluate("document.activeElement.select()");
        user.type_text("41");
        user.tap(".dialog button", "Set");
        user.wait("findByEye('.value', 'T2 length: 41.000') !== null");
        user.tap("#panel-tools button", "Add a tool");
        user.wait("document.activeElement.matches('.dialog input')");
        user.type_text("7");
        user.key("Enter");
        user.wait("findByEye('.value', 'T7 length') !== null");
        user.picture(&format!("tools-{}", screen.width));
        let file = std::fs::read_to_string(&tools).expect("a file");
        assert_eq!(file, "T1 P1 Z50 D6 ;end mill\nT2 P2 Z41 D3\nT7 P0\n");
        user.tap("[role=tab]", "Settings");
        user.wait_for_text(".inputs", "door");
        user.picture(&format!("inputs-{}", screen.width));
        // While a program runs, nothing can be changed.
        user.tap(".motion.start", "");
        user.wait_for_word("RUNNING");
        user.tap("[role=tab]", "Offsets");
        user.wait(
            "[...document.querySelectorAll('#panel-offsets .value')].every(node => node.ariaDisabled === 'true')",
        );
        user.tap(".motion.hold", "");
        user.wait_for_word("FEED HOLD");
    }
}

/// Programs are uploaded, loaded and deleted in the files tab; markup in their names and comments is text.
#[test]
fn a_program_is_uploaded_and_loaded_and_its_markup_is_text() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let programs = bench.path("programs");
    std::fs::create_dir(&programs).expect("a folder");
    let program = format!("({HOSTILE})\nG21 G90 G94\nF600\n(MSG, {HOSTILE})\nG1 X3\nM2\n");
    let hostile = format!("{HOSTILE}.ngc");
    std::fs::write(programs.join(&hostile), &program).expect("a file");
    let upload = bench.file("upload.ngc", "G21 G90 G94\nF600\nG1 X5\nM2\n").display().to_string();
    let server = serve(&bench, &zigzag(4), &["--programs", &programs.display().to_string()]);
    let machine = Machine::new(&server);
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.wait_for_word("READY");
    user.tap("[role=tab]", "Files");
    user.wait_for_text(".files", HOSTILE);
    user.choose_file("#panel-files input[type=file]", &upload);
    user.wait_for_text(".files", "upload.ngc");
    user.tap(".files button", "Load upload.ngc");
    machine.wait("the program", |report| report["state"]["program"]["name"] == "upload.ngc");
    user.wait_for_text("#panel-program .list-title", "upload.ngc");
    user.tap(".files button", &format!("Load {hostile}"));
    machine.wait("the program", |report| report["state"]["program"]["name"].to_string().contains("img"));
    user.wait_for_word("READY");
    user.wait_for_text("#panel-program .listing", HOSTILE);
    user.tap(".motion.start", "");
    user.wait_for_word("ENDED");
    let stop = user.evaluate("document.querySelector('.motion.stop').className");
    assert!(stop.as_str().is_some_and(|class| class.contains("calm")), "nothing is left to stop: {stop}");
    user.tap("[role=tab]", "Log");
    user.wait_for_text("#panel-log .log", HOSTILE);
    user.picture("hostile");
    assert_eq!(user.count("img"), 0, "no markup of a program becomes an element");
    user.tap("[role=tab]", "Files");
    user.tap(".files button", "Delete upload.ngc");
    user.tap(".dialog button", "Delete");
    user.wait("!document.querySelector('.files').textContent.includes('upload.ngc')");
    assert!(!programs.join("upload.ngc").exists(), "the file is gone");
}

/// A refusal is shown with its remedy: as a notice, and in the log.
#[test]
fn the_log_shows_remedies() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(4), &[]);
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.wait_for_word("READY");
    user.tap("[role=tab]", "MDI");
    user.tap(".mdi-text", "");
    user.type_text("G1 X90000 F100");
    user.key("Enter");
    user.wait("/E\\d{4}/.test(document.querySelector('main').textContent)");
    user.picture("refusal");
    while user.count(".dialog button") > 0 {
        user.tap(".dialog button", "");
    }
    user.tap("[role=tab]", "Log");
    user.wait("document.querySelectorAll('#panel-log .is-error').length > 0");
    user.tap("#panel-log .is-error", "");
    user.wait("/E\\d{4}.{20}/.test(document.querySelector('.log-opened').textContent)");
    user.picture("log");
    let text = user.text(".log-opened");
    assert!(text.contains("soft limit"), "{text}");
}
