//! The path and the listing: each shows what is chosen in the other, and both follow the machine.

use retrace_tests::command::Bench;
use retrace_tests::page_user::{PageUser, Screen};

use super::million::COUNTERS;
use super::{Machine, browser, in_control, serve, zigzag};

/// Two lines in a row, from left to right through the middle of the picture.
const TWO_LINES: &str = "G21 G90 G17 G94 G61\nF3000\nG1 X60\nG1 X120\nM2\n";

/// A picture of the path that would be the same is not drawn again; one that changes is, as long as it does. What is
/// chosen while the machine stands is drawn over the path, which stays.
#[test]
fn a_standing_machine_is_drawn_once() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(90), &[]);
    let mut user = PageUser::new(&mut browser, Screen::DESK.light());
    let script = serde_json::json!({"source": COUNTERS});
    user.page().call("Page.addScriptToEvaluateOnNewDocument", script);
    user.sign_in(&server);
    user.wait_for_text("#control-button", "in control");
    user.wait_for_word("READY");
    let pictures_in = |user: &mut PageUser, time_s: u64| {
        let before = user.evaluate("drawn.pictures").as_u64();
        std::thread::sleep(std::time::Duration::from_secs(time_s));
        user.evaluate("drawn.pictures").as_u64().zip(before).map(|(after, before)| after - before)
    };
    // What still comes of the program is drawn first.
    pictures_in(&mut user, 2);
    assert!(pictures_in(&mut user, 3) <= Some(2), "the machine stands, and so does the picture");
    let (before, most) = (user.black_pixels(), 20_000);
    assert!(before < most, "{before} pixels are black");
    // The view moves to the first line that is chosen, and stays for the other.
    for line in ["4", "5"] {
        user.tap(".listing .list-row", line);
        user.wait_for_text(".chosen-text", &format!("line {line} chosen"));
        pictures_in(&mut user, 1);
    }
    let after = user.black_pixels();
    assert!(after < most, "the path stays below what is chosen: {after} pixels are black");
    let before = user.evaluate("drawn.pictures").as_u64().expect("a number");
    user.tap(".motion.start", "");
    // How many there are in a second is a matter of the computer.
    user.wait(&format!("drawn.pictures >= {before} + 6"));
}

/// A tap on the path chooses its line, and a tap on a line its path.
#[test]
fn a_pick_on_the_path_shows_its_line() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::DESK.light()] {
        let bench = Bench::new();
        let server = serve(&bench, TWO_LINES, &[]);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        let canvas = user.find("#path-canvas", "");
        // Room for the legend above and the tools below is left free by the page.
        let middle = canvas.corner.1 + 30.0 + (canvas.size.1 - 86.0) / 2.0;
        for (share, line) in [(0.25, "3"), (0.75, "4")] {
            let at = (canvas.corner.0 + canvas.size.0 * share, middle);
            let chosen = format!("line {line} chosen");
            for _ in 0..40 {
                user.press(at);
                user.release(at);
                std::thread::sleep(std::time::Duration::from_millis(700));
                if user.text(".chosen-text") == chosen {
                    break;
                }
            }
            assert_eq!(user.text(".chosen-text"), chosen);
            user.wait_for_text(".listing .chosen .line-number", line);
        }
        user.tap(".listing .list-row", "3");
        user.wait_for_text(".chosen-text", "line 3 chosen");
        user.picture(&format!("chosen-{}", screen.width));
    }
}

/// The listing follows the block until it is scrolled, and again after `follow`.
#[test]
fn the_listing_follows_the_machine() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(90), &[]);
    let machine = Machine::new(&server);
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.tap(".motion.start", "");
    for line in [5, 8] {
        machine.wait("a line", |report| report["live"]["line"].as_u64() >= Some(line));
        user.wait(&format!("Number(document.querySelector('.listing .now .line-number')?.textContent) >= {line}"));
    }
    user.tap(".motion.hold", "");
    let line = machine.wait_for_rest()["live"]["line"].to_string();
    user.wait_for_text(".listing .now .line-number", &line);
    user.find(".listing .now", "");
    user.evaluate("document.querySelector('.listing').dispatchEvent(new WheelEvent('wheel'))");
    user.evaluate("document.querySelector('.listing').scrollTop = 3000");
    user.wait("document.querySelector('.listing .now') === null");
    assert_eq!(user.evaluate("document.querySelector('.follow').getAttribute('aria-pressed')"), "false");
    user.tap(".follow", "");
    user.wait_for_text(".listing .now .line-number", &line);
}
