//! Names from other languages and from mathematics, and what is written here instead.

/// Where a name stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// In a file with `psi(F)`, which knows tensors.
    EnergyOfGradient,
    /// In any other potential.
    Energy,
    /// In an expression of a scene.
    Scene,
}

/// What to write for names of numbers and their functions, anywhere.
const NUMBERS: &[(&str, &str)] = &[
    ("log", "the natural logarithm is `ln`; a logarithm to base 10 is `ln(x)/ln(10)`"),
    ("log10", "write `ln(x)/ln(10)`"),
    ("log2", "write `ln(x)/ln(2)`"),
    ("pow", "write `x^y`"),
    ("fabs", "the absolute value is `abs`"),
    ("sgn", "the sign is `sign`"),
    ("arcsin", "the inverse sine is `asin`"),
    ("arccos", "the inverse cosine is `acos`"),
    ("arctan", "the inverse tangent is `atan`"),
    ("arctan2", "the angle of a point is `atan2(y, x)`"),
    ("asinh", "write `ln(x + sqrt(x^2 + 1))`"),
    ("arcsinh", "write `ln(x + sqrt(x^2 + 1))`"),
    ("arsinh", "write `ln(x + sqrt(x^2 + 1))`"),
    ("acosh", "write `ln(x + sqrt(x^2 - 1))`"),
    ("atanh", "write `ln((1 + x)/(1 - x))/2`"),
    ("arctanh", "write `ln((1 + x)/(1 - x))/2`"),
    ("artanh", "write `ln((1 + x)/(1 - x))/2`"),
    ("coth", "write `1/tanh(x)`"),
    ("sech", "write `1/cosh(x)`"),
    ("csch", "write `1/sinh(x)`"),
    ("cot", "write `1/tan(x)`"),
    ("sec", "write `1/cos(x)`"),
    ("csc", "write `1/sin(x)`"),
    ("erfc", "write `1 - erf(x)`"),
    ("table", "the first argument of `table` is a file in quotes: `table(\"data.csv\", x)`"),
    ("PI", "write `pi`"),
    ("true", "write a comparison that holds, for instance `0 < 1`"),
    ("false", "write a comparison that does not hold, for instance `1 < 0`"),
];

/// The same for a potential.
const BONDS: &[(&str, &str)] = &[
    ("e", "the base of the natural logarithm is `exp(1)`; the strain of a bond is `l/L - 1`"),
    (
        "xi",
        "the vector of a bond stands in energies that name it, which may hold `l`, too: `psi(xi) = ..`; at rest \
         it is `Xi`",
    ),
    ("r", "the current length of a bond is `l`, its reference length `L`"),
    ("s", "the stretch of a bond is `l/L - 1`"),
    ("l1", "the sides of a triangle stand in energies that name them: `psi(a, l1, l2, l3) = ..`"),
    (
        "a1",
        "the faces of a tetrahedron stand in energies that name them: `psi(v, a1, a2, a3, a4) = ..`",
    ),
    ("angle", "the angle of a triangle stands in energies that name it: `psi(angle) = ..`"),
];

/// Functions of vectors and tensors, and what is written in a file with `psi(F)`.
const TENSOR_FUNCTIONS: &[(&[&str], &str)] = &[
    (
        &["inner", "dot", "ddot", "contract", "double_dot", "frobenius"],
        "the sum of products of all components is `E : E`, the product of two tensors `F*F'`",
    ),
    (&["trace", "Tr"], "the trace is `tr`: write `tr(C)`"),
    (&["transpose", "transp"], "a transpose stands behind its tensor: `F'`"),
    (&["determinant", "Det"], "the determinant is `det`; that of `F` is `J`"),
    (&["inverse"], "the inverse is `inv`: write `inv(C)`"),
    (&["eye", "identity", "Identity", "Id"], "the unit tensor is `I`"),
    (
        &["outer", "otimes", "tensor"],
        "the tensor n m of two vectors is `dyad(n, m)`, with `n = vector(x, y, z)`",
    ),
    (
        &["cross"],
        "there is no cross product: its components are differences of products, `n(1)*m(2) - n(2)*m(1)`",
    ),
    (&["cof", "cofactor"], "the cofactor of `F` is `J*inv(F)'`"),
    (&["logm"], "the logarithm of a tensor is known of stretches: `ln(U)`"),
    (&["expm"], "functions of tensors are known of stretches: `exp(U)`"),
    (&["sqrtm"], "the root of `C` is the stretch `U`"),
    (
        &["eig", "eigvals", "eigenvalues", "eigenvalue", "svd"],
        "sums over the principal stretches are traces of `U`: `tr(U^2)`, `tr(ln(U)^2)`",
    ),
    (&["deviator", "deviatoric"], "the deviator is `dev`: write `dev(E)`"),
    (&["symm"], "the symmetric part is `sym`"),
];

/// Tensors and invariants by their usual names, and what is written in a file with `psi(F)`.
const TENSORS: &[(&[&str], &str)] = &[
    (
        &["I1", "I_1", "IC"],
        "the first invariant is `I1`, that is `tr(C)`, where `C`, `J` and `tr` are not defined anew",
    ),
    (&["I2", "I_2", "IIC"], "the second invariant is `I2`, that is `(tr(C)^2 - C : C)/2`"),
    (
        &["I3", "I_3", "IIIC"],
        "the third invariant is `I3`, that is `J^2`, with `J` the determinant of `F`",
    ),
    (
        &["I4", "I_4", "I4f"],
        "the squared stretch of a fibre along a unit vector `n` is `I4(n)`, that is `n*C*n`",
    ),
    (&["I5", "I_5"], "the fifth invariant is `I5(n)`, that is `n*C*C*n`"),
    (&["I1bar", "I1_bar", "I_1_bar", "Ibar1"], "in three dimensions it is `J^(-2/3)*tr(C)`"),
    (&["B"], "the left Cauchy-Green tensor is `F*F'`; a parameter is declared: `parameter B`"),
    (&["grad", "gradu"], "the gradient of the displacement is `F - I`"),
    (&["eps", "epsilon", "strain"], "Green's strain is `E`, the linear one `sym(F - I)`"),
    (&["T"], "a transpose is written `F'`; a temperature is a parameter: `parameter T`"),
    (
        &["lambda1", "lambda_1", "stretch", "stretches"],
        "sums over the principal stretches are traces of `U`: `tr(U^2)`, `tr(ln(U)^2)`",
    ),
];

/// What to write instead of a name that is known elsewhere.
pub(crate) fn instead(name: &str, place: Place) -> Option<String> {
    let of = |table: &[(&str, &str)]| {
        table.iter().find(|(foreign, _)| *foreign == name).map(|(_, help)| (*help).to_string())
    };
    let among = |table: &[(&[&str], &'static str)]| {
        table.iter().find(|(foreign, _)| foreign.contains(&name)).map(|(_, help)| *help)
    };
    if let Some(help) = of(NUMBERS) {
        return Some(help);
    }
    let function = among(TENSOR_FUNCTIONS);
    match place {
        Place::EnergyOfGradient => {
            function.or_else(|| among(TENSORS)).map(str::to_string).or_else(|| of(BONDS))
        }
        // One letter more likely is a parameter that was forgotten.
        Place::Energy => of(BONDS).or_else(|| {
            let tensors = function.is_some() || is_of_tensors(name);
            (tensors && name.len() > 1).then(|| {
                "tensors are known in files with an energy `psi(F)` of the deformation gradient; \
                 `l`, `a` and `v` are numbers"
                    .to_string()
            })
        }),
        Place::Scene => match name {
            "x" | "y" | "z" => Some(format!(
                "positions are those at rest, in capital letters: `{}`",
                name.to_uppercase()
            )),
            "norm" => Some("a distance is `sqrt(X^2 + Y^2)`".to_string()),
            _ if function.is_some() || is_of_tensors(name) => Some(
                "expressions of a scene are numbers of the position at rest, `X`, `Y`, `Z`, and of \
                 `t`: no vectors, no tensors"
                    .to_string(),
            ),
            _ => None,
        },
    }
}

/// The component that `F11`, `C_12` or `E23` means.
pub(crate) fn component(name: &str) -> Option<String> {
    let mut letters = name.chars().filter(|letter| *letter != '_');
    let (tensor, row, column) = (letters.next()?, letters.next()?, letters.next()?);
    let counts = |index: char| ('1'..='3').contains(&index);
    let is_component = matches!(tensor, 'F' | 'C' | 'E') && counts(row) && counts(column);
    (is_component && letters.next().is_none()).then(|| format!("{tensor}({row}, {column})"))
}

/// Whether a file with `psi(F)` knows this name, and nothing else does.
pub(crate) fn is_of_tensors(name: &str) -> bool {
    ["F", "C", "E", "U", "J", "I", "tr", "det", "dev", "sym", "inv", "dyad", "vector", "norm"]
        .contains(&name)
}

#[cfg(test)]
mod tests {
    use super::{Place, instead};
    use crate::check::check_text;

    /// What the checker says about a line in a file with `psi(F)`, and in one without.
    fn said(line: &str) -> String {
        let text = format!("potential p\nparameter mu\n{line}\n");
        let found = check_text(&text).err().unwrap_or_default();
        found
            .iter()
            .flat_map(|d| {
                [d.message.as_str()].into_iter().chain(d.helps.iter().map(String::as_str))
            })
            .fold(String::new(), |all, part| all + part + "\n")
    }

    #[test]
    fn what_a_newcomer_types_is_answered_with_what_to_write() {
        for (line, answer) in [
            ("psi(F) = mu*inner(E, E)", "`E : E`"),
            ("psi(F) = mu*trace(C)", "`tr(C)`"),
            ("psi(F) = mu*outer(E, E)", "`dyad(n, m)`"),
            ("psi(F) = mu*(I_1 - 3)", "`tr(C)`"),
            ("psi(F) = mu*(I4 - 1)", "`n*C*n`"),
            ("psi(F) = mu*tr(transpose(F)*F)", "`F'`"),
            ("psi(F) = mu*tr(F^T*F)", "`F'`"),
            ("psi(F) = mu*tr(F.T*F)", "`F'`"),
            ("psi(F) = mu*tr(F@F)", "`*`"),
            ("psi(F) = mu*F[1,1]", "`F(1, 2)`"),
            ("psi(l) = mu[3]*(l - L)^2", "`mu3`"),
            ("n = (1,0,0)", "`vector(x, y, z)`"),
            ("n = [1,0,0]", "`vector(x, y, z)`"),
            ("psi(a, l) = mu*(l - L)^2", "`psi(a) = ..` and `psi(l) = ..`"),
            ("psi(l) = mu*tr(l)", "`psi(F)`"),
            ("psi(C) = mu*tr(C)", "`psi(F) = ..`"),
        ] {
            assert!(said(line).contains(answer), "{line}\n{}", said(line));
        }
        // One mistake, one message.
        assert!(!said("psi(C) = mu*tr(C)").contains("unknown"), "{}", said("psi(C) = mu*tr(C)"));
        // What is right stays right.
        assert_eq!(said("psi(F) = mu*(C : C)"), "");
        assert_eq!(said("C = 2\npsi(l) = C*(l - L)^2"), "");
        // A letter that is forgotten is a parameter.
        assert!(said("psi(l) = C*(l - L)^2").contains("`parameter C`"));
    }

    #[test]
    fn scenes_have_neither_vectors_nor_tensors() {
        for name in ["inner", "tr", "F", "transpose"] {
            assert!(instead(name, Place::Scene).is_some_and(|help| help.contains("no vectors")));
        }
        assert_eq!(instead("frequency", Place::Scene), None);
    }
}
