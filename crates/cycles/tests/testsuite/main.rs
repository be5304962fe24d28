//! The integration tests of `retrace-cycles`, in one binary, which links once.

mod common;
mod documented;
mod drilling;
mod language;
mod library;
mod patterns;
mod properties;
mod stock;
mod stock_cases;
mod stock_judge;
mod stock_paths;
mod stock_worked_example;
