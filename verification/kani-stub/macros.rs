//! The attributes of the stub of the `kani` crate.
//!
//! Invariant: a function marked as a proof is changed only by being made public, so that a driver can call it.
#![forbid(unsafe_code)]

extern crate proc_macro;

use proc_macro::{Ident, Span, TokenStream, TokenTree};
use std::io::Write;

/// Environment variable with the file that receives the names of the proofs, one per line.
const NOTES: &str = "RETRACE_STUB_PROOFS";

/// Marks a proof: writes down its name, and makes it public.
#[proc_macro_attribute]
pub fn proof(_options: TokenStream, function: TokenStream) -> TokenStream {
    let text = function.to_string();
    let name = text.split_once("fn ").and_then(|(_, rest)| rest.split(['(', ' ']).next()).unwrap_or_default();
    if let Ok(path) = std::env::var(NOTES) {
        let file = std::fs::OpenOptions::new().create(true).append(true).open(&path);
        let noted = file.and_then(|mut file| writeln!(file, "{name}"));
        assert!(noted.is_ok(), "{path} cannot be written");
    }
    // other attributes precede the function's keyword
    let is_keyword = |token: &TokenTree| token.to_string() == "fn";
    let mut tokens: Vec<TokenTree> = function.into_iter().collect();
    let at = tokens.iter().position(is_keyword).expect("a proof is a function");
    tokens.insert(at, TokenTree::Ident(Ident::new("pub", Span::call_site())));
    tokens.into_iter().collect()
}

/// The bound of a proof's loops: without effect where nothing is proved.
#[proc_macro_attribute]
pub fn unwind(bound: TokenStream, function: TokenStream) -> TokenStream {
    assert!(bound.to_string().parse::<u32>().is_ok(), "unwind takes a number");
    function
}
