//! From a text to machine code: every stage ends with a result or a finding, machine code gives the
//! interpreter's bits and what was written, and what is printed can be read again and means the same.

#![no_main]

#[path = "../../compiler/tests/support/property.rs"]
#[allow(dead_code)] // some of it is for the other tests
mod property;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    property::input(bytes);
});
