//! What points gather is printed with everything that a reader needs to follow it.

use super::{gathered_latex, gathered_listing, gathered_text};
use crate::test_support::model;

const NUMBERS: &str = "potential p\nparameter K = 2\nstate k = 0\nm = integral(L)\ns = integral((l - L)/L)\n\
                       update k = max(k, s)\npsi(s) = K*s^2*(1 - k)\npsi(l, m) = l^2/m\n\
                       break when s > 2\n";

fn forms(text: &str, has_values: bool) -> (crate::Model, crate::GatheredForms) {
    let model = model(text);
    let values = has_values.then(|| model.values(2, &[], Some(1.0)).unwrap());
    let forms = model.gathered_forms(2, values.as_ref()).unwrap();
    (model, forms)
}

#[test]
fn text_names_integrals_integrands_and_derivatives() {
    let (model, forms) = forms(NUMBERS, false);
    let expected = "# I1 = integral(L)\n# I2 = integral((l - L)/L)\n\
                    f1(l) = L\nf1'(l) = 0\nf1''(l) = 0\n\
                    f2(l) = l/L - 1\nf2'(l) = 1/L\nf2''(l) = 0\n\
                    \npsi(s) = K*I2^2*(1 - k)\ndpsi/dI2 = K*(1 - k)*(2*I2)\n\
                    \npsi(l, m) = l^2/I1\ndpsi/dl = 2*l/I1\ndpsi/dI1 = -(l^2/I1/I1)\n\
                    \nbreak when s > 2\n\nupdate k = max(k, s)\n";
    assert_eq!(gathered_text(&model, &forms), expected);
    let listing = gathered_listing(&model, &forms);
    assert!(listing.contains("f2'(l) = %") && listing.contains("margin 1 = %"), "{listing}");
}

#[test]
fn latex_has_an_environment_for_each_function() {
    let (model, forms) = forms(NUMBERS, true);
    let text = gathered_latex(&model, &forms);
    assert_eq!(text.matches(r"\begin{align*}").count(), 5, "{text}");
    for part in [
        r"I_{2} &= \sum_j V_j\, f_{2}(l_j)",
        r"\partial \psi/\partial I_{2} &= ",
        r"\text{bonds break where } g_{1} > 0",
        r"k^{\text{next}} &= ",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
}

#[test]
fn vectors_have_multipliers_and_neighbours() {
    let text = "potential p\nM = integral(xi - Xi)\nz = M - neighbour(M)\npsi(xi, M) = z*z\n";
    let (model, forms) = forms(text, false);
    let text = gathered_text(&model, &forms);
    for line in [
        "# I1 = integral((xi - Xi)(1))",
        "f1 = (xi(1) - Xi(1))",
        "df/dxi(1) = A1",
        "# neighbour(I1) is what the other end of the bond gathers",
        "dpsi/dneighbour(I2) = ",
    ] {
        assert!(text.contains(line), "{line}\n{text}");
    }
    assert!(gathered_latex(&model, &forms).contains(r"\partial \psi/\partial I'_{1}"));
}
