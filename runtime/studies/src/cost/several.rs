//! What functions of several numbers cost: energies of several measures, what points gather and energies of it.

use std::hint::black_box;
use std::time::Instant;

use piola_compiler::{
    Batch, Compiled, CoupledBatch, CoupledKernel, FamilyBatch, FamilyKernel, GatheredBatch,
    GatheredKernel, Kernel, Order, Outputs, Slot,
};
use piola_mechanics::element::CAPACITY;

use super::{CostError, Random, Way};

/// What a function of several numbers costs at one place: a triangle, a tetrahedron, a bond, a point.
#[derive(Clone, Debug, PartialEq)]
pub struct SeveralCost {
    /// What it is: `psi(angle)`; `energy of points`, `energy of bonds`, `integrands`, `functions of integrals`.
    pub title: String,
    /// How many numbers it is differentiated by; of integrands how many there are, each by the length.
    pub n_variables: usize,
    /// Nanoseconds per place: its value; with the gradient; the product with a direction, of integrands second
    /// derivatives.
    pub nanoseconds: [f64; 3],
}

/// Times them all, a few percent from rest.
pub(super) fn time_all(compiled: &Compiled, way: Way) -> Result<Vec<SeveralCost>, CostError> {
    let timer = Timer { n: way.batches * CAPACITY, rounds: way.rounds };
    let mut found: Vec<SeveralCost> = Vec::new();
    let mut add = |title: String, n_variables: usize, times: Option<[f64; 3]>| {
        let Some(nanoseconds) = times else { return Err(CostError::NonFiniteSeveral { title }) };
        found.push(SeveralCost { title, n_variables, nanoseconds });
        Ok(())
    };
    for kernel in &compiled.coupled {
        let title = format!("psi({})", kernel.argument());
        add(title, kernel.variables().len(), timer.coupled(kernel))?;
    }
    if let Some(gathered) = &compiled.gathered {
        let title = "integrands".to_string();
        add(title, gathered.integrals.len(), timer.integrands(&gathered.integrals))?;
        for kernel in [&gathered.points, &gathered.bonds].into_iter().flatten() {
            let of = if kernel.of_bonds() { "bonds" } else { "points" };
            add(format!("energy of {of}"), kernel.n_variables(), timer.numbers(kernel))?;
        }
    }
    if let Some(vectors) = &compiled.vectors {
        let all = [
            ("integrands", Some(&vectors.integrands)),
            ("functions of integrals", vectors.functions.as_ref()),
            ("energy of points", vectors.points.as_ref()),
            ("energy of bonds", vectors.bonds.as_ref()),
        ];
        for (title, kernel) in all.into_iter().filter_map(|(title, own)| Some((title, own?))) {
            add(title.to_string(), kernel.variables().len(), timer.family(kernel))?;
        }
    }
    Ok(found)
}

/// Times a function at `n` places.
struct Timer {
    n: usize,
    rounds: usize,
}

impl Timer {
    /// So many arrays of numbers beside one of these.
    fn numbers_around(&self, of: &[f64], by: f64, random: &mut Random) -> Vec<f64> {
        of.iter().flat_map(|x| vec![*x; self.n]).map(|x| x + by * random.next()).collect()
    }

    /// Nanoseconds a place; nothing where what comes out is not finite.
    fn time(
        &self,
        m: usize,
        mut run: impl FnMut(usize, &mut [f64], &mut [f64]),
    ) -> Option<[f64; 3]> {
        let (mut value, mut others) = (vec![0.0; self.n], [0; 2].map(|_| vec![0.0; m * self.n]));
        let mut least = [f64::INFINITY; 3];
        for _ in 0..=self.rounds {
            for (order, least) in least.iter_mut().enumerate() {
                let other = &mut others[order / 2];
                let start = Instant::now();
                run(order, &mut value, if order == 0 { &mut [] } else { other });
                black_box((&value, &others));
                *least = least.min(start.elapsed().as_secs_f64());
            }
        }
        let mut all = value.iter().chain(others.iter().flatten());
        all.all(|x| x.is_finite()).then(|| least.map(|seconds| seconds / self.n as f64 * 1e9))
    }

    fn coupled(&self, kernel: &CoupledKernel) -> Option<[f64; 3]> {
        let (mut random, m) = (Random(0x636f_7374), kernel.variables().len());
        let rest = self.numbers_around(&vec![1.0; m], 0.1, &mut random);
        let change = self.numbers_around(&vec![0.0; m], 0.04, &mut random);
        let direction = self.numbers_around(&vec![0.0; m], 1.0, &mut random);
        let is_moved = |k: usize| kernel.variables()[k / self.n].component().is_some();
        let now = |(k, (rest, e)): (usize, (&f64, &f64))| match is_moved(k) {
            true => *e,
            false => rest * (1.0 + e),
        };
        let variables: Vec<f64> = rest.iter().zip(&change).enumerate().map(now).collect();
        let fields = self.numbers_around(kernel.fields(), 0.0, &mut random);
        let at = CoupledBatch {
            n: self.n,
            variables: &variables,
            reference: &rest,
            change: &change,
            fields: &fields,
        };
        self.time(m, |order, value, other| match order {
            2 => kernel.product(black_box(at), &direction, other),
            _ => kernel.evaluate(black_box(at), value, other),
        })
    }

    /// All integrands, with their first, and with their second derivatives.
    fn integrands(&self, integrands: &[Kernel]) -> Option<[f64; 3]> {
        let mut random = Random(0x636f_7374);
        let reference = self.numbers_around(&[1.0], 0.3, &mut random);
        let change = self.numbers_around(&[0.0], 0.04, &mut random);
        let measure: Vec<f64> = reference.iter().zip(&change).map(|(x, e)| x * (1.0 + e)).collect();
        let fields: Vec<Vec<f64>> = integrands
            .iter()
            .map(|kernel| self.numbers_around(kernel.fields(), 0.0, &mut random))
            .collect();
        let mut second = vec![0.0; self.n];
        self.time(1, |order, value, other| {
            for (kernel, fields) in integrands.iter().zip(&fields) {
                let at =
                    Batch { measure: &measure, reference: &reference, change: &change, fields };
                let order = [Order::Energy, Order::Gradient, Order::Tangent][order];
                let out = Outputs { psi: &mut *value, dpsi: &mut *other, d2psi: &mut second };
                kernel.evaluate(black_box(at), order, out);
                black_box(&second);
            }
        })
    }

    fn numbers(&self, kernel: &GatheredKernel) -> Option<[f64; 3]> {
        let (mut random, m) = (Random(0x636f_7374), kernel.n_variables());
        let mut variables = self.numbers_around(&vec![1.0; m], 0.3, &mut random);
        let direction = self.numbers_around(&vec![0.0; m], 1.0, &mut random);
        let of_bonds: &[f64] = if kernel.of_bonds() { &[1.0] } else { &[] };
        let reference = self.numbers_around(of_bonds, 0.3, &mut random);
        let change: Vec<f64> = reference.iter().map(|_| 0.04 * random.next()).collect();
        for ((l, rest), e) in variables.iter_mut().zip(&reference).zip(&change) {
            *l = rest * (1.0 + e);
        }
        let fields = self.numbers_around(kernel.fields(), 0.0, &mut random);
        let at = GatheredBatch {
            n: self.n,
            variables: &variables,
            change: &change,
            reference: &reference,
            fields: &fields,
        };
        self.time(m, |order, value, other| match order {
            2 => kernel.product(black_box(at), &direction, other),
            _ => kernel.evaluate(black_box(at), value, other),
        })
    }

    fn family(&self, kernel: &FamilyKernel) -> Option<[f64; 3]> {
        let (mut random, m) = (Random(0x636f_7374), kernel.variables().len());
        let mut of = |slots: &[Slot]| -> Vec<f64> {
            let about = |slot: &Slot| match slot {
                Slot::Moved(_) => (0.0, 0.04),
                _ => (1.0, 0.5),
            };
            let around = |(at, by): (f64, f64)| self.numbers_around(&[at], by, &mut random);
            slots.iter().map(about).flat_map(around).collect()
        };
        let (variables, given) = (of(kernel.variables()), of(kernel.given()));
        let direction = self.numbers_around(&vec![0.0; m], 1.0, &mut random);
        let fields = self.numbers_around(kernel.fields(), 0.0, &mut random);
        let at = FamilyBatch { n: self.n, variables: &variables, given: &given, fields: &fields };
        self.time(m, |order, value, other| match order {
            2 => kernel.product(black_box(at), &direction, other),
            _ => kernel.evaluate(black_box(at), value, other),
        })
    }
}
