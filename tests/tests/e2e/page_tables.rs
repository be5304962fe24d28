//! Offsets and tools over the wire of the page's server: who may change them, when, and what a program does then.

use retrace_tests::command::Bench;
use retrace_tests::page_client::{Answer, Page, PageServer};
use serde_json::{Value, json};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// A tool changes its length in force, and the machine goes to the work zero.
const PROGRAM: &str = "G21 G90 G17 G94 G61\nG55\nF3000\nG1 X0 Y0\nG1 X60\nG1 X0\nM2\n";

/// A server with tables of its own, a page in control, and its session.
struct Tables {
    server: PageServer,
    page: Page,
    cookie: String,
}

impl Tables {
    fn open(bench: &Bench) -> Self {
        let program = bench.file("program.ngc", PROGRAM).display().to_string();
        let tools = bench.file("tools.tbl", "T1 P1 Z50 D6 ;end mill\nT2 P2 Z40 D3\n").display().to_string();
        let offsets = bench.file("offsets.var", "5221\t1.5\n").display().to_string();
        let journal = bench.path("jobs").display().to_string();
        let server = PageServer::start(&[&program, "--tools", &tools, "--params", &offsets, "--journal", &journal]);
        let mut page = server.page(&server.token);
        page.take_control();
        page.wait_for_word("READY");
        let cookie = page.cookie.clone();
        let tables = Self { server, page, cookie };
        // The server may be ready before the machine has told its tables.
        let begun = Instant::now();
        while tables.get("offsets").0["systems"].as_array().is_none_or(Vec::is_empty) {
            assert!(begun.elapsed() < Duration::from_secs(30), "the tables do not come");
            sleep(Duration::from_millis(10));
        }
        tables
    }

    fn get(&self, table: &str) -> (Value, String) {
        let answer = self.server.request("GET", &format!("/api/v1/{table}"), &[("Cookie", &self.cookie)], b"");
        let version = answer.headers.lines().find_map(|line| line.strip_prefix("etag: ").map(str::to_owned));
        (answer.json(), version.expect("a version"))
    }

    /// Changes a table as the page in control, in the present turn and version.
    fn put(&self, table: &str, body: &Value) -> Answer {
        let version = self.get(table).1;
        self.put_as(table, self.page.last("hello")["client"].clone(), 0, Some(&version), body)
    }

    fn put_as(&self, table: &str, client: Value, turns_ago: u64, version: Option<&str>, body: &Value) -> Answer {
        let mut body = body.clone();
        let turn = self.page.last("control")["turn"].as_u64().expect("a turn");
        (body["client"], body["turn"]) = (client, json!(turn - turns_ago));
        let mut headers = vec![("Cookie", self.cookie.as_str()), ("Content-Type", "application/json")];
        headers.extend(version.map(|version| ("If-Match", version)));
        self.server.request("PUT", &format!("/api/v1/{table}"), &headers, body.to_string().as_bytes())
    }
}

fn refused(answer: &Answer, status: u16, number: &str) {
    assert_eq!((answer.status, answer.error_number().as_str()), (status, number), "{answer:?}");
}

/// What is changed on a page is in force for the next program, and in the files.
#[test]
fn offsets_and_tools_are_changed_and_in_force() {
    let bench = Bench::new();
    let mut tables = Tables::open(&bench);
    let (offsets, _) = tables.get("offsets");
    assert_eq!((&offsets["axes"], &offsets["systems"][0]["name"]), (&json!(["x", "y", "z"]), &json!("G54")));
    assert_eq!(offsets["systems"][0]["mm"], json!([1.5, 0.0, 0.0]));
    let g55 = json!({"systems": [{"name": "G55", "mm": [7.0, 3.0, 0.0], "rotation_deg": 0.0}]});
    let done = tables.put("offsets", &g55);
    assert_eq!(done.status, 204, "{done:?}");
    let (now, _) = tables.get("offsets");
    assert_eq!((&now["systems"][1]["mm"], &now["systems"][0]), (&json!([7.0, 3.0, 0.0]), &offsets["systems"][0]));
    let done = tables.put("tools", &json!({"tools": [{"number": 2, "diameter_mm": 3.5, "length_mm": 41.25}]}));
    assert_eq!(done.status, 204, "{done:?}");
    assert_eq!(
        tables.get("tools").0["tools"],
        json!([
            {"number": 1, "diameter_mm": 6.0, "length_mm": 50.0, "name": "end mill"},
            {"number": 2, "diameter_mm": 3.5, "length_mm": 41.25, "name": ""},
        ])
    );
    let file = |name: &str| std::fs::read_to_string(bench.path(name)).expect("a file");
    assert_eq!(file("tools.tbl"), "T1 P1 Z50 D6 ;end mill\nT2 P2 Z41.25 D3.5\n");
    assert!(file("offsets.var").lines().any(|line| line.starts_with("5241") && line.contains("7.0")));
    // The offset of G92 moves the present system, and is cleared again.
    let g92 = |mm: [f64; 3], is_active| json!({"g92": {"mm": mm, "is_active": is_active}});
    assert_eq!(tables.put("offsets", &g92([0.0, 2.0, 0.0], true)).status, 204);
    tables.page.wait_until("the offset", |page| page.last("live")["work"][1] == -2.0);
    assert_eq!(tables.put("offsets", &g92([0.0; 3], false)).status, 204);
    tables.page.wait_until("no offset", |page| page.last("live")["work"][1] == 0.0);
    tables.page.wait_for_word("READY");
    assert_eq!(tables.page.order("cycle start")["t"], "done");
    tables.page.wait_until("the work zero", |page| page.machine_mm(0) > 20.0);
    tables.page.wait_for_word("ENDED");
    tables.page.wait_until("the end", |page| [page.machine_mm(0), page.machine_mm(1)] == [7.0, 3.0]);
}

/// Whoever is not in control, an old turn, an old version, a machine in use: nothing is changed.
#[test]
fn tables_are_changed_in_control_at_rest_and_not_in_use() {
    let bench = Bench::new();
    let mut tables = Tables::open(&bench);
    let g55 = json!({"systems": [{"name": "G55", "mm": [9.0, 9.0, 0.0], "rotation_deg": 0.0}]});
    let longer = json!({"tools": [{"number": 1, "diameter_mm": 6.0, "length_mm": 51.0}]});
    let before = [tables.get("offsets").0, tables.get("tools").0];
    let me = tables.page.last("hello")["client"].clone();
    let version = tables.get("offsets").1;
    for (table, body) in [("offsets", &g55), ("tools", &longer)] {
        refused(&tables.put_as(table, json!(99), 0, Some(&version), body), 409, "E2404");
        refused(&tables.put_as(table, me.clone(), 1, Some(&version), body), 409, "E2405");
        refused(&tables.put_as(table, me.clone(), 0, None, body), 428, "E2422");
        refused(&tables.put_as(table, me.clone(), 0, Some("\"0\""), body), 412, "E2422");
    }
    // Another session has the same rights, but does not speak for this page.
    let own = std::mem::replace(&mut tables.cookie, tables.server.sign_in(&tables.server.token).expect("a session"));
    refused(&tables.put_as("tools", me.clone(), 0, Some(&version), &longer), 409, "E2404");
    tables.cookie = own;
    let watcher = tables.server.sign_in(&tables.server.watch_token).expect("the token is right");
    let headers = [("Cookie", watcher.as_str()), ("Content-Type", "application/json")];
    refused(&tables.server.request("PUT", "/api/v1/offsets", &headers, b"{}"), 403, "E2403");
    refused(&tables.put("offsets", &json!({"system": []})), 422, "E2418");
    refused(
        &tables.put("offsets", &json!({"systems": [{"name": "G60", "mm": [0, 0, 0], "rotation_deg": 0}]})),
        422,
        "E2425",
    );
    // A length in force belongs to the position that is shown.
    assert_eq!(tables.page.order_when_free("mdi T1 M6 G43")["t"], "done");
    tables.page.wait_until("the tool", |page| page.last("state")["tool"] == 1);
    tables.page.wait_until("its length", |page| page.last("live")["work"][2] == -50.0);
    tables.page.listen(std::time::Duration::from_millis(300));
    refused(&tables.put("tools", &longer), 422, "E2424");
    // A jog, and a program that runs and that is held.
    let jog = json!({"t": "jog", "id": 900, "turn": tables.page.last("control")["turn"],
        "seen": tables.page.last("state")["n"], "axis": "x", "up": true, "beat": 1});
    tables.page.send(&jog);
    assert_eq!(tables.page.answer(900)["t"], "done");
    refused(&tables.put("offsets", &g55), 409, "E2423");
    tables.page.send(&json!({"t": "jog_end"}));
    tables.page.listen(std::time::Duration::from_millis(800));
    assert_eq!(tables.page.order_when_free("mdi G49")["t"], "done");
    tables.page.listen(std::time::Duration::from_millis(500));
    tables.page.wait_for_word("READY");
    assert_eq!(tables.page.order("cycle start")["t"], "done");
    tables.page.wait_until("30 mm", |page| page.machine_mm(0) > 30.0);
    for word in ["RUNNING", "FEED HOLD"] {
        tables.page.wait_for_word(word);
        for (table, body) in [("offsets", &g55), ("tools", &longer)] {
            refused(&tables.put(table, body), 409, "E2408");
        }
        tables.page.send(&json!({"t": "hold"}));
    }
    let now = [tables.get("offsets").0, tables.get("tools").0];
    assert_eq!(now, before, "nothing was changed");
    assert_eq!(tables.page.order("stop")["t"], "done");
    tables.page.wait_for_word("ENDED");
}
