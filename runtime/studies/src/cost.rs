//! What an interaction costs: the ways to get its derivatives, timed side by side.
//!
//! Each time is the least of several runs in turn over interactions that stay in the caches: what
//! disturbs the machine makes no run faster.

mod several;

pub use several::SeveralCost;

use std::hint::black_box;
use std::time::{Duration, Instant};

use num_dual::HyperDual64;
use piola_compiler::{
    Argument, CompileError, Form, GradientBatch, GradientKernel, Level, Mode, Model, Values,
};
use piola_mechanics::interaction::n_neighbors;
use piola_mechanics::kernel::Measure;

use piola_mechanics::element::{
    CAPACITY, Contributions, CoordinateElement, Element, InteractionBatch, MeasureElement,
    NonFiniteLane, Order,
};

/// A way to get the derivatives of an energy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Way {
    /// Its name in tables.
    pub name: &'static str,
    /// How psi, psi', psi'' are computed.
    pub mode: Mode,
    /// Whether it differentiates in the coordinates instead of the measure.
    pub in_coordinates: bool,
    /// Batches of interactions that a run evaluates.
    batches: usize,
    /// Runs.
    rounds: usize,
}

/// All ways, the fastest first.
pub const WAYS: [Way; 5] = [
    Way {
        name: "fast",
        mode: Mode::Jit(Level::Fast),
        in_coordinates: false,
        batches: 8,
        rounds: 31,
    },
    Way {
        name: "strict",
        mode: Mode::Jit(Level::Strict),
        in_coordinates: false,
        batches: 8,
        rounds: 31,
    },
    Way {
        name: "interpreter",
        mode: Mode::Interpreter,
        in_coordinates: false,
        batches: 2,
        rounds: 9,
    },
    Way { name: "hyper-dual", mode: Mode::HyperDual, in_coordinates: false, batches: 2, rounds: 9 },
    Way {
        name: "hyper-dual coordinates",
        mode: Mode::HyperDual,
        in_coordinates: true,
        batches: 1,
        rounds: 3,
    },
];

/// What a way costs for the energies of a potential.
#[derive(Clone, Debug, PartialEq)]
pub struct WayCost {
    /// The way.
    pub way: Way,
    /// Seconds from the checked potential to something that can be evaluated, all energies together.
    pub compile_seconds: f64,
    /// One entry per energy that the way can evaluate, measures ascending, then `F`.
    pub energies: Vec<EnergyCost>,
    /// Energies of several measures, then what points gather and energies of it; none in coordinates.
    pub several: Vec<SeveralCost>,
}

/// What an interaction of one kind costs, or a place with a deformation gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnergyCost {
    /// Its measure, or `F`.
    pub argument: Argument,
    /// Nanoseconds per interaction: energy; and gradient; and tangent. Per place: psi; psi and P; dP.
    pub nanoseconds: [f64; 3],
}

/// Why nothing was measured.
#[derive(Clone, Debug, thiserror::Error)]
pub enum CostError {
    /// An energy that cannot be compiled.
    #[error(transparent)]
    Compile(#[from] CompileError),
    /// An energy that is not finite a few percent from rest.
    #[error(
        "psi({}) is not finite, or turned inside out, at {} = {:e}, {} = {:e}: there is nothing to time",
        .measure.symbol(), .measure.symbol(), .at.value, .measure.reference_symbol(), .at.reference
    )]
    NonFinite {
        /// The energy.
        measure: Measure,
        /// The interaction.
        at: NonFiniteLane,
    },
    /// An energy of the deformation gradient that is not finite a few percent from rest.
    #[error("psi(F) is not finite a few percent from rest: there is nothing to time")]
    NonFiniteGradient,
    /// A function of several numbers that is not finite a few percent from rest.
    #[error("{title}: not finite a few percent from rest: there is nothing to time")]
    NonFiniteSeveral {
        /// What it is.
        title: String,
    },
}

/// A compiler that takes longer is timed by fewer runs.
const MOST_COMPILING: Duration = Duration::from_millis(300);

/// Times every way for every energy of a potential.
///
/// # Errors
/// Energies that cannot be compiled or evaluated near rest.
pub fn cost(model: &Model, values: &Values) -> Result<Vec<WayCost>, CostError> {
    WAYS.into_iter().map(|way| cost_of(way, model, values)).collect()
}

/// Times the fastest way alone.
///
/// # Errors
/// As for [`cost`].
pub fn fastest(model: &Model, values: &Values) -> Result<WayCost, CostError> {
    cost_of(WAYS[0], model, values)
}

fn cost_of(way: Way, model: &Model, values: &Values) -> Result<WayCost, CostError> {
    let compile = |values| model.compile(values, way.mode, Form::Accurate);
    let (mut compile_seconds, begun) = (f64::INFINITY, Instant::now());
    for _ in 0..way.rounds {
        let start = Instant::now();
        black_box(compile(black_box(values))?);
        compile_seconds = compile_seconds.min(start.elapsed().as_secs_f64());
        if begun.elapsed() > MOST_COMPILING {
            break;
        }
    }
    let dimension = values.dimension;
    let mut energies = Vec::new();
    let compiled = compile(values)?;
    let several = match way.in_coordinates {
        true => Vec::new(),
        false => several::time_all(&compiled, way)?,
    };
    for kernel in compiled.kernels {
        let measure = kernel.measure();
        let fields = kernel.fields().to_vec();
        let element: Box<dyn Element> = if way.in_coordinates {
            let written = model.written(values, measure);
            let psi = move |m: HyperDual64, reference: f64| {
                written.evaluate(m, HyperDual64::from_re(reference))
            };
            Box::new(CoordinateElement::new(measure, dimension, psi))
        } else {
            Box::new(MeasureElement::new(measure, dimension, Box::new(kernel)))
        };
        let nanoseconds =
            time(&*element, &fields, way).map_err(|at| CostError::NonFinite { measure, at })?;
        energies.push(EnergyCost { argument: Argument::Measure(measure), nanoseconds });
    }
    if !way.in_coordinates
        && let Some(kernel) = compiled.gradient
    {
        let nanoseconds = time_gradient(&kernel, way).ok_or(CostError::NonFiniteGradient)?;
        energies.push(EnergyCost { argument: Argument::Gradient, nanoseconds });
    }
    Ok(WayCost { way, compile_seconds, energies, several })
}

/// Nanoseconds per interaction for each order.
fn time(element: &dyn Element, fields: &[f64], way: Way) -> Result<[f64; 3], NonFiniteLane> {
    let (measure, dimension) = (element.measure(), element.dimension());
    let mut random = Random(0x7069_6f6c_6100 ^ measure as u64);
    let mut batches: Vec<InteractionBatch> =
        (0..way.batches).map(|_| random.batch(measure, dimension)).collect();
    if element.n_fields() > 0 {
        for batch in &mut batches {
            let n = batch.padded_len();
            batch.fields = fields.iter().flat_map(|x| std::iter::repeat_n(*x, n)).collect();
        }
    }
    let mut out = Contributions::new(measure, dimension);
    let mut least = [f64::INFINITY; 3];
    for _ in 0..=way.rounds {
        for (order, least) in
            [Order::Energy, Order::Gradient, Order::Tangent].iter().zip(&mut least)
        {
            let start = Instant::now();
            for batch in &batches {
                element.evaluate(black_box(batch), *order, &mut out)?;
                black_box(&out);
            }
            *least = least.min(start.elapsed().as_secs_f64());
        }
    }
    Ok(least.map(|seconds| seconds / (way.batches * CAPACITY) as f64 * 1e9))
}

/// Nanoseconds per place for psi, for psi and P, and for dP, at strains of some percent; nothing where
/// one of them is not finite.
fn time_gradient(kernel: &GradientKernel, way: Way) -> Option<[f64; 3]> {
    let (d, n) = (kernel.dimension(), way.batches * CAPACITY);
    let mut random = Random(0x7069_6f6c_6146);
    let mut numbers = |size: f64| (0..d * d * n).map(|_| size * random.next()).collect();
    let (change, direction): (Vec<f64>, Vec<f64>) = (numbers(0.04), numbers(1.0));
    let rest = |k: usize| f64::from(u8::from(k / n / d == k / n % d));
    let gradient: Vec<f64> = change.iter().enumerate().map(|(k, h)| rest(k) + h).collect();
    let at = GradientBatch { n, gradient: &gradient, change: &change, fields: &[] };
    let mut psi = vec![0.0; n];
    let (mut stress, mut product) = (vec![0.0; d * d * n], vec![0.0; d * d * n]);
    let mut least = [f64::INFINITY; 3];
    for _ in 0..=way.rounds {
        for (order, least) in least.iter_mut().enumerate() {
            let start = Instant::now();
            match order {
                0 => kernel.evaluate(black_box(at), &mut psi, &mut []),
                1 => kernel.evaluate(black_box(at), &mut psi, &mut stress),
                _ => kernel.product(black_box(at), &direction, &mut product),
            }
            black_box((&psi, &stress, &product));
            *least = least.min(start.elapsed().as_secs_f64());
        }
    }
    let finite = [&psi, &stress, &product].iter().all(|all| all.iter().all(|x| x.is_finite()));
    finite.then(|| least.map(|seconds| seconds / n as f64 * 1e9))
}

/// Reproducible interactions.
struct Random(u64);

impl Random {
    /// Between -1 and 1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A full batch of well-shaped interactions: vectors near the axes, strains of some percent.
    fn batch(&mut self, measure: Measure, dimension: usize) -> InteractionBatch {
        let mut batch = InteractionBatch::new(measure, dimension);
        match (n_neighbors(measure), dimension) {
            (1, 2) => self.fill::<1, 2>(&mut batch),
            (1, _) => self.fill::<1, 3>(&mut batch),
            (2, 2) => self.fill::<2, 2>(&mut batch),
            (2, _) => self.fill::<2, 3>(&mut batch),
            _ => self.fill::<3, 3>(&mut batch),
        }
        for weight in &mut batch.weight {
            *weight = 1.0 + 0.5 * self.next();
        }
        batch
    }

    fn fill<const K: usize, const D: usize>(&mut self, batch: &mut InteractionBatch) {
        let mut near_axis = |corner: usize| -> [f64; D] {
            std::array::from_fn(|axis| f64::from(axis == corner % K) + 0.2 * self.next())
        };
        let reference: Vec<[f64; D]> = (0..K * CAPACITY).map(&mut near_axis).collect();
        let displacement: Vec<[f64; D]> =
            (0..K * CAPACITY).map(|_| std::array::from_fn(|_| 0.02 * self.next())).collect();
        batch.gather::<K, D>(CAPACITY, &reference, &displacement, |lane| {
            std::array::from_fn(|corner| K * lane + corner)
        });
    }
}

#[cfg(test)]
mod tests {
    use piola_compiler::{Setting, check_text};

    use super::*;

    fn cost_of_text(text: &str, dimension: usize) -> Result<Vec<WayCost>, CostError> {
        let (_, model) = check_text(text).unwrap();
        let settings: [(String, Setting); 0] = [];
        cost(&model, &model.values(dimension, &settings, None).unwrap())
    }

    #[test]
    fn every_way_and_energy_has_times() {
        let text = "potential p\npsi(l) = (l/L - 1)^2\npsi(a) = ln(a/A)^2\npsi(v) = V/v + v/V\n";
        for (dimension, measures) in [(2, 2), (3, 3)] {
            let found = cost_of_text(text, dimension).unwrap();
            assert_eq!(found.len(), WAYS.len());
            for (cost, way) in found.iter().zip(WAYS) {
                assert_eq!((cost.way, cost.energies.len()), (way, measures));
                assert!(cost.compile_seconds > 0.0);
                let times = cost.energies.iter().flat_map(|energy| energy.nanoseconds);
                assert!(times.clone().all(|x| x > 0.0 && x.is_finite()), "{found:?}");
            }
        }
    }

    #[test]
    fn energies_of_the_gradient_have_times_in_all_ways_but_coordinates() {
        let text = "potential p\npsi(l) = (l/L - 1)^2\npsi(F) = E : E\n";
        for dimension in [2, 3] {
            let found = cost_of_text(text, dimension).unwrap();
            for cost in &found {
                let arguments: Vec<Argument> = cost.energies.iter().map(|e| e.argument).collect();
                let both = [Argument::Measure(Measure::Length), Argument::Gradient];
                assert_eq!(arguments, both[..if cost.way.in_coordinates { 1 } else { 2 }]);
                let times = cost.energies.iter().flat_map(|energy| energy.nanoseconds);
                assert!(times.clone().all(|x| x > 0.0 && x.is_finite()), "{found:?}");
            }
        }
        let error = cost_of_text("potential p\npsi(F) = ln(0*J)\n", 3).unwrap_err();
        assert!(error.to_string().starts_with("psi(F) is not finite"), "{error}");
    }

    #[test]
    fn functions_of_several_numbers_have_times() {
        let numbers = "potential p\nm = integral(L)\ns = integral((l - L)/L)\npsi(s) = s^2\n\
                       psi(l, m) = (l - L)^2/m\npsi(angle) = (angle - Angle)^2\n";
        let vectors = "potential p\nK = integral(dyad(Xi, Xi))\n\
                       H = integral(dyad(xi - Xi, Xi))*inv(K)\npsi(H) = H : H\npsi(xi, H) = (xi - Xi)*H*Xi\n";
        for (text, titles) in [
            (numbers, ["psi(angle)", "integrands", "energy of points", "energy of bonds"]),
            (
                vectors,
                ["integrands", "functions of integrals", "energy of points", "energy of bonds"],
            ),
        ] {
            for cost in cost_of_text(text, 2).unwrap() {
                let found: Vec<&str> = cost.several.iter().map(|one| &*one.title).collect();
                assert_eq!(found, titles[..if cost.way.in_coordinates { 0 } else { 4 }]);
                let times = cost.several.iter().flat_map(|one| one.nanoseconds);
                assert!(times.clone().all(|x| x > 0.0 && x.is_finite()), "{cost:?}");
                if text == numbers && !cost.way.in_coordinates {
                    let n = cost.several[1..].iter().map(|one| one.n_variables);
                    assert_eq!(n.collect::<Vec<_>>(), [2, 2, 3]);
                }
            }
        }
        let error =
            cost_of_text("potential p\ns = integral(L)\npsi(s) = ln(0*s)\n", 2).unwrap_err();
        assert!(error.to_string().starts_with("energy of points: not finite"), "{error}");
    }

    #[test]
    fn an_energy_that_is_nowhere_finite_is_refused() {
        let error = cost_of_text("potential p\npsi(l) = ln(0*l)\n", 3).unwrap_err();
        assert!(error.to_string().starts_with("psi(l) is not finite"), "{error}");
    }
}
