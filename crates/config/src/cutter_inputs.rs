//! The inputs of the cutters on the card: what proves a cutter, what shows a collision, what controls its height.
//!
//! Invariant: an input of a cutter exists on the card and has no other use.

use retrace_link::InputUse;

use crate::card_config::CardConfig;
use crate::cutter::CutterConfig;
use crate::numbered_error::NumberedError;

/// Checks that the input that proves a cutter has no other meaning on the card.
///
/// # Errors
/// `E2112`
pub(crate) fn proofs_are_plain_inputs(cutters: &[CutterConfig], card: &CardConfig) -> Result<(), NumberedError> {
    for cutter in cutters {
        let pressure = cutter.jet.and_then(|jet| jet.pressure_input);
        if let Some(input) = pressure.filter(|&input| {
            card.input_use(input) != InputUse::Plain || cutter.proof.is_some_and(|proof| proof.input == input)
        }) {
            let what = format!("[[cutter]] {}: jet.pressure_input = {input} has another use", cutter.name);
            return Err(NumberedError::new("E2112", what, "an input with `use = \"plain\"`, for this use only"));
        }
        let Some(proof) = &cutter.proof else { continue };
        if card.input_use(proof.input) != InputUse::Plain {
            let what =
                format!("[[cutter]] {}: ok.input = {} has another use in its [[card.input]]", cutter.name, proof.input);
            return Err(NumberedError::new("E2112", what, "an input with `use = \"plain\"`"));
        }
    }
    Ok(())
}

/// Gives the collision inputs of the cutters their meaning on the card.
///
/// # Errors
/// `E2112` for an input that does not exist or has another use.
pub(crate) fn declare_collision_inputs(cutters: &[CutterConfig], card: &mut CardConfig) -> Result<(), NumberedError> {
    for (cutter, &number) in cutters.iter().flat_map(|cutter| cutter.collision.iter().map(move |n| (cutter, n))) {
        let refuse = |why: &str| {
            let what = format!("[[cutter]] {}: collision = [{number}]: {why}", cutter.name);
            Err(NumberedError::new("E2112", what, "an input from 0 to 15 with `use = \"plain\"`, for this use only"))
        };
        if cutters.iter().any(|other| other.proof.is_some_and(|proof| proof.input == number)) {
            return refuse("it is the input of `ok`");
        }
        match card.inputs.get_mut(usize::from(number)) {
            None => return refuse("there is no such input"),
            Some(input) if input.used_for == InputUse::Plain => {
                input.used_for = InputUse::Collision { only_lit: false };
            }
            // two cutters on one head share a breakaway
            Some(input) if matches!(input.used_for, InputUse::Collision { .. }) => {}
            Some(_) => return refuse("it has another use in its [[card.input]]"),
        }
    }
    Ok(())
}

/// Checks that the inputs of height control exist and have no other use, and that the sheet is sensed.
///
/// # Errors
/// `E2112`
pub(crate) fn check_height_inputs(cutters: &[CutterConfig], card: &CardConfig) -> Result<(), NumberedError> {
    for cutter in cutters {
        let Some(height) = &cutter.height else { continue };
        let refuse = |what: &str, remedy: &str| {
            Err(NumberedError::new("E2112", format!("[[cutter]] {}: height: {what}", cutter.name), remedy.to_owned()))
        };
        if !cutter.sense.is_used() {
            return refuse("the sheet is not sensed", "`sense` with `contacts`: a cut begins at a known height");
        }
        let digital = match (height.volts, height.up, height.down, height.enable) {
            (None, None, None, Some(_)) => {
                if cutter.sense.skip_mm > 0.0 {
                    let what = "the height is not known behind a contour that another controller has followed";
                    return refuse(what, "`skip_mm = 0` in `sense`: every start senses the sheet");
                }
                continue;
            }
            (Some(number), None, None, None) => {
                if !card.analog_inputs.iter().any(|input| input.number == number) {
                    let what = format!("volts = {number}: there is no such analog input");
                    return refuse(&what, "`[[card.analog_input]]` with this number and the unit V");
                }
                continue;
            }
            (None, Some(up), Some(down), None) if up != down => [("up", up), ("down", down)],
            _ => return refuse("it has no source, or two", "either `volts`, or `up` and `down`, or `enable`"),
        };
        for (key, number) in digital {
            let is_plain = card.inputs.get(usize::from(number)).is_some_and(|of| of.used_for == InputUse::Plain);
            let is_proof = cutters.iter().any(|other| other.proof.is_some_and(|proof| proof.input == number));
            if !is_plain || is_proof {
                let what = format!("{key} = {number}: there is no such input, or it has another use");
                return refuse(&what, "an input from 0 to 15 with `use = \"plain\"`, for this use only");
            }
        }
    }
    Ok(())
}
