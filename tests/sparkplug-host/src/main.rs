//! A Sparkplug host application that prints what srad makes of the messages of a node, one line each.
//!
//! `retrace-sparkplug-host PORT GROUP NODE` connects twice to the broker on this computer: once as srad's application,
//! which keeps the state of the node, and once for its messages. A line `rebirth` on standard input requests a birth;
//! the end of the input ends it.
//!
//! | line | meaning |
//! |---|---|
//! | `online` | the application is connected |
//! | `state birth N`, `state data N` | the application has taken so many metrics into its state |
//! | `state stale` | it holds the values for old: a death, or a rebirth that it has requested |
//! | `value NAME VALUE` | value of a metric, `null` where it has none |
//! | `message birth BDSEQ SEQ`, `message data SEQ`, `message death BDSEQ` | a message of the node |
//! | `fault TEXT` | srad cannot read a message, or finds one out of its order |
//! | `request TEXT` | the application itself requests a birth, with its reason |
//!
//! Invariant: nothing here knows of retrace; srad alone decides what is in order.
#![forbid(unsafe_code)]

mod event_printer;
mod log_printer;
mod metric_printer;

use std::process::ExitCode;

use metric_printer::MetricPrinter;
use rumqttc::v5::MqttOptions;
use srad::app::SubscriptionConfig;
use srad::app::generic_app::{ApplicationBuilder, RebirthConfig};
use srad::client_rumqtt::EventLoop;
use tokio::io::{AsyncBufReadExt, BufReader};

/// Messages that srad may have in hand.
const CAPACITY: usize = 64;

#[tokio::main]
async fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [port, group, node] = arguments.as_slice() else {
        eprintln!("retrace-sparkplug-host PORT GROUP NODE");
        return ExitCode::FAILURE;
    };
    let Ok(port) = port.parse::<u16>() else {
        eprintln!("{port} is not a port");
        return ExitCode::FAILURE;
    };
    log_printer::install();
    let group_of = || SubscriptionConfig::SingleGroup { group_id: group.clone() };

    let (events, client) = EventLoop::new(MqttOptions::new("events", "localhost", port), CAPACITY);
    tokio::spawn(event_printer::run(events, client, group_of()));

    let (events, client) = EventLoop::new(MqttOptions::new("srad", "localhost", port), CAPACITY);
    let (application, sender) = ApplicationBuilder::new("srad", events, client, group_of())
        .on_online(|| println!("online"))
        .on_node_created(|node| node.register_metric_store(MetricPrinter::default()))
        .with_rebirth_config(every_reason())
        .build();
    tokio::spawn(application.run());

    let mut lines = BufReader::new(tokio::io::stdin()).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        if line.trim() == "rebirth" && sender.publish_node_rebirth(group, node).await.is_err() {
            println!("fault the request could not be sent");
        }
    }
    ExitCode::SUCCESS
}

/// Requests a birth for every reason that srad knows, at once: none of them stays hidden.
fn every_reason() -> RebirthConfig {
    RebirthConfig { invalid_payload: true, rebirth_cooldown: std::time::Duration::ZERO, ..RebirthConfig::default() }
}
