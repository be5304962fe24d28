//! `retrace shop` cannot move a machine: its files name nothing that starts, resumes, stops or overrides (SHP-12,
//! SHP-13). The arrows of the crates, in `directions`, say the same of the crate `shop`.

use super::Finding;
use retrace_task_support::tree::{Tree, code_only};

/// The files of the command.
const FOLDER: &str = "crates/cli/src/shop/";
/// Crates and modules that can move a machine.
const FORBIDDEN: &[&str] = &[
    "retrace_controller",
    "retrace_core",
    "retrace_hal_serial",
    "retrace_hal_sim",
    "retrace_link",
    "retrace_motion",
    "retrace_serve",
    "retrace_tui",
    "crate::job_runner",
    "crate::job_spec",
    "crate::linked_card",
    "crate::manual",
    "crate::operate",
    "crate::resume",
    "crate::run",
    "crate::serve",
    "crate::shop_job_start",
];
/// The only command that a process of the shop may run.
const CHECK: &str = ".arg(\"check\")";

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (path, text) in tree.rust().filter(|(path, _)| path.starts_with(FOLDER)) {
        for (index, line) in code_only(text).lines().enumerate() {
            for name in FORBIDDEN.iter().filter(|name| line.contains(**name)) {
                let message = format!("`{name}` can move a machine, and `retrace shop` must not");
                findings.push(Finding::at(path, index + 1, message));
            }
        }
        if text.contains("Command::new(") && !text.contains(CHECK) {
            findings.push(Finding::of_file(path, format!("a process of `retrace shop` is a check alone: `{CHECK}`")));
        }
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shop_command_that_could_move_a_machine_is_refused() {
        let tree = Tree::of(&[
            ("crates/cli/src/shop/agent.rs", "// crate::run is named\nuse crate::{a, b};\nuse crate::run::run;\n"),
            (
                "crates/cli/src/shop/start.rs",
                "use retrace_controller::OperatorCommand;\nCommand::new(me).arg(\"run\");",
            ),
            ("crates/cli/src/shop/job_check.rs", "Command::new(me).arg(\"check\");\n"),
            ("crates/cli/src/run.rs", "use retrace_controller::JobStart;\n"),
        ]);
        let places: Vec<(String, usize)> =
            find(&tree).into_iter().map(|finding| (finding.path, finding.line)).collect();
        let at = |name: &str, line| (format!("crates/cli/src/shop/{name}"), line);
        assert_eq!(places, [at("agent.rs", 3), at("start.rs", 1), at("start.rs", 0)]);
    }
}
