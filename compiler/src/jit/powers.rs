//! Powers of one base whose exponents differ by whole numbers, as those of psi, psi' and psi'' do: at
//! the fast level one of them is worked out, and the others are products and quotients with the base.

use rustc_hash::FxHashMap;

use crate::expression::power::PowerPlan;
use crate::expression::{ExprGraph, Node, NodeId};

/// `x^c` as `x^exponent * x^steps`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Share {
    /// The exponent that is worked out.
    pub(super) exponent: f64,
    /// Multiplications with the base; divisions if negative.
    pub(super) steps: i32,
}

/// Most multiplications or divisions, each half a unit in the last place, on the way to a power.
const MOST_STEPS: usize = 2;

/// The powers of a graph that share. It depends on the whole graph, so that psi is the same whichever
/// derivatives come with it.
pub(super) fn shares(graph: &ExprGraph) -> FxHashMap<NodeId, Share> {
    let mut powers: Vec<(NodeId, f64, NodeId)> = Vec::new();
    for (id, node) in graph.nodes() {
        if let Node::PowerConstant(base, bits) = node
            && let PowerPlan::General(exponent) = PowerPlan::new(f64::from_bits(bits))
        {
            powers.push((base, exponent, id));
        }
    }
    powers.sort_by(|x, y| x.0.cmp(&y.0).then(x.1.total_cmp(&y.1)));
    let mut shares = FxHashMap::default();
    for run in powers.chunk_by(|x, y| x.0 == y.0 && is_one(x.1, y.1)) {
        for group in run.chunks(MOST_STEPS + 1) {
            // The smallest has been rounded least: the others differ from it by whole numbers more
            // exactly than their own exponents do.
            let size = |place: &usize| group[*place].1.abs();
            let least = (0..group.len()).min_by(|x, y| size(x).total_cmp(&size(y))).unwrap_or(0);
            for (place, &(_, _, id)) in group.iter().enumerate() {
                let steps = place as i32 - least as i32;
                shares.insert(id, Share { exponent: group[least].1, steps });
            }
        }
    }
    shares
}

/// Whether two exponents differ by 1: differentiation subtracts it, and rounds.
fn is_one(lower: f64, upper: f64) -> bool {
    (upper - lower - 1.0).abs() <= f64::EPSILON * upper.abs().max(lower.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{model, values};

    fn found(psi: &str) -> Vec<(f64, i32)> {
        let model = model(&format!("potential p\npsi(l) = {psi}"));
        let specialised = model.specialise_as(&values(&model, 3, &[]), crate::Form::Textbook);
        let shares = shares(&specialised.unwrap().energies[0].graph);
        let mut found: Vec<_> = shares.values().map(|s| (s.exponent, s.steps)).collect();
        found.sort_by(|x, y| x.partial_cmp(y).unwrap());
        found
    }

    #[test]
    fn derivatives_share_with_the_smallest_exponent() {
        let third = 1.0 / 3.0;
        assert_eq!(found("l^(1/3)"), [(third, -2), (third, -1), (third, 0)]);
    }

    #[test]
    fn powers_of_other_bases_or_exponents_stand_alone() {
        let least = 2.7 - 1.0 - 1.0;
        assert_eq!(found("l^2.7 + L^1.7"), [(least, 0), (least, 1), (least, 2), (1.7, 0)]);
    }
}
