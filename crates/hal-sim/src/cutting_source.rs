//! The simulated source of a cutter: its arc strikes over metal only, may fail to start, and may go out (CUT, section
//! 8).
//!
//! Invariant: it depends on the card's pins and on its seed alone; metal that was cut stays cut.

use crate::arc_voltage::ArcVoltageSettings;
use crate::cut_sheet::CutSheet;
use crate::random::{Chance, Random};

/// Length of a cell of the sheet, in nanometres.
const CELL_NM: f64 = 50_000.0;
/// Longest step, in cells, between two samples of a stroke.
const STEP_CELLS: f64 = 0.5;

/// Distances ahead of the torch at which a kerf shows in the voltage, in cells.
const KERF_AHEAD_CELLS: std::ops::RangeInclusive<u8> = 5..=25;
/// Distance at which an arc reaches metal around a hole, in cells.
const REACH_CELLS: i32 = 10;
/// Number of cut cells within that distance up to which the place is a hole, and not a kerf: 0.15 mm.
const HOLE_CELLS: usize = 3;

/// How a source fails.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceFaults {
    /// Probability that a start strikes no arc.
    pub no_start: Chance,
    /// Lengths of the cut, in µm since the beginning, at which the arc goes out, in ascending order.
    pub lose_at_um: Vec<u64>,
    /// Mean number of losses in a kilometre of cut.
    pub losses_per_km: u32,
    /// Mean number of flickers of the contact in a kilometre of cut; the arc burns on.
    pub flickers_per_km: u32,
    /// Duration of a flicker, in microseconds.
    pub flicker_us: u32,
    /// Whether the contact is welded: the input is always active.
    pub is_welded: bool,
    /// Whether the arc burns on after it was switched off.
    pub stays_on: bool,
    /// Shortest and longest time from the switching to the arc, in microseconds.
    pub delay_us: [u32; 2],
    /// Height of the sheet over the one that the machine file expects, in µm; `None` without a sheet to be sensed.
    pub sheet_um: Option<i32>,
    /// How far the sheet rises within half a metre of the first axis, in µm.
    pub warp_um: i32,
    /// Whether ohmic contacts never close.
    pub no_ohmic: bool,
    /// Seed of everything that is random.
    pub seed: u64,
}

impl Default for SourceFaults {
    fn default() -> Self {
        Self {
            no_start: Chance::NEVER,
            lose_at_um: Vec::new(),
            losses_per_km: 0,
            flickers_per_km: 0,
            flicker_us: 5_000,
            is_welded: false,
            stays_on: false,
            delay_us: [50_000; 2],
            sheet_um: Some(0),
            warp_um: 0,
            no_ohmic: false,
            seed: 0,
        }
    }
}

/// A source on a cutting output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceSettings {
    /// The output that lights it.
    pub channel: u8,
    /// The input that says that it burns or flows.
    pub input: u8,
    /// Length of a pulse of the first two axes, in nanometres.
    pub nm_per_pulse: [u32; 2],
    /// Whether it strikes only where metal is in reach.
    pub needs_metal: bool,
    /// How the voltage of its arc is read, if it is.
    pub voltage: Option<ArcVoltageSettings>,
    /// How it fails.
    pub faults: SourceFaults,
}

const ITEMS: &str = "seed=N, no-start=P, lose-per-m=N, lose@MM, flicker-per-m=N, flicker-ms=N, delay-ms=N, welded, \
    stays-on, sheet=MM, warp=MM, no-sheet, no-ohmic; P is a probability, MM a length of cut or a height";

/// Parses the faults of a source: `no-start=0.1,lose@120.5,seed=7`.
///
/// # Errors
/// The item that is not valid, and a list of the valid ones.
pub fn source_faults(text: &str) -> Result<SourceFaults, String> {
    let mut faults = SourceFaults::default();
    for item in text.split(',').map(str::trim).filter(|item| !item.is_empty()) {
        apply(item, &mut faults).ok_or_else(|| format!("`{item}` is not a fault of a source; valid are {ITEMS}"))?;
    }
    faults.lose_at_um.sort_unstable();
    Ok(faults)
}

fn apply(item: &str, faults: &mut SourceFaults) -> Option<()> {
    let number = |text: &str, most: f64| text.parse::<f64>().ok().filter(|value| (0.0..=most).contains(value));
    if let Some(mm) = item.strip_prefix("lose@") {
        faults.lose_at_um.push((number(mm, 1e9)? * 1000.0) as u64);
        return Some(());
    }
    match item.split_once('=') {
        None if item == "welded" => faults.is_welded = true,
        None if item == "stays-on" => faults.stays_on = true,
        None if item == "no-sheet" => faults.sheet_um = None,
        None if item == "no-ohmic" => faults.no_ohmic = true,
        Some(("sheet", value)) => {
            let mm: f64 = value.parse().ok().filter(|mm: &f64| mm.abs() <= 1000.0)?;
            faults.sheet_um = Some((mm * 1000.0).round() as i32);
        }
        Some(("warp", value)) => {
            let mm: f64 = value.parse().ok().filter(|mm: &f64| mm.abs() <= 100.0)?;
            faults.warp_um = (mm * 1000.0).round() as i32;
        }
        Some(("seed", value)) => faults.seed = value.parse().ok()?,
        Some(("no-start", value)) => faults.no_start = Chance::new(value.parse().ok()?)?,
        Some(("lose-per-m", value)) => faults.losses_per_km = (number(value, 1e6)? * 1000.0) as u32,
        Some(("flicker-per-m", value)) => faults.flickers_per_km = (number(value, 1e6)? * 1000.0) as u32,
        Some(("flicker-ms", value)) => faults.flicker_us = (number(value, 1e4)? * 1000.0) as u32,
        Some(("delay-ms", value)) => faults.delay_us = [(number(value, 1e5)? * 1000.0) as u32; 2],
        _ => return None,
    }
    Some(())
}

/// State of the arc, or of the jet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ArcState {
    Off,
    /// Lit, and strikes from this time on where there is metal.
    Pilot {
        from_us: u64,
    },
    /// Lit without any effect: the start has failed, or the arc went out.
    Dead,
    Burning,
}

/// A source, and the sheet under it.
#[derive(Clone, Debug)]
pub(crate) struct CuttingSource {
    settings: SourceSettings,
    random: Random,
    state: ArcState,
    /// Last position, in cells.
    at: Option<[f64; 2]>,
    /// Length that was cut, in micrometres.
    cut_um: f64,
    next_loss_um: f64,
    next_flicker_um: f64,
    flickers_until_us: u64,
    sheet: CutSheet,
    /// Speed in mm/s, the time of the last position, and the direction of motion in cells.
    speed: (f64, u64, [f64; 2]),
    noise: Random,
}

impl CuttingSource {
    pub(crate) fn new(settings: &SourceSettings) -> Self {
        let mut source = Self {
            settings: settings.clone(),
            random: Random::new(settings.faults.seed),
            state: ArcState::Off,
            at: None,
            cut_um: 0.0,
            next_loss_um: 0.0,
            next_flicker_um: 0.0,
            flickers_until_us: 0,
            sheet: CutSheet::default(),
            speed: (0.0, 0, [0.0; 2]),
            noise: Random::new(settings.faults.seed ^ 0xA5C),
        };
        source.next_loss_um = source.next_at(settings.faults.losses_per_km);
        source.next_flicker_um = source.next_at(settings.faults.flickers_per_km);
        source
    }

    /// Length of cut at which the next of these random events happens, exponentially distributed.
    fn next_at(&mut self, per_km: u32) -> f64 {
        if per_km == 0 {
            return f64::INFINITY;
        }
        let share = (self.random.next() >> 11) as f64 / (1u64 << 53) as f64;
        self.cut_um - (1.0 - share).ln() * 1e9 / f64::from(per_km)
    }

    pub(crate) fn channel(&self) -> u8 {
        self.settings.channel
    }

    pub(crate) fn input(&self) -> u8 {
        self.settings.input
    }

    /// Applies the output at `now_us`.
    pub(crate) fn switch(&mut self, now_us: u64, is_on: bool) {
        match (is_on, self.state) {
            (true, ArcState::Off) => {
                let [shortest, longest] = self.settings.faults.delay_us;
                let delay_us = shortest + self.random.up_to(longest.saturating_sub(shortest));
                let fails = self.settings.faults.no_start.draw(&mut self.random);
                let from_us = now_us + u64::from(delay_us);
                self.state = if fails { ArcState::Dead } else { ArcState::Pilot { from_us } };
            }
            (false, ArcState::Burning) if self.settings.faults.stays_on => {}
            (false, _) => self.state = ArcState::Off,
            (true, _) => {}
        }
    }

    /// Moves the source to the position of its axes at `now_us`, and returns whether its contact is closed.
    pub(crate) fn advance(&mut self, now_us: u64, positions: &[i64]) -> bool {
        let mut to = [0.0; 2];
        for ((cell, &position), &nm) in to.iter_mut().zip(positions).zip(&self.settings.nm_per_pulse) {
            *cell = position as f64 * f64::from(nm) / CELL_NM;
        }
        let from = self.at.replace(to).unwrap_or(to);
        self.record_speed(now_us, from, to);
        if let ArcState::Pilot { from_us } = self.state
            && now_us >= from_us
            && (!self.settings.needs_metal || self.reaches_metal(cell_at(to)))
        {
            self.state = ArcState::Burning;
            self.cut(cell_at(to));
        } else if self.state == ArcState::Burning {
            self.cut_from(from, to);
        }
        if self.cut_um >= self.next_flicker_um {
            self.flickers_until_us = now_us + u64::from(self.settings.faults.flicker_us);
            self.next_flicker_um = self.next_at(self.settings.faults.flickers_per_km);
        }
        self.settings.faults.is_welded || self.state == ArcState::Burning && now_us >= self.flickers_until_us
    }

    fn record_speed(&mut self, now_us: u64, from: [f64; 2], to: [f64; 2]) {
        let way = [to[0] - from[0], to[1] - from[1]];
        let cells = way[0].hypot(way[1]);
        let seconds = now_us.saturating_sub(self.speed.1).max(1) as f64 / 1e6;
        let ahead = if cells > 0.0 { way.map(|part| part / cells) } else { self.speed.2 };
        self.speed = (cells * CELL_NM / 1e6 / seconds, now_us, ahead);
    }

    /// The analog input of the arc's voltage, and its reading with the axes at `positions`.
    pub(crate) fn voltage(&mut self, positions: &[i64]) -> Option<(u8, u16)> {
        let of = self.settings.voltage?;
        let (speed, _, [x, y]) = self.speed;
        if self.state != ArcState::Burning {
            return Some((of.input, of.dark_reading()));
        }
        let is_over_kerf = self.at.is_some_and(|at| {
            let mut ahead = KERF_AHEAD_CELLS.map(f64::from);
            ahead.any(|cells| self.sheet.is_cut(cell_at([at[0] + cells * x, at[1] + cells * y])))
        });
        Some((of.input, of.reading(positions, speed, is_over_kerf, &mut self.noise)))
    }

    /// Whether an arc strikes here: over metal, and in a hole that was pierced without being cut on, because there is
    /// metal around it.
    fn reaches_metal(&self, [x, y]: [i32; 2]) -> bool {
        let around = |at: i32| at - REACH_CELLS..=at + REACH_CELLS;
        let cut = || around(x).flat_map(|x| around(y).map(move |y| [x, y])).filter(|&cell| self.sheet.is_cut(cell));
        !self.sheet.is_cut([x, y]) || cut().take(HOLE_CELLS + 1).count() <= HOLE_CELLS
    }

    /// Cuts a cell of the sheet, which only an arc needs to know.
    fn cut(&mut self, cell: [i32; 2]) {
        if self.settings.needs_metal {
            self.sheet.cut(cell);
        }
    }

    /// Cuts a straight stroke. The arc may go out in it.
    fn cut_from(&mut self, from: [f64; 2], to: [f64; 2]) {
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        let steps = (length / STEP_CELLS).ceil().max(1.0) as u32;
        let step_um = length / f64::from(steps) * CELL_NM / 1000.0;
        for step in 1..=steps {
            let share = f64::from(step) / f64::from(steps);
            let at = [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
            self.cut_um += step_um;
            let lost_here = self.settings.faults.lose_at_um.first().is_some_and(|&um| self.cut_um >= um as f64);
            if lost_here || self.cut_um >= self.next_loss_um {
                if lost_here {
                    self.settings.faults.lose_at_um.remove(0);
                } else {
                    self.next_loss_um = self.next_at(self.settings.faults.losses_per_km);
                }
                self.state = ArcState::Dead;
                return;
            }
            self.cut(cell_at(at));
        }
    }
}

fn cell_at(at: [f64; 2]) -> [i32; 2] {
    at.map(|cell| cell.floor() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A micrometre a pulse; the first axis moves by `um_per_ms` in each period of 1 ms.
    fn source(faults: &str) -> CuttingSource {
        let faults = source_faults(faults).expect("valid");
        let settings =
            SourceSettings { channel: 64, input: 5, nm_per_pulse: [1000; 2], needs_metal: true, voltage: None, faults };
        CuttingSource::new(&settings)
    }

    /// Times in ms at which the contact changes, while the source moves from `from_um` at 10 µm/ms.
    fn changes(source: &mut CuttingSource, from_ms: u64, from_um: i64, periods: u64) -> Vec<u64> {
        let (mut was, mut times) = (false, Vec::new());
        for ms in from_ms..from_ms + periods {
            let is = source.advance(ms * 1000, &[from_um + 10 * (ms - from_ms) as i64, 0]);
            if is != was {
                times.push(ms - from_ms);
                was = is;
            }
        }
        times
    }

    #[test]
    fn it_strikes_after_its_delay_and_goes_out_where_it_is_told() {
        let mut source = source("delay-ms=20,lose@1.5");
        source.switch(0, true);
        assert_eq!(changes(&mut source, 0, 0, 400), [20, 170]);
        assert!(source.sheet.count() >= 29);
        // once out, it stays out until it is switched off and on again
        source.switch(400_000, true);
        assert!(changes(&mut source, 400, 5000, 100).is_empty());
        source.switch(500_000, false);
        source.switch(501_000, true);
        assert_eq!(changes(&mut source, 501, 6000, 100), [20]);
    }

    #[test]
    fn it_does_not_strike_in_a_kerf_and_strikes_where_metal_begins() {
        let mut source = source("delay-ms=0,lose@1");
        source.switch(0, true);
        changes(&mut source, 0, 0, 200);
        source.switch(200_000, false);
        // back to 0.5 mm and along the kerf: it strikes behind 1 mm
        source.switch(201_000, true);
        let struck = changes(&mut source, 201, 500, 200);
        assert!((45..=55).contains(&struck[0]), "{struck:?}");
    }

    #[test]
    fn it_strikes_again_in_a_hole_that_was_only_pierced() {
        let mut source = source("delay-ms=0");
        source.switch(0, true);
        assert!((0..300).all(|ms| source.advance(ms * 1000, &[0, 0])));
        source.switch(300_000, false);
        assert!(!source.advance(300_000, &[0, 0]));
        source.switch(301_000, true);
        assert!(source.advance(301_000, &[0, 0]));
        changes(&mut source, 302, 0, 100);
        source.switch(500_000, false);
        source.switch(501_000, true);
        assert!(!source.advance(502_000, &[0, 0]), "a kerf begins here now");
    }

    #[test]
    fn starts_fail_as_often_as_is_told_and_flickers_pass() {
        let mut failing = source("no-start=0.5,delay-ms=0,seed=3");
        let mut struck = 0;
        for n in 0..1000u64 {
            failing.switch(n * 10_000, true);
            struck += u64::from(failing.advance(n * 10_000 + 1, &[n as i64 * 100, 0]));
            failing.switch(n * 10_000 + 5_000, false);
        }
        assert!((450..550).contains(&struck), "{struck}");
        let mut flickering = source("delay-ms=0,flicker-per-m=1000,flicker-ms=3,seed=3");
        flickering.switch(0, true);
        let changes = changes(&mut flickering, 0, 0, 10_000);
        assert!((100..300).contains(&changes.len()), "{}", changes.len());
        assert_eq!(flickering.state, ArcState::Burning);
    }

    #[test]
    fn a_welded_contact_and_a_source_that_stays_on() {
        let mut welded = source("welded");
        assert!(welded.advance(0, &[0, 0]));
        let mut stuck = source("stays-on,delay-ms=0");
        stuck.switch(0, true);
        assert!(stuck.advance(1, &[0, 0]));
        stuck.switch(10, false);
        assert!(stuck.advance(1_000_000, &[0, 0]));
    }

    #[test]
    fn what_is_not_a_fault_is_refused_with_the_item() {
        for bad in ["lose", "no-start=2", "lose@x", "seed=", "lose-per-m=-1", "delay-ms=1e9"] {
            assert!(source_faults(bad).expect_err(bad).contains(bad), "{bad}");
        }
    }
}
