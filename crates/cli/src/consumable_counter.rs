//! Counts the wear of the consumables while a job runs (CUT-62).
//!
//! Invariant: what was added to the file of the machine is not added again. A killed program loses at most the last
//! minute of it.

use std::collections::BTreeMap;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::{ContourStates, CutterState, EventKind, OperatorCommand, Telemetry};
use retrace_journal::{ConsumableFile, ConsumableSets, ConsumableWear};

/// Time between two changes of the file.
const SAVE_INTERVAL: Duration = Duration::from_secs(60);

/// A cutter.
#[derive(Debug)]
struct CountedCutter {
    name: String,
    fire: u8,
    has_proof: bool,
    /// Period in which it was switched on, while it is on.
    on_since: Option<u64>,
    /// Whether it was proven since it was switched on, or fires for a test.
    was_proven: bool,
    wear: ConsumableWear,
}

/// Counts the wear of a job.
#[derive(Debug)]
pub struct ConsumableCounter {
    file: ConsumableFile,
    cutters: Vec<CountedCutter>,
    contours: ContourStates,
    /// Length that is cut of all contours and is counted already, mm.
    counted_mm: f64,
    period: u64,
    period_s: f64,
    saved: Instant,
    /// The last change of the file; it returns the wear that could not be written.
    saving: Option<JoinHandle<BTreeMap<String, ConsumableWear>>>,
}

impl ConsumableCounter {
    /// Counts for this file; `None` where the machine has no cutter.
    pub fn new(file: ConsumableFile, machine: &MachineConfig) -> Option<Self> {
        let counted = machine.cutters.iter().map(|cutter| CountedCutter {
            name: cutter.name.clone(),
            fire: cutter.fire,
            has_proof: cutter.proof.is_some(),
            on_since: None,
            was_proven: false,
            wear: ConsumableWear::default(),
        });
        let cutters: Vec<_> = counted.collect();
        (!cutters.is_empty()).then(|| Self {
            file,
            cutters,
            contours: ContourStates::default(),
            counted_mm: 0.0,
            period: 0,
            period_s: machine.period_s(),
            saved: Instant::now(),
            saving: None,
        })
    }

    /// Applies a message of the job.
    pub fn observe<const A: usize>(&mut self, message: &Telemetry<A>) {
        self.contours.observe(message);
        match message {
            Telemetry::Period(period) => self.period = period.period,
            Telemetry::Output(change) => self.switched(change.channel, change.value != 0),
            Telemetry::Event(event) => match &event.kind {
                EventKind::CutterState { channel, state, .. } => {
                    let proves = matches!(state, CutterState::Piercing | CutterState::Cutting | CutterState::Test);
                    if let Some(cutter) = self.cutters.iter_mut().find(|cutter| cutter.fire == *channel) {
                        cutter.was_proven |= proves;
                    }
                }
                // What was cut before is counted already.
                EventKind::ContoursRestored(_) => self.counted_mm = self.contours.cut_mm(),
                EventKind::Operator(OperatorCommand::ConsumablesChanged) => self.begin(),
                _ => {}
            },
            _ => {}
        }
        if self.saved.elapsed() >= SAVE_INTERVAL && self.saving.as_ref().is_none_or(JoinHandle::is_finished) {
            self.saved = Instant::now();
            self.finish_saving();
            let (file, wear) = (self.file.clone(), self.take_wear());
            // The motion does not wait for a slow disk. What cannot be written is tried again with the next minute.
            self.saving = Some(std::thread::spawn(move || file.add(&wear).map_or(wear, |_| BTreeMap::new())));
        }
    }

    fn switched(&mut self, channel: u8, on: bool) {
        let (period, period_s) = (self.period, self.period_s);
        let Some(at) = self.cutters.iter().position(|cutter| cutter.fire == channel) else { return };
        let cut_mm = if on { 0.0 } else { self.contours.cut_mm() };
        let cutter = &mut self.cutters[at];
        match (on, cutter.on_since) {
            (true, None) => {
                cutter.on_since = Some(period);
                cutter.wear.starts += 1;
            }
            (false, Some(since)) => {
                cutter.on_since = None;
                cutter.wear.lit_s += period.saturating_sub(since) as f64 * period_s;
                cutter.wear.failed_starts += u64::from(cutter.has_proof && !cutter.was_proven);
                cutter.was_proven = false;
                cutter.wear.cut_m += (cut_mm - self.counted_mm).max(0.0) / 1000.0;
                self.counted_mm = cut_mm;
            }
            _ => {}
        }
    }

    /// The wear that is not in the file yet.
    fn take_wear(&mut self) -> BTreeMap<String, ConsumableWear> {
        self.cutters.iter_mut().map(|cutter| (cutter.name.clone(), std::mem::take(&mut cutter.wear))).collect()
    }

    /// The consumables are new.
    fn begin(&mut self) {
        self.finish_saving();
        let names: Vec<String> = self.take_wear().into_keys().collect();
        self.counted_mm = self.contours.cut_mm();
        for cutter in self.cutters.iter_mut().filter(|cutter| cutter.on_since.is_some()) {
            cutter.on_since = Some(self.period);
        }
        let file = self.file.clone();
        self.saving = Some(std::thread::spawn(move || {
            drop(file.begin(&names));
            BTreeMap::new()
        }));
    }

    fn finish_saving(&mut self) {
        if let Some(saving) = self.saving.take() {
            // A panic there has lost at most a minute of wear.
            let unwritten = saving.join().unwrap_or_default();
            for cutter in &mut self.cutters {
                if let Some(wear) = unwritten.get(&cutter.name) {
                    cutter.wear.add(wear);
                }
            }
        }
    }

    /// The end of the job: the sets with all that it has added.
    ///
    /// # Errors
    /// `E2105`: the file cannot be written.
    pub fn finish(mut self) -> Result<ConsumableSets, NumberedError> {
        let lit = self.cutters.iter().filter(|cutter| cutter.on_since.is_some());
        let lit: Vec<u8> = lit.map(|cutter| cutter.fire).collect();
        lit.into_iter().for_each(|channel| self.switched(channel, false));
        self.finish_saving();
        let wear = self.take_wear();
        self.file.add(&wear)
    }
}
