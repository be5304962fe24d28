//! The cutters of a machine: their outputs, how long they may be on while the machine is at rest, and their names
//! (CUT-1).
//!
//! Invariant: every cutting output belongs to exactly one cutter, and no channel has two uses.

use retrace_link::{CuttingChannel, CuttingSettings, InputWait, MAX_CUTTING_CHANNELS, MAX_PROOFS, channel};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::beam_power::BeamPowerConfig;
use crate::cutter_start::{CutterProof, CutterRestart, CutterStart};
use crate::height_control::HeightControlConfig;
use crate::jet_flow::JetFlow;
use crate::marker_start::MarkerStart;
use crate::numbered_error::NumberedError;
use crate::sheet_sensing::SheetSensing;
use crate::value_range::within;

/// Highest number of a spindle behind `$`.
const MAX_SPINDLE: u8 = 7;

/// Default of `pulse_s` (CUT-9).
const USUAL_PULSE_S: f64 = 1.0;
/// Default of `dwell_lit_s` (CUT-6).
const USUAL_DWELL_LIT_S: f64 = 30.0;

/// Kind of a cutter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CutterKind {
    /// A plasma or oxy-fuel torch: off as soon as the machine is at rest.
    Torch,
    /// A water jet.
    Jet,
    /// A laser beam: off as soon as the machine is at rest.
    Beam,
    /// A scribe, pen or punch, which does not cut.
    Marker,
    /// A milling or engraving spindle: keeps turning in a hold (CUT-10).
    Spindle,
}

impl CutterKind {
    /// Whether it must be off whenever the machine does not move along a cut.
    #[must_use]
    pub const fn cuts_at_rest(self) -> bool {
        matches!(self, Self::Torch | Self::Jet | Self::Beam)
    }

    /// Default time for which it may be on while the machine is at rest, ms (CUT-6).
    const fn usual_standing_ms(self) -> f64 {
        match self {
            Self::Jet => 500.0,
            _ => 0.0,
        }
    }

    /// Default step of single block while it is on.
    const fn usual_step(self) -> SingleBlockStep {
        match self {
            Self::Torch | Self::Jet => SingleBlockStep::Contour,
            _ => SingleBlockStep::Block,
        }
    }
}

/// Treatment of Z words of a program (CUT-16).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ZWords {
    /// The cut cycle rules the height; the words of straight moves and arcs have no effect.
    Ignored,
    /// The program rules the height.
    Obeyed,
}

/// What one step of single block is while a cutter is on (CUT-11).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum SingleBlockStep {
    /// The whole contour, with the code that lights the cutter and the one that switches it off: each stop inside would
    /// cost a pierce.
    Contour,
    /// A block.
    Block,
}

/// A cutter, `[[cutter]]`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct CutterSection {
    /// Name at the screen and in messages.
    name: String,
    /// Kind of the cutter.
    kind: CutterKind,
    /// Output that lights, opens or starts the cutter; 64 is the output of M3.
    #[schemars(range(max = 64))]
    fire: u8,
    /// Output that arms the cutter.
    #[schemars(range(max = 64))]
    arm: Option<u8>,
    /// Output of the assist gas.
    #[schemars(range(max = 64))]
    assist: Option<u8>,
    /// Output of the abrasive.
    #[schemars(range(max = 64))]
    abrasive: Option<u8>,
    /// Flow of the abrasive in g/min, where no material states one. `retrace check` counts it; it has no other effect.
    #[schemars(range(min = 0.0, max = 10_000.0))]
    abrasive_g_per_min: Option<f64>,
    /// Output that raises the pressure of a jet; 0 is low pressure.
    #[schemars(range(max = 64))]
    pressure: Option<u8>,
    /// Number behind `$` with which M3, M4 and M5 address the cutter; 0 by default where `fire` is 64.
    #[schemars(range(max = 7))]
    spindle: Option<u8>,
    /// File of the material table, relative to the machine file. One cutter at most has a table.
    materials: Option<String>,
    /// Z words of a program: obeyed, or ignored because the cut cycle rules the height. Ignored by default for a torch
    /// or a beam with a material table.
    z_words: Option<ZWords>,
    /// Finding the sheet before a pierce, and the height between contours.
    #[serde(default)]
    sense: SheetSensing,
    /// Control of the height while the cutter cuts.
    height: Option<HeightControlConfig>,
    /// Maximum time on while the machine is at rest, in ms.
    #[schemars(range(min = 0.0, max = 5000.0))]
    standing_ms: Option<f64>,
    /// Longest dwell (G4) of a program with the cutter on, in s.
    #[schemars(range(min = 0.0, max = 600.0))]
    dwell_lit_s: Option<f64>,
    /// Whether the operator can open a jet while the path is retraced.
    #[serde(default)]
    retrace_cut: bool,
    /// Whether the cutter may be on in a rapid move.
    #[serde(default)]
    rapid_lit: bool,
    /// One step of single block while the cutter is on: the contour by default for a torch or a jet.
    single_block: Option<SingleBlockStep>,
    /// Input that proves that the cutter burns or flows.
    ok: Option<CutterProof>,
    /// Length of a test pulse, in s.
    #[schemars(range(min = 0.05, max = 3.0))]
    pulse_s: Option<f64>,
    /// Inputs that show that the tool has touched something, such as the breakaway of a torch.
    #[serde(default)]
    collision: Vec<u8>,
    /// How the cutter starts.
    start: Option<CutterStart>,
    /// How the cutter starts again where a cut was interrupted.
    restart: Option<CutterRestart>,
    /// Order of water and abrasive of a jet.
    jet: Option<JetFlow>,
    /// Power output of a beam.
    power: Option<BeamPowerConfig>,
    /// Order of arming and marking of a scribe.
    marker: Option<MarkerStart>,
}

/// A cutter, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct CutterConfig {
    /// Name, for the screen and for messages.
    pub name: String,
    /// Kind of cutter.
    pub kind: CutterKind,
    /// Channel that lights, opens or starts it; 64 is that of M3, M4 and M5.
    pub fire: u8,
    /// Channel that arms it, if any.
    pub arm: Option<u8>,
    /// Channel of its assist gas, if any.
    pub assist: Option<u8>,
    /// Channel of its abrasive, if any.
    pub abrasive: Option<u8>,
    /// Flow of its abrasive, g/min, where no material states one.
    pub abrasive_g_per_min: Option<f64>,
    /// Channel that raises its pressure, if any.
    pub pressure: Option<u8>,
    /// Number behind `$` in M3, M4 and M5, if it has one.
    pub spindle: Option<u8>,
    /// File of its material table as written, relative to the machine file; if any.
    pub materials: Option<String>,
    /// Treatment of a program's Z words.
    pub z_words: ZWords,
    /// How it finds the sheet, and its height between contours.
    pub sense: SheetSensing,
    /// How its height is controlled while it cuts, if it is.
    pub height: Option<HeightControlConfig>,
    /// Time for which it may be on while the machine is at rest, ms. Not used for markers and spindles.
    pub standing_ms: f64,
    /// Longest dwell (G4) of a program while it is on, s. Not used for markers and spindles.
    pub dwell_lit_s: f64,
    /// Whether it may be on while the path is retraced. Jets only.
    pub retrace_cut: bool,
    /// Whether it may be on during a rapid move.
    pub rapid_lit: bool,
    /// One step of single block while it is on.
    pub single_block: SingleBlockStep,
    /// Input that proves that it burns or flows, if any; without one its loss is not watched.
    pub proof: Option<CutterProof>,
    /// Length of a test pulse, s (CUT-9).
    pub pulse_s: f64,
    /// Inputs that show that the tool has touched something (CUT-34).
    pub collision: Vec<u8>,
    /// How it starts.
    pub start: CutterStart,
    /// How it starts again where a cut was interrupted.
    pub restart: CutterRestart,
    /// Order of water and abrasive, where the code that opens a jet switches both.
    pub jet: Option<JetFlow>,
    /// Its power output, if it is a beam with one.
    pub power: Option<BeamPowerConfig>,
    /// Order of arming and marking, where the code that switches it on switches both.
    pub marker: Option<MarkerStart>,
}

impl CutterSection {
    /// The cutter with its defaults; its figures are in their ranges.
    fn checked(self, standing_ms: f64) -> CutterConfig {
        let Self { name, kind, fire, arm, assist, abrasive, pressure, materials, retrace_cut, rapid_lit, .. } = self;
        let rules_height = matches!(kind, CutterKind::Torch | CutterKind::Beam) && materials.is_some();
        CutterConfig {
            name,
            kind,
            fire,
            arm,
            assist,
            abrasive,
            abrasive_g_per_min: self.abrasive_g_per_min,
            pressure,
            spindle: self.spindle.or((fire == channel::SPINDLE).then_some(0)),
            materials,
            z_words: self.z_words.unwrap_or(if rules_height { ZWords::Ignored } else { ZWords::Obeyed }),
            sense: self.sense,
            height: self.height,
            standing_ms,
            dwell_lit_s: self.dwell_lit_s.unwrap_or(USUAL_DWELL_LIT_S),
            retrace_cut,
            rapid_lit,
            single_block: self.single_block.unwrap_or(kind.usual_step()),
            proof: self.ok,
            pulse_s: self.pulse_s.unwrap_or(USUAL_PULSE_S),
            collision: self.collision,
            start: self.start.unwrap_or_default(),
            restart: self.restart.unwrap_or_default(),
            jet: self.jet,
            power: self.power,
            marker: self.marker,
        }
    }
}

impl CutterConfig {
    /// Cutter of a channel that `cutting_outputs` names and no table describes: a torch on M3's channel, else a jet.
    fn of_channel(fire: u8) -> Self {
        let (name, kind) = match fire {
            channel::SPINDLE => ("torch".into(), CutterKind::Torch),
            _ => (format!("output {fire}"), CutterKind::Jet),
        };
        let standing_ms = kind.usual_standing_ms();
        let spindle = (fire == channel::SPINDLE).then_some(0);
        Self {
            name,
            kind,
            fire,
            arm: None,
            assist: None,
            abrasive: None,
            abrasive_g_per_min: None,
            pressure: None,
            spindle,
            materials: None,
            z_words: ZWords::Obeyed,
            sense: SheetSensing::default(),
            height: None,
            standing_ms,
            dwell_lit_s: USUAL_DWELL_LIT_S,
            retrace_cut: false,
            rapid_lit: false,
            single_block: kind.usual_step(),
            proof: None,
            pulse_s: USUAL_PULSE_S,
            collision: Vec::new(),
            start: CutterStart::default(),
            restart: CutterRestart::default(),
            jet: None,
            power: None,
            marker: None,
        }
    }

    /// What switching it on takes after its code, with this pierce delay in s: a duration in control periods, and the
    /// input to wait for. A jet whose abrasive is switched behind the water pierces behind the abrasive.
    #[must_use]
    pub fn start_of_cut(&self, pierce_s: f64, period_us: u32, is_unwatched: bool) -> (u32, Option<InputWait>) {
        let pierce_s = self.follows_water().unwrap_or(pierce_s);
        match self.proof.filter(|_| !is_unwatched) {
            Some(proof) => (0, Some(proof.start_wait(&self.start, pierce_s, period_us))),
            None => ((pierce_s * 1e6 / f64::from(period_us)).round() as u32, None),
        }
    }

    /// Time in s from the water of a jet to its abrasive, where that is switched behind the water.
    #[must_use]
    pub fn follows_water(&self) -> Option<f64> {
        self.jet.filter(|jet| self.abrasive.is_some() && jet.abrasive_lead_s == 0.0).map(|jet| jet.abrasive_delay_s)
    }

    /// The input that switching it off waits for.
    #[must_use]
    pub fn end_of_cut(&self, period_us: u32) -> Option<InputWait> {
        self.proof.as_ref().and_then(|proof| proof.stop_wait(period_us))
    }

    /// Whether it starts in motion where an interrupted cut is continued: a torch, as no arc strikes over a kerf, whose
    /// input tells when the arc meets metal (CUT-38).
    #[must_use]
    pub fn starts_in_motion(&self) -> bool {
        self.kind == CutterKind::Torch && self.proof.is_some()
    }

    /// Length in mm before the end of an interrupted cut from which it is continued.
    #[must_use]
    pub fn run_in_mm(&self) -> f64 {
        if self.starts_in_motion() { self.restart.run_in_mm } else { self.restart.overlap_mm }
    }

    /// Length in mm of a kerf inside a contour over which it stays on to the next gap: none for a torch, whose arc goes
    /// out there (CUT-41).
    #[must_use]
    pub fn bridge_mm(&self) -> f64 {
        if self.kind == CutterKind::Torch { 0.0 } else { self.restart.bridge_mm }
    }

    /// Its channels other than `fire`, with their purpose.
    pub(crate) fn auxiliaries(&self) -> impl Iterator<Item = (u8, &'static str)> {
        let flows = [(self.abrasive, "abrasive"), (self.pressure, "pressure")];
        let enable = self.height.and_then(|height| height.enable);
        let all = [(self.arm, "arm"), (self.assist, "assist"), (enable, "height enable")];
        all.into_iter().chain(flows).filter_map(|(channel, what)| channel.map(|channel| (channel, what)))
    }
}

/// Checks that no `[code.…]` table describes the start of a cutter: its `start` does.
///
/// # Errors
/// `E2112`
pub(crate) fn no_code_starts_a_cutter<'c>(
    written: &[CutterSection],
    mut codes: impl Iterator<Item = &'c String>,
) -> Result<(), NumberedError> {
    let on_spindle = |cutter: &&CutterSection| cutter.fire == channel::SPINDLE && cutter.kind.cuts_at_rest();
    let Some(cutter) = written.iter().find(on_spindle) else { return Ok(()) };
    match codes.find(|code| code.eq_ignore_ascii_case("M3") || code.eq_ignore_ascii_case("M4")) {
        None => Ok(()),
        Some(code) => {
            let what = format!("[code.{code}] beside [[cutter]] {}, which {code} switches on", cutter.name);
            let remedy = "move the delay to `start = { pierce_s = 0.4 }` and the input to `ok = { input = 5 }` of the \
                cutter";
            Err(NumberedError::new("E2112", what, remedy))
        }
    }
}

/// The cutters of a machine file, and those of `cutting_outputs` that have no table.
pub(crate) fn checked(written: Vec<CutterSection>, cutting_outputs: &[u8]) -> Result<Vec<CutterConfig>, NumberedError> {
    let mut cutters: Vec<CutterConfig> = Vec::new();
    for cutter in written {
        let refuse = |what: &str, remedy: &str| {
            Err(NumberedError::new("E2112", format!("[[cutter]] {}: {what}", cutter.name), remedy.to_owned()))
        };
        if cutter.name.is_empty() || cutter.name.chars().any(char::is_control) {
            return refuse("the name is empty or has control characters", "a name such as \"torch\"");
        }
        if cutter.retrace_cut && cutter.kind != CutterKind::Jet && cutter.power.is_none() {
            return refuse(
                "retrace_cut = true",
                "only a jet, or a beam with `power`, can be on while the path is retraced",
            );
        }
        if let Some(power) = cutter.power {
            power.check(&cutter.name)?;
            if cutter.kind != CutterKind::Beam || cutter.fire != channel::SPINDLE {
                return refuse("`power` is of a beam that M3 and M4 light", "kind = \"beam\" and fire = 64");
            }
        }
        let standing_ms = cutter.standing_ms.unwrap_or(cutter.kind.usual_standing_ms());
        within(&format!("cutter {}: standing_ms", cutter.name), standing_ms, 0.0, 5000.0)?;
        let dwell_lit_s = cutter.dwell_lit_s.unwrap_or(USUAL_DWELL_LIT_S);
        within(&format!("cutter {}: dwell_lit_s", cutter.name), dwell_lit_s, 0.0, 600.0)?;
        let pulse_s = cutter.pulse_s.unwrap_or(USUAL_PULSE_S);
        within(&format!("cutter {}: pulse_s", cutter.name), pulse_s, 0.05, 3.0)?;
        let has_start = cutter.ok.is_some() || cutter.start.is_some() || cutter.restart.is_some();
        if has_start && !cutter.kind.cuts_at_rest() {
            return refuse(
                "`ok`, `start` and `restart` are of torches, jets and beams",
                "write the delay and the input of M3 under [code.M3]",
            );
        }
        if cutter.pulse_s.is_some() && !cutter.kind.cuts_at_rest() {
            return refuse("`pulse_s` is of torches, jets and beams", "remove it");
        }
        if cutter.single_block.is_some() && !cutter.kind.cuts_at_rest() {
            return refuse("`single_block` is of torches, jets and beams", "remove it: a step is a block");
        }
        cutter.start.map_or(Ok(()), |start| start.check(&cutter.name))?;
        cutter.restart.map_or(Ok(()), |restart| restart.check(&cutter.name))?;
        cutter.ok.map_or(Ok(()), |proof| proof.check(&cutter.name))?;
        cutter.sense.check(&cutter.name)?;
        cutter.height.map_or(Ok(()), |height| height.check(&cutter.name))?;
        if let Some(flow) = cutter.abrasive_g_per_min {
            within(&format!("cutter {}: abrasive_g_per_min", cutter.name), flow, 0.0, 10_000.0)?;
            if cutter.abrasive.is_none() {
                return refuse("abrasive_g_per_min without `abrasive`", "the output of the abrasive");
            }
        }
        if cutter.spindle.is_some_and(|number| number > MAX_SPINDLE) {
            return refuse("there is no such spindle", "a number from 0 to 7, as in M3 $1");
        }
        if cutter.materials.as_ref().is_some_and(|file| file.trim().is_empty()) {
            return refuse("materials is empty", "the name of a file, such as \"materials.toml\"");
        }
        if let Some(marker) = cutter.marker {
            marker.check(&cutter.name)?;
            if cutter.kind != CutterKind::Marker || cutter.arm.is_none() {
                return refuse("`marker` without `arm`", "kind = \"marker\" and the output that arms it");
            }
        }
        if let Some(jet) = cutter.jet {
            jet.check(&cutter.name)?;
            let is_jet = cutter.kind == CutterKind::Jet;
            if let Some((what, remedy)) = jet.doubt(is_jet, cutter.abrasive.is_some(), cutter.pressure.is_some()) {
                return refuse(what, remedy);
            }
            if cutter.spindle.is_none() && cutter.fire != channel::SPINDLE {
                return refuse("`jet` without `spindle`", "the number behind $ with which M3 opens the jet");
            }
            if jet.abrasive_lag_mm > 0.0 && cutter.materials.is_none() {
                return refuse("jet.abrasive_lag_mm without a material table", "name the table under `materials`");
            }
        }
        cutters.push(cutter.checked(standing_ms));
    }
    for &fire in cutting_outputs {
        if !cutters.iter().any(|cutter| cutter.fire == fire) {
            cutters.push(CutterConfig::of_channel(fire));
        }
    }
    unique(&cutters)?;
    let channels: usize = cutters.iter().map(|cutter| 1 + cutter.auxiliaries().count()).sum();
    if channels > MAX_CUTTING_CHANNELS {
        let what = format!("the cutters have {channels} channels together");
        return Err(NumberedError::new("E2112", what, format!("at most {MAX_CUTTING_CHANNELS} channels")));
    }
    if cutters.iter().filter(|cutter| cutter.proof.is_some()).count() > MAX_PROOFS {
        let what = "more cutters have an input `ok` than the settings of a card hold: one";
        return Err(NumberedError::new("E2112", what, "leave `ok` out of the others: they run by time"));
    }
    Ok(cutters)
}

/// Rejects a channel that two cutters use, or that does not exist, and duplicate names.
fn unique(cutters: &[CutterConfig]) -> Result<(), NumberedError> {
    let mut used: Vec<(u8, &str)> = Vec::new();
    for (at, cutter) in cutters.iter().enumerate() {
        if cutters[..at].iter().any(|other| other.name == cutter.name) {
            let what = format!("[[cutter]] {}: the name is used twice", cutter.name);
            return Err(NumberedError::new("E2112", what, "each cutter needs a name of its own"));
        }
        let same = |other: &&CutterConfig| cutter.spindle.is_some() && other.spindle == cutter.spindle;
        if let Some(other) = cutters[..at].iter().find(same) {
            let what = format!("[[cutter]] {}: cutter {} has the same spindle", cutter.name, other.name);
            return Err(NumberedError::new("E2112", what, "each cutter needs a number of its own behind $"));
        }
        if cutter.materials.is_some() && cutters[..at].iter().any(|other| other.materials.is_some()) {
            let what = format!("[[cutter]] {}: another cutter has materials, too", cutter.name);
            return Err(NumberedError::new("E2112", what, "one material table serves the whole machine"));
        }
        let fire = std::iter::once((cutter.fire, "fire"));
        for (channel, what) in fire.chain(cutter.auxiliaries()) {
            let refuse = |why: String| {
                let remedy = "an output from 0 to 63, or 64 for the output of M3; each for one use only";
                Err(NumberedError::new(
                    "E2112",
                    format!("[[cutter]] {}: {what} = {channel}: {why}", cutter.name),
                    remedy,
                ))
            };
            if channel > channel::SPINDLE || (channel == channel::SPINDLE && what != "fire") {
                return refuse("there is no such output".into());
            }
            if let Some((_, other)) = used.iter().find(|(taken, _)| *taken == channel) {
                return refuse(format!("cutter {other} uses it too"));
            }
            used.push((channel, &cutter.name));
        }
    }
    Ok(())
}

/// The fire channels of torches, jets and beams.
pub(crate) fn cutting_outputs(cutters: &[CutterConfig]) -> Vec<u8> {
    cutters.iter().filter(|cutter| cutter.kind.cuts_at_rest()).map(|cutter| cutter.fire).collect()
}

/// Settings of the cutters for the card. `inhibit`: a dry run.
pub(crate) fn settings(cutters: &[CutterConfig], handover_ms: f64, period_us: u32, inhibit: bool) -> CuttingSettings {
    let period_ms = f64::from(period_us) / 1000.0;
    let periods = |ms: f64| (ms / period_ms).round().clamp(0.0, f64::from(u16::MAX)) as u16;
    let mut all = CuttingSettings { handover_periods: periods(handover_ms), inhibit, ..CuttingSettings::default() };
    let add = |all: &mut CuttingSettings, channel: u8, fires: bool, cutter: &CutterConfig| {
        if let Some(slot) = all.channels.get_mut(usize::from(all.count)) {
            let (standing_periods, lit_in_reverse) = (periods(cutter.standing_ms), cutter.retrace_cut);
            let proof = cutter.proof.filter(|_| fires).map(|proof| proof.settings(period_us));
            *slot = CuttingChannel { channel, fires, standing_periods, lit_in_reverse, proof };
            all.count += 1;
        }
    };
    for cutter in cutters {
        all.beam_power = all.beam_power.or(cutter.power.map(|power| power.settings(cutter.fire)));
        add(&mut all, cutter.fire, cutter.kind.cuts_at_rest(), cutter);
        for (channel, _) in cutter.auxiliaries() {
            add(&mut all, channel, false, cutter);
        }
    }
    all
}

/// Channels that a dry run keeps off (CUT-8).
pub(crate) fn inhibited(cutters: &[CutterConfig]) -> Vec<u8> {
    cutters.iter().flat_map(|cutter| std::iter::once(cutter.fire).chain(cutter.auxiliaries().map(|a| a.0))).collect()
}

/// Channels that a fault switches off by default: all those of torches, jets and beams, and of markers with `marker`,
/// and the output that orients the spindle.
pub(crate) fn off_at_fault(cutters: &[CutterConfig], orient_output: Option<u8>) -> Vec<u8> {
    let cut = cutters.iter().filter(|cutter| cutter.kind.cuts_at_rest() || cutter.marker.is_some());
    let cut = cut.flat_map(|cutter| std::iter::once(cutter.fire).chain(cutter.auxiliaries().map(|a| a.0)));
    cut.chain(orient_output).collect()
}

/// Name of a channel: the cutter's name for its fire channel, the name and purpose for the others.
pub(crate) fn name_of(cutters: &[CutterConfig], channel: u8) -> Option<String> {
    cutters.iter().find_map(|cutter| {
        if cutter.fire == channel {
            return Some(cutter.name.clone());
        }
        let (_, what) = cutter.auxiliaries().find(|(other, _)| *other == channel)?;
        Some(format!("{} {what}", cutter.name))
    })
}

#[cfg(test)]
mod tests {
    use crate::MachineConfig;

    #[test]
    fn what_a_cutter_cannot_have_is_refused() {
        let refused = |text: &str| match MachineConfig::parse(text, "m.toml") {
            Ok(_) => String::new(),
            Err(error) => format!("{error}"),
        };
        let cutter =
            |kind: &str, more: &str| format!("[[cutter]]\nname = \"tool\"\nkind = \"{kind}\"\nfire = 64\n{more}\n");
        for more in ["ok = { input = 5 }", "start = { pierce_s = 1 }", "restart = { run_in_mm = 3 }"] {
            assert_eq!(refused(&cutter("torch", more)), "");
            for kind in ["spindle", "marker"] {
                let error = refused(&cutter(kind, more));
                assert!(error.contains("E2112") && error.contains("torches, jets and beams"), "{kind} {more}: {error}");
            }
        }
        for (used_for, is_free) in [("plain", true), ("door", false), ("emergency-stop", false), ("probe", false)] {
            let input = format!("[[card.input]]\nnumber = 5\nuse = \"{used_for}\"\n");
            let error = refused(&(cutter("torch", "ok = { input = 5 }") + &input));
            assert_eq!(error.is_empty(), is_free, "{used_for}: {error}");
            assert!(is_free || error.contains("ok.input = 5"), "{error}");
        }
        for (number, why) in [(7, ""), (5, "input of `ok`"), (16, "no such input"), (9, "another use")] {
            let door = "[[card.input]]\nnumber = 9\nuse = \"door\"\n";
            let error = refused(&(cutter("torch", &format!("ok = {{ input = 5 }}\ncollision = [{number}]")) + door));
            assert!(error.contains(why) && error.is_empty() == why.is_empty(), "{number}: {error}");
        }
        assert!(refused(&(cutter("torch", "") + "[code.M3]\nduration_ms = 5\n")).contains("beside [[cutter]] tool"));
    }
}
