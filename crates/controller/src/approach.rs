//! The approach to a position in a safe order: retract plane, other axes, tool axis (DNC-6, *Beyond the source*).
//!
//! Invariant: while an axis other than the tool axis moves, the tool axis is at least as high as at the start, at the
//! destination, and at the retract plane. Every end of a move is within the soft limits, and the last one is the
//! destination to the pulse.

use retrace_config::{MachineConfig, NumberedError};

/// The moves from one position to another, each by its end, in counts of the machine's axes: none where the machine is
/// there already, at most three. Where only the tool axis has to move, it moves straight; without a tool axis all axes
/// move together.
///
/// # Errors
/// `E4305` where an axis would go beyond its soft limits. An axis that is beyond them may move back.
pub(crate) fn approach<const A: usize>(
    machine: &MachineConfig,
    from: [i64; A],
    to: [i64; A],
) -> Result<Vec<[i64; A]>, NumberedError> {
    let axes = machine.axes.len().min(A);
    let moves = ends(machine, &from, &to);
    for end in &moves {
        for axis in 0..axes {
            let stays_where_it_is = end[axis] == from[axis] && end[axis] != to[axis];
            if !stays_where_it_is {
                check(machine, axis, end[axis])?;
            }
        }
    }
    Ok(moves)
}

/// The ends of the moves; moves without motion are omitted.
fn ends<const A: usize>(machine: &MachineConfig, from: &[i64; A], to: &[i64; A]) -> Vec<[i64; A]> {
    let mut moves: Vec<[i64; A]> = Vec::with_capacity(3);
    let tool = machine.tool_axis().filter(|&tool| tool < A);
    let others_move = (0..A).any(|axis| Some(axis) != tool && from[axis] != to[axis]);
    if let (Some(tool), true) = (tool, others_move) {
        let plane = machine.setting_up.retract_mm.map(|mm| machine.counts_of(tool, mm));
        let height = from[tool].max(to[tool]).max(plane.unwrap_or(i64::MIN));
        let (mut up, mut across) = (*from, *to);
        (up[tool], across[tool]) = (height, height);
        moves.extend([up, across]);
    }
    moves.push(*to);
    let mut at = *from;
    moves.retain(|end| std::mem::replace(&mut at, *end) != *end);
    moves
}

fn check(machine: &MachineConfig, axis: usize, count: i64) -> Result<(), NumberedError> {
    let Some(of) = machine.axes.get(axis) else { return Ok(()) };
    let [low, high] = of.travel_mm.map(|mm| machine.counts_of(axis, mm));
    if (low..=high).contains(&count) {
        return Ok(());
    }
    let (letter, mm) = (of.name.to_ascii_uppercase(), of.mm_of(count));
    let limit = of.travel_mm[usize::from(count > high)];
    Err(NumberedError::new(
        "E4305",
        format!("on the way there axis {letter} would go to {mm:.3} mm, beyond its soft limit at {limit:.3} mm"),
        "check the position of the machine; home it where that cannot be trusted",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// X, Y and Z with 10, 100 and 1 000 pulses/mm and travels of their own.
    fn machine(before: &str) -> MachineConfig {
        let axis = |name: &str, pulses: u32, travel: &str| {
            format!(
                "[[axis]]\nname = \"{name}\"\npulses_per_mm = {pulses}\nmax_velocity_mm_per_s = \
                    100\nmax_acceleration_mm_per_s2 = 1000\n\
                 max_jerk_mm_per_s3 = 20000\ntravel_mm = {travel}\n"
            )
        };
        let axes = [axis("x", 10, "[0, 500]"), axis("y", 100, "[-200, 300]"), axis("z", 1000, "[-150, 5]")].concat();
        MachineConfig::parse(&format!("{before}{axes}"), "m.toml").expect("valid")
    }

    #[test]
    fn up_across_and_down() {
        let machine = machine("retract_mm = 0\n");
        let from_cut = approach(&machine, [10, 20, -5_000, 0], [4_000, -7_000, -80_000, 0]);
        assert_eq!(from_cut, Ok(vec![[10, 20, 0, 0], [4_000, -7_000, 0, 0], [4_000, -7_000, -80_000, 0]]));
        let from_above = approach(&machine, [10, 20, 3_000, 0], [4_000, 20, 0, 0]);
        assert_eq!(from_above, Ok(vec![[4_000, 20, 3_000, 0], [4_000, 20, 0, 0]]));
        assert_eq!(approach(&machine, [10, 20, -5, 0], [10, 20, -9, 0]), Ok(vec![[10, 20, -9, 0]]));
        assert_eq!(approach(&machine, [10, 20, -5, 0], [10, 20, -5, 0]), Ok(vec![]));
    }

    #[test]
    fn what_leaves_the_soft_limits_is_refused_by_axis() {
        let machine = machine("");
        let refused = |from, to| approach::<3>(&machine, from, to).expect_err("beyond");
        assert!(refused([0, 0, 0], [5_001, 0, 0]).cause.contains("axis X would go to 500.100 mm"));
        assert!(refused([0, 0, 0], [0, -20_001, 0]).cause.contains("axis Y"));
        assert_eq!(refused([0, 0, 0], [0, 0, 5_001]).number, "E4305");
        // an axis beyond a limit may move back, and may not move along beyond it
        assert_eq!(approach::<3>(&machine, [-5, 0, 0], [0, 0, 0]), Ok(vec![[0, 0, 0]]));
    }

    proptest! {
        /// For any positions, tool axis and retract plane: safe, within limits, and exact.
        #[test]
        fn it_is_safe_and_exact(
            from in prop::array::uniform3(0.0..1.0_f64), to in prop::array::uniform3(0.0..1.0_f64),
            still in prop::array::uniform3(any::<bool>()), tool in 0..4_usize, plane in prop::option::of(0.0..1.0_f64),
        ) {
            let bare = machine("");
            let at = |axis: usize, share: f64| {
                let [low, high] = bare.axes[axis].travel_mm;
                low + share * (high - low)
            };
            let mut text = String::new();
            if let Some(name) = ["x", "y", "z"].get(tool) {
                text += &format!("tool_axis = \"{name}\"\n");
            }
            let tool = if tool == 3 { 2 } else { tool };
            if let Some(share) = plane {
                text += &format!("retract_mm = {}\n", at(tool, share));
            }
            let machine = machine(&text);
            let counts = |shares: [f64; 3]| [0, 1, 2].map(|axis| machine.counts_of(axis, at(axis, shares[axis])));
            let from = counts(from);
            let mut to = counts(to);
            for axis in 0..3 {
                if still[axis] {
                    to[axis] = from[axis];
                }
            }
            let moves = approach(&machine, from, to).expect("both are within the limits");
            prop_assert!(moves.len() <= 3 && moves.last().copied().unwrap_or(from) == to);
            let over_plane = plane.map_or(i64::MIN, |share| machine.counts_of(tool, at(tool, share)));
            let least = over_plane.max(from[tool]).max(to[tool]);
            let mut here = from;
            for end in moves {
                prop_assert_ne!(here, end);
                let others = (0..3).any(|axis| axis != tool && here[axis] != end[axis]);
                if others {
                    prop_assert_eq!(here[tool], end[tool]);
                    prop_assert_eq!(here[tool], least);
                }
                for (axis, count) in end.iter().enumerate().take(3) {
                    let [low, high] = machine.axes[axis].travel_mm.map(|mm| machine.counts_of(axis, mm));
                    prop_assert!((low..=high).contains(count));
                }
                here = end;
            }
        }
    }
}
