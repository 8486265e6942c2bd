//! Vectors of parameters and sums over them: the same as what they stand for, written out.

use piola_compiler::{Setting, check_text, print};

/// What a file says, with everything that is worked out from it, places left aside.
fn told(text: &str) -> Vec<String> {
    let (ast, model) = check_text(text).unwrap_or_else(|found| panic!("{found:?}\n{text}"));
    let mut told = vec![piola_grammar::print(&ast), print::model_listing(&model)];
    for dimension in model.dimensions().collect::<Vec<_>>() {
        let values = model.values(dimension, &[], Some(2.0));
        told.push(format!("{:?}", values.map(|values| values.parameters)));
    }
    told
}

#[test]
fn vectors_and_sums_are_what_they_stand_for() {
    let same = [
        (
            "parameter mu(3) = (3, 2, 1) in Pa, mu > 0 \"weights\"\nparameter alpha(3) = 2, mu*alpha > 0\n\
             psi(F) = sum(k, mu(k)/alpha(k)*(tr(U^alpha(k)) - d))",
            "parameter mu1 = 3 in Pa, mu1 > 0 \"weights\"\nparameter mu2 = 2 in Pa, mu2 > 0 \"weights\"\n\
             parameter mu3 = 1 in Pa, mu3 > 0 \"weights\"\nparameter alpha1 = 2, mu1*alpha1 > 0\n\
             parameter alpha2 = 2, mu2*alpha2 > 0\nparameter alpha3 = 2, mu3*alpha3 > 0\n\
             psi(F) = mu1/alpha1*(tr(U^alpha1) - d) + mu2/alpha2*(tr(U^alpha2) - d) \
             + mu3/alpha3*(tr(U^alpha3) - d)",
        ),
        (
            "parameter C1(2) = (1, 2)\npsi(l) = sum(k, 2, 4, C1(2*k - k - (k - 1))*(l/L - 1)^k)",
            "parameter C1_1 = 1\nparameter C1_2 = 2\n\
             psi(l) = C1_1*(l/L - 1)^2 + C1_1*(l/L - 1)^3 + C1_1*(l/L - 1)^4",
        ),
        (
            "parameter c(2) = 1\nf(mu, k) = mu*k\npsi(l) = sum(i, sum(j, c(i)*c(j)*f(l, L))) + c(2)*l",
            "parameter c1 = 1\nparameter c2 = 1\nf(mu, k) = mu*k\n\
             psi(l) = c1*c1*f(l, L) + c1*c2*f(l, L) + (c2*c1*f(l, L) + c2*c2*f(l, L)) + c2*l",
        ),
        (
            "parameter tau(2) = (1, 10)\nstate q(2) = 0\ns = l/L - 1\n\
             psi(l) = sum(k, (s - q(k))^2)\nupdate q(k) = q(k) + (s - q(k))*(1 - exp(-dt/tau(k)))",
            "parameter tau1 = 1\nparameter tau2 = 10\nstate q1 = 0\nstate q2 = 0\ns = l/L - 1\n\
             psi(l) = (s - q1)^2 + (s - q2)^2\nupdate q1 = q1 + (s - q1)*(1 - exp(-dt/tau1))\n\
             update q2 = q2 + (s - q2)*(1 - exp(-dt/tau2))",
        ),
        (
            "dimensions 3\nparameter n(3) = (1, 0, 0)\npsi(l) = (n*Xi/L)^2*(l/L - 1)^2",
            "dimensions 3\nparameter n1 = 1\nparameter n2 = 0\nparameter n3 = 0\n\
             psi(l) = (vector(n1, n2, n3)*Xi/L)^2*(l/L - 1)^2",
        ),
        (
            "n = vector(1, 0)\ndimensions 2\nf(I2) = I2\n\
             psi(F) = I1 + I2^2*I3 + I4(n) + I5(2*n) + f(J)\ndomain I1 in (1, 9)",
            "n = vector(1, 0)\ndimensions 2\nf(I2) = I2\n\
             psi(F) = tr(C) + ((tr(C)^2 - C : C)/2)^2*J^2 + n*C*n + 2*n*C*C*(2*n) + f(J)\n\
             domain tr(C) in (1, 9)",
        ),
        // What a file defines itself is what it says.
        ("I1 = 2*tr(C)\npsi(F) = I1", "I1 = 2*tr(C)\npsi(F) = I1"),
        (
            "sum(x, y) = x + y\nparameter c(2) = 1\ng(c) = c\npsi(l) = sum(c(1), g(l))",
            "sum(x, y) = x + y\nparameter c1 = 1\nparameter c2 = 1\ng(c) = c\npsi(l) = sum(c1, g(l))",
        ),
        (
            "parameter c(2) = 1\ndomain l/L in (c_0, sum(k, 1, 3, k))\n",
            "parameter c1 = 1\nparameter c2 = 1\ndomain l/L in (c_0, 1 + 2 + 3)\n",
        ),
    ];
    for (short, long) in same {
        let file = |text: &str| {
            let rest = if text.contains("c_0") { "c_0 = 1/2\npsi(l) = l\n" } else { "" };
            format!("potential p\n{rest}{text}\n")
        };
        assert_eq!(told(&file(short)), told(&file(long)), "{short}");
    }
}

#[test]
fn entries_are_set_by_their_names() {
    let text =
        "potential p\nparameter mu(2) in MPa, mu > 0\npsi(F) = sum(k, mu(k)*(tr(C) - d)^k)\n";
    let (_, model) = check_text(text).unwrap();
    let set = |name: &str, value| (name.to_string(), Setting::Number(value));
    let values = model.values(2, &[set("mu1", 2.0), set("mu2", 3.0)], None).unwrap();
    assert_eq!(values.parameters, [2e6, 3e6]);
    let errors = model.values(2, &[set("mu1", 2.0), set("mu2", -3.0)], None).unwrap_err();
    assert_eq!((errors[0].code, errors[0].parameter.as_str()), ("constraint-violated", "mu2"));
    assert!(errors[0].message.contains("breaks `mu2 > 0`"), "{}", errors[0].message);
    let errors = model.values(2, &[set("mu", 2.0)], None).unwrap_err();
    assert!(errors[0].help.contains("mu1, mu2"), "{}", errors[0].help);
    let missing: Vec<&str> = errors[1..].iter().map(|error| error.parameter.as_str()).collect();
    assert_eq!(missing, ["mu1", "mu2"]);
}

/// The codes of what is found in a file, with the text at each place.
fn found(text: &str) -> Vec<(&'static str, String)> {
    let found = check_text(text).expect_err(text);
    found.into_iter().map(|f| (f.code, text[f.span.range()].to_string())).collect()
}

#[test]
fn what_has_no_entries_is_told_at_its_place() {
    let vectors = "parameter mu(3) = 1\nparameter nu(2) = 1\nparameter C = 1\n";
    for (line, code, place) in [
        ("psi(l) = mu(4)*l", "wrong-shape", "4"),
        ("psi(l) = mu(0)*l", "wrong-shape", "0"),
        ("psi(l) = mu(1.5)*l", "wrong-shape", "1.5"),
        ("psi(l) = mu(d)*l", "wrong-shape", "d"),
        ("psi(l) = mu(1, 2)*l", "wrong-shape", "1"),
        ("psi(l) = mu*l", "wrong-shape", "mu"),
        ("psi(l) = sum(k, l^k)", "wrong-shape", "k"),
        ("psi(l) = sum(k, mu(k)*nu(k)*l)", "wrong-shape", "nu"),
        ("psi(l) = sum(k, mu(k + 1)*mu(k)*l)", "wrong-shape", "k + 1"),
        ("psi(l) = sum(mu(1), l)", "wrong-number-of-arguments", "sum(mu(1), l)"),
        ("psi(l) = sum(k)", "wrong-number-of-arguments", "sum(k)"),
        ("psi(l) = sum(k, 1, mu(k))", "wrong-number-of-arguments", "sum(k, 1, mu(k))"),
        ("psi(l) = sum(k, 1, C, l^k)", "wrong-shape", "C"),
        ("psi(l) = sum(C, mu(C)*l)", "duplicate-name", "C"),
        ("psi(l) = sum(k, sum(k, mu(k)*l))", "duplicate-name", "k"),
        ("psi(l) = sum(l, mu(l))", "reserved-name", "l"),
        ("psi(l) = sum(k, mu(k)*y)", "unknown-name", "y"),
        ("psi(l) = sum(k, m(k)*l)", "unknown-name", "m"),
        ("psi(l) = sum(i, 1, 1000, sum(j, 1, 1000, l^i))", "too-large", "l"),
        ("f(k, x) = mu(k)*x\npsi(l) = f(1, l)", "wrong-shape", "k"),
        ("psi(l) = l\nparameter mu1 = 2", "duplicate-name", "mu1"),
        ("psi(l) = l\nparameter C(2) = 2", "duplicate-name", "C"),
        ("psi(l) = l\nmu(x) = x", "duplicate-name", "mu"),
        ("psi(l) = l\nparameter x(2) = (1, 2, 3)", "wrong-shape", "1, 2, 3"),
        ("psi(l) = l\nparameter x = (1, 2)", "wrong-shape", "1, 2"),
        ("psi(l) = l\nparameter exp(2) = 1", "reserved-name", "exp"),
        ("psi(l) = l\nparameter x(0) = 1", "syntax", "0"),
        ("psi(l) = l\nparameter x(101) = 1", "syntax", "101"),
        ("psi(l) = l*q(1)\nstate q(2) = 0\nupdate q = l", "wrong-shape", "q"),
        ("psi(l) = l\nupdate C(k) = l", "not-a-state", "C"),
    ] {
        let text = format!("potential p\n{vectors}{line}\n");
        let found = found(&text);
        let expected = (code, place.to_string());
        assert!(found.contains(&expected), "{line}: {found:?}");
        // One mistake, few words.
        assert!(found.len() <= 2, "{line}: {found:?}");
    }
}

#[test]
fn what_a_bad_line_declares_is_not_told_twice() {
    let text = "potential p\nparameter mu(3) in in Pa\npsi(l) = sum(k, mu(k)*l)\n";
    assert_eq!(found(text).len(), 1, "{:?}", found(text));
}
