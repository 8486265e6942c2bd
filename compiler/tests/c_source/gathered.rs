//! What points gather, numbers and vectors, with conditions and what is remembered.

use piola_compiler::{
    Batch, FamilyBatch, FamilyKernel, Form, GatheredBatch, GatheredKernel, Level, Mode, Model,
    Values, check, print,
};
use piola_grammar::parse;

use super::{Folder, Random, machine, run, same_bits};

const MODE: Mode = Mode::Jit(Level::Strict);

/// Places of each function.
const N: usize = 9;

fn numbers(random: &mut Random, n: usize) -> Vec<f64> {
    (0..n * N).map(|_| random.uniform(0.5, 2.0)).collect()
}

/// A call in a C program, of which the last arrays come out, and the numbers that these must have.
struct Call {
    symbol: String,
    given: Vec<Vec<f64>>,
    /// The time step, behind these many arrays.
    time: Option<(usize, f64)>,
    expected: Vec<Vec<f64>>,
}

/// Compiles the C of a potential beside a `main` with all calls, and holds what it prints against what is expected.
fn agree(name: &str, model: &Model, values: &Values, calls: &[Call]) {
    let folder = Folder::new(&format!("piola_c_of_{name}"));
    let forms = model.gathered_forms(values.dimension, Some(values)).unwrap();
    let source = print::c_source(model, &[], None) + &print::gathered_c(model, &forms);
    std::fs::write(folder.0.join("law.c"), source).unwrap();
    let mut main = "#include <stdio.h>\n#include \"law.c\"\nint main(void) {\n".to_string();
    for Call { symbol, given, time, expected } in calls {
        let list = |x: &[f64]| x.iter().map(|x| format!("{x:e}")).collect::<Vec<_>>().join(", ");
        let mut words = vec![N.to_string()];
        main += "  {\n";
        for (k, array) in given.iter().enumerate() {
            if let Some((_, dt)) = time.filter(|(place, _)| *place == k) {
                words.push(format!("{dt:?}"));
            }
            main += &format!("    double in{k}[] = {{{}}};\n", list(array));
            words.push(format!("in{k}"));
        }
        if let Some((_, dt)) = time.filter(|(place, _)| *place == given.len()) {
            words.push(format!("{dt:?}"));
        }
        for (k, array) in expected.iter().enumerate() {
            main += &format!("    double out{k}[{}];\n", array.len());
            words.push(format!("out{k}"));
        }
        main += &format!("    {symbol}({});\n", words.join(", "));
        for (k, array) in expected.iter().enumerate() {
            let n = array.len();
            main +=
                &format!("    for (int i = 0; i < {n}; i++) printf(\"%.17g\\n\", out{k}[i]);\n");
        }
        main += "  }\n";
    }
    main += "  return 0;\n}\n";
    let printed = run(&folder, Vec::new(), &main);
    let mut printed = printed.lines().map(|line| line.parse::<f64>().unwrap());
    for Call { symbol, expected, .. } in calls {
        for (k, x) in expected.iter().flatten().enumerate() {
            let found = printed.next().expect("one line per number");
            assert!(
                x.is_finite() && same_bits(found, *x),
                "{symbol}, number {k}: {found:e} for {x:e}"
            );
        }
    }
    assert!(printed.next().is_none());
}

/// Value with gradient, and product, of a kernel of numbers.
fn of_kernel(kernel: &GatheredKernel, at: GatheredBatch<'_>, direction: &[f64]) -> [Vec<f64>; 3] {
    let mut all = [N, at.variables.len(), at.variables.len()].map(|n| vec![0.0; n]);
    let [psi, gradient, product] = &mut all;
    kernel.evaluate(at, psi, gradient);
    kernel.product(at, direction, product);
    all
}

#[test]
fn printed_c_of_gathered_numbers_gives_the_same_numbers() {
    if !machine::has_c_compiler() {
        return;
    }
    let text = "potential states\nstate p = 0.25\nparameter K = 3\n\
                m = integral(L^2)\ntheta = 3/m*integral(L*(l - L)*(1 + (Xi(1)/L)^2))\n\
                update p = max(p, theta)/(1 + dt)\npsi(theta, m) = K/2*(1 - p)*theta^2*m\n\
                psi(l, m) = (l - L)^2/m*(Xi(2)/L)^2\nbreak when theta > 3 - p\nbreak when l/L - 1 >= 1/4*theta\n";
    let model = check(&parse(text).unwrap()).unwrap();
    let values = model.values(3, &[], None).unwrap().with_states(&model);
    let compiled = model.compile(&values, MODE, Form::Accurate).unwrap().gathered.unwrap();
    let mut random = Random::new(0x6320_6761);
    let (states, unit) = (numbers(&mut random, 1), numbers(&mut random, 3));
    let (integrals, lengths) = (numbers(&mut random, 2), numbers(&mut random, 1));
    let (reference, direction) = (numbers(&mut random, 1), numbers(&mut random, 3));
    let change: Vec<f64> =
        lengths.iter().zip(&reference).map(|(l, rest)| (l - rest) / rest).collect();
    let fields = [&states[..], &unit].concat();
    let mut calls = Vec::new();
    for (k, integrand) in compiled.integrals.iter().enumerate() {
        let fields = if integrand.fields().is_empty() { &[][..] } else { &fields };
        let batch = Batch { measure: &lengths, reference: &reference, change: &change, fields };
        let found = integrand.derivatives(batch);
        let directions = unit.chunks(N).filter(|_| !fields.is_empty()).map(<[f64]>::to_vec);
        calls.push(Call {
            symbol: format!("states_integrand_{}", k + 1),
            given: [&lengths, &reference, &change].into_iter().cloned().chain(directions).collect(),
            time: None,
            expected: vec![found.psi, found.dpsi, found.d2psi],
        });
    }
    let points =
        GatheredBatch { n: N, variables: &integrals, change: &[], reference: &[], fields: &fields };
    let of_bonds = [&lengths[..], &integrals].concat();
    let bonds = GatheredBatch {
        n: N,
        variables: &of_bonds,
        change: &change,
        reference: &reference,
        fields: &fields,
    };
    let given = [&reference[..], &change].concat();
    let second = unit[N..2 * N].to_vec();
    let kernel = compiled.points.as_ref().unwrap();
    let [psi, gradient, product] = of_kernel(kernel, points, &direction[..2 * N]);
    let expected = vec![psi, gradient];
    let of = |symbol: &str, given: &[&[f64]], expected: Vec<Vec<f64>>| {
        let given = given.iter().map(|array| array.to_vec()).collect();
        Call { symbol: symbol.to_string(), given, time: None, expected }
    };
    calls.push(of("states_points", &[&integrals, &states], expected));
    let all = [&integrals[..], &states, &direction[..2 * N]];
    calls.push(of("states_points_product", &all, vec![product]));
    let kernel = compiled.bonds.as_ref().unwrap();
    let [psi, gradient, product] = of_kernel(kernel, bonds, &direction);
    calls.push(of("states_bonds", &[&of_bonds, &given, &second], vec![psi, gradient]));
    calls.push(of(
        "states_bonds_product",
        &[&of_bonds, &given, &second, &direction],
        vec![product],
    ));
    let margins = model.gathered_criteria(&values, MODE, Form::Accurate).unwrap();
    let margin = |number: usize, at| {
        let mut margin = vec![0.0; N];
        margins[number].margin.evaluate(at, &mut margin, &mut []);
        vec![margin]
    };
    calls.push(of("states_margin_1", &[&integrals, &states], margin(0, points)));
    let bare = GatheredBatch { fields: &[], ..bonds };
    calls.push(of("states_margin_2", &[&of_bonds, &given], margin(1, bare)));
    let in_time = values.clone().following_states(&model);
    let next = model.gathered_next_states(&in_time, MODE, Form::Accurate).unwrap();
    let step = [&fields[..], &[0.125; N]].concat();
    let mut values_next = vec![0.0; N];
    next[0].next.evaluate(GatheredBatch { fields: &step, ..points }, &mut values_next, &mut []);
    let mut call = of("states_next_p", &[&integrals, &states], vec![values_next]);
    call.time = Some((2, 0.125));
    calls.push(call);
    agree("numbers", &model, &values, &calls);
}

#[test]
fn printed_c_of_gathered_vectors_gives_the_same_numbers() {
    if !machine::has_c_compiler() {
        return;
    }
    let text = "potential tensors\nm = integral(1)\nK = integral(dyad(Xi, Xi))\n\
                H = integral(dyad(xi - Xi, Xi))*inv(K)\npsi(H) = (H : H)/2 + tr(H)^2\n\
                z = xi - Xi - (H + neighbour(H))*Xi/2\npsi(xi, H, m) = (z*z)/m\n";
    let model = check(&parse(text).unwrap()).unwrap();
    for d in [2, 3] {
        let values = model.values(d, &[], None).unwrap();
        let kernels = model.compile(&values, MODE, Form::Accurate).unwrap().vectors.unwrap();
        let mut random = Random::new(0x6320_7665 + d as u64);
        let unit = numbers(&mut random, d);
        let mut calls = Vec::new();
        let mut add = |symbol: &str, kernel: &FamilyKernel| {
            let m = kernel.variables().len();
            let (variables, direction) = (numbers(&mut random, m), numbers(&mut random, m));
            let given = numbers(&mut random, kernel.given().len());
            let fields = if kernel.fields().is_empty() { &[][..] } else { &unit };
            let at = FamilyBatch { n: N, variables: &variables, given: &given, fields };
            let [mut value, mut gradient, mut product] = [N, m * N, m * N].map(|n| vec![0.0; n]);
            kernel.evaluate(at, &mut value, &mut gradient);
            kernel.product(at, &direction, &mut product);
            let mut all = vec![variables];
            all.extend(Some(given).filter(|given| !given.is_empty()));
            all.extend(fields.chunks(N).map(<[f64]>::to_vec));
            let of = |ending: &str, given: Vec<Vec<f64>>, expected| Call {
                symbol: format!("tensors_{symbol}{ending}"),
                given,
                time: None,
                expected,
            };
            calls.push(of("", all.clone(), vec![value, gradient]));
            all.push(direction);
            calls.push(of("_product", all, vec![product]));
        };
        add("integrands", &kernels.integrands);
        add("functions", kernels.functions.as_ref().unwrap());
        add("points", kernels.points.as_ref().unwrap());
        add("bonds", kernels.bonds.as_ref().unwrap());
        agree("vectors", &model, &values, &calls);
    }
}
