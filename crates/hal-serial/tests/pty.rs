//! Host port and pseudo-terminal, against each other and under faults.
#![cfg(target_os = "linux")]

use std::path::Path;
use std::time::{Duration, Instant};

use retrace_hal_serial::{Address, LatencyTimer, Pty, SerialPort};
use retrace_link::{BytePort, CardFailure};

fn pair() -> (Pty, SerialPort) {
    let pty = Pty::open().expect("a pseudo-terminal");
    let port = SerialPort::open(&address(pty.path())).expect("opens");
    (pty, port)
}

fn address(path: &Path) -> Address {
    Address::parse(&path.display().to_string()).expect("a path")
}

/// Every value of a byte is transferred, in both directions: nothing translates, echoes or swallows.
#[test]
fn all_bytes_come_through_both_ways() {
    let (mut card, mut host) = pair();
    assert_eq!((host.latency(), host.usb()), (&LatencyTimer::None, None));
    let all: Vec<u8> = (0..1024u32).map(|n| (n * 7 + n / 256) as u8).collect();
    let (mut sent, mut up) = (0, Vec::new());
    while up.len() < all.len() {
        sent += host.write(&all[sent..]).expect("a line");
        let mut bytes = [0; 100];
        let count = card.read(&mut bytes, Duration::from_millis(20)).expect("a line");
        up.extend_from_slice(&bytes[..count]);
    }
    assert_eq!(up, all);
    card.write(&all).expect("a line");
    let mut down = Vec::new();
    while down.len() < all.len() {
        let mut bytes = [0; 100];
        let count = host.read(&mut bytes, 1_000_000).expect("a line");
        assert!(count > 0, "after {}", down.len());
        down.extend_from_slice(&bytes[..count]);
    }
    assert_eq!((down, card.dropped()), (all, 0));
}

#[test]
fn no_more_than_four_milliseconds_are_written_ahead() {
    let (_card, mut host) = pair();
    let begin = host.now_us();
    let mut sent = 0;
    while host.now_us() < begin + 50_000 {
        let room = host.writable_bytes();
        assert!(room <= 400);
        sent += host.write(&[0x55; 1000]).expect("a line");
    }
    let passed = host.now_us() - begin;
    assert!(sent as u64 <= passed / 10 + 401, "{sent} bytes in {passed} µs of a line of 1 Mbaud");
    // after a wait that long the whole buffer is free again
    std::thread::sleep(Duration::from_millis(5));
    assert_eq!((host.writable_bytes(), host.write(&[0x55; 1000]).expect("a line")), (400, 400));
}

/// Largest number of bytes that the system buffers for an end that does not read, with those it has not counted yet.
const MAX_BUFFERED: u64 = 24_000;

/// Nobody reads on either side: neither writer waits, and the line works afterwards.
#[test]
fn nobody_reads_and_nobody_waits() {
    let (mut card, mut host) = pair();
    let begin = Instant::now();
    for _ in 0..100 {
        card.write(&[0xAA; 3000]).expect("a line");
    }
    assert!(card.dropped() > 300_000 - MAX_BUFFERED, "{}", card.dropped());
    let mut bytes = [0; 4096];
    let mut old = 0;
    loop {
        match host.read(&mut bytes, 200_000).expect("a line") {
            0 => break,
            count => old += count as u64,
        }
    }
    assert_eq!(old + card.dropped(), 300_000, "what is not dropped is there");
    let mut sent = 0;
    while sent < 60_000 {
        sent += host.write(&[0x55; 400]).expect("a line");
        assert!(begin.elapsed() < Duration::from_secs(60), "stuck after {sent}");
        std::thread::sleep(Duration::from_millis(1));
    }
    // the last part arrives, and the line works
    host.write(b"end").expect("a line");
    card.write(b"hello").expect("a line");
    let count = host.read(&mut bytes, 1_000_000).expect("a line");
    assert_eq!(&bytes[..count], b"hello");
}

#[test]
fn a_host_that_comes_later_reads_nothing_old() {
    let (mut card, mut host) = pair();
    card.write(&[0xAA; 500]).expect("a line");
    // with the first of them all have arrived
    assert_eq!(host.read(&mut [0; 1], 5_000_000).expect("a line"), 1);
    drop(host);
    let mut host = SerialPort::open(&address(card.path())).expect("free again");
    assert_eq!(host.read(&mut [0; 500], 20_000).expect("a line"), 0);
}

#[test]
fn a_wait_is_as_long_as_it_was_told() {
    let (_card, mut host) = pair();
    let begin = Instant::now();
    for _ in 0..20 {
        assert_eq!(host.read(&mut [0; 8], 500).expect("a line"), 0);
    }
    assert!(begin.elapsed() >= Duration::from_millis(10));
}

#[test]
fn a_port_is_open_once() {
    let (card, host) = pair();
    let refused = SerialPort::open(&address(card.path())).expect_err("it is in use");
    assert_eq!(refused.number, "E2144");
    assert!(refused.what.contains("this program itself"), "{refused}");
    drop(host);
    SerialPort::open(&address(card.path())).expect("free again");
}

#[test]
fn what_is_no_port_is_refused() {
    let number = |text: &str| SerialPort::open(&Address::parse(text).expect("a path")).expect_err("no port").number;
    assert_eq!(number("/dev/no-such-port"), "E2141");
    assert_eq!(number("/dev/null"), "E2146");
    assert_eq!(number("/"), "E2146");
    assert_eq!(number("Cargo.toml"), "E2146");
}

#[test]
fn a_closed_other_end_is_a_lost_line_and_may_come_back() {
    let (card, mut host) = pair();
    drop(card);
    let lost = host.read(&mut [0; 8], 1_000_000).expect_err("closed");
    assert!(lost.to_string().contains("is lost"), "{lost}");
    assert_eq!(lost.number(), "E3009");
    assert!(!host.is_open());
    assert_eq!(host.writable_bytes(), 0);
    host.write(b"x").expect_err("still lost");
    assert_eq!(host.reopen_within(Duration::from_millis(120)).expect_err("nobody there").number, "E2147");
    // a link, such as a fixed name for a card, leads to the new one
    let folder = tempfile::tempdir().expect("a folder");
    let name = folder.path().join("card");
    let first = Pty::open().expect("a pseudo-terminal");
    std::os::unix::fs::symlink(first.path(), &name).expect("a link");
    let mut host = SerialPort::open(&address(&name)).expect("opens");
    let second = Pty::open().expect("another");
    drop(first);
    host.read(&mut [0; 8], 1_000_000).expect_err("closed");
    std::fs::remove_file(&name).expect("ours");
    std::os::unix::fs::symlink(second.path(), &name).expect("a link");
    host.reopen_within(Duration::from_secs(5)).expect("there again");
    assert!(host.is_open() && host.address().path == name);
}

/// Another test's terminal, for example, which has got the number of a card that is gone.
#[test]
fn another_pseudo_terminal_of_the_same_number_is_not_opened() {
    let (card, mut host) = pair();
    host.reopen().expect("it is the same one");
    let path = card.path().to_owned();
    // The time of a device file is that of a tick of the kernel, and any other test may take the number at once.
    std::thread::sleep(Duration::from_millis(20));
    drop(card);
    assert_eq!(host.reopen().expect_err("it is gone").number, "E2141");
    let mut others = Vec::new();
    while !path.exists() && others.len() < 100 {
        others.push(Pty::open().expect("a pseudo-terminal"));
    }
    assert!(path.exists(), "the number is used again");
    assert_eq!(host.reopen().expect_err("another one").number, "E2141");
}
