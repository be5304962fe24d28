//! Contours of the program, and what is missing of them.

use retrace_controller::{CutterOffReason, CutterState, EventKind, Outcome};

use super::{FIRE, PROGRAM, machine, machine_text, parsed, run};

/// The arc does not strike at the end of the contour, and M5 passes: the contour is reported with what is missing, and
/// again when it is whole.
#[test]
fn a_contour_whose_end_is_cut_later_is_whole() {
    // the second ignition of this seed strikes no arc
    let job = run(&machine(), PROGRAM, "lose@59,no-start=0.4,seed=11", "at 5.5s recover\nafter 5s recover\n");
    assert_eq!(job.end.outcome, Outcome::Completed);
    let missing: Vec<(u32, bool)> = job.contours().iter().map(|&(number, mm)| (number, mm > 0.0)).collect();
    assert_eq!(missing, [(1, true), (1, false), (2, false)]);
    let stats = &job.end.stats;
    assert_eq!((stats.contours, stats.contours_not_cut, stats.not_cut_um), (2, 0, 0));
}

/// Where the operator confirms the outputs, the torch pierces where the machine came to rest.
#[test]
fn what_is_not_cut_is_reported() {
    let job = run(&machine(), PROGRAM, "lose@20", "at 3s resume\nafter 1s agree\n");
    assert_eq!(job.end.outcome, Outcome::Completed);
    let not_cut = job.picked(|kind| if let EventKind::NotCut(mm) = kind { Some(*mm) } else { None });
    let rests_mm = job.ignitions()[1][0];
    assert!(not_cut.len() == 1 && (not_cut[0] - (rests_mm - 30.0)).abs() < 0.2 && not_cut[0] > 0.5, "{not_cut:?}");
    let contours = job.contours();
    assert_eq!((contours[0].0, contours[1]), (1, (2, 0.0)));
    assert!((contours[0].1 - not_cut[0]).abs() < 0.2, "{contours:?}");
    let stats = &job.end.stats;
    assert_eq!((stats.contours, stats.contours_not_cut), (2, 1));
    assert!((stats.not_cut_um as f64 / 1000.0 - contours[0].1).abs() < 0.001, "{stats:?}");
}

/// Each stop inside a contour would cost a pierce: a step ends before the torch is lit and after it is switched off.
#[test]
fn in_single_block_one_step_is_the_whole_contour() {
    let program = "G21 G90 F1800\nG0 X10\nM3 S1\nG1 X30\nG1 X40 Y10\nG4 P0.2\nM5\nG0 X100\nM3\nG1 X120\nG1 X130 Y5\n\
                   M5\nG0 X0\nM2\n";
    let steps = |machine: &str, starts: usize| {
        let script = "at 0s single\n".to_string() + &"after 6s cycle start\n".repeat(starts);
        let job = run(&parsed(machine), program, "", &script);
        let stops = job.events.iter().filter(|event| event.kind == EventKind::SingleBlock);
        (
            stops.map(|event| event.line).collect::<Vec<_>>(),
            job.ignitions().len(),
            job.end.outcome,
            job.end.stats.not_cut_um,
        )
    };
    assert_eq!(steps(&machine_text(), 4), (vec![2, 5, 8, 11], 2, Outcome::Completed, 0));
    let in_blocks = machine_text().replace("kind = \"torch\"", "kind = \"torch\"\nsingle_block = \"block\"");
    let (stops, _, outcome, _) = steps(&in_blocks, 1);
    assert_eq!((&stops[..], outcome), (&[2][..], Outcome::Stopped), "it stops in the cut");
}

/// The operator goes back into a contour that is whole: the arc would find no metal there, and the job would stand in
/// its kerf. It is tried all the same at the second command, and the rest is passed with the torch off.
#[test]
fn a_contour_that_is_whole_is_cut_again_only_at_the_second_command() {
    let whole = run(&machine(), PROGRAM, "", "");
    let back = "at 2.9s hold\nafter 0.5s back to pierce\nafter 4s cut moving\n";
    let job = run(&machine(), PROGRAM, "", &format!("{back}after 0.1s recover\n"));
    assert!(job.rejections().len() == 1 && job.rejections()[0].contains("once more"), "{:?}", job.rejections());
    job.assert_part_of(&whole);
    job.assert_safe();
    assert_eq!(job.ignitions().len(), 2);
    let job = run(&machine(), PROGRAM, "", &format!("{back}after 0.1s cut moving\nafter 5s recover\n"));
    assert_eq!(job.rejections().len(), 1);
    job.assert_part_of(&whole);
    job.assert_safe();
    let not_latched = EventKind::CutterOff { channel: FIRE, reason: CutterOffReason::NotLatched };
    assert_eq!((job.ignitions().len(), job.count(&not_latched)), (3, 1));
}

/// The machine is at the pierce already, and not at that of the contour before.
#[test]
fn a_torch_that_is_put_out_in_its_start_is_started_again_at_its_pierce() {
    let whole = run(&machine(), PROGRAM, "", "");
    let second = whole.events.iter().filter(|event| event.kind == EventKind::Switching("M3")).nth(1);
    let at_s = second.expect("a second contour").time_s + 0.02;
    let script = format!("at {at_s:.3}s cutter off\nafter 1s back to pierce\nafter 1s recover\n");
    let job = run(&machine(), PROGRAM, "", &script);
    assert!(job.rejections().len() == 1 && job.rejections()[0].contains("at the pierce"), "{:?}", job.rejections());
    assert!(job.periods.iter().all(|period| period.rate.signum() >= 0), "it does not go back");
    job.assert_part_of(&whole);
}

/// A pause at the end of a contour has the torch on at rest: it does not cut there.
#[test]
fn the_end_of_a_contour_is_a_state_of_its_own() {
    let torch = machine_text().replace("kind = \"torch\"", "kind = \"torch\"\nspindle = 0\nmaterials = \"m.toml\"");
    let table = "units = \"mm\"\n[[material]]\nnumber = 1\npierce_height_mm = 4\npierce_delay_s = 0.4\n\
        cut_height_mm = 1.5\nfeed_mm_per_min = 1800\npause_at_end_s = 0.3\n";
    let machine = parsed(&torch).with_materials(table.into(), "m.toml".into()).expect("valid");
    let job = run(&machine, PROGRAM, "", "");
    assert_eq!(job.end.outcome, Outcome::Completed);
    let states = job.events.iter().filter_map(|event| match event.kind {
        EventKind::CutterState { state, contour, .. } => Some((event.period, state, contour)),
        _ => None,
    });
    let states: Vec<_> = states.collect();
    let endings: Vec<_> = states.windows(2).filter(|pair| pair[0].1 == CutterState::Ending).collect();
    assert_eq!(endings.iter().map(|pair| pair[0].2).collect::<Vec<_>>(), [1, 2], "{states:?}");
    for ending in endings {
        let [begins, ends] = [ending[0].0, ending[1].0];
        assert!((299..=302).contains(&(ends - begins)), "{states:?}");
        let at = |period: u64| job.periods.iter().find(|p| p.period == period).expect("recorded").place;
        assert_eq!(at(begins), at(ends));
    }
}

/// In a dry run the torch is off and nothing is cut; no state says that the program has it on before it has.
#[test]
fn in_a_dry_run_nothing_is_lit_and_nothing_cut() {
    let whole = run(&machine(), PROGRAM, "", "");
    let mut dry = machine();
    dry.inhibits_outputs = true;
    let job = run(&dry, PROGRAM, "", "");
    assert_eq!((&job.end.outcome, job.counts()), (&Outcome::Completed, whole.counts()));
    assert!(!job.lit.contains(&true) && job.contours().is_empty());
    assert_eq!(job.end.stats.contours, 0);
    let states = job.events.iter().filter_map(|event| match event.kind {
        EventKind::CutterState { state, .. } => Some(state),
        _ => None,
    });
    assert_eq!(states.collect::<Vec<_>>(), [CutterState::Dry], "from the first period to the last");
}
