//! Source of a property's arbitrary values: the only difference between the engines.
//!
//! Invariant: a property is a function of its choices alone, so that the numbers of a counterexample replay it
//! anywhere.

use crate::region::Region;

/// Rate one, and the length of a record, in units of 2⁻³².
pub(crate) const ONE: i64 = retrace_core::Rate::ONE.units();

/// A source of arbitrary values. In a proof every method stands for *all* its values at once; natively they are
/// enumerated, drawn at random, or replayed.
pub trait Choice {
    /// Any 32-bit word. Natively: values around 0, 2³¹ and the wrap, or random ones.
    fn word(&mut self) -> u32;

    /// Any number in 0 … `n` − 1; `n` is at least 1. Natively: every one of them.
    fn below(&mut self, n: u32) -> u32;

    /// Any number in 0 … `most`. Natively: the ends and numbers near them, or random ones.
    fn upto(&mut self, most: u32) -> u32;

    /// Any number in `low` … `high`, both included. Natively: the ends, numbers near 0, 2³¹ and 2³², or random ones.
    fn between(&mut self, low: i64, high: i64) -> i64;

    /// Continues only where `holds`; the property makes no claim about the rest.
    fn assume(&mut self, holds: bool) -> Option<()>;

    /// Records that this run is in a region where `reached`; see [`Region`].
    fn cover(&mut self, region: Region, reached: bool) {
        let _ = (region, reached);
    }

    /// Any increment. Natively: around 0 and both ends.
    fn increment(&mut self) -> i16 {
        self.between(i16::MIN as i64, i16::MAX as i64) as i16
    }

    /// Either value.
    fn flag(&mut self) -> bool {
        self.below(2) == 1
    }
}

/// All bits that a number up to `most` may have.
#[cfg(not(kani))]
pub(crate) const fn bits_of(most: u64) -> u64 {
    if most == 0 { 0 } else { u64::MAX >> most.leading_zeros() }
}

/// A property: choices in, `None` where an assumption does not hold, a panic where the property does not.
pub type Property<C> = fn(&mut C) -> Option<()>;

#[cfg(kani)]
pub use on_kani::Kani;

#[cfg(kani)]
mod on_kani {
    /// Every value at once, in Kani.
    #[derive(Debug)]
    pub struct Kani;

    impl super::Choice for Kani {
        fn word(&mut self) -> u32 {
            kani::any()
        }
        fn below(&mut self, n: u32) -> u32 {
            let value: u32 = kani::any();
            kani::assume(value < n);
            value
        }
        fn upto(&mut self, most: u32) -> u32 {
            let value: u32 = kani::any();
            kani::assume(value <= most);
            value
        }
        fn between(&mut self, low: i64, high: i64) -> i64 {
            let value: i64 = kani::any();
            kani::assume(low <= value && value <= high);
            value
        }
        fn assume(&mut self, holds: bool) -> Option<()> {
            kani::assume(holds);
            Some(())
        }
    }
}

#[cfg(verify_wasm)]
pub use on_cbmc::Cbmc;
#[cfg(verify_wasm)]
pub(crate) use on_cbmc::fail;

#[cfg(verify_wasm)]
mod on_cbmc {
    mod import {
        #[link(wasm_import_module = "v")]
        unsafe extern "C" {
            pub(super) safe fn nd() -> u32;
            pub(super) safe fn assume(holds: u32);
            pub(super) safe fn fail(line: u32) -> !;
            pub(super) safe fn cover(region: u32, reached: u32);
            pub(super) safe fn multiply_high(a: u64, b: u64) -> u64;
        }
    }

    /// Reports that the claim in that line does not hold.
    pub(crate) fn fail(line: u32) -> ! {
        import::fail(line)
    }

    /// Replaces the compiler's check whether a product of 64 bits overflows; both factors are sign-extended from 64
    /// bits.
    #[unsafe(no_mangle)]
    extern "C" fn __multi3(a: u128, b: u128) -> u128 {
        let (a, b) = (a as u64, b as u64);
        u128::from(import::multiply_high(a, b)) << 64 | u128::from(a.wrapping_mul(b))
    }

    #[panic_handler]
    fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
        import::fail(info.location().map_or(0, |place| place.line()))
    }

    /// Every value at once, in CBMC: the functions that the harness in C defines.
    #[derive(Debug)]
    pub struct Cbmc;

    impl super::Choice for Cbmc {
        fn word(&mut self) -> u32 {
            import::nd()
        }
        fn below(&mut self, n: u32) -> u32 {
            self.upto(n - 1)
        }
        fn upto(&mut self, most: u32) -> u32 {
            // bits that cannot be set are omitted, which makes the formula smaller
            let value = import::nd() & super::bits_of(most as u64) as u32;
            import::assume(u32::from(value <= most));
            value
        }
        fn between(&mut self, low: i64, high: i64) -> i64 {
            let range = high.wrapping_sub(low) as u64;
            let word = if range >> 32 == 0 { 0 } else { u64::from(import::nd()) << 32 };
            let offset = (word | u64::from(import::nd())) & super::bits_of(range);
            import::assume(u32::from(offset <= range));
            low.wrapping_add(offset as i64)
        }
        fn assume(&mut self, holds: bool) -> Option<()> {
            import::assume(u32::from(holds));
            Some(())
        }
        fn cover(&mut self, region: super::Region, reached: bool) {
            import::cover(region as u32, u32::from(reached));
        }
    }
}
