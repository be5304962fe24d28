//! What srad only writes to its log: the births that it requests, and messages out of their order.

use log::{LevelFilter, Log, Metadata, Record};

/// The beginning of the message with which srad requests a birth.
const REQUEST: &str = "Issuing rebirth";

struct LogPrinter;

impl Log for LogPrinter {
    fn enabled(&self, metadata: &Metadata) -> bool {
        metadata.target().starts_with("srad")
    }

    fn log(&self, record: &Record) {
        if !self.enabled(record.metadata()) {
            return;
        }
        let text = record.args().to_string().replace('\n', " ");
        match record.level() {
            _ if text.starts_with(REQUEST) => println!("request {text}"),
            log::Level::Error | log::Level::Warn => println!("fault {text}"),
            // srad reports a message that is not the next one at the level of details.
            log::Level::Debug if text.contains("out of order") => println!("fault {text}"),
            _ => {}
        }
    }

    fn flush(&self) {}
}

/// Prints srad's log from now on.
pub(crate) fn install() {
    if log::set_logger(&LogPrinter).is_ok() {
        log::set_max_level(LevelFilter::Debug);
    }
}
