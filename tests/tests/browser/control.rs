//! Who is in control, what the others can do, and what is left when a link or a server is gone.

use retrace_tests::command::Bench;
use retrace_tests::page_user::{PageUser, Screen};

use super::{Machine, browser, in_control, serve, zigzag, zigzag_at};

/// Buttons that only a page in control has.
const MOTION: [&str; 5] = [".motion.start", ".motion.reverse", ".motion.forward", ".motion.wheel", ".motion.stop"];

/// The token is gone from the address and from the history of the browser.
#[test]
fn signing_in_takes_the_token_out_of_the_address() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(4), &[]);
    let mut user = in_control(&mut browser, &server, Screen::PHONE);
    assert_eq!(user.evaluate("location.href"), format!("http://{}/", server.host));
    assert!(!user.page().call("Page.getNavigationHistory", serde_json::json!({})).to_string().contains(&server.token));
    // Another one without a token is asked for it, and signs in with it.
    let mut other = PageUser::new(&mut browser, Screen::TABLET);
    other.open(&format!("http://{}/", server.host));
    other.wait_for_text(".dialog h2", "Sign in");
    other.picture("sign-in");
    other.wait("document.activeElement.matches('.dialog input')");
    other.type_text(&server.token);
    other.key("Enter");
    other.tap(".dialog button", "Understood");
    other.wait_for_text("#control-button", "has control");
    // The browser itself reports that it was not let in before.
    other.forgive("401");
    other.forgive("HTTP Authentication failed");
}

/// A watcher can start nothing, by touch or by key, but it can hold; it asks for control and is given it.
#[test]
fn a_watcher_starts_nothing_and_asks_for_control() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(90), &[]);
    let machine = Machine::new(&server);
    let mut holder = in_control(&mut browser, &server, Screen::TABLET);
    let mut watcher = PageUser::new(&mut browser, Screen::DESK);
    watcher.sign_in(&server);
    watcher.wait_for_text("#control-button", "has control");
    watcher.wait_for_word("READY");
    let cannot_start = |user: &mut PageUser| {
        for button in MOTION {
            assert!(user.is_off(button, ""), "{button}");
            let (x, y) = user.middle_of(button);
            user.press((x, y));
            user.release((x, y));
        }
        for key in ["c", "r", "R", "f", "w", "H", "[", "ArrowRight"] {
            user.key(key);
        }
        std::thread::sleep(std::time::Duration::from_millis(500));
    };
    cannot_start(&mut watcher);
    let report = machine.report();
    assert_eq!((&report["state"]["word"], &report["live"]["mm"][0]), (&"READY".into(), &0.0.into()), "{report:#}");
    holder.tap(".motion.start", "");
    watcher.wait_for_word("RUNNING");
    watcher.tap(".motion.hold", "");
    holder.wait_for_word("FEED HOLD");
    machine.wait_for_rest();
    cannot_start(&mut watcher);
    assert_eq!(machine.word(), "FEED HOLD");
    // It asks; the holder gives.
    watcher.tap("#control-button", "");
    watcher.tap(".dialog button", "Ask for control");
    holder.wait_for_text(".dialog h2", "Give control?");
    holder.picture("give");
    holder.tap(".dialog button", "Give to");
    watcher.wait_for_text("#control-button", "in control");
    holder.wait_for_text("#control-button", "has control");
    assert_eq!(machine.word(), "FEED HOLD", "passing control starts nothing");
    assert!(holder.is_off(".motion.start", ""));
    watcher.tap(".motion.start", "");
    watcher.wait_for_word("RUNNING");
    holder.tap(".motion.hold", "");
    watcher.wait_for_word("FEED HOLD");
}

/// The address for watching gives a page that can hold, and cannot even ask for control.
#[test]
fn a_page_for_watching_only_holds() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(90), &[]);
    let mut holder = in_control(&mut browser, &server, Screen::TABLET);
    let mut watcher = PageUser::new(&mut browser, Screen::PHONE);
    watcher.sign_in_with(&server, &server.watch_token.clone());
    watcher.wait_for_text("#control-button", "watching");
    assert!(MOTION.iter().all(|button| watcher.is_off(button, "")));
    assert!(watcher.is_off("#control-button", ""));
    holder.tap(".motion.start", "");
    watcher.wait_for_word("RUNNING");
    watcher.picture("watching");
    watcher.tap(".motion.hold", "");
    holder.wait_for_word("FEED HOLD");
}

/// A page that is loaded again comes back as a watcher, and has sent nothing.
#[test]
fn a_reload_sends_nothing_again() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag_at(600, 90), &[]);
    let machine = Machine::new(&server);
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.tap(".motion.start", "");
    user.wait_for_word("RUNNING");
    machine.wait("100 mm", |report| report["live"]["history_mm"].as_f64() > Some(100.0));
    user.tap(".motion.reverse", "");
    user.wait_for_word("REVERSE");
    // At rest between forward and reverse, it has not ended.
    machine.wait("reverse run", |report| report["live"]["rate"].as_f64().is_some_and(|rate| rate < 0.0));
    user.reload();
    // Reverse run ends with its page.
    let stood = machine.wait_for_rest();
    user.wait("document.querySelector('#state-word span:last-child')?.textContent === 'FEED HOLD'");
    user.wait_for_text("#control-button", "control");
    assert_ne!(user.text("#control-button"), "in control");
    assert!(MOTION.iter().all(|button| user.is_off(button, "")));
    std::thread::sleep(std::time::Duration::from_millis(1000));
    assert_eq!(machine.live("record"), stood["live"]["record"], "it stands");
    assert_eq!(user.count(".notice"), 0);
}

/// A server that is silent or gone is shown, with everything off but HOLD; and nothing is sent when it is back.
#[test]
fn a_lost_link_is_shown() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(90), &[]);
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.wait_for_word("READY");
    let signal = |name: &str| {
        let sent = std::process::Command::new("kill").args([name, &server.process().to_string()]).status();
        assert!(sent.is_ok_and(|status| status.success()));
    };
    signal("-STOP");
    user.wait_for_word("NO LINK");
    assert!(MOTION.iter().all(|button| user.is_off(button, "")));
    let (x, y) = user.middle_of(".motion.start");
    user.press((x, y));
    user.release((x, y));
    user.key("c");
    user.picture("no-link");
    signal("-CONT");
    user.wait_for_word("READY");
    std::thread::sleep(std::time::Duration::from_millis(1000));
    assert_eq!(Machine::new(&server).word(), "READY", "what was pressed without a link is not sent later");
    drop(server);
    user.wait_for_word("NO LINK");
    assert!(!user.is_off(".motion.hold", ""));
    user.forgive("ERR_CONNECTION_REFUSED");
    user.forgive("WebSocket");
}
