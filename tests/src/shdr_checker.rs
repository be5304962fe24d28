//! Checker of an SHDR adapter, written from the text of the MTConnect standard (version 2.0) and of its agent's
//! protocol.
//!
//! Invariant: it knows nothing of the adapter but its device file and its lines.

use std::collections::BTreeMap;

use roxmltree::Document;

/// Items of a device file: type and category by `id`.
pub type DeviceItems = BTreeMap<String, (String, String)>;

/// Reads a device file, with the structure that the standard's schema asks for.
///
/// # Errors
/// What is wrong with it.
pub fn device_items(xml: &str) -> Result<DeviceItems, String> {
    let document = Document::parse(xml).map_err(|error| error.to_string())?;
    let root = document.root_element();
    let named = |name: &'static str| root.descendants().filter(move |node| node.tag_name().name() == name);
    if root.tag_name().name() != "MTConnectDevices" || root.tag_name().namespace().is_none() {
        return Err(format!("the root is {:?}", root.tag_name()));
    }
    let elements: Vec<&str> =
        root.children().filter(|node| node.is_element()).map(|node| node.tag_name().name()).collect();
    if elements != ["Header", "Devices"] {
        return Err(format!("the root has {elements:?}"));
    }
    for device in named("Device") {
        for attribute in ["id", "name", "uuid"] {
            device
                .attribute(attribute)
                .filter(|value| !value.is_empty())
                .ok_or(format!("no {attribute} of a device"))?;
        }
    }
    for list in ["DataItems", "Components"] {
        if let Some(empty) = named(list).find(|node| !node.has_children()) {
            return Err(format!(
                "{list} of {:?} is empty",
                empty.parent().map(|node| node.tag_name().name().to_owned())
            ));
        }
    }
    let mut ids: Vec<&str> = root.descendants().filter_map(|node| node.attribute("id")).collect();
    let count = ids.len();
    ids.sort_unstable();
    ids.dedup();
    if ids.len() != count {
        return Err("an id is there twice".into());
    }
    let mut items = DeviceItems::new();
    for item in named("DataItem") {
        let of = |name: &str| item.attribute(name).map(str::to_owned).ok_or(format!("a data item without {name}"));
        let (id, kind, category) = (of("id")?, of("type")?, of("category")?);
        if !["EVENT", "SAMPLE", "CONDITION"].contains(&category.as_str()) {
            return Err(format!("{id} has the category {category}"));
        }
        if category == "SAMPLE" && item.attribute("units").is_none() {
            return Err(format!("{id} is a sample without units"));
        }
        items.insert(id, (kind, category));
    }
    Ok(items)
}

/// Values that an item of this type may have; none where it may have any, or is a number.
fn allowed(kind: &str) -> Option<&'static [&'static str]> {
    Some(match kind {
        "AVAILABILITY" => &["AVAILABLE"],
        "EMERGENCY_STOP" => &["ARMED", "TRIGGERED"],
        "EXECUTION" => &[
            "READY",
            "ACTIVE",
            "INTERRUPTED",
            "WAIT",
            "FEED_HOLD",
            "STOPPED",
            "OPTIONAL_STOP",
            "PROGRAM_STOPPED",
            "PROGRAM_COMPLETED",
            "PROGRAM_OPTIONAL_STOP",
        ],
        "CONTROLLER_MODE" => &["AUTOMATIC", "MANUAL", "MANUAL_DATA_INPUT", "SEMI_AUTOMATIC", "EDIT"],
        "x:RETRACE" => &["NONE", "FORWARD", "REVERSE"],
        _ => return None,
    })
}

fn is_number(kind: &str) -> bool {
    let numbers = ["POSITION", "ANGLE", "PATH_FEEDRATE", "PATH_FEEDRATE_OVERRIDE", "ROTARY_VELOCITY", "LINE_NUMBER"];
    numbers.contains(&kind) || ["PART_COUNT", "TOOL_NUMBER", "x:REACHED"].contains(&kind)
}

/// Fields of a line: a field in quotes may contain vertical bars behind backslashes.
fn fields(line: &str) -> Result<Vec<String>, String> {
    let (mut fields, mut field, mut quoted) = (Vec::new(), String::new(), false);
    let mut letters = line.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if field.is_empty() && !quoted => quoted = true,
            '"' if quoted && letters.peek().is_none_or(|&next| next == '|') => quoted = false,
            '\\' if quoted && letters.peek() == Some(&'|') => field.extend(letters.next()),
            '|' if quoted => return Err(format!("a vertical bar within quotes: {line}")),
            '|' => fields.push(std::mem::take(&mut field)),
            letter if letter.is_control() => return Err(format!("a control character: {line:?}")),
            letter => field.push(letter),
        }
    }
    if quoted {
        return Err(format!("quotes that do not end: {line}"));
    }
    fields.push(field);
    Ok(fields)
}

/// What an agent knows of a machine.
#[derive(Clone, Debug, Default)]
pub struct ShdrAgentState {
    /// Version of the protocol, once it was told.
    pub version: Option<String>,
    /// Present values by key; of a condition its level and its code.
    pub values: BTreeMap<String, String>,
    /// Number of lines.
    pub lines: u64,
    time: String,
}

impl ShdrAgentState {
    /// Takes a line, without its line end.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn take(&mut self, line: &str, items: &DeviceItems) -> Result<(), String> {
        self.lines += 1;
        if let Some(command) = line.strip_prefix("* ") {
            if let Some(version) = command.strip_prefix("shdrVersion: ") {
                self.version = Some(version.to_owned());
            } else if !command.starts_with("adapterVersion: ") && !command.starts_with("PONG ") {
                return Err(format!("an unknown command: {line}"));
            }
            return Ok(());
        }
        let fields = fields(line)?;
        let time = &fields[0];
        let is_utc =
            time.len() == 24 && time.ends_with('Z') && time.as_bytes()[10] == b'T' && time.as_bytes()[19] == b'.';
        if !is_utc || *time < self.time {
            return Err(format!("the time {time} behind {}", self.time));
        }
        self.time.clone_from(time);
        let of = |key: &str| items.get(key).ok_or(format!("{key} is not in the device file: {line}"));
        let (_, category) = of(fields.get(1).ok_or(format!("no key: {line}"))?)?;
        if category == "CONDITION" {
            let [_, key, level, code, severity, qualifier, _text] = fields.as_slice() else {
                return Err(format!("a condition of {} fields: {line}", fields.len()));
            };
            let is_fault = ["WARNING", "FAULT"].contains(&level.as_str());
            let is_known = is_fault || ["NORMAL", "UNAVAILABLE"].contains(&level.as_str());
            if !is_known || is_fault == code.is_empty() || !severity.is_empty() || !qualifier.is_empty() {
                return Err(format!("not a condition: {line}"));
            }
            self.values.insert(key.clone(), format!("{level} {code}").trim_end().to_owned());
            return Ok(());
        }
        if fields.len() % 2 == 0 {
            return Err(format!("a key without a value: {line}"));
        }
        for pair in fields[1..].chunks_exact(2) {
            let (kind, category) = of(&pair[0])?;
            let value = pair[1].as_str();
            let is_valid = value == "UNAVAILABLE"
                || match allowed(kind) {
                    Some(values) => values.contains(&value),
                    None if is_number(kind) => value.parse::<f64>().is_ok_and(f64::is_finite),
                    None => !value.is_empty(),
                };
            if !is_valid || category == "CONDITION" {
                return Err(format!("{} is {value:?}: {line}", pair[0]));
            }
            self.values.insert(pair[0].clone(), value.to_owned());
        }
        Ok(())
    }
}
