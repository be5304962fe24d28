//! The JSON schemas of the messages: the ones in `docs/api` are those of the types.
//!
//! Invariant: only `RETRACE_BLESS=1` rewrites them.

use std::fs;
use std::path::Path;

use crate::answers::{ControlView, DoneView, RefusedView, RejectedView, WhereView};
use crate::hello::HelloView;
use crate::messages::PageMessage;
use crate::path_levels::PathView;
use crate::shop_job_list::ShopJobList;
use crate::snapshot::{LiveView, LogView, StateView};
use crate::table_requests::{OffsetOrder, OffsetTable, ToolOrder, ToolRows};
use crate::watched_folder::OfferView;

#[test]
fn the_schemas_in_the_docs_are_those_of_the_types() {
    let schemas = [
        ("page-message", schemars::schema_for!(PageMessage)),
        ("state", schemars::schema_for!(StateView)),
        ("live", schemars::schema_for!(LiveView)),
        ("log", schemars::schema_for!(LogView)),
        ("path", schemars::schema_for!(PathView)),
        ("hello", schemars::schema_for!(HelloView)),
        ("control", schemars::schema_for!(ControlView)),
        ("done", schemars::schema_for!(DoneView)),
        ("refused", schemars::schema_for!(RefusedView)),
        ("rejected", schemars::schema_for!(RejectedView)),
        ("offer", schemars::schema_for!(OfferView)),
        ("where", schemars::schema_for!(WhereView)),
        ("offsets", schemars::schema_for!(OffsetTable)),
        ("offsets-change", schemars::schema_for!(OffsetOrder)),
        ("tools", schemars::schema_for!(ToolRows)),
        ("shop-jobs", schemars::schema_for!(ShopJobList)),
        ("tools-change", schemars::schema_for!(ToolOrder)),
    ];
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/api");
    for (name, schema) in schemas {
        let path = folder.join(format!("{name}.schema.json"));
        let text = serde_json::to_string_pretty(&schema).expect("a schema can be written") + "\n";
        if std::env::var_os("RETRACE_BLESS").is_some() {
            fs::write(&path, &text).expect("the schema can be written");
        }
        let found = fs::read_to_string(&path).unwrap_or_default();
        assert!(found == text, "{name} has changed; to write it: RETRACE_BLESS=1 cargo test -p retrace-serve schemas");
    }
}
