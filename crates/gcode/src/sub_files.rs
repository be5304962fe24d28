//! Subprograms in files of their own.
//!
//! Invariant: the source alone decides which file a name refers to.

use crate::text::Text;
use std::fmt::Debug;

/// Source of subprograms in files of their own.
pub trait SubFiles: Debug + Send + Sync {
    /// Returns the file of the subprogram of this name (in lower case), if it exists.
    fn find(&self, name: &str) -> Option<SubFile>;
}

/// The file of a subprogram.
#[derive(Clone, Debug)]
pub struct SubFile {
    /// Name of the file for messages.
    pub name: String,
    /// Text of the file, or why it cannot be read.
    pub text: Result<Text, String>,
}
