//! Energies over numbers of any precision, where results are exact, extreme or none, and their audits:
//! none panics.

#![no_main]

#[path = "../../compiler/tests/support/audited.rs"]
#[allow(dead_code)] // counts are for the tests
mod audited;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let (numbers, text) = audited::split(bytes);
    audited::evaluated(&text, numbers);
    audited::audited(&text);
});
