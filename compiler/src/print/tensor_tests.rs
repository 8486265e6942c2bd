use super::monomial::{Exponent, Sums};
use super::tensor_latex;
use crate::check_text;
use crate::expression::{Input, Node, NodeId};
use crate::point::sample::{Sample, far};
use crate::tensors::tests::{Place, potentials, some_values};
use crate::tensors::{Invariant, TensorForm};
use crate::verify::sample::Random;

fn printed(text: &str) -> String {
    let (ast, model) = check_text(text).unwrap_or_else(|e| panic!("{e:#?}"));
    let dimension = model.dimensions().last().unwrap();
    tensor_latex(&model, &model.in_tensors(&ast, dimension, None).unwrap().unwrap())
}

/// What the sums of products of a node come to, and the sum of their sizes.
fn of_terms(form: &TensorForm, place: &Place<'_>, node: NodeId) -> (f64, f64) {
    let graph = form.algebra.graph.graph();
    let is_jacobian = |node: NodeId| {
        matches!(graph[node], Node::Input(Input::Variable(k))
            if form.algebra.invariants[usize::from(k)] == Invariant::Jacobian)
    };
    let is_named = |node| form.named.iter().any(|(known, _)| *known == node);
    let sums = Sums { graph, is_named: &is_named, is_multiplied_out: &is_jacobian };
    let exponent = |e: Exponent| {
        let symbol = e.symbol.map_or(0.0, |(factor, node)| {
            factor.numerator / factor.denominator * place.number(node)
        });
        e.number.numerator / e.number.denominator + symbol
    };
    let (mut sum, mut size) = (0.0, 0.0);
    for term in sums.terms_of(node) {
        let start = term.coefficient.numerator / term.coefficient.denominator;
        let power = |(base, e): &(NodeId, Exponent)| libm::pow(place.number(*base), exponent(*e));
        let value: f64 = term.factors.iter().map(power).product::<f64>() * start;
        sum += value;
        size += value.abs();
    }
    (sum, size)
}

#[test]
fn sums_of_products_are_the_numbers_they_were_read_from() {
    let mut n_numbers = 0;
    for (name, text) in potentials() {
        let (ast, model) = check_text(&text).unwrap();
        let dimension = model.dimensions().last().unwrap();
        let form = model.in_tensors(&ast, dimension, None).unwrap().unwrap();
        let values = some_values(&model, dimension);
        let mut random = Random::new(3);
        for _ in 0..5 {
            let gradient = far(dimension, 0.1, &mut random);
            let sample = Sample::of_gradient(gradient, &mut random);
            let place = Place::new(&form, &values, &sample.gradient, &sample.direction);
            let terms = form.stress.iter().chain(&form.product);
            for node in terms.map(|term| term.coefficient).chain([form.psi]) {
                let (found, size) = of_terms(&form, &place, node);
                let expected = place.number(node);
                let bound = 1e3 * f64::EPSILON * size.max(expected.abs());
                assert!((found - expected).abs() <= bound, "{name}: {found} {expected}");
                n_numbers += 1;
            }
        }
    }
    assert!(n_numbers > 1000, "{n_numbers}");
}

#[test]
fn every_potential_is_printed_in_a_few_rows() {
    let count = |latex: &str, what: &str| latex.matches(what).count();
    for (name, text) in potentials() {
        let latex = printed(&text);
        println!("{name}: {} lines\n{latex}", latex.lines().count());
        assert_eq!(count(&latex, "{"), count(&latex, "}"), "{latex}");
        assert_eq!(count(&latex, r"\left"), count(&latex, r"\right"), "{latex}");
        assert_eq!(count(&latex, r"\begin{cases}"), count(&latex, r"\end{cases}"), "{latex}");
        assert!(!latex.contains("NaN") && !latex.contains("nan"), "{latex}");
        assert!(latex.lines().count() <= 40, "{name}:\n{latex}");
    }
}
