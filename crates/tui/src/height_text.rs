//! Height of the tool on the screens: path and layer; the arc voltage with its target, and what height control does.
//!
//! Invariant: a voltage or a height that is not known is not shown.

use retrace_link::{HeightState, channel};

use crate::model::ScreenModel;

/// Height control as it is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightFigures {
    /// What it does, as an identifier: `off`, `waiting`, `active`, `held`, `at_limit`.
    pub state: &'static str,
    /// Whether the operator lets it act.
    pub is_on: bool,
    /// Whether another controller moves the axis while it is active.
    pub is_external: bool,
    /// The arc voltage, V.
    pub volts: Option<f64>,
    /// The voltage that it aims at, V: that of the material of the contour that is cut, and what the operator adds.
    /// Not known between contours, and where the card samples it.
    pub target_volts: Option<f64>,
    /// What the operator adds to the target, V.
    pub offset_volts: f64,
    /// How far the tool is above its path, mm.
    pub layer_mm: Option<f64>,
}

/// Height of the tool on a machine that senses the sheet: the sum of path and layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolHeight {
    /// Index of the tool axis.
    pub axis: usize,
    /// Work position of the axis on the path, mm, once the card has reported it.
    pub path_mm: Option<f64>,
    /// What sensing and height control add to it, mm, once the card has reported it. Not known where another
    /// controller moves the axis.
    pub layer_mm: Option<f64>,
}

impl ToolHeight {
    /// What the model shows; `None` on a machine that senses no sheet.
    #[must_use]
    pub fn of(model: &ScreenModel) -> Option<Self> {
        let axis = model.facts.layer_axis?;
        let facts = model.facts.axes.get(axis)?;
        let is_external = model.facts.height.as_ref().is_some_and(|height| height.is_external);
        let counted_mm = (model.period > 0).then(|| model.layer as f64 / facts.pulses_per_mm);
        let path_mm = counted_mm.map(|layer_mm| model.work_mm(axis) - layer_mm);
        Some(Self { axis, path_mm, layer_mm: counted_mm.filter(|_| !is_external) })
    }
}

impl HeightFigures {
    /// What the model shows; `None` on a machine without height control.
    #[must_use]
    pub fn of(model: &ScreenModel) -> Option<Self> {
        let facts = model.facts.height.as_ref()?;
        let offset = model.output(channel::HEIGHT_OFFSET);
        let is_on = offset != channel::HEIGHT_STAYS;
        let input = facts.volts.as_ref();
        let reading = input.and_then(|input| model.analog_inputs.get(usize::from(input.number)).copied().flatten());
        let offset_volts = input.filter(|_| is_on).map_or(0.0, |input| f64::from(offset) * input.per_reading());
        Some(Self {
            state: match model.height {
                HeightState::Off => "off",
                HeightState::Waiting => "waiting",
                HeightState::Active => "active",
                HeightState::Held => "held",
                HeightState::AtLimit => "at_limit",
            },
            is_on,
            is_external: facts.is_external,
            volts: input.zip(reading).map(|(input, reading)| input.amount(reading)),
            target_volts: input.and_then(|_| material_volts(model)).map(|volts| volts + offset_volts),
            offset_volts,
            layer_mm: ToolHeight::of(model).and_then(|height| height.layer_mm),
        })
    }

    /// One line for the terminal screen.
    #[must_use]
    pub fn text(&self) -> String {
        let state = match self.state {
            _ if !self.is_on => "OFF by the operator",
            "off" => "off",
            "waiting" => "waits for the feed",
            "active" if self.is_external => "by the external controller",
            "active" => "active",
            "held" => "held",
            _ => "AT THE END OF ITS RANGE",
        };
        let volts = self.volts.map(|volts| format!(" · arc {volts:.1} V")).unwrap_or_default();
        // −0 as 0
        let offset = (self.offset_volts * 100.0).round() / 100.0 + 0.0;
        let by_hand = if offset == 0.0 { String::new() } else { format!(" · {offset:+} V by hand") };
        let layer = self.layer_mm.map_or_else(|| "–".into(), |mm| format!("{:+.2} mm", mm + 0.0));
        format!("height control {state}{volts}{by_hand} · layer {layer}")
    }
}

/// Arc voltage of the material of the contour that is cut, V, where height control aims at it.
fn material_volts(model: &ScreenModel) -> Option<f64> {
    let (number, _) = model.contours.current()?;
    let material = model.facts.contours.as_ref()?.contour(number)?.material.as_ref()?;
    (material.height_control && material.volts > 0.0).then_some(material.volts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_says_what_the_control_does() {
        let figures = HeightFigures {
            state: "active",
            is_on: true,
            is_external: false,
            volts: Some(115.26),
            target_volts: Some(115.0),
            offset_volts: 0.0,
            layer_mm: Some(-70.5),
        };
        assert_eq!(figures.text(), "height control active · arc 115.3 V · layer -70.50 mm");
        let by_hand = HeightFigures { offset_volts: 1.999, volts: None, state: "at_limit", ..figures.clone() };
        assert_eq!(by_hand.text(), "height control AT THE END OF ITS RANGE · +2 V by hand · layer -70.50 mm");
        let off = HeightFigures { is_on: false, layer_mm: Some(-0.0), ..figures.clone() };
        assert_eq!(off.text(), "height control OFF by the operator · arc 115.3 V · layer +0.00 mm");
        let unknown = HeightFigures { volts: None, layer_mm: None, ..figures };
        assert_eq!(unknown.text(), "height control active · layer –");
        let external = HeightFigures { is_external: true, ..unknown };
        assert_eq!(external.text(), "height control by the external controller · layer –");
    }
}
