//! One list of harnesses for every engine: Kani proofs, exports for CBMC over wasm32, and entries for the native
//! engine.
//!
//! Invariant: a harness is listed once in the code; the engines' lists are made from that one.

/// Makes harnesses of properties: `name, unwind N, covers [Region, …] => property;`. `N` is one more than the turns of
/// the longest loop, as Kani counts; each region of the list must be reached by a run within the assumptions.
macro_rules! harnesses {
    ($($name:ident, unwind $unwind:literal, covers [$($region:ident),* $(,)?] => $body:expr;)*) => {
        /// The proofs of this module, in Kani.
        #[cfg(kani)]
        pub mod on_kani {
            use super::*;
            $(#[kani::proof] #[kani::unwind($unwind)] fn $name() {
                let property: crate::choice::Property<crate::choice::Kani> = $body;
                kani::assume(property(&mut crate::choice::Kani).is_some());
            })*
        }
        #[cfg(verify_wasm)]
        mod on_cbmc {
            use super::*;
            $(#[unsafe(export_name = concat!("h_", stringify!($name), "__u",
                stringify!($unwind)))] extern "C" fn $name() {
                let property: crate::choice::Property<crate::choice::Cbmc> = $body;
                // what a property does not ask about does not reach the end of its harness, nor a region
                let is_asked = property(&mut crate::choice::Cbmc).is_some();
                let _ = crate::choice::Choice::assume(&mut crate::choice::Cbmc, is_asked);
            })*
        }
        /// The harnesses of this module, for the native engine and the ledger.
        #[cfg(not(any(kani, verify_wasm)))]
        pub const HARNESSES: &[crate::native::Harness] = &[
            $(crate::native::Harness { name: stringify!($name), module: module_path!(), unwind: $unwind,
                covers: &[$(crate::region::Region::$region),*], property: $body },)*
        ];
    };
}
/// Claim of a property. It panics where it does not hold; under CBMC it is a call with the line alone, because every
/// message is memory that the proof has to model.
macro_rules! holds {
    ($claim:expr) => {
        if !$claim {
            #[cfg(verify_wasm)]
            crate::choice::fail(line!());
            #[cfg(kani)]
            panic!("does not hold");
            #[cfg(not(any(kani, verify_wasm)))]
            panic!("{}", concat!("does not hold: ", stringify!($claim)));
        }
    };
}

/// What the code under test has to build here. That it refuses is a failure, not a state outside of the question: a
/// proof must not depend on the code that it proves.
macro_rules! built {
    ($made:expr) => {
        match $made {
            Some(made) => made,
            None => {
                #[cfg(verify_wasm)]
                crate::choice::fail(line!());
                #[cfg(kani)]
                panic!("a valid state is refused");
                #[cfg(not(any(kani, verify_wasm)))]
                panic!("{}", concat!("refused: ", stringify!($made)));
            }
        }
    };
}

/// States that a region is reached where the condition holds. What a harness lists and no run reaches fails it.
macro_rules! cover {
    ($c:expr, $region:ident, $condition:expr) => {
        #[cfg(kani)]
        kani::cover!($condition);
        #[cfg(not(kani))]
        $c.cover(crate::region::Region::$region, $condition);
    };
}

pub(crate) use {built, cover, harnesses, holds};
