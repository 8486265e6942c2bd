//! Functions of bonds that remember, break and know their direction.

use piola_compiler::{Form, Level, Mode, check, print};
use piola_grammar::parse;

use super::{Folder, machine, run, same_bits};

/// What bonds remember and when they break: functions with states and a time step, to the last bit.
#[test]
fn printed_c_of_bonds_that_remember_gives_the_same_numbers() {
    if !machine::has_c_compiler() {
        return;
    }
    let text = "potential memory\nstate k = 0.25\nstate life = 2\ns = l/L - 1\n\
                update k = max(k, s)\nupdate life = life - max(0, s - 1/8)^2*dt\n\
                state g = 0.5\nupdate g = max(g, a/A - 1)\npsi(a) = A*g*(a/A - 1)^2\n\
                psi(l) = L*s^2/(1 + k)\ndissipation(l) = k*l*rate(l)^2*abs(rate(l))\nbreak when k + s > 3/4\nbreak when life <= 1 or s >= 2";
    let model = check(&parse(text).unwrap()).unwrap();
    let values = model.values(3, &[], Some(1.0)).unwrap().with_states(&model);
    let folder = Folder::new("piola_c_of_bonds");
    let mut source = print::c_source(&model, &model.specialise(&values).unwrap().energies, None);
    source += &print::c_of_bonds(&model, &model.bond_functions(3, Some(&values)).unwrap());
    let path = folder.0.join("memory.c");
    std::fs::write(&path, &source).unwrap();
    let measures = [0.5, 1.0, 1.0625, 1.125, 1.5, 2.0, 3.5];
    let list =
        |values: &[f64]| values.iter().map(|x| format!("{x:e}")).collect::<Vec<_>>().join(", ");
    let changes = measures.map(|l| l - 1.0);
    let rates = [0.5, -2.0, 1.5, 1e-3, -7.0, 3.0, 0.125];
    let (lives, ks) =
        ([2.0, 1.5, 1.0, 0.5, 1.25, 3.0, 2.5], [0.0, 0.5, 0.25, 0.125, 1.0, 0.0, 2.0]);
    let gs = [0.5, 0.25, 0.0, 1.0, 0.75, 0.5, 3.0];
    let main = format!(
        "#include <stdio.h>\n#include \"memory.c\"\nint main(void) {{\n\
         double l[] = {{{}}}, L[] = {{{}}}, e[] = {{{}}}, k[] = {{{}}}, a[] = {{{}}}, g[] = {{{}}}, r[] = {{{}}}, x[7], y[7], z[7];\n\
         memory_l(7, l, L, e, k, a, x, y, z);\nfor (int i = 0; i < 7; i++) printf(\"%.17g\\n\", y[i]);\n\
         memory_next_k(7, l, L, e, k, a, 0.5, x);\nfor (int i = 0; i < 7; i++) printf(\"%.17g\\n\", x[i]);\n\
         memory_next_life(7, l, L, e, k, a, 0.5, x);\nfor (int i = 0; i < 7; i++) printf(\"%.17g\\n\", x[i]);\n\
         memory_next_g(7, l, L, e, g, 0.5, x);\nfor (int i = 0; i < 7; i++) printf(\"%.17g\\n\", x[i]);\n\
         memory_margin_1(7, l, L, e, k, a, x);\nfor (int i = 0; i < 7; i++) printf(\"%.17g\\n\", x[i]);\n\
         memory_margin_2(7, l, L, e, k, a, x);\nfor (int i = 0; i < 7; i++) printf(\"%.17g\\n\", x[i]);\n\
         memory_dissipation(7, l, L, e, r, k, a, x, y, z);\nfor (int i = 0; i < 7; i++) printf(\"%.17g\\n\", y[i]);\n\
         return 0;\n}}\n",
        list(&measures),
        list(&[1.0; 7]),
        list(&changes),
        list(&ks),
        list(&lives),
        list(&gs),
        list(&rates),
    );
    let printed = run(&folder, Vec::new(), &main);
    let mut printed = printed.lines().map(|line| line.parse::<f64>().unwrap());
    let mode = Mode::Jit(Level::Strict);
    let fields = |with_time: bool| {
        let dt = [0.5; 7];
        if with_time {
            [&ks[..], &lives, &gs, &dt].concat()
        } else {
            [&ks[..], &lives, &gs].concat()
        }
    };
    let reference = [1.0; 7];
    let batch = |fields| piola_compiler::Batch {
        measure: &measures,
        reference: &reference,
        change: &changes,
        fields,
    };
    let (of_energy, of_next) = (fields(false), fields(true));
    let kernels = model.compile(&values, mode, Form::Accurate).unwrap().kernels;
    let mut expected = kernels[0].derivatives(batch(&of_energy)).dpsi;
    for next in model.next_states(&values, mode, Form::Accurate).unwrap() {
        expected.extend(next.next.derivatives(batch(&of_next)).psi);
    }
    for criterion in model.criteria(&values, mode, Form::Accurate).unwrap() {
        expected.extend(criterion.margin.derivatives(batch(&of_energy)).psi);
    }
    let dissipation = model.dissipation(&values, mode).unwrap().unwrap();
    let of_rate = [&ks[..], &lives, &gs, &measures].concat();
    let change = rates.map(|rate| rate - 1.0);
    let by_rate = piola_compiler::Batch { measure: &rates, change: &change, ..batch(&of_rate) };
    expected.extend(dissipation.derivatives(by_rate).dpsi);
    for (k, expected) in expected.iter().enumerate() {
        let found = printed.next().unwrap();
        assert!(same_bits(found, *expected), "{k}: {found:e} and {expected:e}\n{source}");
    }
    assert!(printed.next().is_none());
}

/// The direction of a bond at rest: an array for each component, behind states.
#[test]
fn printed_c_of_bonds_by_direction_gives_the_same_numbers() {
    if !machine::has_c_compiler() {
        return;
    }
    let text = "potential directed\ndimensions 2\nstate k = 0\nc = (vector(3, 4)*Xi/L)^2\n\
                update k = max(k, c*(l/L - 1))\npsi(l) = (2 + c)*L*(l/L - 1)^2/(1 + k)\n\
                break when l/L - 1 > c/8";
    let model = check(&parse(text).unwrap()).unwrap();
    let values = model.values(2, &[], None).unwrap().with_states(&model);
    let folder = Folder::new("piola_c_of_directions");
    let mut source = print::c_source(&model, &model.specialise(&values).unwrap().energies, None);
    source += &print::c_of_bonds(&model, &model.bond_functions(2, Some(&values)).unwrap());
    std::fs::write(folder.0.join("directed.c"), &source).unwrap();
    let measures = [0.5, 1.0, 1.0625, 1.5];
    let changes = measures.map(|l| l - 1.0);
    let (reference, ks) = ([1.0; 4], [0.0, 0.5, 0.25, 0.125]);
    let (xs, ys) = ([0.6, -0.8, 1.0, 0.28], [0.8, 0.6, 0.0, -0.96]);
    let list =
        |values: &[f64]| values.iter().map(|x| format!("{x:e}")).collect::<Vec<_>>().join(", ");
    let arrays =
        [("l", measures), ("L", reference), ("e", changes), ("k", ks), ("x", xs), ("y", ys)];
    let arrays = arrays.map(|(name, values)| format!("double {name}[] = {{{}}};\n", list(&values)));
    let main = format!(
        "#include <stdio.h>\n#include \"directed.c\"\nint main(void) {{\n{}double p[4], q[4], r[4];\n\
         directed_l(4, l, L, e, k, x, y, p, q, r);\nfor (int i = 0; i < 4; i++) printf(\"%.17g\\n\", q[i]);\n\
         directed_next_k(4, l, L, e, k, x, y, p);\nfor (int i = 0; i < 4; i++) printf(\"%.17g\\n\", p[i]);\n\
         directed_margin_1(4, l, L, e, k, x, y, p);\nfor (int i = 0; i < 4; i++) printf(\"%.17g\\n\", p[i]);\n\
         return 0;\n}}\n",
        arrays.concat()
    );
    let printed = run(&folder, Vec::new(), &main);
    let found: Vec<f64> = printed.lines().map(|line| line.parse().unwrap()).collect();
    let fields = [ks, xs, ys].concat();
    let batch = piola_compiler::Batch {
        measure: &measures,
        reference: &reference,
        change: &changes,
        fields: &fields,
    };
    let mode = Mode::Jit(Level::Strict);
    let kernels = model.compile(&values, mode, Form::Accurate).unwrap().kernels;
    let mut expected = kernels[0].derivatives(batch).dpsi;
    for next in model.next_states(&values, mode, Form::Accurate).unwrap() {
        expected.extend(next.next.derivatives(batch).psi);
    }
    for criterion in model.criteria(&values, mode, Form::Accurate).unwrap() {
        expected.extend(criterion.margin.derivatives(batch).psi);
    }
    assert_eq!(found.len(), expected.len());
    for (k, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert!(same_bits(*found, *expected), "{k}: {found:e} and {expected:e}\n{source}");
    }
}
