//! Payloads of Sparkplug B, as protocol buffers.
//!
//! The field numbers are those of the Sparkplug specification 3.0, chapter 6. Fields that are not used here, such as
//! properties, data sets and templates, are skipped when a payload is decoded.
//!
//! Invariant: a metric has a value or is null, never both.

use prost::Message;

/// Payload of every message but `STATE`.
#[derive(Clone, PartialEq, Message)]
pub(super) struct Payload {
    /// Time at which it was sent, in ms since 1970 (UTC).
    #[prost(uint64, optional, tag = "1")]
    pub(super) timestamp: Option<u64>,
    /// Metrics.
    #[prost(message, repeated, tag = "2")]
    pub(super) metrics: Vec<PayloadMetric>,
    /// Number of the message since the birth, 0 to 255.
    #[prost(uint64, optional, tag = "3")]
    pub(super) seq: Option<u64>,
}

/// A metric of a payload.
#[derive(Clone, PartialEq, Message)]
pub(super) struct PayloadMetric {
    /// Name; in `NDATA` the alias stands for it.
    #[prost(string, optional, tag = "1")]
    pub(super) name: Option<String>,
    /// Number that stands for the name in `NDATA`.
    #[prost(uint64, optional, tag = "2")]
    pub(super) alias: Option<u64>,
    /// Time of the value, in ms since 1970 (UTC).
    #[prost(uint64, optional, tag = "3")]
    pub(super) timestamp: Option<u64>,
    /// Type of the value: a number of [`Datatype`].
    #[prost(uint32, optional, tag = "4")]
    pub(super) datatype: Option<u32>,
    /// Whether the value is an old one.
    #[prost(bool, optional, tag = "5")]
    pub(super) is_historical: Option<bool>,
    /// Whether there is no value.
    #[prost(bool, optional, tag = "7")]
    pub(super) is_null: Option<bool>,
    /// The value.
    #[prost(oneof = "PayloadValue", tags = "10, 11, 13, 14, 15")]
    pub(super) value: Option<PayloadValue>,
}

/// Value of a metric.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum PayloadValue {
    /// An integer of up to 32 bits.
    #[prost(uint32, tag = "10")]
    Int(u32),
    /// An integer of 64 bits; a signed one in two's complement.
    #[prost(uint64, tag = "11")]
    Long(u64),
    /// A number.
    #[prost(double, tag = "13")]
    Double(f64),
    /// True or false.
    #[prost(bool, tag = "14")]
    Boolean(bool),
    /// A text.
    #[prost(string, tag = "15")]
    Text(String),
}

/// Types of values that are used here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Datatype {
    /// Integer of 64 bits with a sign.
    Int64 = 4,
    /// Number.
    Double = 10,
    /// True or false.
    Boolean = 11,
    /// Text.
    String = 12,
}

impl Payload {
    /// The bytes of a message.
    #[must_use]
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        self.encode_to_vec()
    }

    /// The payload of a message; none where the bytes are not one.
    #[must_use]
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        Self::decode(bytes).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn value() -> impl Strategy<Value = Option<PayloadValue>> {
        prop_oneof![
            Just(None),
            any::<u32>().prop_map(|number| Some(PayloadValue::Int(number))),
            any::<u64>().prop_map(|number| Some(PayloadValue::Long(number))),
            any::<f64>().prop_filter("equal", |n| !n.is_nan()).prop_map(|number| Some(PayloadValue::Double(number))),
            any::<bool>().prop_map(|flag| Some(PayloadValue::Boolean(flag))),
            "\\PC{0,20}".prop_map(|text| Some(PayloadValue::Text(text))),
        ]
    }

    fn name() -> impl Strategy<Value = Option<String>> {
        proptest::option::of("\\PC{0,20}")
    }

    proptest! {
        #[test]
        fn what_is_encoded_is_decoded(
            timestamp: Option<u64>,
            seq: Option<u64>,
            metrics in proptest::collection::vec((name(), any::<Option<u64>>(), value()), 0..9),
        ) {
            let metrics = metrics.into_iter().map(|(name, alias, value)| PayloadMetric {
                name,
                alias,
                timestamp,
                datatype: Some(Datatype::Double as u32),
                is_historical: None,
                is_null: value.is_none().then_some(true),
                value,
            });
            let payload = Payload { timestamp, metrics: metrics.collect(), seq };
            prop_assert_eq!(Payload::from_bytes(&payload.to_bytes()), Some(payload));
        }

        #[test]
        fn any_bytes_are_a_payload_or_none(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = Payload::from_bytes(&bytes);
        }
    }

    /// The bytes that the protocol buffer encoding gives by hand: key = field number · 8 + wire type.
    #[test]
    fn the_bytes_are_those_of_the_encoding() {
        let metric = |name: &str, datatype, value| PayloadMetric {
            name: Some(name.into()),
            alias: Some(300),
            timestamp: Some(1),
            datatype: Some(datatype as u32),
            value: Some(value),
            ..PayloadMetric::default()
        };
        let bytes = |metric| Payload { timestamp: None, metrics: vec![metric], seq: Some(0) }.to_bytes();
        let begin = |name: u8, length: u8| vec![0x12, length, 0x0A, 1, name, 0x10, 0xAC, 0x02, 0x18, 1, 0x20];
        let with = |begin: Vec<u8>, end: &[u8]| [begin.as_slice(), end, &[0x18, 0]].concat();
        assert_eq!(bytes(metric("a", Datatype::Int64, PayloadValue::Long(5))), with(begin(b'a', 12), &[4, 0x58, 5]));
        assert_eq!(
            bytes(metric("b", Datatype::Double, PayloadValue::Double(1.0))),
            with(begin(b'b', 19), &[10, 0x69, 0, 0, 0, 0, 0, 0, 0xF0, 0x3F])
        );
        assert_eq!(
            bytes(metric("c", Datatype::Boolean, PayloadValue::Boolean(false))),
            with(begin(b'c', 12), &[11, 0x70, 0])
        );
        assert_eq!(
            bytes(metric("d", Datatype::String, PayloadValue::Text("x".into()))),
            with(begin(b'd', 13), &[12, 0x7A, 1, b'x'])
        );
        let null = PayloadMetric { is_null: Some(true), ..PayloadMetric::default() };
        assert_eq!(Payload { timestamp: Some(7), metrics: vec![null], seq: None }.to_bytes(), [8, 7, 0x12, 2, 0x38, 1]);
    }
}
