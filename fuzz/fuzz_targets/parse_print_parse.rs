//! What parses prints, and what was printed parses to the same tree; what does not parse has
//! findings inside the text.

#![no_main]

#[path = "../../grammar/tests/support/reads.rs"]
mod reads;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| reads::input(bytes));
