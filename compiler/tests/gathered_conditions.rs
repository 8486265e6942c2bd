//! Conditions of gathered values under which bonds break: margins as written in all ways to evaluate them, and
//! what is refused.

use piola_compiler::verify::{Subject, verify};
use piola_compiler::{Model, OfFamily, check};
use piola_grammar::parse;

/// So many conditions of gathered values, in two and three dimensions.
fn all_margins_pass(model: &Model, n: usize) {
    for d in [2, 3] {
        let values = model.values(d, &[], Some(1.0)).unwrap();
        let (found, _) = verify(model, &values, 60).unwrap();
        let margins: Vec<_> =
            found.iter().filter(|one| matches!(one.subject, Subject::Margin(None, _))).collect();
        assert_eq!(margins.len(), n);
        for one in margins {
            println!("{:?}: {} places, {:?}", one.subject, one.n_places, one.errors);
            assert!(one.passed() && one.n_places > 200, "{:?}", one.misses.first());
        }
    }
}

#[test]
fn margins_are_those_as_written_in_every_way() {
    let text = "potential p\nparameter s0 = 0.3\nm = integral(L^2)\ntheta = 3/m*integral(L*(l - L))\n\
                psi(theta) = theta^2\npsi(l, m) = (l - L)^2/m\n\
                break when theta > 3 or theta < -1/2 \"volume\"\nbreak when l/L - 1 > s0*theta\n\
                break when l/L - 1 >= s0\n";
    let model = check(&parse(text).unwrap()).unwrap();
    assert!(model.can_break() && model.breaks().len() == 1);
    let of: Vec<OfFamily> = model.family_breaks().iter().map(|one| one.of).collect();
    assert_eq!(of, [OfFamily::Points, OfFamily::Bonds]);
    all_margins_pass(&model, 2);
}

/// Of vectors, too: conditions of points, of bonds and of both ends of a bond.
#[test]
fn margins_of_tensors_are_those_as_written_in_every_way() {
    let text = "potential p\nparameter s0 = 0.05\nw(L) = 1/L\nK = integral(w*dyad(Xi, Xi))\n\
                H = integral(w*dyad(xi - Xi, Xi))*inv(K)\npsi(H) = H : H\n\
                break when det(I + H) - 1 > s0 \"volume\"\n\
                break when norm(xi - H*Xi)/L - 1 > s0 and tr(H) > 0\n\
                break when tr(H + neighbour(H)) >= 4*s0\nbreak when l/L - 1 > s0*tr(H)\n\
                break when l/L > 2\n";
    let model = check(&parse(text).unwrap()).unwrap();
    assert!(model.can_break() && model.breaks().len() == 1);
    let of: Vec<OfFamily> = model.family_breaks().iter().map(|one| one.of).collect();
    assert_eq!(of, [OfFamily::Points, OfFamily::Bonds, OfFamily::Bonds, OfFamily::Bonds]);
    all_margins_pass(&model, 4);
}

#[test]
fn what_is_no_condition_of_gathered_values_is_refused() {
    for (text, code) in [
        ("s = integral(l)\npsi(l) = l\nbreak when s > 2", "wrong-measure"),
        ("s = integral(l)\npsi(s) = s\nbreak when s > a/A", "wrong-measure"),
        ("s = integral(l)\npsi(s) = s\nbreak when s == 2", "no-threshold"),
        (
            "state k = 0\nupdate k = max(k, l/L)\ns = integral(l)\npsi(l) = k*l\npsi(s) = s\n\
             break when s > k",
            "wrong-measure",
        ),
    ] {
        let checked = check(&parse(&format!("potential p\n{text}")).unwrap());
        let found: Vec<&str> = checked.unwrap_err().iter().map(|error| error.code).collect();
        assert_eq!(found, [code], "{text}");
    }
}
