//! Execution of a job: its numbers and checks, then the cuts in order.
//!
//! Invariant: every check is made before the first move is written.

use super::contour::{check_number, read};
use super::move_writer::MoveWriter;
use super::piece::Piece;
use super::rough::{Allowance, raise};
use super::sections::{Sections, divide, levels};
use super::shape::{Orientation, Shape, normalise};
use super::{
    Axes, LIFT_OFF, Path, Point, StockRemovalError, StockRemovalParams, Warning, finish, nose, relief, roughing,
};

/// Radius below which a nose counts as none.
const POINTED: f64 = 1e-6;

/// Degrees by which a flank may exceed the clearance angle: tool tables hold rounded angles.
const ANGLE: f64 = 1e-3;

/// Components of VARI.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Variant {
    lie: Orientation,
    roughs: bool,
    finishes: bool,
}

impl Variant {
    fn of(vari: i32) -> Result<Self, StockRemovalError> {
        // The hundreds digit 2 follows the contour to the previous level, as 0 does here.
        let plain = if (201..=212).contains(&vari) { vari - 200 } else { vari };
        if !(1..=12).contains(&plain) {
            return Err(StockRemovalError::MachiningType(vari));
        }
        let (kind, lie) = ((plain - 1) / 4, (plain - 1) % 4);
        let lie = Orientation { face: lie % 2 == 1, inside: lie >= 2 };
        Ok(Self { lie, roughs: kind != 1, finishes: kind != 0 })
    }
}

/// Parameters of a job, checked, without sign and with their defaults.
#[derive(Clone, Copy, Debug)]
struct Sizes {
    mid: f64,
    allowance: Allowance,
    dam: f64,
    lift: f64,
    nose: f64,
}

impl Sizes {
    fn of(job: &StockRemovalParams, face: bool, warnings: &mut Vec<Warning>) -> Result<Self, StockRemovalError> {
        let mut size = |name: &'static str, value: f64| {
            check_number(name, value)?;
            if value < 0.0 {
                warnings.push(Warning::SignDropped(name));
            }
            Ok(value.abs())
        };
        let mid = size("MID", job.mid)?;
        let (first, second) = (size("FALZ", job.fal_z)?, size("FALX", job.fal_x)?);
        let along = size("FAL", job.fal)?;
        let (dam, lift) = (size("DAM", job.dam)?, size("_VRT", job.vrt)?);
        let nose = size("the nose radius", job.nose_radius)?;
        let (cut, infeed) = if face { (second, first) } else { (first, second) };
        check_number("the clearance angle", job.clearance_angle)?;
        for part in [job.tip.u, job.tip.v] {
            if !(-1.0..=1.0).contains(&part) {
                return Err(StockRemovalError::Number("the edge position"));
            }
        }
        let lift = if lift == 0.0 { LIFT_OFF } else { lift };
        let nose = if nose < POINTED { 0.0 } else { nose };
        Ok(Self { mid, allowance: Allowance { cut: cut + along, infeed: infeed + along }, dam, lift, nose })
    }
}

/// Returns the path of a job, or why it has none.
pub(super) fn execute(job: &StockRemovalParams) -> Result<Path, StockRemovalError> {
    let Variant { lie, roughs, finishes } = Variant::of(job.vari)?;
    let mut warnings = Vec::new();
    let sizes = Sizes::of(job, lie.face, &mut warnings)?;
    if roughs && sizes.mid == 0.0 {
        return Err(StockRemovalError::InfeedDepth);
    }
    let segments = read(&job.contour)?;
    let shape = normalise(&segments, lie)?;
    check_clearance(&shape.contour, job.clearance_angle)?;
    if finishes && sizes.nose > 0.0 {
        nose::check(&shape.contour, sizes.nose)?;
    }
    if let Some(position) = job.position {
        check_number("the position", position.u)?;
        check_number("the position", position.v)?;
        if roughs && shape.contains(shape.frame.into(position)) {
            return Err(StockRemovalError::StartInBlank);
        }
    }
    let mut writer = if roughs {
        rough(job, &shape, sizes, &mut warnings)?
    } else {
        let start = shape.start_of_finishing(sizes.allowance, sizes.lift, !shape.reversed);
        let approach = [MoveWriter::infeed_axis(shape.frame), MoveWriter::cut_axis(shape.frame)];
        MoveWriter::at_start(shape.frame, sizes.dam, start, &approach)
    };
    let start = shape.frame.out(writer.at());
    if finishes {
        if roughs && shape.reversed {
            let reversed: Vec<_> = segments.iter().rev().map(super::segment::Segment::reversed).collect();
            finish::finish(&mut writer, &reversed, shape.frame, true)?;
        } else {
            finish::finish(&mut writer, &segments, shape.frame, !shape.reversed)?;
        }
    }
    Ok(Path { start, moves: writer.into_moves(), warnings })
}

/// Emits all roughing; the tool is then at the start point again.
fn rough(
    job: &StockRemovalParams,
    shape: &Shape,
    sizes: Sizes,
    warnings: &mut Vec<Warning>,
) -> Result<MoveWriter, StockRemovalError> {
    let mut chain = raise(&shape.pieces, sizes.allowance);
    if job.rough_compensated && sizes.nose > 0.0 {
        chain = nose::offset(&chain, sizes.nose, shape.frame.into(Point::new(job.tip.u, job.tip.v)));
        if let Err(StockRemovalError::NoseTooLarge(line)) = nose::check(&shape.contour, sizes.nose) {
            warnings.push(Warning::NoseLeavesStock(line));
        }
    }
    let Sections { profile, reliefs } = divide(&chain);
    let lost = divide(&shape.pieces).reliefs.len().saturating_sub(reliefs.len());
    if lost > 0 {
        warnings.push(Warning::ReliefLeftToFinishing(lost));
    }
    let (first, last) = profile.first().zip(profile.last()).ok_or(StockRemovalError::NoExtent)?;
    let (top, lift) = (last.to.v, sizes.lift);
    let start = Point::new(first.from.u + lift, top + lift);
    let levels = levels(top, first.from.v, sizes.mid)?;
    let mut writer = MoveWriter::at_start(shape.frame, sizes.dam, start, &[Axes::Both]);
    roughing::rough(&mut writer, &profile, &levels, top, lift)?;
    relief::rough(&mut writer, &reliefs, relief::Cutting { start, mid: sizes.mid, lift })?;
    Ok(writer)
}

/// Refuses a falling flank that is steeper than the tool clears. An angle of 0 switches the check off.
fn check_clearance(pieces: &[Piece], clearance: f64) -> Result<(), StockRemovalError> {
    if clearance <= 0.0 {
        return Ok(());
    }
    for piece in pieces.iter().filter(|piece| piece.falls()) {
        let angle = |at| {
            let heading = piece.heading(at);
            (-heading.v).atan2(-heading.u).to_degrees()
        };
        let flank = angle(piece.from).max(angle(piece.to));
        if flank > clearance + ANGLE {
            return Err(StockRemovalError::ClearanceAngle { line: piece.line, flank, clearance });
        }
    }
    Ok(())
}
