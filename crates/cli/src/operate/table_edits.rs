//! Offsets and tools of the modal context, as screens show and replace them.
//!
//! Invariant: a change applies to the tables that the operator saw, or not at all.

use std::sync::Arc;

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::ModalContext;
use retrace_tui::{ScreenModel, TableChange, WorkTables, lock_model};
use std::sync::Mutex;

/// Tables of this context, with the names that the model has for its tools.
fn tables(model: &ScreenModel, machine: &MachineConfig, context: &ModalContext) -> WorkTables {
    let name_of = |number: u32| {
        let names = &model.facts.tool_names;
        i32::try_from(number).ok().and_then(|number| names.get(&number)).cloned().unwrap_or_default()
    };
    WorkTables::of(machine, context.modal_snapshot(), name_of)
}

/// Shows the tables of this context, if they have changed.
pub(super) fn show(model: &Mutex<ScreenModel>, machine: &MachineConfig, context: &ModalContext) {
    let mut model = lock_model(model);
    let tables = tables(&model, machine, context);
    if *model.tables != tables {
        model.tables = Arc::new(tables);
        model.changes += 1;
    }
}

/// Replaces the tables of this context.
///
/// # Errors
/// `E2422` where they are not those that the operator saw.
pub(super) fn apply(
    model: &Mutex<ScreenModel>,
    machine: &MachineConfig,
    context: &mut ModalContext,
    change: &TableChange,
) -> Result<(), NumberedError> {
    if tables(&lock_model(model), machine, context) != change.before {
        let cause = "offsets or tools were changed in between";
        return Err(NumberedError::new("E2422", cause, "read the table again, then change it"));
    }
    let (parameters, tools) = change.applied_to(machine, context.modal_snapshot());
    context.set_tables(parameters, tools);
    Ok(())
}
