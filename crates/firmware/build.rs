//! The linker's memory map of the microcontroller that was chosen.
//!
//! Invariant: no map goes beyond the smallest part of its kind (RM0090 and RM0368, *Memory map*; the data sheets'
//! ordering tables).

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let has = |board: &str| env::var_os(format!("CARGO_FEATURE_{board}")).is_some();
    for (board, script) in [("RP2040", "rp2040.x"), ("RP2350", "rp2350.x")] {
        println!("cargo:rerun-if-changed={script}");
        if has(board) {
            let root = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
            println!("cargo:rustc-link-arg-bins=-T{root}/{script}");
            // else the linker would load the headers of the ELF file, too, where the flash has the code
            println!("cargo:rustc-link-arg-bins=--nmagic");
            return;
        }
    }
    // the F405 has 64 KiB more, core-coupled, which is left alone
    let (flash, ram) = match (has("F405"), has("F401"), has("F411")) {
        (true, false, false) => (1024, 112),
        (false, true, false) => (256, 64),
        (false, false, true) => (512, 128),
        _ => panic!("choose one microcontroller: --features f405, f401, f411, rp2040 or rp2350"),
    };
    let map = format!(
        "MEMORY {{\n  FLASH : ORIGIN = 0x08000000, LENGTH = {flash}K\n  RAM : ORIGIN = 0x20000000, LENGTH = \
            {ram}K\n}}\n"
    );
    let folder = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::write(folder.join("memory.x"), map).expect("OUT_DIR can be written to");
    println!("cargo:rustc-link-search={}", folder.display());
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
}
