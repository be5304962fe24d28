//! Height control on the screens: the arc voltage, what the operator has added to its target, what the control does.
//!
//! Invariant: a voltage that is not known is not shown.

use retrace_link::{HeightState, channel};

use crate::model::ScreenModel;

/// Height control as it is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightFigures {
    /// What it does, as an identifier: `off`, `waiting`, `active`, `held`, `at_limit`.
    pub state: &'static str,
    /// Whether the operator lets it act.
    pub is_on: bool,
    /// The arc voltage, V.
    pub volts: Option<f64>,
    /// What the operator adds to the target, V.
    pub offset_volts: f64,
    /// How far the tool is above its path, mm.
    pub layer_mm: f64,
}

impl HeightFigures {
    /// What the model shows; `None` on a machine without height control.
    #[must_use]
    pub fn of(model: &ScreenModel) -> Option<Self> {
        let facts = model.facts.height.as_ref()?;
        let axis = model.facts.layer_axis.and_then(|axis| model.facts.axes.get(axis));
        let offset = model.output(channel::HEIGHT_OFFSET);
        let is_on = offset != channel::HEIGHT_STAYS;
        let input = facts.volts.as_ref();
        let reading = input.and_then(|input| model.analog_inputs.get(usize::from(input.number)).copied().flatten());
        Some(Self {
            state: match model.height {
                HeightState::Off => "off",
                HeightState::Waiting => "waiting",
                HeightState::Active => "active",
                HeightState::Held => "held",
                HeightState::AtLimit => "at_limit",
            },
            is_on,
            volts: input.zip(reading).map(|(input, reading)| input.amount(reading)),
            offset_volts: input.filter(|_| is_on).map_or(0.0, |input| f64::from(offset) * input.per_reading()),
            layer_mm: axis.map_or(0.0, |axis| model.layer as f64 / axis.pulses_per_mm),
        })
    }

    /// One line for the terminal screen.
    #[must_use]
    pub fn text(&self) -> String {
        let state = match self.state {
            _ if !self.is_on => "OFF by the operator",
            "off" => "off",
            "waiting" => "waits for the feed",
            "active" => "active",
            "held" => "held",
            _ => "AT THE END OF ITS RANGE",
        };
        let volts = self.volts.map(|volts| format!(" · arc {volts:.1} V")).unwrap_or_default();
        // −0 as 0
        let offset = (self.offset_volts * 100.0).round() / 100.0 + 0.0;
        let by_hand = if offset == 0.0 { String::new() } else { format!(" · {offset:+} V by hand") };
        format!("height control {state}{volts}{by_hand} · layer {:+.2} mm", self.layer_mm + 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_says_what_the_control_does() {
        let figures =
            HeightFigures { state: "active", is_on: true, volts: Some(115.26), offset_volts: 0.0, layer_mm: -70.5 };
        assert_eq!(figures.text(), "height control active · arc 115.3 V · layer -70.50 mm");
        let by_hand = HeightFigures { offset_volts: 1.999, volts: None, state: "at_limit", ..figures.clone() };
        assert_eq!(by_hand.text(), "height control AT THE END OF ITS RANGE · +2 V by hand · layer -70.50 mm");
        let off = HeightFigures { is_on: false, layer_mm: -0.0, ..figures };
        assert_eq!(off.text(), "height control OFF by the operator · arc 115.3 V · layer +0.00 mm");
    }
}
