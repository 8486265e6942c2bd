//! One energy for every lint, and one beside it that is right.

use super::LINTS;
use crate::test_support::model;

/// Codes of the warnings for these statements.
fn found(statements: &str) -> Vec<&'static str> {
    let model = model(&format!("potential p\n{statements}\n"));
    model.lint(true).into_iter().map(|warning| warning.code).collect()
}

fn message(statements: &str, code: &str) -> String {
    let model = model(&format!("potential p\n{statements}\n"));
    let warnings = model.lint(true);
    let warning = warnings.iter().find(|warning| warning.code == code);
    let warning = warning.unwrap_or_else(|| panic!("no {code}: {warnings:#?}"));
    format!("{}; {}", warning.message, warning.label)
}

/// Code, an energy that has it, an energy that has not.
const PAIRS: [(&str, &str, &str); 51] = [
    (
        "update-creates-energy",
        "state k = 0\nupdate k = max(k, a/A - 1)\npsi(l) = (l/L - 1)^2\npsi(a) = (1 + k)*(a/A - 1)^2",
        "state k = 0\nupdate k = max(k, a/A - 1)\npsi(l) = (l/L - 1)^2\npsi(a) = (a/A - 1)^2/(1 + k)",
    ),
    (
        "update-not-settled",
        "state k = 0\nupdate k = 1/2*k + v/V - 1\npsi(v) = (v/V - 1)^2*(3 - sign(k))",
        "state k = 0\nupdate k = k + dt*(v/V - 1)\npsi(v) = (v/V - 1)^2*(3 - sign(k))",
    ),
    ("not-objective", "psi(xi) = ((xi - Xi)*Xi/L)^2", "psi(xi) = (norm(xi)/norm(Xi) - 1)^2"),
    (
        "state-unused",
        "state k = 0\nupdate k = max(k, a/A - 1)\npsi(l) = (l/L - 1)^2\npsi(a) = (a/A - 1)^2",
        "state k = 0\nupdate k = max(k, a/A - 1)\npsi(l) = (l/L - 1)^2\npsi(a) = (a/A - 1)^2/(1 + k)",
    ),
    (
        "breaks-at-rest",
        "state k = 0\nupdate k = max(k, a/A - 1)\npsi(a) = (a/A - 1)^2\nbreak when k >= 0",
        "state k = 0\nupdate k = max(k, a/A - 1)\npsi(a) = (a/A - 1)^2\nbreak when k > 0.1",
    ),
    (
        "breaks-nothing",
        "psi(l) = (l/L - 1)^2\nbreak when a/A - 1 > 0.1",
        "psi(l) = (l/L - 1)^2\npsi(angle) = (angle - Angle)^2\nbreak when a/A - 1 > 0.1",
    ),
    (
        "breaks-nothing",
        "psi(l) = (l/L - 1)^2\npsi(a) = (a/A - 1)^2\nbreak when v/V > 2",
        "psi(l) = (l/L - 1)^2\npsi(v) = (v/V - 1)^2\nbreak when v/V > 2",
    ),
    (
        "never-breaks",
        "state k = 0\nupdate k = max(k, l/L - 1)\npsi(l) = (l/L - 1)^2\nbreak when k > 20",
        "state k = 0\nupdate k = max(k, l/L - 1)\npsi(l) = (l/L - 1)^2\nbreak when k > 0.1",
    ),
    (
        "never-breaks",
        "state life = 1\nupdate life = life + max(0, l/L - 1)*dt\npsi(l) = (l/L - 1)^2\nbreak when life <= 0",
        "state life = 1\nupdate life = life - max(0, l/L - 1)*dt\npsi(l) = (l/L - 1)^2\nbreak when life <= 0",
    ),
    (
        "update-creates-energy",
        "state k = 0\nupdate k = max(k, l/L - 1)\npsi(l) = (1 + k)*(l/L - 1)^2",
        "state k = 0\nupdate k = max(k, l/L - 1)\npsi(l) = (l/L - 1)^2/(1 + k)",
    ),
    (
        "update-not-settled",
        "state k = 0\nupdate k = 1/2*k + l/L - 1\npsi(l) = (l/L - 1)^2*(3 - sign(k))",
        "state k = 0\nupdate k = k + dt*(l/L - 1)\npsi(l) = (l/L - 1)^2*(3 - sign(k))",
    ),
    (
        "dissipation-creates-energy",
        "psi(l) = (l/L - 1)^2\ndissipation(l) = -rate(l)^2",
        "psi(l) = (l/L - 1)^2\ndissipation(l) = abs(rate(l))^1.5 + abs(rate(l))",
    ),
    (
        "dissipation-creates-energy",
        "psi(l) = (l/L - 1)^2\ndissipation(l) = (rate(l) + 1e-3)^2",
        "psi(l) = (l/L - 1)^2\ndissipation(l) = l*rate(l)^2 + rate(l)^4/L",
    ),
    (
        "state-unused",
        "state k = 0\nupdate k = max(k, l/L - 1)\npsi(l) = (l/L - 1)^2\ndissipation(l) = rate(l)^2",
        "state k = 0\nupdate k = max(k, l/L - 1)\npsi(l) = (l/L - 1)^2\ndissipation(l) = (1 + k)*rate(l)^2",
    ),
    (
        "state-unused",
        "state k = 0\nupdate k = max(k, l/L - 1)\npsi(l) = (l/L - 1)^2",
        "state k = 0\nupdate k = max(k, l/L - 1)\npsi(l) = (l/L - 1)^2/(1 + k)",
    ),
    (
        "state-unused",
        "state k = 0\npsi(l) = (l/L - 1)^2/(1 + k)",
        "parameter k = 0\npsi(l) = (l/L - 1)^2/(1 + k)",
    ),
    ("breaks-at-rest", "psi(F) = E : E\nbreak when J >= 1", "psi(F) = E : E\nbreak when J > 1"),
    ("never-breaks", "psi(F) = E : E\nbreak when J > 1000.5", "psi(F) = E : E\nbreak when J > 99"),
    (
        "breaks-in-compression",
        "psi(F) = E : E\nbreak when E : E > 0.01",
        "psi(F) = E : E\nbreak when E : E > 0.01 and J > 1",
    ),
    (
        "breaks-at-rest",
        "psi(l) = (l/L - 1)^2\nbreak when l >= L",
        "psi(l) = (l/L - 1)^2\nbreak when l > L",
    ),
    (
        "never-breaks",
        "psi(l) = (l/L - 1)^2\nbreak when (l/L - 1)^2 > 81.5",
        "psi(l) = (l/L - 1)^2\nbreak when (l/L - 1)^2 > 80 and l > L",
    ),
    (
        "never-breaks",
        "psi(l) = (l/L - 1)^2\ndomain l/L in (0, 2)\nbreak when l/L > 2",
        "psi(l) = (l/L - 1)^2\ndomain l/L in (0, 2)\nbreak when l/L > 1.99",
    ),
    (
        "breaks-in-compression",
        "psi(l) = (l/L - 1)^2\nbreak when (l/L - 1)^2 > 1/4",
        "psi(l) = (l/L - 1)^2\nbreak when (l/L - 1)^2 > 4",
    ),
    (
        "breaks-in-compression",
        "psi(l) = (l/L - 1)^2\nbreak when L - l > 0.1*delta",
        "psi(l) = (l/L - 1)^2\nbreak when l - L > 0.5*delta",
    ),
    (
        "breaks-at-rest",
        "psi(a) = (a/A - 1)^2\nbreak when a >= A",
        "psi(a) = (a/A - 1)^2\nbreak when abs(a/A - 1) > 0.1",
    ),
    (
        "never-breaks",
        "psi(a) = (a/A - 1)^2\nbreak when a/A > 11",
        "psi(a) = (a/A - 1)^2\nbreak when a/A > 9",
    ),
    ("not-stress-free", "psi(l) = (l/L)^2", "psi(l) = (l/L - 1)^2"),
    ("not-stress-free", "psi(l) = ln(l)^2", "psi(l) = ln(l/L)^2"),
    (
        "not-stress-free",
        "psi(l) = 12*((L/l)^12 - (L/l)^6)",
        "psi(l) = (L/l)^12 - 2*(L/l)^6\npsi(l) = 0.1*(l/L - 1)^2",
    ),
    ("not-stiff-at-rest", "psi(l) = (l/L - 1)^4", "psi(l) = (l/L - 1)^4 + (l/L - 1)^2"),
    ("not-stiff-at-rest", "psi(a) = -(a/A - 1)^2", "psi(a) = (a/A - 1)^2"),
    ("not-stiff-at-rest", "psi(l) = l/L", "psi(l) = cosh(l/L - 1)"),
    (
        "not-stiff-at-rest",
        "psi(l) = abs(l/L - 1)^3",
        "psi(l) = (1 + abs(l/L - 1))^1.2 - 1.2*abs(l/L - 1)",
    ),
    ("singular-in-domain", "psi(v) = ln(v/V)^2", "psi(v) = ln(v/V)^2\ndomain v/V in (0, inf)"),
    ("singular-in-domain", "psi(l) = abs(l/L - 1)^1.5", "psi(l) = abs(l/L - 1)^2.5"),
    (
        "singular-in-domain",
        "psi(l) = -ln(1 - (l/L - 1)^2)",
        "psi(l) = -ln(1 - (l/L - 1)^2)\ndomain l/L in (0, 2)",
    ),
    ("singular-in-domain", "psi(l) = (2 - l/L)^-2", "psi(l) = (12 - l/L)^-2"),
    ("singular-in-domain", "psi(l) = sqrt(l/L - 1)", "psi(l) = exp(30*(l/L - 1)^2)"),
    (
        "jump-in-energy",
        "psi(l) = if l/L < 1.1 then (l/L - 1)^2 else 0",
        "psi(l) = if l/L < 1.1 then (l/L - 1)^2 else 0.01",
    ),
    (
        "jump-in-energy",
        "psi(l) = (l/L - 1)^2*(2 + sign(l/L - 1.5))",
        "psi(l) = (l/L - 1)^2*(2 + sign(l/L - 1))",
    ),
    (
        "jump-in-energy",
        "psi(l) = (l/L - 1)^2 + atan2(l/L - 1.5, -1)^3/100",
        "psi(l) = (l/L - 1)^2 + atan2(l/L - 1.5, 1)^3/100",
    ),
    (
        "jump-in-force",
        "psi(l) = if l/L < 1.1 then (l/L - 1)^2 else 0.01",
        "psi(l) = if l > L then (l/L - 1)^2 else 2*(l/L - 1)^2",
    ),
    ("jump-in-force", "psi(l) = abs(l/L - 1)", "psi(l) = abs(l/L - 1)^2"),
    (
        "jump-in-force",
        "psi(l) = (l/L - 1)^2 + max(0, l/L - 1.3)",
        "psi(l) = (l/L - 1)^2 + max(0, l/L - 1.3)^2",
    ),
    (
        "jump-in-stiffness",
        "psi(l) = (l/L - 1)^2 + max(0, l/L - 1.3)^2",
        "psi(l) = (l/L - 1)^2 + max(0, l/L - 1.3)^3",
    ),
    ("jump-in-force", "psi(l) = min((l/L - 1)^2, 0.04)", "psi(l) = (l/L - 1)^2"),
    ("no-bond-energy", "psi(a) = (a/A - 1)^2", "psi(a) = (a/A - 1)^2\npsi(l) = (l/L - 1)^2"),
    ("no-collapse-resistance", "psi(l) = (l/L - 1)^2", "psi(l) = ln(l/L)^2"),
    (
        "no-collapse-resistance",
        "psi(l) = (l/L - 1)^2",
        "psi(l) = (l/L - 1)^2\ndomain l/L in (1/2, 2)",
    ),
    (
        "no-inversion-resistance",
        "psi(v) = (v/V - 1)^2",
        "psi(v) = ln(v/V)^2\ndomain v/V in (0, inf)",
    ),
    ("no-inversion-resistance", "dimensions 2\npsi(a) = (a/A - 1)^2", "psi(a) = (a/A - A/a)^2"),
];

#[test]
fn every_lint_finds_what_it_is_for_and_nothing_beside_it() {
    for lint in LINTS {
        assert!(PAIRS.iter().any(|(code, ..)| *code == lint.code), "{}", lint.code);
    }
    for (code, wrong, right) in PAIRS {
        assert!(found(wrong).contains(&code), "{code} is not found in\n{wrong}");
        assert!(!found(right).contains(&code), "{code} is found in\n{right}");
    }
}

#[test]
fn a_silent_lint_stays_silent_for_its_code_alone() {
    let text = "psi(a) = (a/A - 1)^4";
    assert_eq!(found(text).len(), 3 + 1, "{:?}", found(text));
    let allowed = format!("allow \"no-bond-energy\" \"bonds are elsewhere\"\n{text}");
    assert!(!found(&allowed).contains(&"no-bond-energy"));
    assert!(found(&allowed).contains(&"not-stiff-at-rest"));
}

#[test]
fn what_proven_potentials_do_is_told_on_request() {
    let spring = model("potential spring\npsi(l) = (l/L - 1)^2");
    assert!(spring.lint(false).is_empty());
    assert_eq!(spring.lint(true)[0].code, "no-collapse-resistance");
}

#[test]
fn coefficients_that_are_zero_and_conditions_hide_nothing() {
    let text = "parameter C = 0, C >= 0\npsi(l) = (l/L - 1)^2\npsi(a) = C*(a/A)^2";
    assert!(message(text, "not-stress-free").ends_with("; with C = 1"));
    let text = "parameter n, n < 0\npsi(l) = n*(l/L - 1)^2";
    assert!(message(text, "not-stiff-at-rest").ends_with("; with n = -1"));
}

#[test]
fn messages_are_short_and_name_the_place() {
    let text = "parameter E = 2 in GPa\nparameter c = 1/(2^0.5)\ndimensions 3\n\
                psi(l) = if l/L < 1 + c then 1/2*E*L*L^-3*(l/L - 1)^2/L else 0*E/L^3";
    let found = message(text, "jump-in-energy");
    assert_eq!(found, "psi(l) jumps by -5e8 at l/L = 1.71 (L = 1); with E = 2, c = 0.707");
}

/// What deformation gradients remember is tried like what bonds do.
#[test]
fn states_of_gradients_are_looked_at() {
    let potential = |lines: &str| format!("potential p\nstate k = 0\n{lines}\n");
    for (lines, code) in [
        ("update k = max(k, E : E)\npsi(F) = (1 + k)*(E : E)", "update-creates-energy"),
        ("update k = k + (J - 1)^2\npsi(F) = exp(-k)*(E : E)", "update-not-settled"),
        ("update k = max(k, J - 1)\npsi(F) = E : E", "state-unused"),
        ("update k = max(k, J - 1)\npsi(F) = exp(-k)*(E : E)\nbreak when k < 0", "never-breaks"),
        ("update k = max(k, J - 1)\npsi(F) = exp(-k)*(E : E)\nbreak when k >= 0", "breaks-at-rest"),
        (
            "update k = max(k, 1 - J)\npsi(F) = exp(-k)*(E : E)\nbreak when k > 0.2",
            "breaks-in-compression",
        ),
        // What a state brings about in the end is seen.
        ("update k = max(k, J - 1)\npsi(F) = exp(-k)*(E : E)\nbreak when k > 0.2", ""),
        ("update k = k + max(0, J - 1)*dt\npsi(F) = exp(-k)*(E : E)\nbreak when k > 1e9", ""),
    ] {
        let found: Vec<&str> =
            model(&potential(lines)).lint(false).iter().map(|found| found.code).collect();
        let expected: &[&str] = if code.is_empty() { &[] } else { &[code] };
        assert_eq!(found, expected, "{lines}");
    }
}

/// What is gathered is tried in an evenly deformed body: conditions of points and of bonds, and what points
/// remember.
#[test]
fn gathered_numbers_are_looked_at() {
    let potential = |lines: &str| {
        format!(
            "potential p\nm = integral(1)\ne = integral(l/L - 1)\npsi(e, m) = (e/m)^2\n{lines}\n"
        )
    };
    let remembering = |lines: &str| {
        format!("potential p\nm = integral(1)\ne = integral(l/L - 1)\nstate k = 0\n{lines}\n")
    };
    let tensors = |lines: &str| {
        format!(
            "potential p\nK = integral(dyad(Xi, Xi))\nH = integral(dyad(xi - Xi, Xi))*inv(K)\n\
             psi(H) = (H + H') : (H + H')\nallow \"not-objective\" \"linear\"\n{lines}\n"
        )
    };
    let remembered = |psi: &str, next: &str| {
        tensors(&format!("state k = 0\nupdate k = {next}\npsi(xi, H) = ({psi})*(norm(xi)/L - 1)^2"))
    };
    for (text, code) in [
        (remembered("exp(-k)", "max(k, det(I + H) - 1)"), ""),
        (remembered("1 + k", "max(k, det(I + H) - 1)"), "update-creates-energy"),
        (remembered("exp(-k)", "k + tr(H)^2"), "update-not-settled"),
        (remembered("exp(-k)", "k + tr(H)^2*dt"), ""),
        (remembered("exp(-k)", "max(k, tr(H))") + "break when tr(H) > 1e4 + k\n", "never-breaks"),
        (tensors("break when tr(H) >= 0"), "breaks-at-rest"),
        (tensors("break when det(I + H) - 1 > 0.1"), ""),
        (tensors("break when det(I + H) - 1 > 1001"), "never-breaks"),
        (tensors("break when H : H > 0.01"), "breaks-in-compression"),
        (tensors("break when norm(xi)/L - 1 > 0.1"), ""),
        (
            tensors("break when norm(xi)/L - 1 > 0.1 + tr(H + neighbour(H))"),
            "breaks-in-compression",
        ),
        (potential("break when e/m >= 0"), "breaks-at-rest"),
        (potential("break when m > 0"), "breaks-at-rest"),
        (potential("break when e/m > 0.1"), ""),
        (potential("break when e/m > 9.1"), "never-breaks"),
        (potential("break when e/m > 8.9"), ""),
        (potential("break when (e/m)^2 > 0.01"), "breaks-in-compression"),
        (potential("break when (e/m)^2 > 0.01 and e > 0"), ""),
        (potential("break when l/L - 1 > 0.1 + e/m"), ""),
        (potential("break when l/L - 1 > 3 + e/m"), ""),
        (potential("break when l/L - 1 > 9.5 + abs(e)/m"), "never-breaks"),
        (potential("break when l/L - 1 >= e/m"), "breaks-at-rest"),
        (potential("break when l/L - 1 > 0.1 + 2*e/m"), "breaks-in-compression"),
        (potential("domain l/L in (0, 2)\nbreak when e/m > 1.2"), "never-breaks"),
        (potential("domain l/L in (0.9, 1.2)\nbreak when (e/m)^2 > 0.03"), ""),
        (potential("break when e/m > 0.1 and (Xi(1)/L)^2 > 0.4"), ""),
        (tensors("domain l/L in (0.9, 1.2)\nbreak when H : H > 0.05"), ""),
        (
            remembering("update k = max(k, e/m)\npsi(e, m) = (1 + k)*(e/m)^2"),
            "update-creates-energy",
        ),
        (remembering("update k = max(k, e/m)\npsi(e, m) = exp(-k)*(e/m)^2"), ""),
        (
            remembering("update k = max(k, e/m)\npsi(l, e, m) = (1 + k)*(l/L - 1 - e/m)^2"),
            "update-creates-energy",
        ),
        (remembering("update k = max(k, e/m)\npsi(l, e, m) = exp(-k)*(l/L - 1 - e/m)^2"), ""),
        (remembering("update k = k + (e/m)^2\npsi(e, m) = exp(-k)*(e/m)^2"), "update-not-settled"),
        (remembering("update k = k + (e/m)^2*dt\npsi(e, m) = exp(-k)*(e/m)^2"), ""),
        (
            remembering("update k = k + (e/m)^2*dt\npsi(e, m) = exp(-k)*(e/m)^2\nbreak when k < 0"),
            "never-breaks",
        ),
        (
            remembering(
                "update k = k + max(0, e/m)*dt\npsi(e, m) = exp(-k)*(e/m)^2\nbreak when k > 1e9",
            ),
            "",
        ),
    ] {
        let found: Vec<&str> = model(&text).lint(false).iter().map(|found| found.code).collect();
        let expected: &[&str] = if code.is_empty() { &[] } else { &[code] };
        assert_eq!(found, expected, "{text}");
    }
}
