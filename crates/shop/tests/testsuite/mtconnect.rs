//! The SHDR adapter, by a checker that knows the protocol only (SHP-29).

use std::io::{BufRead, BufReader, Read};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use retrace_shop::{MachineReport, ReportedAxis, ShdrAdapter, devices_xml};
use serde_json::{Value, json};

use crate::shdr_checker::{ShdrAgentState, device_items};

/// Reports of any kind, on one connection and on many: each line is well-formed, and a new connection has the state.
#[test]
fn any_report_makes_well_formed_lines() {
    let axes = [('x', true), ('z', true), ('a', false)].map(|(letter, is_linear)| ReportedAxis { letter, is_linear });
    let items = device_items(&devices_xml("mill \"1\" <&>", &axes)).expect("a device file");
    let mut runner = TestRunner::new(Config { cases: 1_500, ..Config::default() });
    let words = prop_oneof![
        Just("job"),
        Just("setup"),
        Just("ended"),
        Just("run"),
        Just("reverse"),
        Just("hold"),
        Just("none"),
        Just("program stop"),
        Just("M3"),
        Just("G1 G21 G94 F300"),
        Just("G20 G94 Fnan")
    ];
    let text = prop_oneof![words.prop_map(str::to_owned), "\\PC{0,40}", Just("a|b\r\n\"c\\|".to_owned())];
    let figure =
        prop_oneof![Just(Value::Null), any::<f64>().prop_map(Value::from), Just(json!(3)), Just(json!([1.5, null]))];
    let texts = proptest::collection::vec(text, 9);
    let figures = proptest::collection::vec(figure, 8);
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address");
    let adapter = std::cell::RefCell::new(ShdrAdapter::new(listener).expect("an adapter"));
    let lines = std::cell::Cell::new(0);
    runner
        .run(&(texts, figures, any::<[bool; 4]>()), |(text, figure, has)| {
            let alarm = has[0].then(|| json!({"number": "E3012", "cause": text[7], "is_refusal": has[1]}));
            let mut report = MachineReport::default();
            report.take(json!({
                "t": "state", "stage": text[0], "mode": text[1], "hold_reason": text[2], "why": text[3],
                "modal": text[4], "program": {"name": text[5]}, "line": figure[0], "override": figure[1],
                "tool": figure[2], "alarm": alarm,
                "pause": has[2].then_some(1), "switching": has[3].then_some("M3"),
            }));
            report.take(json!({
                "t": "live", "mm": figure[3], "work": figure[4], "feed": figure[5], "rate": figure[6], "rpm": figure[7],
                "back_mm": figure[5], "at_rest": has[1],
            }));
            report.take(json!({"t": "block", "text": text[6], "line": 1}));
            let stream = TcpStream::connect(address).expect("it listens");
            let mut adapter = adapter.borrow_mut();
            let begun = Instant::now();
            while adapter.agents() == 0 && begun.elapsed() < Duration::from_secs(5) {
                adapter.serve(&report, &axes);
            }
            report.forget();
            adapter.serve(&report, &axes);
            stream.shutdown(std::net::Shutdown::Write).expect("it is open");
            while adapter.agents() > 0 && begun.elapsed() < Duration::from_secs(5) {
                adapter.serve(&report, &axes);
            }
            let mut agent = ShdrAgentState::default();
            for line in BufReader::new(stream).lines() {
                agent.take(&line.expect("text"), &items).map_err(TestCaseError::fail)?;
            }
            prop_assert_eq!(agent.values.len(), items.len());
            prop_assert_eq!(&agent.values["avail"], "UNAVAILABLE");
            lines.set(lines.get() + agent.lines);
            Ok(())
        })
        .unwrap_or_else(|why| panic!("{why}"));
    assert!(lines.get() > 10_000, "{} lines", lines.get());
}

/// An agent that reads nothing is disconnected, and the others have everything.
#[test]
fn an_agent_that_reads_nothing_is_disconnected() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address");
    let mut adapter = ShdrAdapter::new(listener).expect("an adapter");
    let (sleeper, reader) = (TcpStream::connect(address).expect("one"), TcpStream::connect(address).expect("two"));
    let mut report = MachineReport::default();
    while adapter.agents() < 2 {
        adapter.serve(&report, &[]);
    }
    reader.set_nonblocking(true).expect("a socket");
    let (mut sent, mut read, mut buffer) = (0_u64, 0_u64, vec![0; 1 << 16]);
    while adapter.agents() == 2 {
        report
            .take(json!({"t": "state", "stage": "job", "program": {"name": format!("{sent} {}", "x".repeat(2_000))}}));
        adapter.serve(&report, &[]);
        sent += 1;
        while let Ok(count) = (&reader).read(&mut buffer) {
            read += count as u64;
        }
        assert!(sent < 100_000, "it takes no memory without end");
    }
    assert!(read > 2_000 * (sent - 1), "{read} bytes of {sent} values");
    drop(sleeper);
}
