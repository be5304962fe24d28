//! Height of the tool on the screens: path and layer; the arc voltage with its target, and what height control does.
//!
//! Invariant: a voltage or a height that is not known is not shown.

use retrace_controller::CutterState;
use retrace_link::{HeightState, channel};

use crate::model::{ScreenModel, ScreenStage};

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

/// Follows where the sheet was sensed: a start lights its cutter at the pierce height over it.
pub(crate) fn follow_sheet(model: &mut ScreenModel, before: CutterState, state: CutterState) {
    match (before, state) {
        (_, CutterState::Sensing) => (model.sheet_mm, model.tool_is_down) = (None, true),
        (CutterState::Sensing, CutterState::Igniting | CutterState::Piercing | CutterState::Cutting) => {
            model.sheet_mm = sheet_below(model);
        }
        _ => {}
    }
}

/// Position of the sheet below a tool that is at the pierce height, mm of the machine. A restart may begin at another
/// height, and which contour begins is not known yet: where the program has several pierce heights, this one is not.
fn sheet_below(model: &ScreenModel) -> Option<f64> {
    let axis = model.facts.layer_axis.filter(|_| model.restarting.is_none())?;
    let mut heights =
        model.facts.contours.as_ref()?.materials.iter().map(|of| Some(of.material.as_ref()?.pierce_height_mm));
    let pierce_mm = heights.next()?.filter(|mm| *mm > 0.0)?;
    heights.all(|mm| mm == Some(pierce_mm)).then(|| model.machine_mm(axis) - pierce_mm)
}

/// Height of the tool in mm over the sheet where it was sensed last; `None` where it is not known: before that, where
/// the arc voltage moves the tool, and behind a pause.
#[must_use]
pub fn over_sheet_mm(model: &ScreenModel) -> Option<f64> {
    let axis = model.facts.layer_axis?;
    let is_counted = matches!(model.height, HeightState::Off | HeightState::Waiting);
    model.sheet_mm.filter(|_| is_counted && model.stage == ScreenStage::Job).map(|mm| model.machine_mm(axis) - mm)
}

/// The height over the sheet of a machine that senses it, in a job, for the title of the positions.
pub(crate) fn over_sheet_text(model: &ScreenModel) -> Option<String> {
    let is_shown = model.facts.layer_axis.is_some() && model.stage == ScreenStage::Job;
    is_shown.then(|| match over_sheet_mm(model) {
        Some(mm) => format!("over sheet {:.2}", mm + 0.0),
        None if model.height == HeightState::Active => "height by voltage".into(),
        None => "over sheet ?".into(),
    })
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

    /// A torch over its sheet, whose surface is at -70 mm.
    fn over_the_sheet() -> ScreenModel {
        let machine = retrace_config::MachineConfig::built_in().expect("valid");
        let facts = crate::ProgramFacts::of(&machine, "part.ngc", "M2\n");
        let mut model = ScreenModel::new(std::sync::Arc::new(crate::ProgramFacts { layer_axis: Some(2), ..facts }));
        model.counts[2] = (-66.2 * model.facts.axes[2].pulses_per_mm).round() as i64;
        (model.stage, model.sheet_mm) = (ScreenStage::Job, Some(-70.0));
        model
    }

    #[test]
    fn the_height_over_the_sheet_is_shown_only_where_it_is_known() {
        let mut model = over_the_sheet();
        let shown = |model: &ScreenModel| over_sheet_text(model).unwrap_or_default();
        assert_eq!(shown(&model), "over sheet 3.80");
        for (height, text) in [
            (HeightState::Waiting, "over sheet 3.80"),
            (HeightState::Active, "height by voltage"),
            (HeightState::Held, "over sheet ?"),
            (HeightState::AtLimit, "over sheet ?"),
            (HeightState::Off, "over sheet 3.80"),
        ] {
            model.height = height;
            assert_eq!(shown(&model), text, "{height:?}");
        }
        follow_sheet(&mut model, CutterState::Off, CutterState::Sensing);
        assert_eq!(shown(&model), "over sheet ?");
        // Without the height of its material nothing is known of what was found.
        follow_sheet(&mut model, CutterState::Sensing, CutterState::Igniting);
        assert_eq!(shown(&model), "over sheet ?");
        model.stage = ScreenStage::Setup;
        assert_eq!(over_sheet_text(&model), None);
    }

    /// A torch that was stopped at the sheet is said to be there, until it is moved.
    #[test]
    fn a_torch_that_is_left_at_the_sheet_is_said_to_be_down() {
        let mut model = over_the_sheet();
        model.end("stopped");
        assert_eq!(model.stage, ScreenStage::Ended("stopped".into()), "it was not at the sheet");
        model.stage = ScreenStage::Job;
        follow_sheet(&mut model, CutterState::Off, CutterState::Sensing);
        model.end("stopped");
        let down = "the tool is DOWN: u, then PgUp raises it; stopped";
        assert_eq!(model.stage, ScreenStage::Ended(down.into()));
        model.stage = ScreenStage::Setup;
        let reason = crate::status_line::of(&model).reason;
        assert!(reason.starts_with("the tool is DOWN: PgUp raises it"), "{reason}");
    }

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
