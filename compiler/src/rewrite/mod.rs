//! Energies in the form that keeps their digits, before and after they are differentiated.
//!
//! Before: a simplified graph. After: the same energy, with differences of nearly equal numbers
//! replaced by what they are in terms of the relative change `e = (l - L)/L`, which comes without
//! cancellation from displacements. A difference of powers becomes the strain
//! `S_n = ((l/L)^n - 1)/n`, one node, whose derivative `(l/L)^(n-1)/L` is a product again;
//! [`expand`] puts the accurate form of the strain in its place when all derivatives are there.
//! [`REWRITES`] lists the identities; a test of the same name shows each at work.

mod expand;
mod explain;
mod monomial;
mod rules;
mod values;

pub use expand::expand;
pub use explain::{Explanation, Side, explain};
pub(crate) use monomial::{Base, Monomial, Monomials, strain, stretch};

use crate::expression::{NodeId, TooManyNodes};
use crate::measure::Measure;
use crate::simplify::{Rule, Simplifier, rule};
use rules::Rules;

/// Every identity in use. `x` is the stretch `l/L`, `e` the relative change, `S_n` the strain.
pub const REWRITES: &[Rule] = &[
    rule("rebuild_stretch", "1 + e = l/L", "always"),
    rule(
        "difference_of_powers",
        "c*x^p - c*x^q = c*(p - q)*x^q*S_(p-q), also times powers of L",
        "p, q and c are numbers",
    ),
    rule(
        "difference_of_exponentials",
        "c*exp(p*y) - c*exp(q*y) = c*exp(q*y)*expm1((p - q)*y)",
        "p, q and c are numbers",
    ),
    rule(
        "perfect_square",
        "c*t^2 - 2*c*t*u + c*u^2 = c*(t - u)^2",
        "t and u are powers of the stretch or exponentials",
    ),
    rule("logarithm_of_stretch", "ln(x^p) = p*S_0", "p is no even number"),
    rule("logarithm_of_sum", "ln(1 + y) = log1p(y)", "always"),
    rule(
        "inverse_hyperbolic_sine",
        "ln(y + sqrt(y^2 + c)) = ln(c) - ln(sqrt(y^2 + c) - y)",
        "y < 0 and c > 0 is a number, else it stays",
    ),
    rule(
        "logarithm_of_change",
        "log1p(e) = S_0, log1pmx(e) = ln(x) - e",
        "abs(e) >= 0.5, else they stay",
    ),
    rule("difference_of_squares", "y^2 - z^2 = (y - z)*(y + z)", "always"),
    rule(
        "difference_of_roots",
        "sqrt(y) - c = (y - c^2)/(sqrt(y) + c)",
        "c > 0 is a number whose square is exact",
    ),
    rule("logarithm_of_square", "log1p(-y^2) = ln((1 - y)*(1 + y))", "y^2 >= 0.5, else it stays"),
    rule(
        "strain_of_whole_order",
        "S_2n = S_n*(x^n + 1)/2, S_m = e*(1 + x + .. + x^(m-1))/m, S_-m from 1/x, S_(m/2) from sqrt(x)",
        "2*abs(n) is a whole number up to 32",
    ),
    rule(
        "strain_of_any_order",
        "S_n = lg if abs(n*lg) < 1e-16, expm1(n*lg)/n if < 0.5, else (x^n - 1)/n; lg = log1p(e) if abs(e) < 0.5, else ln(x)",
        "always",
    ),
    rule(
        "remainder_at_rest",
        "f - f(1) - f'(1)*e - .. by the remainders of its functions, f(1), f'(1), .. in 256 bits",
        "abs(e) < 0.5, where the other rules leave a difference that cancels",
    ),
];

/// The rule with this name.
///
/// # Panics
/// If there is none: the names are those of this crate.
pub(crate) fn named(name: &str) -> &'static Rule {
    REWRITES.iter().find(|rule| rule.name == name).expect("a rule of the table")
}

/// One use of a rule.
#[derive(Clone, Copy, Debug)]
pub struct Applied {
    /// Which.
    pub rule: &'static Rule,
    /// What was there.
    pub before: NodeId,
    /// What took its place.
    pub after: NodeId,
}

/// The accurate form of everything `root` needs; what was done is added to `applied`.
pub fn rewrite(
    graph: &mut Simplifier,
    root: NodeId,
    measure: Measure,
    applied: &mut Vec<Applied>,
) -> Result<NodeId, TooManyNodes> {
    let needed = graph.graph().reachable(&[root]);
    let mut rules = Rules::new(measure);
    let mut place: Vec<NodeId> = Vec::with_capacity(needed.len());
    for index in 0..=root.0 as usize {
        let id = NodeId(index as u32);
        if !needed[index] {
            place.push(id);
            continue;
        }
        let made = match rules.logarithm_of_sum(graph, id, &place)? {
            Some(made) => made,
            None => {
                let node = graph.graph()[id].map_operands(|x| place[x.0 as usize]);
                let made = graph.make(node)?;
                rules.apply(graph, made)?
            }
        };
        place.push(made);
    }
    applied.append(&mut rules.applied);
    Ok(place[root.0 as usize])
}

#[cfg(test)]
mod tests;
