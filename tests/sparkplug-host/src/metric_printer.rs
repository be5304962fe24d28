//! The state of a node as srad's application keeps it, printed with each change.

use std::collections::HashMap;

use srad::app::generic_app::{MetricStore, StateUpdateError};
use srad::app::{MetricBirthDetails, MetricDetails};
use srad::types::payload::DataType;
use srad::types::{MetricId, MetricValueKind};

/// Names and types of the last birth.
#[derive(Default)]
pub(crate) struct MetricPrinter {
    metrics: HashMap<MetricId, (String, DataType)>,
}

impl MetricPrinter {
    fn print(&self, id: &MetricId, details: MetricDetails) -> Result<(), StateUpdateError> {
        let (name, datatype) = self.metrics.get(id).ok_or(StateUpdateError::UnknownMetric)?;
        let historical = if details.is_historical { " historical" } else { "" };
        let Some(value) = details.value else {
            println!("value {name} null{historical}");
            return Ok(());
        };
        let value = MetricValueKind::try_from_metric_value(*datatype, value);
        let value = match value.map_err(|_| StateUpdateError::InvalidValue)? {
            MetricValueKind::String(text) => text,
            MetricValueKind::Int64(number) => number.to_string(),
            MetricValueKind::Double(number) => number.to_string(),
            MetricValueKind::Boolean(is_set) => is_set.to_string(),
            _ => return Err(StateUpdateError::InvalidValue),
        };
        println!("value {name} {value}{historical}");
        Ok(())
    }
}

impl MetricStore for MetricPrinter {
    fn set_stale(&mut self) {
        println!("state stale");
    }

    fn update_from_birth(&mut self, details: Vec<(MetricBirthDetails, MetricDetails)>) -> Result<(), StateUpdateError> {
        self.metrics = details.iter().map(|(of, _)| (of.get_metric_id(), (of.name.clone(), of.datatype))).collect();
        let count = details.len();
        details.into_iter().try_for_each(|(of, details)| self.print(&of.get_metric_id(), details))?;
        println!("state birth {count}");
        Ok(())
    }

    fn update_from_data(&mut self, details: Vec<(MetricId, MetricDetails)>) -> Result<(), StateUpdateError> {
        let count = details.len();
        details.into_iter().try_for_each(|(id, details)| self.print(&id, details))?;
        println!("state data {count}");
        Ok(())
    }
}
