use super::tensor_latex;
use crate::check_text;
use crate::expression::NodeId;
use crate::point::sample::{Sample, far};
use crate::tensors::monomial::{Exponent, Sums};
use crate::tensors::tests::{Place, potentials, some_values};
use crate::tensors::{NotInTensors, TensorForm};
use crate::verify::sample::Random;

fn printed(text: &str) -> String {
    let (ast, model) = check_text(text).unwrap_or_else(|e| panic!("{e:#?}"));
    let dimension = model.dimensions().last().unwrap();
    tensor_latex(&model, &model.in_tensors(&ast, dimension, None).unwrap().unwrap())
}

/// What the sums of products of a node come to, and the sum of their sizes.
fn of_terms(form: &TensorForm, place: &Place<'_>, node: NodeId) -> (f64, f64) {
    let graph = form.algebra.graph.graph();
    let is_named = |node| form.named.iter().any(|(known, _)| *known == node);
    let sums = Sums {
        graph,
        is_named: &is_named,
        is_multiplied_out: &|node| form.algebra.is_jacobian(node),
        are_numbers_multiplied_out: true,
    };
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
fn every_potential_is_printed_in_seventy_lines_that_balance() {
    let count = |latex: &str, what: &str| latex.matches(what).count();
    for (name, text) in potentials() {
        let latex = printed(&text);
        println!("{name}: {} lines\n{latex}", latex.lines().count());
        assert_eq!(count(&latex, "{"), count(&latex, "}"), "{latex}");
        assert_eq!(count(&latex, r"\left"), count(&latex, r"\right"), "{latex}");
        assert_eq!(count(&latex, r"\begin{cases}"), count(&latex, r"\end{cases}"), "{latex}");
        assert!(!latex.contains("NaN") && !latex.contains("nan"), "{latex}");
        assert!(latex.lines().count() <= 70, "{name}:\n{latex}");
    }
}

#[test]
fn neo_hooke_is_printed_as_in_a_textbook() {
    let text = "potential p\nparameter lambda\nparameter mu\n\
                psi(F) = mu/2*(tr(C) - d - 2*ln(J)) + lambda/2*ln(J)^2";
    let expected = r"\begin{align*}
  \psi &= \frac{\mu}{2} \, \left(\operatorname{tr}\left(\boldsymbol{C}\right) - 3 - 2 \, \ln\left(J\right)\right) + \frac{\lambda}{2} \, \ln\left(J\right)^{2} \\
  \boldsymbol{P} &= \mu \, \boldsymbol{F} + \left(\lambda \, \ln\left(J\right) - \mu\right) \, \boldsymbol{F}^{-\mathsf{T}} \\
";
    let latex = printed(text);
    assert!(latex.starts_with(expected), "{latex}");
    assert!(
        latex.contains(r"\frac{\lambda}{J} \, \dot{J} \, \boldsymbol{F}^{-\mathsf{T}}"),
        "{latex}"
    );
}

/// Rows of the stress, as the library's potentials of these forms have them.
#[test]
fn stresses_are_sums_of_tensors() {
    let stress = |energy: &str| {
        let parameters = "parameter k\nparameter b\nparameter n";
        let latex = printed(&format!("potential p\ndimensions 3\n{parameters}\npsi(F) = {energy}"));
        let row = latex.lines().find_map(|line| line.trim().strip_prefix(r"\boldsymbol{P} &= "));
        row.unwrap().trim_end_matches(r" \\").replace(r"\boldsymbol", "").replace(r" \,", "")
    };
    assert_eq!(stress("k*tr(C)"), "2 k {F}");
    assert_eq!(stress("k*(C : C)"), "4 k {F} {C}");
    assert_eq!(stress("k*tr(inv(C))"), "-2 k {F} {C}^{-2}");
    assert_eq!(stress("k*det(C)"), r"2 k J^{2} {F}^{-\mathsf{T}}");
    assert_eq!(stress("k*(F : F) + b*det(F'*F)"), r"2 k {F} + 2 b J^{2} {F}^{-\mathsf{T}}");
    assert_eq!(stress("k*tr(U^n)"), "k n {F} {U}^{n - 2}");
    assert_eq!(stress("k*tr(ln(U)^2)"), r"2 k {F} {U}^{-2} \ln\left({U}\right)");
    assert_eq!(stress("k*(C : dyad(1, 0, 0))"), "2 k {F} {M}");
    assert_eq!(stress("k*tr(dev(E)^2)"), r"2 k {F} \operatorname{dev}\left({E}\right)");
    assert_eq!(stress("k*tr((U - I)^2)"), r"2 k {F} {U}^{-1} \left({U} - {I}\right)");
}

#[test]
fn what_cannot_be_written_in_tensors_says_why() {
    let reason = |energy: &str| {
        let (ast, model) = check_text(&format!("potential p\npsi(F) = {energy}")).unwrap();
        model.in_tensors(&ast, 3, None).unwrap_err()
    };
    assert_eq!(reason("tr(inv(I + tr(C)*C))"), NotInTensors::VaryingSum);
    assert_eq!(reason("tr(if J > 1 then C else E)"), NotInTensors::Choice);
    assert_eq!(
        reason("C : (if d == 2 then dyad(J, 0) else dyad(J, 0, 0))"),
        NotInTensors::VaryingVector
    );
}
