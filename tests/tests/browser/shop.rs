//! The jobs of a shop on the page: the table, the details, and the two steps of a start (SHP-36).

use std::process::Command;

use retrace_tests::command::{Bench, binary};
use retrace_tests::page_client::PageServer;
use retrace_tests::page_user::{PageUser, Screen};

use super::layout::no_fault;
use super::{HOSTILE, Machine, browser, in_control};

const PART: &str = "G21 G90 G94 F6000\nG1 X20\nX25 Y5\nX0 Y0\nM2\n";

fn done(bench: &Bench, arguments: &[&str]) -> String {
    let result = bench.retrace(arguments);
    assert_eq!(result.code, Some(0), "{arguments:?}: {}\n{}", result.out, result.err);
    result.out.trim().to_owned()
}

/// A server of a machine with a job that has errors, one that is ready, and one with markup for its texts.
fn serve_jobs(bench: &Bench) -> PageServer {
    bench.file("bad.ngc", "G1 X1 Q\n");
    bench.file("part.ngc", PART);
    bench.file("mill.toml", "name = \"mill\"\n");
    done(bench, &["shop", "submit", "bad.ngc"]);
    let more = ["--quantity", "2", "--material", "steel 4 mm", "--made-for", "mill.toml"];
    done(bench, &[&["shop", "submit", "part.ngc", "--order", "A-4711/2", "--note", "burr inside"], &more[..]].concat());
    done(bench, &["shop", "submit", "part.ngc", "--note", HOSTILE, "--material", HOSTILE]);
    done(bench, &["shop", "agent", "--once"]);
    let mut command = Command::new(binary());
    command.env("XDG_STATE_HOME", bench.path("state"));
    PageServer::start_as(command, &[])
}

fn pieces(user: &mut PageUser) -> String {
    user.text(".shop-jobs tr.now .pieces")
}

/// A job is looked at and started by two steps. Cancelled, or tapped by a page that only watches, nothing moves.
#[test]
fn a_job_of_the_shop_is_shown_and_started_after_a_question() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::DESK.light(), Screen::PHONE] {
        let bench = Bench::new();
        let server = serve_jobs(&bench);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.tap("#tab-shop", "");
        user.wait_for_text(".shop-jobs tr.now .state", "▸ ready");
        user.wait_for_text("#panel-shop .list-title", "3 jobs of local");
        assert_eq!(user.count(".shop-jobs tbody tr"), 3);
        assert_eq!((pieces(&mut user).as_str(), user.count(".shop-jobs img")), ("0/2", 0));
        assert_eq!(user.text(".shop-jobs tr.now .order"), "A-4711/2");
        user.picture(&format!("shop-{}", screen.width));
        no_fault(&mut user, "the jobs of the shop");
        user.tap(".shop-jobs button", "bad.ngc");
        user.wait_for_text("[aria-label='Details of the job of the shop']", "E1101");
        assert!(user.is_off("#panel-shop button", "Start"));
        user.tap(".shop-jobs button", "part.ngc");
        user.tap("#panel-shop button", "Start");
        for text in [
            "part.ngc",
            "1 of 2",
            "A-4711/2",
            "steel 4 mm",
            "burr inside",
            "the built-in machine",
            "another machine file",
        ] {
            user.wait_for_text(".dialog", text);
        }
        user.picture(&format!("shop-start-{}", screen.width));
        let before = machine.wait_for_rest();
        user.tap(".dialog button", "Cancel");
        assert_eq!(machine.wait_for_rest()["live"]["mm"], before["live"]["mm"], "cancelled, nothing moves");
        user.tap("#panel-shop button", "Start");
        user.tap(".dialog button", "Start");
        machine.wait("the end", |report| report["state"]["situation"] == "program_end");
        user.wait_for_text(".shop-jobs tr.now .state", "running");
        user.tap(".shop-jobs button", "part.ngc");
        assert!(user.is_off("#panel-shop button", "Start"), "it is not released yet");
        server_order(&server, "set up");
        user.wait_for_text(".shop-jobs tr.now .pieces", "1/2");
        user.picture(&format!("shop-one-piece-{}", screen.width));
    }
}

/// A page that takes control and gives one order.
fn server_order(server: &PageServer, words: &str) {
    let mut page = server.page(&server.token);
    page.take_control();
    assert_eq!(page.order(words)["t"], "done");
}

#[test]
fn a_page_that_watches_sees_the_jobs_and_starts_none() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve_jobs(&bench);
    let mut user = PageUser::new(&mut browser, Screen::TABLET);
    user.sign_in_with(&server, &server.watch_token.clone());
    user.tap("#tab-shop", "");
    user.wait_for_text(".shop-jobs tr.now .state", "▸ ready");
    assert!(user.is_off("#panel-shop button", "Start"));
}

/// A series is started with as many pieces as the dialog shows, and a job that permits none has no such choice.
#[test]
fn a_series_has_as_many_pieces_as_the_dialog_shows() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    bench.file("part.ngc", PART);
    done(&bench, &["shop", "submit", "part.ngc", "--quantity", "3", "--may-repeat", "--note", "a series"]);
    done(&bench, &["shop", "submit", "part.ngc", "--quantity", "3", "--note", "piece by piece"]);
    done(&bench, &["shop", "agent", "--once"]);
    let mut command = Command::new(binary());
    command.env("XDG_STATE_HOME", bench.path("state"));
    let server = PageServer::start_as(command, &[]);
    let machine = Machine::new(&server);
    let mut user = in_control(&mut browser, &server, Screen::PHONE);
    user.tap("#tab-shop", "");
    user.wait_for_text(".shop-jobs tr.now .state", "▸ ready");
    user.tap(".shop-jobs tbody tr:nth-child(2) button", "part.ngc");
    user.tap("#panel-shop button", "Start");
    user.wait_for_text(".dialog", "piece by piece");
    assert_eq!(user.count(".piece-choice"), 0);
    user.tap(".dialog button", "Cancel");
    user.tap(".shop-jobs tbody tr:nth-child(1) button", "part.ngc");
    user.tap("#panel-shop button", "Start");
    user.wait_for_text(".piece-choice output", "one piece");
    for shown in ["2 of 3 pieces", "3 of 3 pieces"] {
        user.tap(".piece-choice button", "+");
        user.wait_for_text(".piece-choice output", shown);
    }
    assert!(user.is_off(".piece-choice button", "+"));
    user.tap(".piece-choice button", "−");
    user.wait_for_text(".piece-choice output", "2 of 3 pieces, one after the other");
    user.tap(".dialog button", "Start");
    machine.wait("the end", |report| report["state"]["situation"] == "program_end");
    server_order(&server, "set up");
    user.wait_for_text(".shop-jobs tr.now .pieces", "2/3");
}
