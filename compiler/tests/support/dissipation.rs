//! What holds for what bonds dissipate: it is printed so that it can be read, and machine code is what was
//! compiled.

use piola_compiler::{BondFunction, BondFunctionKind, Level, Mode, Model, Values, check};
use piola_grammar::parse;

use super::functions::same;
use super::{placed, potential_of};

/// Follows the dissipation of a model as far as it can be compiled.
///
/// # Panics
/// Where something does not hold.
pub(super) fn follow(text: &str, model: &Model, values: &Values, functions: &[BondFunction]) {
    for one in functions.iter().filter(|one| one.kind == BondFunctionKind::Dissipation) {
        reads(model, one, values.dimension);
    }
    let kernel = |mode| placed(text, model.dissipation(values, mode)).ok().flatten();
    let (Some(code), Some(graph)) = (kernel(Mode::Jit(Level::Strict)), kernel(Mode::Interpreter))
    else {
        return;
    };
    same(&code, &graph, text);
}

/// What is printed of it is a dissipation again, unless no rate is left in it.
fn reads(model: &Model, one: &BondFunction, dimension: usize) {
    for root in 0..3 {
        let again = potential_of(model, &one.function, dimension, root);
        let again = again.replacen("\npsi(l)", "\npsi(l) = l\ndissipation(l)", 1);
        let again = again.replacen('\n', "\nparameter dt\n", 1);
        let ast = parse(&again).unwrap_or_else(|e| panic!("{e:#?}\n{again}"));
        if again.contains("rate(l)") {
            check(&ast).unwrap_or_else(|e| panic!("{e:#?}\n{again}"));
        }
    }
}
