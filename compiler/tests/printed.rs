//! What is printed means what it was printed from: every derivative of the library, for many
//! parameter values, is read again and gives the same bits.

#[path = "support/library.rs"]
mod library;
#[path = "support/property.rs"]
#[allow(dead_code)] // the rest is for the other tests
mod property;

use library::cases;

#[test]
fn printed_derivatives_read_again_give_the_same_bits() {
    let mut n_energies = 0;
    for case in cases() {
        let specialised = case.model.specialise(&case.values).unwrap();
        println!("{}", case.name);
        for energy in &specialised.energies {
            property::round_trip(&case.model, energy, case.values.dimension);
            n_energies += 1;
        }
    }
    assert!(n_energies > 100, "{n_energies}");
}
