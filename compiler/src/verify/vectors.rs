//! What points gather of vectors, and energies of it, against hyper-dual numbers of what is written: at bonds of
//! random families, deformed by a random gradient and a little beside it, so that shape tensors and the like are
//! those of families. Where the tolerance is missed, numbers of any precision decide.

use super::gathered::largest;
use super::sample::Random;
use super::{Subject, Verification, Witness, families, vector_margin};
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::expression::random_rounding::RandomlyRounded;
use crate::gathered::vectors::Which;
use crate::gathered::{FamilyBatch, FamilyKernel, Slot, VectorKernels, WrittenFamily, argument};
use crate::kernel::{Level, Mode};
use crate::model::{Model, Variant};
use crate::point::truth::by_lines;
use crate::specialise::{CompileError, Form};
use crate::values::Values;

/// Largest error of values, gradients and products.
const BAR: f64 = 1e4;

/// Bonds of a family.
const BONDS: usize = 24;

/// How far families are deformed: the components of the gradient that all bonds share, and what each moves beside it.
pub(super) const SIZES: [f64; 2] = [0.25, 0.05];

/// Verifies all functions of a potential of vectors at `n` places each.
pub(super) fn verify(
    model: &Model,
    values: &Values,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let values = &values.without_parameters_that_vary(model);
    let compiled = |mode| -> Result<Option<VectorKernels>, CompileError> {
        let mut kernels = None;
        model.compile_vectors(values, (mode, Form::Accurate), &mut kernels)?;
        Ok(kernels)
    };
    let modes = [Mode::Jit(Level::Strict), Mode::Jit(Level::Fast), Mode::Interpreter];
    let [Some(strict), Some(fast), Some(interpreted)] = modes.map(compiled).map(Result::transpose)
    else {
        return Ok(Vec::new());
    };
    let (strict, fast, interpreted) = (strict?, fast?, interpreted?);
    let Some(dual) = compiled(Mode::HyperDual)? else { return Ok(Vec::new()) };
    let Some(variant) = model.variant(values.dimension) else { return Ok(Vec::new()) };
    let places = places(&strict, (model, values), n);
    let margins = vector_margin::verify((model, values), &strict, n)?;
    let next_states = families::verify_vectors((model, values), &strict, n)?;
    let mut found = Vec::new();
    for which in [Which::Integrands, Which::Functions, Which::Points, Which::Bonds] {
        let ways = [&strict, &fast, &interpreted, &dual].map(|kernels| of(kernels, which));
        let [Some(strict), Some(fast), Some(interpreted), Some(dual)] = ways else { continue };
        let written = model.written_vectors(values, which);
        let witness = Seen { written: &written, kernel: strict, places: &places };
        let [strict, fast, interpreted, dual] =
            [strict, fast, interpreted, dual].map(|kernel| evaluate(kernel, &places));
        let mut verification =
            Verification::new(subject(variant, which), &[(Witness::HyperDual, BAR)]);
        let ways = [&*strict, &fast, &interpreted, &dual];
        let places = (|p: usize| witness.variables(p), |p: usize| witness.truth(p));
        verification.judge(ways, BAR, largest, places);
        found.push(verification);
    }
    found.extend(margins);
    found.extend(next_states);
    Ok(found)
}

pub(crate) fn of(kernels: &VectorKernels, which: Which) -> Option<&FamilyKernel> {
    match which {
        Which::Integrands => Some(&kernels.integrands),
        Which::Functions => kernels.functions.as_ref(),
        Which::Points => kernels.points.as_ref(),
        Which::Bonds => kernels.bonds.as_ref(),
    }
}

pub(crate) fn subject(variant: &Variant, which: Which) -> Subject {
    match which {
        Which::Integrands => Subject::Gathering("integral(..)".into()),
        Which::Functions => {
            let functions = variant.integrals.iter().filter(|one| one.is_function);
            let stems = functions.map(|one| one.text.split('(').next().unwrap_or_default());
            let mut stems: Vec<&str> = stems.collect();
            stems.dedup();
            Subject::Gathering(stems.join(", "))
        }
        Which::Points => Subject::Gathered(argument(variant, false)),
        Which::Bonds => Subject::Gathered(argument(variant, true)),
    }
}

/// A bond as one of its ends sees it, with what both gather.
#[derive(Clone)]
pub(crate) struct Place {
    /// The direction at rest, a unit vector.
    unit: Vec<f64>,
    length: f64,
    moved: Vec<f64>,
    /// Of this end and the other.
    gathered: [Vec<f64>; 2],
    /// Random numbers: multipliers, and a direction for products, as many as there may be.
    random: [Vec<f64>; 2],
}

impl Place {
    /// A bond whose other end is at `rest` and has moved so far, both in m, with what both ends gather.
    pub(crate) fn new(rest: &[f64], moved: Vec<f64>, gathered: Vec<f64>) -> Place {
        let length = rest.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
        let unit = rest.iter().map(|x| x / length).collect();
        let random = [vec![0.0; gathered.len()], Vec::new()];
        Place { unit, length, moved, gathered: [gathered.clone(), gathered], random }
    }

    /// The place of these numbers: what a kernel is differentiated by and what it takes beside, the direction at rest,
    /// and the direction of products; all else is 0.
    pub(crate) fn of(kernel: &FamilyKernel, (d, m): (usize, usize), given: &[f64]) -> Place {
        let nothing = || vec![0.0; m];
        let mut place = Place {
            unit: Vec::new(),
            length: 1.0,
            moved: vec![0.0; d],
            gathered: [nothing(), nothing()],
            random: [nothing(), Vec::new()],
        };
        let slots = || kernel.variables().iter().chain(kernel.given());
        for (slot, x) in slots().zip(given) {
            *match slot {
                Slot::Length => &mut place.length,
                Slot::Moved(axis) => &mut place.moved[*axis],
                Slot::Own(k) => &mut place.gathered[0][*k],
                Slot::Neighbour(k) => &mut place.gathered[1][*k],
                Slot::Multiplier(k) => &mut place.random[0][*k],
            } = *x;
        }
        let (unit, direction) = given[slots().count()..].split_at(d);
        (place.unit, place.random[1]) = (unit.to_vec(), direction.to_vec());
        place
    }

    /// The same where a kernel is differentiated by other numbers.
    pub(super) fn moved(&self, kernel: &FamilyKernel, variables: &[f64]) -> Place {
        let mut given = self.given(kernel);
        given[..variables.len()].copy_from_slice(variables);
        Place::of(kernel, (self.moved.len(), self.n_gathered()), &given)
    }

    /// These numbers.
    pub(crate) fn given(&self, kernel: &FamilyKernel) -> Vec<f64> {
        let slots = kernel.variables().iter().chain(kernel.given()).map(|slot| self.slot(*slot));
        let direction = self.direction(kernel);
        slots.chain(self.unit.iter().copied()).chain(direction.iter().copied()).collect()
    }

    /// The direction of products.
    pub(crate) fn direction(&self, kernel: &FamilyKernel) -> &[f64] {
        &self.random[1][..kernel.variables().len()]
    }

    /// How many numbers each end gathers.
    pub(crate) fn n_gathered(&self) -> usize {
        self.gathered[0].len()
    }

    /// The direction of the bond at rest.
    pub(crate) fn unit(&self) -> &[f64] {
        &self.unit
    }

    /// The length of the bond now.
    pub(crate) fn length(&self) -> f64 {
        let now = self.unit.iter().zip(&self.moved).map(|(n, u)| n * self.length + u);
        now.fold(0.0, |sum, x| sum + x * x).sqrt()
    }

    pub(crate) fn slot(&self, slot: Slot) -> f64 {
        match slot {
            Slot::Length => self.length,
            Slot::Moved(axis) => self.moved[axis],
            Slot::Own(k) => self.gathered[0][k],
            Slot::Neighbour(k) => self.gathered[1][k],
            Slot::Multiplier(k) => self.random[0][k],
        }
    }
}

impl Place {
    /// The same bond a part `t` of the way to another in all that changes with displacements: what has moved, in parts
    /// of the length at rest, and what is gathered.
    pub(super) fn with(&self, other: &Place, t: f64) -> Place {
        let between = |x: &[f64], y: &[f64], scale: f64| -> Vec<f64> {
            x.iter().zip(y).map(|(x, y)| x + t * (scale * y - x)).collect()
        };
        let gathered = [0, 1].map(|end| between(&self.gathered[end], &other.gathered[end], 1.0));
        let moved = between(&self.moved, &other.moved, self.length / other.length);
        Place { moved, gathered, ..self.clone() }
    }

    /// Turns the vector of the bond by about 2 in the first plane, then by about 1 in the last.
    fn turn(&mut self) {
        let d = self.unit.len();
        let rest = |axis: usize| self.unit[axis] * self.length;
        let mut now: Vec<f64> = (0..d).map(|axis| rest(axis) + self.moved[axis]).collect();
        for (axis, angle) in [(0, 2.0), (d - 2, 1.0)] {
            let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
            let (x, y) = (now[axis], now[axis + 1]);
            (now[axis], now[axis + 1]) = (cosine * x - sine * y, sine * x + cosine * y);
        }
        self.moved = (0..d).map(|axis| now[axis] - rest(axis)).collect();
    }
}

/// Places to verify at.
pub(crate) struct Places<'a> {
    all: Vec<Place>,
    values: &'a Values,
    /// The numbers of the components of the direction.
    directions: std::ops::Range<u16>,
}

impl<'a> Places<'a> {
    pub(crate) fn new(all: Vec<Place>, (model, values): (&Model, &'a Values)) -> Places<'a> {
        Places { all, values, directions: model.directions(values.dimension) }
    }

    /// A parameter that varies, by its number: a component of the direction of the bond, or what the values say.
    fn field(&self, place: usize, number: u16) -> f64 {
        let axis = self.directions.clone().position(|own| own == number);
        let typical = self.values.parameters[usize::from(number)];
        axis.map_or(typical, |axis| self.all[place].unit[axis])
    }
}

/// Bonds of random families.
fn places<'a>(
    kernels: &VectorKernels,
    (model, values): (&Model, &'a Values),
    n: usize,
) -> Places<'a> {
    let mut random = Random::new(0x7665_6374_6f72);
    let bond = |_| bond(kernels, (model, values), (SIZES, false), &mut random);
    Places::new((0..n).map(bond).collect(), (model, values))
}

/// A bond with what its ends gather, in families that are deformed so far, and then turned or not.
pub(crate) fn bond(
    kernels: &VectorKernels,
    (model, values): (&Model, &Values),
    (sizes, is_turned): ([f64; 2], bool),
    random: &mut Random,
) -> Place {
    let (d, m) = (values.dimension, kernels.n_gathered);
    let of = |mut all: Vec<Place>| {
        if is_turned {
            all.iter_mut().for_each(Place::turn);
        }
        Places::new(all, (model, values))
    };
    let ends = [0; 2].map(|_| {
        let bonds = of(family(random, (d, m), sizes));
        gathered(kernels, &bonds, || random.uniform(0.05, 0.15))
    });
    let mut bond = of(family(random, (d, m), sizes)).all.swap_remove(0);
    bond.gathered = ends;
    bond
}

/// The bonds of a point, deformed alike but for a little.
fn family(random: &mut Random, (d, m): (usize, usize), [of_all, own]: [f64; 2]) -> Vec<Place> {
    let mut numbers =
        |n: usize, size: f64| (0..n).map(|_| random.uniform(-size, size)).collect::<Vec<f64>>();
    let gradient = numbers(d * d, of_all);
    let mut bond = || loop {
        let rest = numbers(d, 1.0);
        let length = rest.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
        if !(0.3..1.0).contains(&length) {
            continue;
        }
        let beside = numbers(d, own);
        let moved = |axis: usize| {
            let row = gradient[axis * d..(axis + 1) * d].iter().zip(&rest);
            row.fold(beside[axis], |sum, (h, x)| sum + h * x)
        };
        return Place {
            unit: rest.iter().map(|x| x / length).collect(),
            length,
            moved: (0..d).map(moved).collect(),
            gathered: [vec![0.0; m], vec![0.0; m]],
            random: [numbers(m, 1.0), numbers(2 * m + d, 1.0)],
        };
    };
    (0..BONDS).map(|_| bond()).collect()
}

/// The energies of a point and of a bond, where there are any, in random families; and the same where all of it is
/// turned as a whole by a right angle and more.
pub(crate) fn turned(kernels: &VectorKernels, (model, values): (&Model, &Values)) -> [[f64; 2]; 2] {
    let energies = |is_turned: bool| {
        let mut random = Random::new(0x7475_726e);
        let bond = bond(kernels, (model, values), (SIZES, is_turned), &mut random);
        let bond = Places::new(vec![bond], (model, values));
        [&kernels.points, &kernels.bonds]
            .map(|kernel| kernel.as_ref().map_or(0.0, |kernel| evaluate(kernel, &bond)[0][0]))
    };
    let [at_rest, turned] = [false, true].map(energies);
    [0, 1].map(|part| [at_rest[part], turned[part]])
}

/// What a point gathers from a family whose bonds have these volumes.
pub(crate) fn gathered(
    kernels: &VectorKernels,
    bonds: &Places<'_>,
    mut volume: impl FnMut() -> f64,
) -> Vec<f64> {
    let mut gathered = vec![0.0; kernels.n_gathered];
    let multiplied = |kernel: &FamilyKernel, places: &Places<'_>| -> Vec<Vec<(usize, f64)>> {
        let of = |values: Vec<f64>| {
            let slots = kernel.variables().iter().zip(&values[1..]);
            let multiplied = slots.filter_map(|(slot, value)| match slot {
                Slot::Multiplier(k) => Some((*k, *value)),
                _ => None,
            });
            multiplied.collect()
        };
        gradients(kernel, places).into_iter().map(of).collect()
    };
    for bond in multiplied(&kernels.integrands, bonds) {
        let volume = volume();
        bond.into_iter().for_each(|(k, value)| gathered[k] += volume * value);
    }
    if let Some(kernel) = &kernels.functions {
        let Places { all, values, directions } = bonds;
        let [unit, moved] = [&all[0].unit, &all[0].moved].map(Vec::clone);
        let own = [gathered.clone(), gathered.clone()];
        let (length, random) = (all[0].length, all[0].random.clone());
        let point = vec![Place { unit, length, moved, gathered: own, random }];
        let point = Places { all: point, values, directions: directions.clone() };
        for values in multiplied(kernel, &point) {
            values.into_iter().for_each(|(k, value)| gathered[k] = value);
        }
    }
    gathered
}

/// Value, gradient and product of a kernel at all places.
pub(crate) fn evaluate(kernel: &FamilyKernel, places: &Places<'_>) -> Vec<Vec<f64>> {
    let (n, m) = (places.all.len(), kernel.variables().len());
    let direction: Vec<f64> =
        (0..m).flat_map(|k| places.all.iter().map(move |place| place.random[1][k])).collect();
    let mut product = vec![0.0; m * n];
    batch(kernel, places, |at| kernel.product(at, &direction, &mut product));
    let column = |p: usize| product.iter().skip(p).step_by(n).copied().collect::<Vec<f64>>();
    let found = gradients(kernel, places).into_iter().enumerate();
    found.map(|(p, found)| [found, column(p)].concat()).collect()
}

/// Value and gradient.
fn gradients(kernel: &FamilyKernel, places: &Places<'_>) -> Vec<Vec<f64>> {
    let (n, m) = (places.all.len(), kernel.variables().len());
    let (mut value, mut gradient) = (vec![0.0; n], vec![0.0; m * n]);
    batch(kernel, places, |at| kernel.evaluate(at, &mut value, &mut gradient));
    let column = |p: usize| gradient.iter().skip(p).step_by(n).copied().collect::<Vec<f64>>();
    (0..n).map(|p| [vec![value[p]], column(p)].concat()).collect()
}

/// The value alone.
pub(crate) fn values(kernel: &FamilyKernel, places: &Places<'_>) -> Vec<f64> {
    let mut value = vec![0.0; places.all.len()];
    batch(kernel, places, |at| kernel.evaluate(at, &mut value, &mut []));
    value
}

/// Hands places over as a kernel takes them.
fn batch(kernel: &FamilyKernel, places: &Places<'_>, take: impl FnOnce(FamilyBatch<'_>)) {
    let of = |slots: &[Slot]| -> Vec<f64> {
        slots.iter().flat_map(|slot| places.all.iter().map(|place| place.slot(*slot))).collect()
    };
    let (variables, given) = (of(kernel.variables()), of(kernel.given()));
    let numbers = kernel.fields().iter().zip(&places.values.fields).map(|(_, number)| *number);
    let fields: Vec<f64> = numbers
        .flat_map(|number| (0..places.all.len()).map(move |p| places.field(p, number)))
        .collect();
    let n = places.all.len();
    take(FamilyBatch { n, variables: &variables, given: &given, fields: &fields });
}

/// A function as written, at the places of its kernel.
pub(crate) struct Seen<'a> {
    pub(crate) written: &'a WrittenFamily,
    pub(crate) kernel: &'a FamilyKernel,
    pub(crate) places: &'a Places<'a>,
}

impl Seen<'_> {
    fn variables(&self, p: usize) -> Vec<f64> {
        let place = &self.places.all[p];
        self.kernel.variables().iter().map(|slot| place.slot(*slot)).collect()
    }

    /// What is true at a place; nothing where that is no finite number.
    pub(crate) fn truth(&self, p: usize) -> Option<Vec<f64>> {
        let (place, variables) = (&self.places.all[p], self.kernel.variables());
        let truth = by_lines(&place.random[1][..variables.len()], |slope| {
            let slot = |slot: Slot| match variables.iter().position(|own| *own == slot) {
                Some(k) => Precise::line(place.slot(slot), slope(k), 0.0),
                None => Precise::constant(place.slot(slot)),
            };
            self.written.value(slot, Some(&|k| self.field(p, k)))
        })?;
        truth.iter().all(|x| x.is_finite()).then_some(truth)
    }

    /// The value alone.
    pub(super) fn value(&self, p: usize) -> Option<f64> {
        let place = &self.places.all[p];
        let slot = |slot: Slot| Precise::<256>::constant(place.slot(slot));
        let value = self.written.value(slot, Some(&|k| self.field(p, k)));
        value.parts().map(|_| value.rounded()[0])
    }

    /// The value alone in doubles that are rounded at random.
    pub(super) fn rounded(&self, p: usize, seed: u64) -> f64 {
        let place = &self.places.all[p];
        let slot = |slot: Slot| RandomlyRounded::given(place.slot(slot), seed);
        self.written.value(slot, Some(&|k| self.field(p, k))).value()
    }

    /// A field at a place, by its place among the fields.
    fn field(&self, p: usize, k: usize) -> f64 {
        self.places.field(p, self.places.values.fields[k])
    }
}
