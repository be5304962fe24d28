//! Preview of a program: its path for the drawing, and the end of each block.
//!
//! Invariant: bounded however long the program is, except for one end per line; a line that ends in more than one place
//! has no end.

use retrace_config::MachineConfig;
use retrace_controller::{BlockDecoder, Cancelled, MotionSink, PlanWriteError, SwitchInstruction, feed_program};
use retrace_link::OutputChange;
use retrace_motion::{Arc, FeedRate, PathMode};

use crate::trail::{Trail, TrailPoint};

/// Maximum number of lines whose ends are stored.
const MAX_ENDS: usize = 1_000_000;

/// Path of a program and the ends of its blocks.
#[derive(Clone, Debug, Default)]
pub struct Preview {
    /// Path.
    pub path: Trail,
    ends: Vec<PreviewEnd>,
    axes: usize,
    space: [Option<usize>; 3],
    at_mm: [f64; 9],
    along_mm: f64,
    /// Last line that was decoded.
    line: u32,
    /// Ends of the moves in X and Y, where they are collected, with the maximum number of them.
    collected: Option<(Vec<[f32; 2]>, usize)>,
}

/// End of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum PreviewEnd {
    /// The line moves nothing.
    #[default]
    Nowhere,
    /// Machine position, mm, of at most nine axes.
    At([f32; 9]),
    /// The line is executed more than once, with different ends.
    Several,
}

impl Preview {
    /// Decodes a program that was checked before.
    #[must_use]
    pub fn of(machine: &MachineConfig, program: &mut impl BlockDecoder) -> Self {
        let mut preview = Self::of_machine(machine);
        feed_program::<9>(machine, program, &mut preview);
        preview
    }

    fn of_machine(machine: &MachineConfig) -> Self {
        let space = ['x', 'y', 'z'].map(|name| machine.axes.iter().position(|a| a.name == name));
        let mut preview = Self { space, axes: machine.axes.len(), at_mm: machine.start_mm(), ..Self::default() };
        preview.draw(false);
        preview
    }

    /// Decodes a program that was checked before, and collects the ends of at most this number of moves in X and Y, mm.
    pub(crate) fn with_ends(
        machine: &MachineConfig,
        program: &mut impl BlockDecoder,
        most: usize,
    ) -> (Self, Vec<[f32; 2]>) {
        let mut preview = Self { collected: Some((Vec::new(), most)), ..Self::of_machine(machine) };
        feed_program::<9>(machine, program, &mut preview);
        let ends = preview.collected.take().map_or_else(Vec::new, |(ends, _)| ends);
        (preview, ends)
    }

    /// End of the block of a line, as a machine position in mm, if there is a single one.
    #[must_use]
    pub fn end_of(&self, line: u32) -> Option<&[f32]> {
        match self.ends.get(line as usize)? {
            PreviewEnd::At(end) => end.get(..self.axes),
            _ => None,
        }
    }

    fn move_to(&mut self, to: [f64; 9], rapid: bool) {
        self.along_mm += (0..9).map(|i| (to[i] - self.at_mm[i]).powi(2)).sum::<f64>().sqrt();
        self.at_mm = to;
        self.draw(rapid);
    }

    fn draw(&mut self, rapid: bool) {
        let at = self.space.map(|axis| axis.map_or(0.0, |i| self.at_mm[i] as f32));
        self.path.push(TrailPoint { along_mm: self.along_mm, at, rapid });
        if let Some((ends, _)) = self.collected.as_mut().filter(|(ends, most)| ends.len() < *most) {
            ends.push([at[0], at[1]]);
        }
    }

    fn end(&mut self, line: u32) {
        let (index, end) = (line as usize, self.at_mm.map(|mm| mm as f32));
        if index >= MAX_ENDS {
            return;
        }
        if index >= self.ends.len() {
            self.ends.resize(index + 1, PreviewEnd::Nowhere);
        }
        let slot = &mut self.ends[index];
        // Several successive moves are one block, whose last one counts.
        *slot = match *slot {
            PreviewEnd::At(old) if self.line != line && old != end => PreviewEnd::Several,
            PreviewEnd::Several => PreviewEnd::Several,
            _ => PreviewEnd::At(end),
        };
        self.line = line;
    }
}

impl MotionSink<9> for Preview {
    fn straight(&mut self, end_mm: [f64; 9], feed: FeedRate, _: PathMode, line: u32) -> Result<(), PlanWriteError> {
        self.move_to(end_mm, feed == FeedRate::Rapid);
        self.end(line);
        Ok(())
    }

    fn arc(&mut self, arc: &Arc<9>, _: FeedRate, _: PathMode, line: u32) -> Result<(), PlanWriteError> {
        let ([p, q], [cp, cq], start) = (arc.plane, arc.centre_mm, self.at_mm);
        let radius = (start[p] - cp).hypot(start[q] - cq);
        let (from, sweep) = arc.sweep(&start);
        let chords = (sweep.abs() / 0.1).ceil().clamp(2.0, 10_000.0);
        for k in 1..=chords as u32 {
            let share = f64::from(k) / chords;
            let angle = from + sweep * share;
            let mut point: [f64; 9] = std::array::from_fn(|i| start[i] + (arc.end_mm[i] - start[i]) * share);
            point[p] = cp + radius * angle.cos();
            point[q] = cq + radius * angle.sin();
            self.move_to(point, false);
        }
        self.move_to(arc.end_mm, false);
        self.end(line);
        Ok(())
    }

    fn action(&mut self, _: OutputChange, _: u32) {}

    fn exclusive(&mut self, _: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        Ok(())
    }

    fn message(&mut self, _: String, _: u32) -> Result<(), Cancelled> {
        Ok(())
    }
}
