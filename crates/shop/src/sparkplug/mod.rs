//! Sparkplug B: what a machine does, as an edge node of an MQTT broker (SHP-27, SHP-28).
//!
//! ```text
//!  socket of the state ─> StateReader ─> MachineReport ─> node_metrics ─> EdgeNode ─> MqttConnection ─> broker
//!                                                                           ▲               │
//!                                                                           └── a rebirth, ─┘
//!                                                                               the primary host
//! ```
//!
//! The protocol is that of the Eclipse Sparkplug specification 3.0.
//!
//! Invariant: nothing that comes from the broker goes further than the [`EdgeNode`], which has no way to the machine.

mod edge_node;
mod mqtt_connection;
mod node_metric;
mod payload;
mod reconnection_delay;
mod sparkplug_session;
mod tls;
mod value_history;

pub use edge_node::{EdgeNode, NodeName, NodeStep, Publication, ReceivedCounts};
pub use mqtt_connection::MqttVersion;
pub use node_metric::{NodeMetric, node_metrics};
pub use sparkplug_session::{SparkplugNotice, SparkplugSession};
