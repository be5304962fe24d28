//! The edge node of Sparkplug B, by a checker that knows the specification only (SHP-27).

use std::time::Duration;

use proptest::prelude::*;
use retrace_shop::{EdgeNode, MachineReport, NodeName, NodeStep, Publication, ReportedAxis, node_metrics};
use serde_json::json;

use crate::sparkplug_checker::{HostValue, SparkplugHost, bd_seq, command, decode};

const STATE: &str = "spBv1.0/STATE/scada";
const COMMAND: &str = "spBv1.0/shop/NCMD/mill";

/// What happens to a node.
#[derive(Clone, Debug)]
enum Happening {
    Connect,
    ConnectFails,
    Subscribed,
    Lost,
    Time(u16),
    Report(u8, bool),
    Rebirth,
    OtherCommand(Vec<u8>),
    Host(bool, u8),
}

fn happening() -> impl Strategy<Value = Happening> {
    use Happening::*;
    prop_oneof![
        2 => Just(Connect),
        1 => Just(ConnectFails),
        3 => Just(Subscribed),
        1 => Just(Lost),
        8 => (0..900_u16).prop_map(Time),
        8 => (any::<u8>(), prop::bool::weighted(0.1)).prop_map(|(line, is_turning)| Report(line, is_turning)),
        2 => Just(Rebirth),
        1 => proptest::collection::vec(any::<u8>(), 0..40).prop_map(OtherCommand),
        3 => (prop::bool::weighted(0.8), any::<u8>()).prop_map(|(is_online, time)| Host(is_online, time)),
    ]
}

/// A node, and the host that it is connected to or not.
struct Trial {
    node: EdgeNode,
    host: SparkplugHost,
    has_primary: bool,
    /// `bdSeq` of the wills, and whether the connection of the last one is open.
    wills: Vec<u64>,
    is_connected: bool,
    will: Option<Publication>,
    now_ms: u64,
    /// Time of the last message, and what the host application was said to be.
    sent_ms: Option<u64>,
    primary: Option<(bool, u8)>,
    report: MachineReport,
    axes: Vec<ReportedAxis>,
}

impl Trial {
    fn new(has_primary: bool, bd_seq: Option<u8>) -> Self {
        let primary_host = has_primary.then(|| "scada".to_owned());
        let name = NodeName { group: "shop".into(), node: "mill".into(), primary_host };
        Self {
            node: EdgeNode::new(name, bd_seq),
            host: SparkplugHost::default(),
            has_primary,
            wills: bd_seq.into_iter().map(u64::from).collect(),
            is_connected: false,
            will: None,
            now_ms: 0,
            sent_ms: None,
            primary: None,
            report: MachineReport::default(),
            axes: vec![ReportedAxis { letter: 'x', is_linear: true }],
        }
    }

    /// The broker publishes the will of a connection that breaks off.
    fn break_off(&mut self) -> Result<(), String> {
        (self.is_connected, self.primary) = (false, None);
        self.will.take().map_or(Ok(()), |will| self.deliver(&will))
    }

    fn deliver(&mut self, message: &Publication) -> Result<(), String> {
        let elements: Vec<&str> = message.topic.split('/').collect();
        let ["spBv1.0", "shop", kind, "mill"] = elements[..] else { return Err(message.topic.clone()) };
        self.host.take(kind, message.qos, false, &message.payload)
    }

    fn apply(&mut self, happening: Happening) -> Result<(), String> {
        match happening {
            Happening::Connect | Happening::ConnectFails => {
                self.break_off()?;
                let will = self.node.connect(self.now_ms);
                let number = bd_seq(&decode(&will.payload)?)?;
                if let Some(last) = self.wills.last()
                    && number != (last + 1) % 256
                {
                    return Err(format!("a will with bdSeq {number} after {last}"));
                }
                if matches!(happening, Happening::ConnectFails) {
                    self.node.connect_failed();
                } else {
                    self.wills.push(number);
                    (self.is_connected, self.will) = (true, Some(will));
                }
            }
            Happening::Subscribed if self.is_connected && !self.node.is_born() => self.node.subscribed(),
            Happening::Subscribed => {}
            Happening::Lost => {
                self.node.lost();
                self.break_off()?;
            }
            Happening::Time(ms) => self.now_ms += u64::from(ms),
            Happening::Report(line, is_turning) => {
                self.report.take(json!({"t": "state", "stage": "job", "line": line, "override": 1.0}));
                if is_turning {
                    let letter = if self.axes[0].letter == 'x' { 'a' } else { 'x' };
                    self.axes = vec![ReportedAxis { letter, is_linear: letter == 'x' }];
                }
            }
            Happening::Rebirth if self.is_connected => {
                self.node.receive(COMMAND, &command("Node Control/Rebirth", true));
            }
            Happening::OtherCommand(bytes) if self.is_connected => {
                let before = self.node.received();
                self.node.receive(COMMAND, &bytes);
                self.node.receive(COMMAND, &command("Node Control/Rebirth", false));
                self.node.receive(COMMAND, &command("Node Control/Reboot", true));
                self.node.receive("spBv1.0/shop/NCMD/lathe", &command("Node Control/Rebirth", true));
                if self.node.received().ignored != before.ignored + 4 {
                    return Err(format!("{:?} after {before:?}", self.node.received()));
                }
            }
            Happening::Host(is_online, time) if self.is_connected => {
                let state = json!({"online": is_online, "timestamp": time}).to_string();
                self.node.receive(STATE, state.as_bytes());
                if self.primary.is_none_or(|(_, known)| time >= known) {
                    self.primary = Some((is_online, time));
                }
            }
            Happening::Rebirth | Happening::OtherCommand(_) | Happening::Host(..) => {}
        }
        self.step()
    }

    fn step(&mut self) -> Result<(), String> {
        let metrics = node_metrics(&self.report, &self.axes);
        let was_born = self.node.is_born();
        let primary_is_away = self.has_primary && self.primary.is_none_or(|(is_online, _)| !is_online);
        match self.node.step(Duration::from_millis(self.now_ms), self.now_ms, metrics) {
            NodeStep::Idle => Ok(()),
            NodeStep::Publish(_) if !self.is_connected || primary_is_away => {
                Err("a message without a connection, or without its host".into())
            }
            NodeStep::Publish(message) => {
                if was_born && self.sent_ms.is_some_and(|sent| self.now_ms - sent < 500) {
                    return Err("more than two messages a second".into());
                }
                self.sent_ms = Some(self.now_ms);
                self.deliver(&message)
            }
            NodeStep::Disconnect(death) => {
                if !was_born || !primary_is_away {
                    return Err("a death while the host is online".into());
                }
                // It leaves in order: the will is dropped.
                (self.is_connected, self.will, self.primary) = (false, None, None);
                self.deliver(&death)
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    /// After anything that may happen to a connection, what was sent is a session of the specification.
    #[test]
    fn whatever_happens_the_host_sees_sessions_of_the_specification(
        happenings in proptest::collection::vec(happening(), 1..120),
        has_primary: bool,
        bd_seq in proptest::option::of(prop_oneof![Just(254_u8), any::<u8>()]),
    ) {
        let mut trial = Trial::new(has_primary, bd_seq);
        for happening in happenings {
            let shown = format!("{happening:?}");
            trial.apply(happening).map_err(|why| TestCaseError::fail(format!("{shown}: {why}")))?;
            prop_assert!(!trial.node.is_born() || trial.host.is_online, "{}", shown);
        }
        // In the end the host knows what the node knows.
        trial.now_ms += 500;
        trial.step().map_err(TestCaseError::fail)?;
        if trial.node.is_born() {
            let line = trial.report.line().map(HostValue::Integer);
            prop_assert_eq!(trial.host.value("line"), line.as_ref());
            let axis = format!("axis/{}/work", trial.axes[0].letter);
            prop_assert!(trial.host.values.contains_key(&axis), "{} was not born", axis);
        }
    }
}

#[test]
fn three_hundred_changes_wrap_the_sequence_and_one_rebirth_begins_it_again() {
    let mut trial = Trial::new(false, None);
    trial.apply(Happening::Connect).and_then(|()| trial.apply(Happening::Subscribed)).expect("born");
    for change in 0..300_u16 {
        trial.apply(Happening::Time(500)).expect("time");
        trial.apply(Happening::Report((change % 200) as u8 + 1, false)).expect("data");
    }
    assert_eq!((trial.host.births, trial.host.data), (1, 300));
    (0..100).for_each(|_| trial.apply(Happening::Rebirth).expect("asked"));
    trial.apply(Happening::Time(500)).expect("reborn");
    assert_eq!((trial.host.births, trial.host.bd_seq, trial.node.received().rebirths), (2, Some(0), 100));
}

/// Values of the time away: after the birth, in order, with the times at which they were so, and none of them twice.
#[test]
fn values_of_the_time_away_follow_the_birth() -> Result<(), String> {
    let mut trial = Trial::new(false, None);
    for happening in [Happening::Connect, Happening::Subscribed, Happening::Report(1, false), Happening::Lost] {
        trial.apply(happening)?;
    }
    for line in 2..=40 {
        trial.apply(Happening::Report(line, false))?;
        trial.apply(Happening::Time(600))?;
    }
    trial.apply(Happening::Connect)?;
    trial.apply(Happening::Subscribed)?;
    assert!(trial.host.is_online && trial.host.historical.is_empty());
    for _ in 0..5 {
        trial.apply(Happening::Time(600))?;
    }
    let lines = trial.host.historical.iter().filter(|(name, ..)| name == "line");
    let lines: Vec<_> = lines.map(|(_, _, value)| value.clone()).collect();
    // the first look only begins the record
    let expected: Vec<_> = (2..=40).map(|line| Some(HostValue::Integer(line))).collect();
    assert!(expected.ends_with(&lines) && lines.len() >= 38, "{lines:?}");
    assert_eq!(trial.host.value("line"), Some(&HostValue::Integer(40)));
    // what was sent is not sent again
    let sent = trial.host.historical.len();
    for happening in [Happening::Lost, Happening::Connect, Happening::Subscribed, Happening::Time(600)] {
        trial.apply(happening)?;
    }
    trial.apply(Happening::Time(600))?;
    assert!(sent > 0 && trial.host.is_online && trial.host.historical.is_empty(), "{:?}", trial.host.historical);
    Ok(())
}
