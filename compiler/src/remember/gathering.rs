//! A point of an evenly deformed body, with what it gathers and what it remembers, from one deformation to the
//! next. All points gather the same there, so that one with its neighbours is a body.

use std::sync::Arc;

use super::History;
use crate::gathered::{
    GatheredBatch, GatheredCriterion, GatheredKernel, GatheredKernels, GatheredNextState,
};
use crate::kernel::{Batch, Kernel, Mode};
use crate::measure::Measure;
use crate::model::{Model, Variant};
use crate::specialise::{CompileError, Form};
use crate::values::Values;
use crate::verify::sample::{Point, contains};

/// The horizon of the family, in spacings of its lattice: 20 neighbours in two dimensions, 80 in three.
const SPACINGS: f64 = 2.5;

/// A point with its neighbours and its history.
#[derive(Clone, Debug)]
pub(crate) struct RememberingPoint {
    family: Arc<Family>,
    /// The fields of the values, states and the time step among them, as they are now.
    fields: Vec<f64>,
    /// The number of the time step among them.
    time_step: Option<usize>,
    /// Which of them is which component of the direction of a bond at rest.
    axes: Vec<Option<usize>>,
}

#[derive(Debug)]
struct Family {
    next: Vec<GatheredNextState>,
    integrals: Vec<Kernel>,
    /// Where neighbours are, from the point, at rest.
    vectors: Vec<Vec<f64>>,
    /// The volume of a point, in m^d.
    volume: f64,
}

impl RememberingPoint {
    /// One that begins with the states that the values say, with its energies; nothing where none is of gathered
    /// numbers.
    pub(crate) fn new(
        model: &Model,
        values: &Values,
        (mode, form): (Mode, Form),
    ) -> Result<Option<(RememberingPoint, GatheredKernels, Values)>, CompileError> {
        let mut values = values.clone().with_states(model);
        let dt = model.number_of_time_step().filter(|_| model.families_remember_time());
        values = dt.into_iter().fold(values, Values::with_field);
        let Some(mut kernels) = model.compile(&values, mode, form)?.gathered else {
            return Ok(None);
        };
        let next = model.gathered_next_states(&values, mode, form)?;
        let fields = values.typical().map(|(_, value)| value).collect();
        let time_step = dt.and_then(|dt| values.fields.iter().position(|field| *field == dt));
        let family = Family {
            next,
            integrals: std::mem::take(&mut kernels.integrals),
            vectors: neighbours(values.dimension, values.horizon),
            volume: volume(values.dimension, values.horizon),
        };
        let directions = model.directions(values.dimension);
        let axis = |field: &u16| directions.clone().position(|own| own == *field);
        let axes = values.fields.iter().map(axis).collect();
        let point = RememberingPoint { family: Arc::new(family), fields, time_step, axes };
        Ok(Some((point, kernels, values)))
    }

    /// Whether the declared domain has all of its bonds where the body is deformed by `F - I`, row by row.
    pub(crate) fn is_declared(&self, variant: &Variant, values: &Values, change: &[f64]) -> bool {
        let bonds = self.family.bonds(change);
        let mut bonds = bonds.reference.iter().zip(&bonds.measure);
        bonds.all(|(&reference, &measure)| {
            contains(variant, Measure::Length, values, Point { measure, reference })
        })
    }

    /// So many fields, each at every bond.
    fn for_each_bond(&self, fields: &[f64], taken: usize) -> Vec<f64> {
        let vectors = &self.family.vectors;
        let of_bonds = |(field, axis): (&f64, &Option<usize>)| -> Vec<f64> {
            let component = |xi: &Vec<f64>| match axis {
                Some(axis) => xi[*axis] / xi.iter().fold(0.0, |sum, x| sum + x * x).sqrt(),
                None => *field,
            };
            vectors.iter().map(component).collect()
        };
        fields[..taken].iter().zip(&self.axes).flat_map(of_bonds).collect()
    }

    /// A function of what it gathers, or of this and the length of each of its bonds.
    fn values(&self, kernel: &GatheredKernel, change: &[f64], fields: &[f64]) -> Vec<f64> {
        let bonds = self.family.bonds(change);
        let integrals = self.family.integrals.iter().map(|one| {
            let fields = self.for_each_bond(fields, one.fields().len());
            let values = one.derivatives(bonds.batch(&fields)).psi;
            values.iter().sum::<f64>() * self.family.volume
        });
        let n = if kernel.of_bonds() { bonds.n() } else { 1 };
        let lengths = if kernel.of_bonds() { &bonds.measure[..] } else { &[] };
        let gathered = integrals.flat_map(|one| std::iter::repeat_n(one, n));
        let variables: Vec<f64> = lengths.iter().copied().chain(gathered).collect();
        let (change, reference) = match kernel.of_bonds() {
            true => (&bonds.change[..], &bonds.reference[..]),
            false => (&[][..], &[][..]),
        };
        let fields = match kernel.of_bonds() {
            true => self.for_each_bond(fields, kernel.fields().len()),
            false => fields[..kernel.fields().len()].to_vec(),
        };
        let mut found = vec![f64::NAN; n];
        let at = GatheredBatch { n, variables: &variables, change, reference, fields: &fields };
        kernel.evaluate(at, &mut found, &mut []);
        found
    }
}

impl History for RememberingPoint {
    type Energy = GatheredKernels;
    type Criterion = GatheredCriterion;

    fn next(&self, change: &[f64], dt: f64) -> Vec<f64> {
        let mut fields = self.fields.clone();
        if let Some(time_step) = self.time_step {
            fields[time_step] = dt;
        }
        self.family.next.iter().map(|one| self.values(&one.next, change, &fields)[0]).collect()
    }

    fn advance(&mut self, change: &[f64], dt: f64) {
        let next = self.next(change, dt);
        for (one, value) in self.family.next.iter().zip(next) {
            self.fields[one.field] = value;
        }
    }

    /// Per volume of the body, in J/m^3: `psi + 1/2 sum_j V_j phi`.
    fn energy(&self, kernels: &GatheredKernels, change: &[f64]) -> f64 {
        let sum = |kernel: &Option<GatheredKernel>| -> f64 {
            kernel.iter().flat_map(|kernel| self.values(kernel, change, &self.fields)).sum()
        };
        sum(&kernels.points) + 0.5 * self.family.volume * sum(&kernels.bonds)
    }

    fn breaks(&self, criterion: &GatheredCriterion, change: &[f64]) -> bool {
        let margins = self.values(&criterion.margin, change, &self.fields);
        margins.into_iter().any(|margin| criterion.breaks(margin))
    }
}

/// All bonds of a point.
struct Bonds {
    measure: Vec<f64>,
    reference: Vec<f64>,
    change: Vec<f64>,
}

impl Bonds {
    fn n(&self) -> usize {
        self.measure.len()
    }

    fn batch<'a>(&'a self, fields: &'a [f64]) -> Batch<'a> {
        let Bonds { measure, reference, change } = self;
        Batch { measure, reference, change, fields }
    }
}

impl Family {
    fn bonds(&self, change: &[f64]) -> Bonds {
        let mut bonds = Bonds { measure: Vec::new(), reference: Vec::new(), change: Vec::new() };
        for xi in &self.vectors {
            let row = |i: usize| change[i * xi.len()..].iter().zip(xi).map(|(h, x)| h * x).sum();
            let moved: Vec<f64> = (0..xi.len()).map(row).collect();
            let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
            let reference = dot(xi, xi).sqrt();
            // l^2 - L^2, without a difference of nearly equal numbers.
            let grown = 2.0 * dot(xi, &moved) + dot(&moved, &moved);
            let measure = (reference * reference + grown).max(0.0).sqrt();
            bonds.change.push(grown / (reference * (measure + reference)));
            bonds.measure.push(measure);
            bonds.reference.push(reference);
        }
        bonds
    }
}

/// The volume of a point of the lattice, in m^d.
pub(super) fn volume(dimension: usize, horizon: f64) -> f64 {
    (0..dimension).fold(1.0, |volume, _| volume * horizon / SPACINGS)
}

/// Vectors of a square or cubic lattice up to the horizon.
pub(super) fn neighbours(dimension: usize, horizon: f64) -> Vec<Vec<f64>> {
    let spacing = horizon / SPACINGS;
    let reach = SPACINGS.floor() as i32;
    let along = || -reach..=reach;
    let mut vectors: Vec<Vec<i32>> = vec![Vec::new()];
    for _ in 0..dimension {
        let longer = |v: Vec<i32>| along().map(move |k| [&v[..], &[k]].concat());
        vectors = vectors.into_iter().flat_map(longer).collect();
    }
    let square = |v: &[i32]| f64::from(v.iter().map(|k| k * k).sum::<i32>());
    vectors.retain(|v| (1.0..=SPACINGS * SPACINGS).contains(&square(v)));
    let scaled = |v: Vec<i32>| v.into_iter().map(|k| f64::from(k) * spacing).collect();
    vectors.into_iter().map(scaled).collect()
}
