//! Host application of Sparkplug B that believes nothing: a decoder and a checker, written from the text of the Eclipse
//! Sparkplug specification 3.0 and of the encoding of protocol buffers.
//!
//! Invariant: it knows nothing of the edge node but its messages.

use std::collections::{BTreeMap, BTreeSet};

/// Value of a metric.
#[derive(Clone, Debug, PartialEq)]
pub enum HostValue {
    /// Fields 10 and 11.
    Integer(u64),
    /// Field 13.
    Number(f64),
    /// Field 14.
    Flag(bool),
    /// Field 15.
    Text(String),
}

/// A metric as it came.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HostMetric {
    name: Option<String>,
    alias: Option<u64>,
    timestamp: Option<u64>,
    datatype: Option<u64>,
    is_null: bool,
    is_historical: bool,
    value: Option<HostValue>,
}

/// A payload as it came.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HostPayload {
    timestamp: Option<u64>,
    metrics: Vec<HostMetric>,
    seq: Option<u64>,
}

/// What a host application knows of one edge node.
#[derive(Clone, Debug, Default)]
pub struct SparkplugHost {
    /// Whether the node is online.
    pub is_online: bool,
    /// `bdSeq` of the last birth.
    pub bd_seq: Option<u64>,
    /// Number of births, of messages with data, and of deaths of the session that was online.
    pub births: usize,
    /// Messages with data.
    pub data: usize,
    /// Deaths of the session that was online.
    pub deaths: usize,
    /// Historical values of this session: name, time in ms since 1970, and value; `None` is null.
    pub historical: Vec<(String, u64, Option<HostValue>)>,
    /// Present values by name; `None` is null.
    pub values: BTreeMap<String, Option<HostValue>>,
    names: BTreeMap<u64, (String, u64)>,
    /// Time of the last birth.
    born_ms: u64,
    seq: u64,
    /// `bdSeq` of the last death.
    dead: Option<u64>,
}

impl SparkplugHost {
    /// Takes a message of an edge node: its kind (`NBIRTH`, `NDATA`, `NDEATH`), quality of service, and payload.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn take(&mut self, kind: &str, qos: u8, is_retained: bool, payload: &[u8]) -> Result<(), String> {
        let payload = decode(payload)?;
        if is_retained {
            return Err(format!("{kind} is retained"));
        }
        if payload.timestamp.is_none() {
            return Err(format!("{kind} without a timestamp"));
        }
        match (kind, qos) {
            ("NBIRTH", 0) => self.birth(&payload),
            ("NDATA", 0) => self.data(payload),
            ("NDEATH", 1) => self.death(&payload),
            _ => Err(format!("{kind} with quality of service {qos}")),
        }
    }

    /// Present value of a metric; `None` is null or unknown.
    #[must_use]
    pub fn value(&self, name: &str) -> Option<&HostValue> {
        self.values.get(name)?.as_ref()
    }

    fn birth(&mut self, payload: &HostPayload) -> Result<(), String> {
        if payload.seq != Some(0) {
            return Err(format!("a birth with seq {:?}", payload.seq));
        }
        let number = bd_seq(payload)?;
        match self.bd_seq {
            // A birth on request.
            Some(last) if self.is_online && number != last => {
                return Err(format!("a birth with bdSeq {number} while that with {last} is online"));
            }
            Some(last) if !self.is_online && self.dead == Some(number) => {
                return Err(format!("a birth with bdSeq {number} of a death, after that with {last}"));
            }
            _ => {}
        }
        let (mut names, mut values) = (BTreeMap::new(), BTreeMap::new());
        for metric in &payload.metrics {
            let name = metric.name.clone().ok_or("a metric of a birth without a name")?;
            let datatype = metric.datatype.ok_or_else(|| format!("{name} without a type"))?;
            has_value(metric, datatype).map_err(|why| format!("{name}: {why}"))?;
            if metric.is_historical {
                return Err(format!("{name} is historical in a birth"));
            }
            if let Some(alias) = metric.alias
                && names.insert(alias, (name.clone(), datatype)).is_some()
            {
                return Err(format!("two metrics with alias {alias}"));
            }
            if values.insert(name.clone(), metric.value.clone()).is_some() {
                return Err(format!("two metrics {name}"));
            }
        }
        let rebirth = payload.metrics.iter().find(|metric| metric.name.as_deref() == Some("Node Control/Rebirth"));
        let is_command = |metric: &HostMetric| {
            metric.alias.is_none() && metric.datatype == Some(11) && metric.value == Some(HostValue::Flag(false))
        };
        if !rebirth.is_some_and(is_command) {
            return Err("no `Node Control/Rebirth` that is false and has no alias".into());
        }
        (self.names, self.values) = (names, values);
        if !self.is_online {
            self.historical.clear();
        }
        self.born_ms = payload.timestamp.unwrap_or_default();
        (self.is_online, self.bd_seq, self.seq) = (true, Some(number), 0);
        self.births += 1;
        Ok(())
    }

    fn data(&mut self, payload: HostPayload) -> Result<(), String> {
        if !self.is_online {
            return Err("data without a birth".into());
        }
        let next = (self.seq + 1) % 256;
        if payload.seq != Some(next) {
            return Err(format!("seq {:?} instead of {next}", payload.seq));
        }
        if payload.metrics.is_empty() {
            return Err("data without a metric".into());
        }
        let mut aliases = BTreeSet::new();
        for metric in payload.metrics {
            let alias = metric.alias.ok_or("a metric of data without an alias")?;
            let (name, datatype) = self.names.get(&alias).ok_or_else(|| format!("alias {alias} was not born"))?;
            has_value(&metric, *datatype).map_err(|why| format!("{name}: {why}"))?;
            if metric.is_historical && metric.name.is_none() {
                let time = metric.timestamp.unwrap_or_default();
                let is_in_order = self.historical.last().is_none_or(|(_, last, _)| *last <= time);
                if !is_in_order || time > self.born_ms {
                    return Err(format!("{name}: an old value of {time}, which is not in order or not old"));
                }
                self.historical.push((name.clone(), time, metric.value));
                continue;
            }
            if metric.name.is_some() || !aliases.insert(alias) {
                return Err(format!("{name} comes twice, or with its name"));
            }
            let last = self.values.insert(name.clone(), metric.value.clone());
            if last == Some(metric.value) {
                return Err(format!("{name} has not changed"));
            }
        }
        self.seq = next;
        self.data += 1;
        Ok(())
    }

    fn death(&mut self, payload: &HostPayload) -> Result<(), String> {
        if payload.seq.is_some() {
            return Err("a death with a seq".into());
        }
        let number = bd_seq(payload)?;
        self.dead = Some(number);
        // That of another connection says nothing of this one.
        if self.is_online && self.bd_seq == Some(number) {
            self.is_online = false;
            self.deaths += 1;
        }
        Ok(())
    }
}

/// The metric `bdSeq` of a birth or a death.
///
/// # Errors
/// What is wrong with it.
pub fn bd_seq(payload: &HostPayload) -> Result<u64, String> {
    let mut found = payload.metrics.iter().filter(|metric| metric.name.as_deref() == Some("bdSeq"));
    match (found.next(), found.next()) {
        (Some(HostMetric { datatype: Some(4), value: Some(HostValue::Integer(number @ 0..256)), .. }), None) => {
            Ok(*number)
        }
        found => Err(format!("bdSeq is {found:?}")),
    }
}

/// Whether a metric has a time, and a value of its type or none.
fn has_value(metric: &HostMetric, datatype: u64) -> Result<(), String> {
    if metric.timestamp.is_none() {
        return Err("no timestamp".into());
    }
    match (datatype, &metric.value, metric.is_null) {
        (4, Some(HostValue::Integer(_)), false)
        | (10, Some(HostValue::Number(_)), false)
        | (11, Some(HostValue::Flag(_)), false)
        | (12, Some(HostValue::Text(_)), false)
        | (4 | 10 | 11 | 12, None, true) => Ok(()),
        other => Err(format!("type, value and null are {other:?}")),
    }
}

/// Decodes a payload.
///
/// # Errors
/// What is wrong with it.
pub fn decode(bytes: &[u8]) -> Result<HostPayload, String> {
    let mut payload = HostPayload::default();
    let mut fields = Fields(bytes);
    while let Some((number, field)) = fields.next()? {
        match (number, field) {
            (1, Field::Varint(time)) => payload.timestamp = Some(time),
            (2, Field::Bytes(metric)) => payload.metrics.push(decode_metric(metric)?),
            (3, Field::Varint(seq)) => payload.seq = Some(seq),
            other => return Err(format!("field {other:?} of a payload")),
        }
    }
    Ok(payload)
}

fn decode_metric(bytes: &[u8]) -> Result<HostMetric, String> {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).map_err(|error| error.to_string());
    let mut metric = HostMetric::default();
    let mut fields = Fields(bytes);
    while let Some((number, field)) = fields.next()? {
        match (number, field) {
            (1, Field::Bytes(name)) => metric.name = Some(text(name)?),
            (2, Field::Varint(alias)) => metric.alias = Some(alias),
            (3, Field::Varint(time)) => metric.timestamp = Some(time),
            (4, Field::Varint(datatype)) => metric.datatype = Some(datatype),
            (5, Field::Varint(flag)) => metric.is_historical = flag != 0,
            (7, Field::Varint(flag)) => metric.is_null = flag != 0,
            (10 | 11, Field::Varint(value)) => metric.value = Some(HostValue::Integer(value)),
            (13, Field::Fixed(value)) => metric.value = Some(HostValue::Number(f64::from_le_bytes(value))),
            (14, Field::Varint(value)) => metric.value = Some(HostValue::Flag(value != 0)),
            (15, Field::Bytes(value)) => metric.value = Some(HostValue::Text(text(value)?)),
            other => return Err(format!("field {other:?} of a metric")),
        }
    }
    Ok(metric)
}

/// A command as a host writes it: `Node Control/Rebirth`, or another metric, with a Boolean.
#[must_use]
pub fn command(name: &str, value: bool) -> Vec<u8> {
    let mut metric = vec![0x0A, name.len() as u8];
    metric.extend_from_slice(name.as_bytes());
    metric.extend_from_slice(&[0x18, 1, 0x20, 11, 0x70, value.into()]);
    let mut payload = vec![0x08, 1, 0x12, metric.len() as u8];
    payload.extend(metric);
    payload
}

/// A field of a message.
#[derive(Debug)]
enum Field<'a> {
    Varint(u64),
    Fixed([u8; 8]),
    Bytes(&'a [u8]),
}

/// The fields of a message.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn next(&mut self) -> Result<Option<(u64, Field<'a>)>, String> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let key = self.varint()?;
        let field = match key & 7 {
            0 => Field::Varint(self.varint()?),
            1 => Field::Fixed(self.bytes(8)?.try_into().map_err(|_| "eight bytes")?),
            2 => {
                let length = usize::try_from(self.varint()?).map_err(|error| error.to_string())?;
                Field::Bytes(self.bytes(length)?)
            }
            other => return Err(format!("wire type {other}")),
        };
        Ok(Some((key >> 3, field)))
    }

    fn varint(&mut self) -> Result<u64, String> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.bytes(1)?[0];
            value |= u64::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err("a varint without end".into())
    }

    fn bytes(&mut self, length: usize) -> Result<&'a [u8], String> {
        let (bytes, rest) = self.0.split_at_checked(length).ok_or("the message is cut off")?;
        self.0 = rest;
        Ok(bytes)
    }
}
