//! `Devices.xml`, by which MTConnect's agent knows the items of a machine.
//!
//! Invariant: every item that is sent is in it, with its key as `id`.

use std::fmt::Write as _;

use super::data_item::{Category, DataItem, Part, data_items};
use crate::machine_report::ReportedAxis;

/// The device file of a machine of this name with these axes.
#[must_use]
pub fn devices_xml(name: &str, axes: &[ReportedAxis]) -> String {
    let items = data_items(axes);
    let of = |part: Part, indent: &str| {
        let items = items.iter().filter(|item| item.part == part);
        let lines: String = items.map(|item| format!("{indent}  {}\n", element(item))).collect();
        format!("{indent}<DataItems>\n{lines}{indent}</DataItems>\n")
    };
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <MTConnectDevices xmlns=\"urn:mtconnect.org:MTConnectDevices:2.0\" \
         xmlns:x=\"urn:retrace:MTConnectDevices:2.0\">\n  \
         <Header creationTime=\"1970-01-01T00:00:00Z\" sender=\"retrace\" instanceId=\"0\" version=\"2.0\" \
         bufferSize=\"131072\" assetBufferSize=\"1\" assetCount=\"0\" \
         deviceModelChangeTime=\"1970-01-01T00:00:00Z\"/>\n  \
         <Devices>\n    <Device id=\"device\" name=\"{name}\" uuid=\"retrace-{name}\">\n      \
         <Description manufacturer=\"retrace\">{name}</Description>\n",
        name = escaped(name)
    );
    text += &of(Part::Device, "      ");
    text += "      <Components>\n        <Axes id=\"axes\" name=\"axes\">\n          <Components>\n";
    for (index, axis) in axes.iter().enumerate() {
        let (kind, letter) = (if axis.is_linear { "Linear" } else { "Rotary" }, axis.letter.to_ascii_uppercase());
        let _ = writeln!(text, "            <{kind} id=\"axis{}\" name=\"{letter}\">", axis.letter);
        text += &of(Part::Axis(index), "              ");
        let _ = writeln!(text, "            </{kind}>");
    }
    text += "            <Rotary id=\"spindle\" name=\"S\">\n";
    text += &of(Part::Spindle, "              ");
    text += "            </Rotary>\n          </Components>\n        </Axes>\n        \
             <Controller id=\"controller\" name=\"controller\">\n";
    text += &of(Part::Controller, "          ");
    text += "          <Components>\n            <Path id=\"path\" name=\"path\">\n";
    text += &of(Part::Path, "              ");
    text + "            </Path>\n          </Components>\n        </Controller>\n      </Components>\n    </Device>\n  \
            </Devices>\n</MTConnectDevices>\n"
}

fn element(item: &DataItem) -> String {
    let category = match item.category {
        Category::Event => "EVENT",
        Category::Sample => "SAMPLE",
        Category::Condition => "CONDITION",
    };
    let mut text = format!("<DataItem category=\"{category}\" id=\"{}\" type=\"{}\"", item.key, item.kind);
    let mut attribute = |name: &str, value: Option<&str>| {
        if let Some(value) = value {
            let _ = write!(text, " {name}=\"{value}\"");
        }
    };
    attribute("subType", item.sub_kind);
    attribute("units", item.units.map(|[units, _]| units));
    attribute("nativeUnits", item.units.map(|[_, native]| native));
    attribute("coordinateSystem", item.coordinate_system);
    text + "/>"
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
