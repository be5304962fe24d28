//! Words of cutting programs: materials, `$` of cutters, QtPlasmaC's outputs, shares of the feed, small holes (CUT-24).
//!
//! Invariant: none of it has an effect on a machine without a material table.

use super::block_motion::{AXES, BlockMotion};
use super::interpreter_core::{BlockEnvironment, Core, Emitter};
use crate::block::Words;
use crate::canon::{Canon, CanonStep, WaitFor, WaitInput};
use crate::canon_modes::Plane;
use crate::comment::Comment;
use crate::cutting::{CuttingSetting, CuttingSwitch, CuttingTool, GREATEST_PLAIN_SPEED, SpindleUse};
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::eval::to_whole_number;
use crate::groups::{GroupG, GroupM};
use crate::material::{FIRST_TEMPORARY_MATERIAL, Material};
use crate::material_comment::{Declaration, MaterialComment};
use crate::modal_groups::{MotionMode, SpindleRotation};
use crate::params::SHOW_DEBUG;
use crate::parse::LineReader;
use std::sync::Arc;

/// M190: selects a material.
pub(super) const SELECT_MATERIAL: u8 = 190;
/// M159: sets a figure of a pierce in motion.
pub(super) const PIERCE_VALUE: u8 = 159;

/// Number behind `$` with which QtPlasmaC addresses the torch to mark points.
const SPOTTING_TORCH: i32 = 2;

/// Greatest difference between F and the feed rate of the material, in program units per minute, that is not reported.
const FEED_DIFFERENCE: f64 = 1.0;

impl Core {
    /// Executes the comment of the block in `reader`, if it has one.
    pub(super) fn emit_comment(&mut self, reader: &LineReader, line: u32, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let Some(comment) = &reader.block.comment else { return Ok(()) };
        let environment = BlockEnvironment { core: self, names: &reader.names, line };
        let show_debug = self.parameters.get(SHOW_DEBUG) > 0.0;
        if let Some(canon) = comment.canon(&environment, show_debug)? {
            emit.call(canon);
        }
        if let Comment::Material(material) = comment {
            self.declare_material(material, emit)?;
        }
        self.check_material_comment(comment, emit);
        Ok(())
    }

    /// Takes over the material table before the first block.
    pub(crate) fn begin_cutting(&mut self) {
        let Some(setup) = &self.cutting else { return };
        let state = &mut self.state.cutting;
        let materials = state.materials.get_or_insert_with(|| Arc::clone(&setup.materials));
        if state.material.is_none() {
            state.material = materials.default_material().cloned();
        }
    }

    /// Executes M190: selects the material P, or the default one with P-1.
    pub(super) fn select_material(&mut self, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let Some(number) = words.get(b'p') else {
            let at = words.m_span(GroupM::User);
            return fault(ErrorCode::WordMissing, at, "M190 needs a P word: the number of a material, or -1");
        };
        let at = words.span(b'p');
        let number = to_whole_number(number, at, "P")?;
        let state = &mut self.state.cutting;
        let Some(materials) = &state.materials else { return Ok(()) };
        let material = match u32::try_from(number) {
            Ok(number) => materials.get(number),
            Err(_) if number == -1 => materials.default_material(),
            Err(_) => None,
        };
        let Some(material) = material.cloned() else {
            let known: Vec<String> = materials.numbers().map(|number| number.to_string()).collect();
            let message = format!("there is no material {number}; the table has {}", known.join(", "));
            return fault(ErrorCode::NoSuchMaterial, at, message);
        };
        state.is_requested = true;
        self.use_material(material, emit);
        Ok(())
    }

    /// Executes a comment that declares a material.
    ///
    /// # Errors
    /// E1734 for a figure out of its range, a missing one, or a number that the table has with other figures.
    pub(super) fn declare_material(&mut self, comment: &MaterialComment, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let units = self.state.units;
        let state = &mut self.state.cutting;
        let temporary = state.last_temporary.max(FIRST_TEMPORARY_MATERIAL - 1) + 1;
        let material = comment.material(temporary, units, state.cuts_tube)?;
        if comment.declaration == Declaration::Temporary {
            state.last_temporary = temporary;
            self.use_material(Arc::new(material), emit);
            return Ok(());
        }
        let Some(materials) = &mut state.materials else { return Ok(()) };
        let existing = materials.get(material.number);
        if existing.is_some_and(|existing| **existing == material) {
            return Ok(());
        }
        if existing.is_some() && comment.declaration == Declaration::Add {
            let message = format!("material {} exists with other figures; o=2 overwrites it", material.number);
            return fault(ErrorCode::BadMaterialComment, comment.at, message);
        }
        if !state.declared.contains(&material.number) {
            state.declared.push(material.number);
        }
        Arc::make_mut(materials).insert(material);
        Ok(())
    }

    fn use_material(&mut self, material: Arc<Material>, emit: &mut Emitter<'_>) {
        let state = &mut self.state.cutting;
        let material = state.pierce_figures.applied_to(state.plain_material.insert(material));
        state.material = Some(Arc::clone(&material));
        emit.call(Canon::SelectMaterial(material));
    }

    /// Executes M159: sets a figure of the pierces to come, or resets all of them.
    pub(super) fn pierce_value(&mut self, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let at = words.m_span(GroupM::User);
        let number = words.get(b'p').map(|number| to_whole_number(number, words.span(b'p'), "P")).transpose()?;
        let (number, value) = match (number, words.get(b'q')) {
            (Some(609), value) => (609, value.unwrap_or_default()),
            (Some(number), Some(value)) => (number, value),
            _ => return fault(ErrorCode::WordMissing, at, "M159 needs P601 to P609 and a Q word: the value"),
        };
        let Some(number) = u16::try_from(number).ok().filter(|number| (601..=609).contains(number)) else {
            return fault(ErrorCode::BadP, words.span(b'p'), format!("M159 has P601 to P609, not P{number}"));
        };
        let (unit_mm, state) = (self.state.units.millimetres(), &mut self.state.cutting);
        if let Err([least, greatest]) = state.pierce_figures.set(number, value, unit_mm) {
            let whole = if number == 601 {
                "0 (at rest), 1 (in motion) or 2 (ramp)".to_owned()
            } else {
                format!("a number from {least} to {greatest:.6}")
            };
            return fault(ErrorCode::BadPierceFigure, words.span(b'q'), format!("P{number} Q{value}: {whole}"));
        }
        emit.call(Canon::SetPierceValue { number, value });
        if let Some(material) = state.plain_material.clone().or_else(|| state.material.clone()) {
            self.use_material(material, emit);
        }
        Ok(())
    }

    /// Returns the tool that M3, M4, M5 and S of this block address, on a machine with a material table.
    fn addressed_tool(&self, words: &Words) -> Option<CuttingTool> {
        self.cutting.as_ref()?.tool(words.get(b'$').unwrap_or_default() as i32)
    }

    /// Whether S of this block has no meaning: its tool has no speed.
    pub(super) fn ignores_speed(&self, words: &Words) -> bool {
        self.addressed_tool(words).is_some_and(|tool| !tool.uses_speed)
    }

    /// Warns of M3 or M4 whose S word does not fit what it starts: a spindle that is named as a cutter, or the reverse
    /// (CUT-10).
    pub(super) fn check_speed_of_start(&self, code: u8, words: &Words, emit: &mut Emitter<'_>) {
        let tool = self.addressed_tool(words);
        let (spindle_use, speed) = match tool {
            Some(tool) if !tool.uses_speed => (tool.spindle_use(), words.get(b's').unwrap_or_default()),
            Some(tool) => (tool.spindle_use(), self.state.spindle_speed),
            None => (self.spindle_use, self.state.spindle_speed),
        };
        if code == 5 || speed == 0.0 || self.state.constant_surface_speed {
            return;
        }
        let at = if words.has(b's') { words.span(b's') } else { words.m_span(GroupM::Spindle) };
        match spindle_use {
            SpindleUse::NoSpeed if speed > GREATEST_PLAIN_SPEED => {
                let message = format!("S is {speed}, and M{code} starts a cutter that has no speed");
                emit.warn(ErrorCode::SpeedOfCutter, at, message);
            }
            SpindleUse::Speed if speed <= GREATEST_PLAIN_SPEED => {
                let message = format!("S is {speed}, and M{code} starts a spindle, not a torch");
                emit.warn(ErrorCode::TorchSpeedOfSpindle, at, message);
            }
            _ => {}
        }
    }

    /// Warns of a comment that declares a material on a machine that has none.
    pub(super) fn check_material_comment(&self, comment: &Comment, emit: &mut Emitter<'_>) {
        if self.cutting.is_none()
            && self.spindle_use != SpindleUse::Unknown
            && let Comment::Plain(text) = comment
            && MaterialComment::declares(text)
        {
            emit.warn(ErrorCode::MaterialWithoutTable, Span::default(), format!("({text}) has no effect"));
        }
    }

    /// Checks that the machine has the spindle or cutter that M3, M4, M5 or S of the block addresses.
    ///
    /// # Errors
    /// E1630 for one that it does not have.
    pub(super) fn check_spindle(&self, words: &Words) -> BlockResult<()> {
        let Some(number) = words.get(b'$') else { return Ok(()) };
        let number = number as i32;
        let is_stop = words.m(GroupM::Spindle) == Some(5);
        let exists = match (number, &self.cutting) {
            (0, _) | (-1, None) => true,
            (-1, Some(_)) => is_stop,
            (number, Some(setup)) => setup.tool(number).is_some(),
            _ => false,
        };
        if exists {
            return Ok(());
        }
        let message = match &self.cutting {
            Some(_) if number == SPOTTING_TORCH => {
                let message = "$2 marks points with the torch (spotting), which this machine does not do";
                return fault(ErrorCode::NoSpottingTorch, words.span(b'$'), message);
            }
            Some(setup) => {
                let known: Vec<String> = setup.tools.iter().map(|tool| format!("${}", tool.spindle)).collect();
                format!("there is no spindle {number}; the cutters of this machine are {}", known.join(", "))
            }
            None => format!("there is no spindle {number}"),
        };
        fault(ErrorCode::NoSuchSpindle, words.span(b'$'), message)
    }

    /// Executes M3, M4 and M5 of the cutters. Returns whether it is done: otherwise the block is about spindle 0.
    pub(super) fn switch_cutter(&mut self, code: u8, words: &Words, emit: &mut Emitter<'_>) -> bool {
        let Some(setup) = self.cutting.clone() else { return false };
        let number = words.get(b'$').unwrap_or_default() as i32;
        let all = number == -1;
        for tool in setup.tools.iter().filter(|tool| all || i32::from(tool.spindle) == number) {
            self.switch_tool(code, tool.spindle, emit);
        }
        let zero = setup.tool(0).is_some();
        if all && !zero {
            self.switch_tool(5, 0, emit);
        }
        all || number != 0 || zero
    }

    fn switch_tool(&mut self, code: u8, spindle: u8, emit: &mut Emitter<'_>) {
        let rotation = match code {
            3 => SpindleRotation::Clockwise,
            4 => SpindleRotation::Counterclockwise,
            _ => SpindleRotation::Stopped,
        };
        let state = &mut self.state;
        if spindle == 0 {
            state.spindle = rotation;
        }
        let bit = 1_u8.checked_shl(spindle.into()).unwrap_or_default();
        let lit = &mut state.cutting.lit;
        *lit = if rotation == SpindleRotation::Stopped { *lit & !bit } else { *lit | bit };
        emit.call(rotation.canon(spindle));
        if rotation == SpindleRotation::Stopped && !self.is_cutting() {
            self.allow_after_passing(emit);
        }
    }

    /// Allows a cutter that went off in passing to be lit again: it is behind M5.
    fn allow_after_passing(&mut self, emit: &mut Emitter<'_>) {
        let state = &mut self.state.cutting;
        if std::mem::take(&mut state.is_off_in_passing) {
            state.is_forbidden = false;
            emit.call(Canon::SetCutting(CuttingSwitch::Cutter, true));
        }
    }

    /// Ends cutting at the end of a program: every cutter off, everything allowed again.
    pub(super) fn end_cutting(&mut self, emit: &mut Emitter<'_>) {
        let Some(setup) = self.cutting.clone() else { return };
        for tool in setup.tools.iter().filter(|tool| tool.spindle != 0) {
            if self.state.cutting.lit & 1_u8.checked_shl(tool.spindle.into()).unwrap_or_default() != 0 {
                emit.call(Canon::StopSpindleTurning(tool.spindle));
            }
        }
        let state = &mut self.state.cutting;
        if std::mem::take(&mut state.is_forbidden) | std::mem::take(&mut state.is_off_in_passing) {
            emit.call(Canon::SetCutting(CuttingSwitch::Cutter, true));
        }
        if std::mem::take(&mut state.is_arc_ignored) {
            emit.call(Canon::SetCutting(CuttingSwitch::IgnoreArcOk, false));
        }
        if std::mem::take(&mut state.is_height_held) {
            emit.call(Canon::SetCutting(CuttingSwitch::HeightControl, true));
        }
        (state.lit, state.velocity_percent) = (0, 100.0);
    }

    /// Executes M62 to M65 of QtPlasmaC: P1 the arc, P2 height control, P3 the cutter. Returns whether it is one.
    pub(super) fn cutting_switch(&mut self, code: u8, words: &Words, emit: &mut Emitter<'_>) -> bool {
        if self.cutting.is_none() || !matches!(code, 62..=65) {
            return false;
        }
        let is_set = matches!(code, 62 | 64);
        let (switch, on) = match words.get(b'p') {
            Some(1.0) => (CuttingSwitch::IgnoreArcOk, is_set),
            Some(2.0) => (CuttingSwitch::HeightControl, !is_set),
            Some(3.0) => (CuttingSwitch::Cutter, !is_set),
            _ => return false,
        };
        if switch == CuttingSwitch::Cutter {
            let is_cutting = self.is_cutting();
            let state = &mut self.state.cutting;
            state.is_forbidden = is_set;
            state.is_off_in_passing = is_set && is_cutting;
        }
        if switch == CuttingSwitch::HeightControl {
            self.state.cutting.is_height_held = is_set;
        }
        if switch == CuttingSwitch::IgnoreArcOk {
            self.state.cutting.is_arc_ignored = on;
        }
        emit.call(Canon::SetCutting(switch, on));
        true
    }

    /// Whether this M66 waits for the change of the material, which is done.
    pub(super) fn waits_for_material(&self, input: WaitInput, wait_for: WaitFor) -> bool {
        self.state.cutting.is_requested && input == WaitInput::Digital(3) && wait_for == WaitFor::High
    }

    /// Executes M67 E3 and M68 E3: the share of the feed rate. Returns whether it is one.
    pub(super) fn velocity_share(&mut self, words: &Words, emit: &mut Emitter<'_>) -> bool {
        let (Some(3.0), Some(percent), true) = (words.get(b'e'), words.get(b'q'), self.cutting.is_some()) else {
            return false;
        };
        let is_share = percent > 0.0 && percent < 100.0;
        if is_share && percent < 10.0 {
            emit.warn(ErrorCode::SmallShare, words.span(b'q'), format!("the share of the feed rate is {percent} %"));
        }
        self.state.cutting.velocity_percent = if is_share { percent } else { 100.0 };
        emit.call(Canon::SetFeedRate(self.shared_rate()));
        true
    }

    /// The feed rate in force with the share of M67 E3.
    pub(super) fn shared_rate(&self) -> f64 {
        let percent = self.state.cutting.velocity_percent;
        if percent == 100.0 { self.state.feed_rate } else { self.state.feed_rate * percent / 100.0 }
    }

    /// Reports an F word that differs from the feed rate of the material.
    pub(super) fn compare_feed(&self, feed: f64, at: Span, emit: &mut Emitter<'_>) {
        let Some(material) = &self.state.cutting.material else { return };
        let wanted = material.feed_mm_per_min / self.state.units.millimetres();
        if wanted > 0.0 && (feed - wanted).abs() > FEED_DIFFERENCE {
            let message = format!("F is {feed}; the feed rate of material {} is {wanted:.3}", material.number);
            emit.warn(ErrorCode::FeedOfMaterial, at, message);
        }
    }

    /// Applies an assignment to a parameter that sets how the program cuts.
    pub(crate) fn set_cutting(&mut self, setting: CuttingSetting, value: f64) {
        let mm = self.state.units.millimetres();
        let state = &mut self.state.cutting;
        match setting {
            CuttingSetting::Holes => state.holes.mode = value.clamp(0.0, 4.0) as u8,
            CuttingSetting::HoleDiameter => state.holes.diameter_mm = value * mm,
            CuttingSetting::HoleVelocity => state.holes.velocity_percent = value,
            CuttingSetting::OverCutLength => state.holes.over_cut_mm = value * mm,
            CuttingSetting::PierceOnly => state.pierces_only = value != 0.0,
            CuttingSetting::TubeCut => state.cuts_tube = value != 0.0,
            CuttingSetting::KeepZ => state.keeps_z = value != 0.0,
        }
    }

    /// Takes the feed moves between the going on and the going off of a cutter out of the steps from `first`:
    /// `#<pierce-only>`.
    #[cold]
    pub(super) fn keep_pierces(&mut self, first: usize, steps: &mut Vec<CanonStep>) {
        let Some(setup) = self.cutting.clone() else { return };
        let is_pierce = &mut self.state.cutting.is_piercing;
        let bits = setup.cutting_bits();
        let cuts = |spindle: u8| bits & 1_u8.checked_shl(spindle.into()).unwrap_or_default() != 0;
        let new = steps.split_off(first);
        steps.extend(new.into_iter().filter(|step| {
            match step.canon {
                Canon::StartSpindleClockwise(spindle) | Canon::StartSpindleCounterclockwise(spindle)
                    if cuts(spindle) =>
                {
                    *is_pierce = true;
                }
                Canon::StopSpindleTurning(spindle) if cuts(spindle) => *is_pierce = false,
                _ => {}
            }
            !*is_pierce || !matches!(step.canon, Canon::StraightFeed(_) | Canon::ArcFeed(_) | Canon::NurbsFeed(_))
        }));
    }

    /// Returns the block without its Z word, where that has no effect, and the motion that remains (CUT-16).
    pub(super) fn without_z(&mut self, words: &Words, motion: BlockMotion) -> Option<(Words, BlockMotion)> {
        let state = &self.state.cutting;
        let rules_height = self.cutting.as_ref().is_some_and(|setup| setup.ignores_z);
        if !words.has(b'z') || !rules_height || state.cuts_tube || state.keeps_z {
            return None;
        }
        let BlockMotion::Move(mode) = motion else { return None };
        let is_straight = matches!(mode, MotionMode::Traverse | MotionMode::Feed);
        let plane = words.g(GroupG::Plane).map_or(self.state.plane == Plane::Xy, |code| code == 170);
        // G53 names a place of the machine, so that its Z word is meant.
        if words.g(GroupG::NonModal) == Some(530) || !(is_straight || mode.is_arc() && plane) {
            return None;
        }
        let mut words = words.clone();
        words.remove(b'z');
        if is_straight && !words.has_any(AXES) {
            (self.state.motion, self.state.series) = (Some(mode), None);
            return Some((words, BlockMotion::None));
        }
        Some((words, motion))
    }
}
