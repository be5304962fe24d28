//! A host for tests: it maintains the modal state as an interpreter would, and records every block.
//!
//! Invariant: nothing here uses the crate's own reading of blocks; words are read one by one.

use retrace_cycles::{
    Alarm, Argument, Cycle, CycleBlock, CycleLibrary, CycleRunError, CycleStoppedError, Host, Message, Query,
    StockCall, StockMove, StockPathError, Vm, VmLimits,
};

/// A minimal interpreter.
#[derive(Clone, Debug)]
pub(crate) struct Recorder {
    pub(crate) lines: Vec<String>,
    pub(crate) messages: Vec<String>,
    pub(crate) warnings: Vec<u32>,
    pub(crate) position: [f64; 3],
    pub(crate) feed: f64,
    pub(crate) speed: f64,
    pub(crate) direction: f64,
    pub(crate) offset: f64,
    pub(crate) plane: f64,
    pub(crate) compensation: f64,
    pub(crate) distance: f64,
    pub(crate) inch: f64,
    pub(crate) modal_cycle: f64,
    pub(crate) path: Result<Vec<StockMove>, StockPathError>,
    pub(crate) stock_calls: Vec<String>,
    pub(crate) entered: Vec<String>,
    pub(crate) triggers: usize,
    /// Index of the block at which it stops.
    pub(crate) stop_at: Option<usize>,
}

impl Default for Recorder {
    fn default() -> Self {
        Self {
            lines: Vec::new(),
            messages: Vec::new(),
            warnings: Vec::new(),
            position: [0.0; 3],
            feed: 100.0,
            speed: 600.0,
            direction: 3.0,
            offset: 1.0,
            plane: 17.0,
            compensation: 40.0,
            distance: 90.0,
            inch: 0.0,
            modal_cycle: 1.0,
            path: Ok(Vec::new()),
            stock_calls: Vec::new(),
            entered: Vec::new(),
            triggers: 0,
            stop_at: None,
        }
    }
}

/// Formats a number to a millionth, without trailing zeros.
pub(crate) fn shown(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    format!("{}", if rounded == 0.0 { 0.0 } else { rounded })
}

impl Host for Recorder {
    fn ask(&self, what: Query) -> f64 {
        match what {
            Query::Position(letter) => self.position[usize::from(letter - b'X').min(2)],
            Query::Feed => self.feed,
            Query::SpindleSpeed => self.speed,
            Query::SpindleDirection => self.direction,
            Query::OffsetNumber => self.offset,
            Query::Plane => self.plane,
            Query::Compensation => self.compensation,
            Query::Distance => self.distance,
            Query::FeedMode => 94.0,
            Query::SpindleMode => 97.0,
            Query::Inch => self.inch,
            Query::ModalCycle => self.modal_cycle,
            Query::ToolRadius => 0.8,
            Query::EdgePosition => 3.0,
            Query::ClearanceAngle => 30.0,
            Query::Motion | Query::Diameter => 0.0,
        }
    }

    fn block(&mut self, block: &CycleBlock) -> Result<(), CycleStoppedError> {
        if self.stop_at == Some(self.lines.len()) {
            return Err(CycleStoppedError);
        }
        let mut words = Vec::new();
        for tenths in block.g() {
            words.push(format!("G{}", shown(f64::from(*tenths) / 10.0)));
            match tenths {
                170..=190 => self.plane = f64::from(tenths / 10),
                400..=420 => self.compensation = f64::from(tenths / 10),
                900 | 910 => self.distance = f64::from(tenths / 10),
                _ => {}
            }
        }
        for word in block.words() {
            words.push(format!("{}{}", char::from(word.letter), shown(word.value)));
            match word.letter {
                b'X'..=b'Z' => self.position[usize::from(word.letter - b'X')] = word.value,
                b'F' => self.feed = word.value,
                b'S' => self.speed = word.value,
                _ => {}
            }
        }
        words.extend(block.m().iter().map(|code| format!("M{code}")));
        self.triggers += usize::from(block.triggers);
        self.lines.push(words.join(" "));
        Ok(())
    }

    fn message(&mut self, message: &Message<'_>) {
        match message.warning {
            Some(number) => self.warnings.push(number),
            None => self.messages.push(message.text.to_owned()),
        }
    }

    fn enter(&mut self, cycle: &Cycle) {
        self.entered.push(format!("+{}", cycle.name()));
    }

    fn leave(&mut self, cycle: &Cycle) -> Result<(), CycleStoppedError> {
        self.entered.push(format!("-{}", cycle.name()));
        Ok(())
    }

    fn stock(&mut self, call: &StockCall<'_>) -> Result<u32, StockPathError> {
        self.stock_calls.push(format!("{call:?}"));
        self.path.as_ref().map(|path| path.len() as u32).map_err(Clone::clone)
    }

    fn stock_move(&self, index: u32) -> Option<StockMove> {
        self.path.as_ref().ok().and_then(|path| path.get(index as usize)).copied()
    }
}

/// Parses `NAME(1, , "text")`, as in a program.
pub(crate) fn call(text: &str) -> (String, Vec<Option<String>>) {
    let (name, rest) = text.split_once('(').unwrap_or((text, ")"));
    let inner = rest.trim_end_matches(')');
    let arguments = if inner.is_empty() { Vec::new() } else { inner.split(',').map(|a| a.trim().to_owned()).collect() };
    (name.to_owned(), arguments.into_iter().map(|a: String| (!a.is_empty()).then_some(a)).collect())
}

/// Runs a call, such as `CYCLE81(10,0,2,-20)`, over a host.
pub(crate) fn run(library: &CycleLibrary, text: &str, host: &mut Recorder) -> Result<(), CycleRunError> {
    let (name, arguments) = call(text);
    let arguments: Vec<Argument<'_>> = arguments
        .iter()
        .map(|argument| match argument.as_deref() {
            None => Argument::Missing,
            Some(text) if text.starts_with('"') => Argument::Text(text.trim_matches('"')),
            Some(number) => Argument::Number(number.parse().expect("a number")),
        })
        .collect();
    let cycle = library.find(&name).unwrap_or_else(|| panic!("there is no {name}"));
    let limits = VmLimits { steps: 200_000, blocks: 100_000, ..VmLimits::default() };
    Vm::new(limits).run(library, cycle, &arguments, host)
}

/// Returns the blocks of a call of a shipped cycle from the usual state, which must run without an alarm.
pub(crate) fn blocks(text: &str) -> Vec<String> {
    blocks_from(text, Recorder::default()).lines
}

/// Returns the host after a call from another state.
pub(crate) fn blocks_from(text: &str, mut host: Recorder) -> Recorder {
    let done = run(&CycleLibrary::shipped(), text, &mut host);
    assert_eq!(done, Ok(()), "{text}");
    host
}

/// Returns the alarm of a call of a shipped cycle; nothing has moved.
pub(crate) fn alarm(text: &str) -> u32 {
    alarm_from(text, Recorder::default())
}

/// Returns the alarm of a call from another state.
pub(crate) fn alarm_from(text: &str, mut host: Recorder) -> u32 {
    let alarm = halted(run(&CycleLibrary::shipped(), text, &mut host));
    assert!(host.lines.is_empty(), "{text} has moved: {:?}", host.lines);
    alarm.number.unwrap_or_else(|| panic!("{text}: {alarm:?}"))
}

/// Returns the alarm of a run.
pub(crate) fn halted(done: Result<(), CycleRunError>) -> Alarm {
    match done {
        Err(CycleRunError::Alarm(alarm)) => *alarm,
        other => panic!("no alarm: {other:?}"),
    }
}
