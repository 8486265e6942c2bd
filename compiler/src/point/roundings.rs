//! Powers of what is 0 but for rounding.
//!
//! Where a body is squeezed alike in all directions `J^(-2/3)*I1 - 3` is 0, and a few roundings in numbers:
//! below 0 they have no power of 1.7. Such powers are 0 there, and so are their derivatives.

use crate::expression::{Comparison, Function, Node, NodeId, Operator, TooManyNodes};
use crate::simplify::Simplifier;
use crate::verify::UNIT_ROUNDOFF;

/// How many roundings of the number that is taken off are nothing: `J^(-2/3)`, whose exponent is rounded,
/// has 14 where J is 1e-18.
const ROUNDINGS: f64 = 64.0;

/// The same energy in which `(x - c)^p` is 0 where `x - c` is rounding, for `c > 0` and broken `p > 1`.
pub(super) fn without_powers_of_roundings(
    graph: &mut Simplifier,
    root: NodeId,
) -> Result<NodeId, TooManyNodes> {
    let needed = graph.graph().reachable(&[root]);
    let powers = |(id, node): (NodeId, Node)| {
        needed.get(id.0 as usize) == Some(&true) && taken_off(graph, node).is_some()
    };
    if !graph.graph().nodes().any(powers) {
        return Ok(root);
    }
    let mut place: Vec<NodeId> = Vec::with_capacity(needed.len());
    for index in 0..=root.0 as usize {
        let id = NodeId(index as u32);
        if !needed[index] {
            place.push(id);
            continue;
        }
        let node = graph.graph()[id].map_operands(|x| place[x.0 as usize]);
        let made = graph.make(node)?;
        let number = taken_off(graph, graph.graph()[id]);
        place.push(match (number, graph.graph()[made]) {
            (Some(number), Node::PowerConstant(x, _)) => {
                let size = graph.unary(Function::Abs, x)?;
                let nothing = graph.number(ROUNDINGS * UNIT_ROUNDOFF * number)?;
                let is_nothing = graph.make(Node::Compare(Comparison::Less, size, nothing))?;
                let zero = graph.number(0.0)?;
                graph.make(Node::Select(is_nothing, zero, made))?
            }
            _ => made,
        });
    }
    Ok(place[root.0 as usize])
}

/// `c` of `(x - c)^p`, `c > 0` and broken `p > 1`.
fn taken_off(graph: &Simplifier, node: Node) -> Option<f64> {
    let Node::PowerConstant(x, exponent) = node else { return None };
    let exponent = f64::from_bits(exponent);
    let graph = graph.graph();
    let number = match graph[x] {
        Node::Binary(Operator::Subtract, _, c) => graph.as_number(c)?,
        Node::Binary(Operator::Add, a, b) => -graph.as_number(a).or(graph.as_number(b))?,
        _ => return None,
    };
    (number > 0.0 && exponent > 1.0 && exponent.fract() != 0.0).then_some(number)
}

#[cfg(test)]
mod tests {
    use crate::point::NEAR;
    use crate::point::sample::{Sample, diagonal, evaluate};
    use crate::specialise::Form;
    use crate::test_support::{model, values};
    use crate::verify::sample::Random;
    use crate::{Level, Mode};

    fn of_gradient(energy: &str, gradient: Vec<f64>) -> Vec<f64> {
        let model = model(&format!("potential p\ndimensions 3\npsi(F) = {energy}"));
        let mode = Mode::Jit(Level::Strict);
        let kernel = model.compile(&values(&model, 3, &[]), mode, Form::Accurate).unwrap();
        let samples = [Sample::of_gradient(gradient, &mut Random::new(5))];
        evaluate(&kernel.gradient.unwrap(), &samples).remove(0)
    }

    /// Without the term there would be the rest alone, to the last bit.
    #[test]
    fn a_body_that_is_squeezed_alike_has_no_power_of_a_rounding() {
        let rest = "(J - 1)^2";
        let stretches = (0..60).map(|k| libm::exp(f64::from(k) * 0.4 - 13.0));
        for stretch in stretches.filter(|stretch| (stretch - 1.0).abs() > NEAR) {
            let gradient = diagonal(&[stretch; 3]);
            let alone = of_gradient(rest, gradient.clone());
            for power in ["(J^(-2/3)*I1 - 3)^1.7", "(-3 + J^(-4/3)*I2)^2.5"] {
                let with = of_gradient(&format!("{power} + {rest}"), gradient.clone());
                assert_eq!(with, alone, "{power}, {gradient:?}");
            }
        }
    }

    /// What is below 0 by more than roundings has no power, what is above keeps it.
    #[test]
    fn what_is_no_rounding_keeps_its_power() {
        let below = of_gradient("(tr(C) - 20)^1.7", diagonal(&[2.0; 3]));
        assert!(below[0].is_nan(), "{below:?}");
        let above = of_gradient("(tr(C) - 11)^1.5", diagonal(&[2.0; 3]));
        assert!((above[0] - 1.0).abs() < 1e-12, "{above:?}");
    }
}
