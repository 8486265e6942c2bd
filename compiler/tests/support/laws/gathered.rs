//! Energies of gathered states: integrands as energies of bonds, energies of points and of bonds for what a
//! family of six bonds gathers at strains from 1e-1 to 1e-15.
//!
//! Gathered values come rounded, so psi and its gradient count in what rounding the variables once changes
//! them by, at least in their value; products as those in all directions, likewise.

use piola_compiler::verify::sample::Random;
use piola_compiler::{Batch, GatheredBatch, GatheredKernel, GatheredKernels, Mode, check_text};

use super::{Case, DECADES, FORM, Found, LEVELS, Truth, in_units, measure, truth};

/// Bonds of a family.
const BONDS: usize = 6;

pub(super) fn look_at(case: &Case, text: &str, found: &mut Found) {
    integrands(case, text, found);
    for level in LEVELS {
        let compiled = case.model.compile(&case.values, Mode::Jit(level), FORM).unwrap();
        let gathered = compiled.gathered.unwrap();
        let mut random = Random::new(0x6661_6d69_6c79);
        for decade in DECADES.into_iter().flat_map(|decade| [decade; 2]) {
            let strain = libm::pow(10.0, -f64::from(decade)) * random.uniform(0.4, 2.0);
            let family = Family::new(strain, &mut random);
            let integrals = family.gather(&gathered);
            let name = format!("strain 1e-{decade} {}", case.with);
            for (kernel, of_bonds) in [(&gathered.points, false), (&gathered.bonds, true)] {
                if let Some(kernel) = kernel {
                    energy(case, (kernel, of_bonds), (&family, &integrals), &name, found);
                }
            }
        }
    }
}

/// Each integrand as an energy of bonds, as `piola audit` looks at it.
fn integrands(case: &Case, text: &str, found: &mut Found) {
    let variant = case.model.variant(case.values.dimension).unwrap();
    for integral in &variant.integrals {
        let keeps = |line: &&str| !line.starts_with("psi(");
        let lines: Vec<&str> = text.lines().filter(keeps).collect();
        let domain = "domain l/L in [0.5, 2]";
        let text = format!("{}\npsi(l) = {}\n{domain}\n", lines.join("\n"), integral.text);
        let (_, model) = check_text(&text).unwrap_or_else(|e| panic!("{text}: {e:?}"));
        // Of the length at rest alone: nothing to lose.
        let of_length = integral.text.split(|c: char| !c.is_alphanumeric()).any(|word| word == "l");
        if of_length {
            let case = Case { model: &model, values: case.values.clone(), with: "integrand" };
            measure::look_at(&case, found);
        }
    }
}

struct Family {
    volumes: Vec<f64>,
    rest: Vec<f64>,
    lengths: Vec<f64>,
    change: Vec<f64>,
}

impl Family {
    fn new(strain: f64, random: &mut Random) -> Family {
        let mut numbers =
            |low, high| (0..BONDS).map(|_| random.uniform(low, high)).collect::<Vec<f64>>();
        let (volumes, rest) = (numbers(0.5, 1.0), numbers(1.0, 5.0));
        // More of one sign, as a dilatation has it.
        let strains: Vec<f64> = numbers(-0.4, 1.0).iter().map(|e| e * strain).collect();
        let lengths: Vec<f64> =
            rest.iter().zip(&strains).map(|(rest, e)| rest + rest * e).collect();
        let change = lengths.iter().zip(&rest).map(|(l, rest)| (l - rest) / rest).collect();
        Family { volumes, rest, lengths, change }
    }

    /// The integrals, each rounded.
    fn gather(&self, kernels: &GatheredKernels) -> Vec<f64> {
        let batch = Batch {
            measure: &self.lengths,
            reference: &self.rest,
            change: &self.change,
            fields: &[],
        };
        let sum = |kernel: &piola_compiler::Kernel| {
            kernel.derivatives(batch).psi.iter().zip(&self.volumes).map(|(g, v)| g * v).sum()
        };
        kernels.integrals.iter().map(sum).collect()
    }
}

fn energy(
    case: &Case,
    (kernel, of_bonds): (&GatheredKernel, bool),
    (family, integrals): (&Family, &[f64]),
    name: &str,
    found: &mut Found,
) {
    let written = case.model.written_gathered(&case.values, of_bonds);
    let bond = if of_bonds { &family.lengths[..1] } else { &[] };
    let (change, reference): (&[f64], &[f64]) =
        if of_bonds { (&family.change[..1], &family.rest[..1]) } else { (&[], &[]) };
    let variables = [bond, integrals].concat();
    let n = variables.len();
    let at = GatheredBatch { n: 1, variables: &variables, change, reference, fields: &[] };
    let (mut psi, mut gradient) = (vec![0.0], vec![0.0; n]);
    kernel.evaluate(at, &mut psi, &mut gradient);
    // Where the change of the length is what is rounded, it is known to u of itself.
    let known = |k: usize| match (of_bonds, k) {
        (true, 0) => (family.lengths[0] - family.rest[0]).abs(),
        _ => variables[k].abs(),
    };
    let true_along = |direction: usize, variables: &[f64]| -> Option<Truth> {
        let unit: Vec<f64> = (0..n).map(|j| f64::from(u8::from(j == direction))).collect();
        truth(variables, &unit, |variables| {
            let rest = piola_compiler::expression::number::Number::constant(family.rest[0]);
            written.psi(|k| variables[k].clone(), rest)
        })
    };
    let Some(truths) = (0..n).map(|k| true_along(k, &variables)).collect::<Option<Vec<_>>>() else {
        return;
    };
    found.n_places += 1;
    let at_name = || format!("{name} of {}", if of_bonds { "bonds" } else { "points" });
    let change_of_psi: f64 = (0..n).map(|k| known(k) * truths[0].gradient[k].abs()).sum();
    let scale = truths[0].psi.abs() + change_of_psi;
    found.see(true, 0, in_units(psi[0] - truths[0].psi, scale), at_name);
    for k in 0..n {
        let change: f64 = (0..n).map(|j| known(j) * truths[k].product[j].abs()).sum();
        let expected = truths[0].gradient[k];
        let error = in_units(gradient[k] - expected, expected.abs() + change);
        found.see(true, 1, error, at_name);
        let (mut unit, mut product) = (vec![0.0; n], vec![0.0; n]);
        unit[k] = 1.0;
        kernel.product(at, &unit, &mut product);
        for (j, expected) in truths[k].product.iter().enumerate() {
            let beside = |m: usize| {
                let mut moved = variables.clone();
                moved[m] += libm::ldexp(known(m), -20);
                let by = moved[m] - variables[m];
                let other = true_along(k, &moved).map_or(*expected, |truth| truth.product[j]);
                if by == 0.0 { 0.0 } else { ((other - expected) / by * known(m)).abs() }
            };
            let change: f64 = (0..n).map(beside).sum();
            found.see(true, 2, in_units(product[j] - expected, expected.abs() + change), at_name);
        }
    }
}
