//! The rows of `--records`: what the card executed, one row per control period.

use std::collections::HashMap;

/// One period.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Number of the period.
    pub period: u64,
    /// Program line that was being executed.
    pub line: u64,
    /// Rate at which it was played, in 10⁻⁹.
    pub rate_nano: i64,
    /// Record under the cursor at the period's end.
    pub record: u64,
    /// Fraction of that record before the cursor, in 2⁻³².
    pub fraction: u64,
    /// Pulses that each axis emitted.
    pub increments: Vec<i64>,
    /// Layer of the tool axis at the end of the period, in pulses; 0 where the file has no such column.
    pub layer: i64,
    /// Outputs that retracing switched, `5=0 66=1`; empty also where the file has no such column.
    pub retrace_switched: String,
}

/// Rate 1 in [`Row::rate_nano`].
pub const RATE_ONE: i64 = 1_000_000_000;

/// All rows, and the names of the axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Records {
    /// The axes, in the order of the increments.
    pub axes: Vec<String>,
    /// The rows, in the order of time.
    pub rows: Vec<Row>,
    /// Whether they are of a dry run.
    pub is_dry: bool,
}

/// The columns before the axes.
const COLUMNS: [&str; 5] = ["period", "line", "rate", "record", "fraction"];

impl Records {
    /// Parses the file's text.
    ///
    /// # Errors
    /// The first line that does not have the format of the interface.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut lines = text.lines();
        let mut header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
        let is_dry = header.last() == Some(&"dry_run");
        if is_dry {
            header.pop();
        }
        if header.get(..COLUMNS.len()) != Some(&COLUMNS[..]) || header.len() == COLUMNS.len() {
            return Err(format!("the header is {header:?}"));
        }
        let has_switched = header.last() == Some(&"retrace_switched");
        let has_layer = header.contains(&"layer");
        let is_axis = |name: &&&str| !["layer", "retrace_switched"].contains(name);
        let axes: Vec<String> = header[COLUMNS.len()..].iter().filter(is_axis).map(|name| (*name).to_owned()).collect();
        let mut rows = Vec::new();
        for (index, line) in lines.enumerate() {
            let fields = if is_dry { line.strip_suffix(",1").unwrap_or_default() } else { line };
            let row = row(fields, axes.len(), has_layer, has_switched)
                .ok_or_else(|| format!("line {}: {line:?}", index + 2))?;
            rows.push(row);
        }
        Ok(Self { axes, rows, is_dry })
    }

    /// The sum of every axis over all rows, in pulses.
    #[must_use]
    pub fn totals(&self) -> Vec<i64> {
        let mut totals = vec![0; self.axes.len()];
        for row in &self.rows {
            totals.iter_mut().zip(&row.increments).for_each(|(total, increment)| *total += increment);
        }
        totals
    }

    /// The rows as the machine moved: the layer is added to its axis.
    #[must_use]
    pub fn with_layer(mut self, axis: usize) -> Self {
        let mut layer = 0;
        for row in &mut self.rows {
            row.increments[axis] += row.layer - layer;
            layer = row.layer;
        }
        self
    }

    /// Checks that position is a function of the place; returns the number of places that were visited more than once.
    ///
    /// # Errors
    /// The first period that is at a place visited before, but at another position.
    pub fn places_visited_twice(&self) -> Result<usize, String> {
        let mut positions: HashMap<(u64, u64), Vec<i64>> = HashMap::new();
        let mut position = vec![0_i64; self.axes.len()];
        let mut twice = 0;
        let mut last_place = None;
        for row in &self.rows {
            position.iter_mut().zip(&row.increments).for_each(|(sum, increment)| *sum += increment);
            let place = (row.record, row.fraction);
            match positions.get(&place) {
                Some(before) if *before != position => {
                    return Err(format!("period {}: {place:?} was {before:?} and is {position:?}", row.period));
                }
                // Remaining at a place is not returning to it.
                Some(_) => twice += usize::from(last_place != Some(place)),
                None => {
                    positions.insert(place, position.clone());
                }
            }
            last_place = Some(place);
        }
        Ok(twice)
    }
}

fn row(line: &str, axes: usize, has_layer: bool, has_switched: bool) -> Option<Row> {
    let (line, retrace_switched) = if has_switched { line.rsplit_once(',')? } else { (line, "") };
    let (line, layer) = if has_layer { line.rsplit_once(',')? } else { (line, "0") };
    let layer = layer.parse().ok()?;
    let mut fields = line.split(',');
    let row = Row {
        period: fields.next()?.parse().ok()?,
        line: fields.next()?.parse().ok()?,
        rate_nano: rate_nano(fields.next()?)?,
        record: fields.next()?.parse().ok()?,
        fraction: fields.next()?.parse().ok().filter(|fraction| *fraction < 1 << 32)?,
        increments: fields.map(|field| field.parse().ok()).collect::<Option<_>>()?,
        layer,
        retrace_switched: retrace_switched.to_owned(),
    };
    (row.increments.len() == axes).then_some(row)
}

/// Parses a rate: digits, nine decimals, and never −0.
fn rate_nano(text: &str) -> Option<i64> {
    let (is_negative, digits) = text.strip_prefix('-').map_or((false, text), |digits| (true, digits));
    let (whole, decimals) = digits.split_once('.')?;
    if decimals.len() != 9 || whole.is_empty() || !digits.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.') {
        return None;
    }
    let nano = whole.parse::<i64>().ok()? * RATE_ONE + decimals.parse::<i64>().ok()?;
    match (is_negative, nano) {
        (true, 0) => None,
        (true, nano) => Some(-nano),
        (false, nano) => Some(nano),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "period,line,rate,record,fraction,x,y\n";

    #[test]
    fn rows_are_read_and_malformed_ones_refused() {
        let records = Records::parse(&format!("{HEADER}1,3,-0.500000000,7,2147483648,-12,4\n")).expect("well formed");
        assert_eq!(records.axes, ["x", "y"]);
        assert_eq!(
            records.rows,
            [Row {
                period: 1,
                line: 3,
                rate_nano: -RATE_ONE / 2,
                record: 7,
                fraction: 1 << 31,
                increments: vec![-12, 4],
                layer: 0,
                retrace_switched: String::new(),
            }]
        );
        for bad in [
            "1,3,-0.000000000,7,0,1,1",
            "1,3,0.5,7,0,1,1",
            "1,3,1.000000000,7,4294967296,1,1",
            "1,3,1.000000000,7,0,1",
            "1,3,1.000000000,7,0,1,1,1",
            "1,3,1.000000000,7,0,1,1.5",
        ] {
            assert!(Records::parse(&format!("{HEADER}{bad}\n")).is_err(), "{bad}");
        }
        assert!(Records::parse("period,line\n").is_err());
    }

    #[test]
    fn a_place_that_lies_elsewhere_the_second_time_is_found() {
        let rows = |last: &str| {
            format!("{HEADER}1,1,1.000000000,1,0,5,0\n2,1,1.000000000,2,0,5,0\n3,1,-1.000000000,1,0,{last},0\n")
        };
        assert_eq!(Records::parse(&rows("-5")).and_then(|records| records.places_visited_twice()), Ok(1));
        assert!(Records::parse(&rows("-4")).and_then(|records| records.places_visited_twice()).is_err());
    }
}
