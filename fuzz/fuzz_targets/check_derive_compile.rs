//! From a text to machine code: every stage ends with a result or a finding, machine code gives the
//! interpreter's bits, and what is printed can be read again and means the same.
//!
//! The first byte chooses: the rest is taken as text, or as the choices of the program generator.

#![no_main]

#[path = "../../compiler/tests/support/property.rs"]
#[allow(dead_code)] // some of it is for the other tests
mod property;

use libfuzzer_sys::fuzz_target;
use piola_grammar::generate::potential_text;

fuzz_target!(|bytes: &[u8]| {
    let Some((&choice, rest)) = bytes.split_first() else { return };
    if choice % 2 == 0 {
        property::follow(&String::from_utf8_lossy(rest));
    } else {
        let outcome = property::follow(&potential_text(rest));
        assert_ne!(outcome, property::Outcome::Unreadable);
    }
});
