//! `retrace shop key`: the key with which a computer of the shop signs in and signs its jobs.
//!
//! Invariant: a seed is never printed, and no file is overwritten.

use std::path::Path;

use retrace_config::NumberedError;

/// Prints the public key of a seed; with `is_new` makes a seed in a new file first.
///
/// # Errors
/// `E5036` where the file cannot be read or written, or has no seed.
pub fn run(file: &Path, is_new: bool) -> Result<(), NumberedError> {
    let public = if is_new { retrace_shop::new_seed(file)? } else { retrace_shop::public_key(file)? };
    crate::out::line(public);
    Ok(())
}
