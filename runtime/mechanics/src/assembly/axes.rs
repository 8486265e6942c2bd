//! Displacements and forces of a slab axis by axis: consecutive points are lanes of a register.

use std::ops::Range;

use super::DiscreteEnergy;
use crate::element::{Order, WIDEST};
use crate::geometry::each;

/// What is wanted of the interactions of a slab.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// Energies and forces, as far as the order asks for them.
    Order(Order),
    /// Products of the Hessian with a direction.
    Product,
}

impl Wanted {
    pub(super) fn has_energy(self) -> bool {
        matches!(self, Wanted::Order(order) if order.has_energy())
    }

    pub(super) fn has_forces(self) -> bool {
        self != Wanted::Order(Order::Energy)
    }
}

/// The points that a slab touches, one number after the other for each axis, with room for a register
/// before and behind.
#[derive(Default)]
pub(super) struct Axes {
    pub(super) slab: usize,
    /// From one axis to the next.
    pub(super) stride: usize,
    /// The first point.
    pub(super) first: usize,
    /// In m.
    pub(super) displacement: Vec<f64>,
    /// Of a product.
    pub(super) direction: Vec<f64>,
    /// What points get as owners of interactions, to be taken off.
    pub(super) own: Vec<f64>,
    /// What points get otherwise: forces in N, or a product.
    pub(super) other: Vec<f64>,
    /// Whether some bond has grown beyond its limit.
    pub(super) is_beyond: bool,
    /// The same of the triangles or tetrahedra that were seen last.
    pub(super) is_clique_beyond: bool,
}

impl Axes {
    /// Large enough for every slab.
    pub(super) fn new(energy: &DiscreteEnergy) -> Axes {
        let slabs = 0..energy.slabs.len();
        let points = slabs.map(|slab| around(energy, slab).len()).max();
        let numbers = (points.unwrap_or(0) + 2 * WIDEST) * energy.body.dimension();
        let room = || Vec::with_capacity(numbers);
        let [displacement, direction, own, other] = [(); 4].map(|()| room());
        Axes { displacement, direction, own, other, ..Axes::default() }
    }

    /// Moves to a slab at displacements `u`, and to a direction for products.
    pub(super) fn set<const D: usize>(
        &mut self,
        energy: &DiscreteEnergy,
        slab: usize,
        u: &[f64],
        p: Option<&[f64]>,
    ) {
        let touched = energy.slabs.touched(slab);
        (self.slab, self.first, self.stride) = (slab, touched.start, touched.len() + 2 * WIDEST);
        let points = touched.start * D..touched.end * D;
        by_axes::<D>(&u[points.clone()], &mut self.displacement);
        if let Some(p) = p {
            by_axes::<D>(&p[points], &mut self.direction);
        }
        for force in [&mut self.own, &mut self.other] {
            force.clear();
            force.resize(self.stride * D, 0.0);
        }
    }

    /// Moves to a slab and those beside it at displacements `u`.
    pub(super) fn set_around<const D: usize>(
        &mut self,
        energy: &DiscreteEnergy,
        slab: usize,
        u: &[f64],
    ) {
        let points = around(energy, slab);
        (self.slab, self.first, self.stride) = (slab, points.start, points.len() + 2 * WIDEST);
        by_axes::<D>(&u[points.start * D..points.end * D], &mut self.displacement);
    }

    /// Shows what each point has got.
    pub(super) fn each<const D: usize>(&self, mut see: impl FnMut(usize, &[f64; D])) {
        for place in WIDEST..self.stride - WIDEST {
            let part = |axis: usize| {
                self.other[axis * self.stride + place] - self.own[axis * self.stride + place]
            };
            see(self.first + place - WIDEST, &each(part));
        }
    }
}

/// The points of a slab, of the one before and of the one behind it.
fn around(energy: &DiscreteEnergy, slab: usize) -> Range<usize> {
    energy.slabs.start(slab.saturating_sub(1))..energy.slabs.touched(slab).end
}

/// From point by point to axis by axis.
fn by_axes<const D: usize>(rows: &[f64], axes: &mut Vec<f64>) {
    axes.clear();
    for axis in 0..D {
        axes.extend([0.0; WIDEST]);
        axes.extend(rows.as_chunks::<D>().0.iter().map(|row| row[axis]));
        axes.extend([0.0; WIDEST]);
    }
}

/// The numbers of one axis.
#[inline(always)]
pub(super) fn axis_of(of: &[f64], axis: usize, stride: usize) -> &[f64] {
    &of[axis * stride..][..stride]
}

/// The numbers of each axis.
#[inline(always)]
pub(super) fn axes_of<const D: usize>(of: &mut [f64], stride: usize) -> [&mut [f64]; D] {
    let mut axes = of.chunks_exact_mut(stride);
    [(); D].map(|()| axes.next().unwrap_or_default())
}
