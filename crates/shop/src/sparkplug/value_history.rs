//! Values of the time in which nothing could be published, to be sent after the next birth (SHP-27).
//!
//! Invariant: at most [`MAX_AGE_MS`] and [`MAX_VALUES`] of them are held, the newest ones. A value is sent once.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use super::edge_node::MIN_INTERVAL;
use super::node_metric::NodeMetric;
use super::payload::{Datatype, PayloadMetric, PayloadValue};

/// Longest time for which a value is held.
const MAX_AGE_MS: u64 = 3_600_000;
/// Most values that are held.
const MAX_VALUES: usize = 20_000;
/// Interval at which figures that change all the time, such as positions, are recorded.
const NUMBER_INTERVAL: Duration = Duration::from_secs(10);
/// Most values of a message.
const MAX_BATCH: usize = 500;

/// A value that was not published.
#[derive(Clone, Debug)]
struct HistoricalValue {
    name: Arc<str>,
    time_ms: u64,
    value: Option<PayloadValue>,
}

/// The metrics as they were recorded last.
#[derive(Clone, Debug)]
struct LastRecord {
    metrics: Vec<(Arc<str>, Option<PayloadValue>)>,
    at: Duration,
    numbers_at: Duration,
}

/// Values that were not published.
#[derive(Clone, Debug, Default)]
pub(super) struct ValueHistory {
    values: VecDeque<HistoricalValue>,
    last: Option<LastRecord>,
}

impl ValueHistory {
    /// Records what has changed since the last record; the first one of a time away compares with what was published.
    pub(super) fn record(&mut self, now: Duration, time_ms: u64, published: &[NodeMetric], metrics: &[NodeMetric]) {
        let Some(last) = &mut self.last else {
            let metrics = published.iter().map(|metric| (metric.name.as_str().into(), metric.value.clone()));
            self.last = Some(LastRecord { metrics: metrics.collect(), at: now, numbers_at: now });
            return;
        };
        if now.saturating_sub(last.at) < MIN_INTERVAL {
            return;
        }
        last.at = now;
        let with_numbers = now.saturating_sub(last.numbers_at) >= NUMBER_INTERVAL;
        if with_numbers {
            last.numbers_at = now;
        }
        for (index, metric) in metrics.iter().enumerate() {
            if last.metrics.get(index).is_none_or(|(name, _)| **name != *metric.name) {
                // other axes than before: from here on the metrics are these
                last.metrics.truncate(index);
                last.metrics.push((metric.name.as_str().into(), None));
            }
            let (name, known) = &mut last.metrics[index];
            let has_waited = with_numbers || metric.datatype != Datatype::Double || metric.value.is_none();
            if *known != metric.value && has_waited {
                known.clone_from(&metric.value);
                self.values.push_back(HistoricalValue { name: Arc::clone(name), time_ms, value: metric.value.clone() });
            }
        }
        let excess = self.values.len().saturating_sub(MAX_VALUES);
        self.values.drain(..excess);
        self.forget_old(time_ms);
    }

    /// The time away is over: the present values are published.
    pub(super) fn pause(&mut self) {
        self.last = None;
    }

    /// Whether values wait to be sent.
    #[cfg(test)]
    fn has_values(&self) -> bool {
        !self.values.is_empty()
    }

    /// Takes the oldest values that a message holds, by the aliases of these metrics. One whose metric is not there any
    /// more is dropped.
    pub(super) fn take(&mut self, time_ms: u64, published: &[NodeMetric]) -> Vec<PayloadMetric> {
        self.forget_old(time_ms);
        let count = self.values.len().min(MAX_BATCH);
        let alias_of = |name: &str| published.iter().zip(1..).find(|(metric, _)| metric.name == name);
        let values = self.values.drain(..count).filter_map(|value| {
            let (_, alias) = alias_of(&value.name)?;
            Some(PayloadMetric {
                alias: Some(alias),
                timestamp: Some(value.time_ms),
                is_historical: Some(true),
                is_null: value.value.is_none().then_some(true),
                value: value.value,
                ..PayloadMetric::default()
            })
        });
        values.collect()
    }

    fn forget_old(&mut self, time_ms: u64) {
        while self.values.front().is_some_and(|value| value.time_ms.saturating_add(MAX_AGE_MS) < time_ms) {
            self.values.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metrics(line: u64, x: f64) -> Vec<NodeMetric> {
        let metric = |name: &str, datatype, value| NodeMetric { name: name.into(), datatype, value: Some(value) };
        vec![
            metric("line", Datatype::Int64, PayloadValue::Long(line)),
            metric("axis/x/work", Datatype::Double, PayloadValue::Double(x)),
        ]
    }

    /// A whole day without a broker: an hour of it is kept, in bounded memory, and sent once, the oldest first.
    #[test]
    fn a_day_away_leaves_the_values_of_its_last_hour() {
        let mut history = ValueHistory::default();
        let published = metrics(0, 0.0);
        let day = 2 * 24 * 3600_u64;
        for half in 0..=day {
            let at = Duration::from_millis(500 * half);
            history.record(at, 500 * half, &published, &metrics(half / 3, half as f64));
            assert!(history.values.len() <= MAX_VALUES);
        }
        history.pause();
        let now_ms = 500 * day;
        let mut sent = Vec::new();
        while history.has_values() {
            let batch = history.take(now_ms, &published);
            assert!(!batch.is_empty() && batch.len() <= MAX_BATCH);
            sent.extend(batch);
        }
        let times: Vec<u64> = sent.iter().filter_map(|metric| metric.timestamp).collect();
        assert!(times.is_sorted() && times[0] + MAX_AGE_MS >= now_ms && times[0] + MAX_AGE_MS < now_ms + 2_000);
        // lines at each change, every 1.5 s; positions every 10 s
        let count = |alias| sent.iter().filter(|metric| metric.alias == Some(alias)).count();
        assert_eq!((count(1), count(2)), (2_401, 361));
        assert!(sent.iter().all(|metric| metric.is_historical == Some(true) && metric.name.is_none()));
        assert_eq!(history.take(now_ms, &published), vec![]);
    }

    #[test]
    fn a_machine_that_changes_everything_all_the_time_and_loses_an_axis_takes_bounded_memory() {
        let mut history = ValueHistory::default();
        let many = |number: u64| -> Vec<NodeMetric> {
            let metric = |index: u64| NodeMetric {
                name: format!("m{}", index + number / 40_000),
                datatype: Datatype::Int64,
                value: Some(PayloadValue::Long(number)),
            };
            (0..20).map(metric).collect()
        };
        for number in 0..60_000 {
            history.record(Duration::from_millis(500 * number), number, &[], &many(number));
        }
        assert_eq!(history.values.len(), MAX_VALUES);
        // metrics that were not born are not sent
        let sent = history.take(60_000, &many(0)[..1]);
        assert!(sent.len() <= MAX_BATCH && sent.iter().all(|metric| metric.alias == Some(1)));
    }
}
