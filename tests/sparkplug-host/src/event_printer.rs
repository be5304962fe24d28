//! The messages of a node as srad reads them, before its application puts them in order.

use srad::app::SubscriptionConfig;
use srad::client::{Client, Event, EventLoop, MessageKind, NodeMessage};
use srad::client_rumqtt as client;
use srad::types::MetricValue;

/// Prints every message of the group while the process lives.
pub(crate) async fn run(mut events: client::EventLoop, client: client::Client, group: SubscriptionConfig) {
    loop {
        match events.poll().await {
            Event::Online if client.subscribe_many(group.clone().into()).await.is_err() => {
                println!("fault the group cannot be subscribed to");
            }
            Event::Online | Event::Offline | Event::State { .. } => {}
            Event::Node(message) => print(&message),
            Event::Device(message) => println!("fault a device {}", message.device_id),
            Event::InvalidPublish { reason, .. } => println!("fault {reason:?}"),
        }
    }
}

fn print(message: &NodeMessage) {
    let payload = &message.message.payload;
    let number = |number: Option<u64>| number.map_or("null".to_owned(), |number| number.to_string());
    let bd_seq = || {
        let metric = payload.metrics.iter().find(|metric| metric.name.as_deref() == Some("bdSeq"));
        let value = metric.and_then(|metric| metric.value.clone());
        number(value.and_then(|value| i64::try_from(MetricValue::from(value)).ok()).and_then(|n| n.try_into().ok()))
    };
    match &message.message.kind {
        MessageKind::Birth => println!("message birth {} {}", bd_seq(), number(payload.seq)),
        MessageKind::Data => println!("message data {}", number(payload.seq)),
        MessageKind::Death => println!("message death {}", bd_seq()),
        MessageKind::Cmd => {}
        MessageKind::Other(kind) => println!("fault a message {kind}"),
    }
}
