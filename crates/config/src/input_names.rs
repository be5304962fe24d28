//! Names of inputs, for screens.
//!
//! Invariant: every input that the machine file gives a use has a name, and no other one has.

use retrace_link::InputUse;

use crate::machine_config::MachineConfig;

impl MachineConfig {
    /// Inputs that the machine uses, with what each of them is: `X lower limit`, `torch ok`, `door`.
    #[must_use]
    pub fn input_names(&self) -> Vec<(u8, String)> {
        (0..)
            .zip(&self.card.inputs)
            .filter_map(|(number, input)| Some((number, self.input_name(number, input.used_for)?)))
            .collect()
    }

    fn input_name(&self, number: u8, used_for: InputUse) -> Option<String> {
        let axis = |axis: u8| self.axes.get(usize::from(axis)).map_or('?', |axis| axis.name).to_ascii_uppercase();
        let of_cutter = || self.cutters.iter().find(|cutter| cutter.proof.is_some_and(|proof| proof.input == number));
        let name = match used_for {
            InputUse::Plain => match of_cutter() {
                Some(cutter) => format!("{} ok", cutter.name),
                None if self.card.declares_input(number) => format!("input {number}"),
                None => return None,
            },
            InputUse::Limit { axis: index, upper: false } => format!("{} lower limit", axis(index)),
            InputUse::Limit { axis: index, upper: true } => format!("{} upper limit", axis(index)),
            InputUse::Home { axis: index } => format!("{} home", axis(index)),
            InputUse::Door => "door".into(),
            InputUse::EmergencyStop => "emergency-stop chain".into(),
            InputUse::Probe => "probe".into(),
            InputUse::Collision { only_lit: false } => "collision".into(),
            InputUse::Collision { only_lit: true } => "float switch".into(),
        };
        Some(name)
    }
}

#[cfg(test)]
mod tests {
    use crate::MachineConfig;

    #[test]
    fn inputs_are_named_by_their_use() {
        let text = "[[card.input]]\nnumber = 0\nuse = \"lower-limit\"\naxis = \"x\"\n\
                    [[card.input]]\nnumber = 2\nuse = \"door\"\n[[card.input]]\nnumber = 5\nuse = \"plain\"\n";
        let machine = MachineConfig::parse(text, "machine.toml").expect("valid");
        let names = machine.input_names();
        let names: Vec<(u8, &str)> = names.iter().map(|(number, name)| (*number, name.as_str())).collect();
        assert_eq!(names, [(0, "X lower limit"), (2, "door"), (5, "input 5")]);
    }
}
