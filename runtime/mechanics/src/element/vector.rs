//! The element of energies of the vector of a bond: derivatives of psi by its length and by what its ends have
//! moved by, `w`, from a law, the rest by geometry.
//!
//! With `n = xi/l` the gradient by a component of `w` is `psi_w + psi_l n`, and the Hessian
//! `psi_ww + psi_wl n + n psi_lw + psi_ll n n + psi_l (1 - n n)/l`. All loops run over the bonds of a batch.

use piola_compiler::MAX_FIELDS;

use super::batch::{CAPACITY, Channel, Contributions, InteractionBatch};
use super::{Element, NonFiniteLane, Order};
use crate::geometry::bond::Bond;
use crate::geometry::{Change, Geometry, packed};
use crate::kernel::{CoupledLaw, Measure, Variables};

/// Variables of the largest law: the length and three components.
const VARIABLES: usize = 4;

/// An energy density of the vector of a bond.
pub struct VectorElement {
    dimension: usize,
    law: Box<dyn CoupledLaw>,
}

/// What a law takes, variable by variable, and the geometry of the bonds; on the stack, for a pool would be
/// fought for by all threads at every batch.
struct Room {
    n: usize,
    current: [f64; VARIABLES * CAPACITY],
    change: [f64; VARIABLES * CAPACITY],
    /// Values at rest, then fields.
    given: [f64; (VARIABLES + MAX_FIELDS) * CAPACITY],
    lengths: Channel,
    /// `n`, axis by axis.
    normal: [Channel; 3],
}

/// How a variable changes with a component of `w`.
#[derive(Clone, Copy)]
enum Slope<'a> {
    Zero,
    One,
    /// The length, bond by bond.
    Normal(&'a Channel),
}

impl Slope<'_> {
    /// Multiplies the numbers of all bonds; whether anything is left.
    fn scale(self, numbers: &mut [f64]) -> bool {
        if let Slope::Normal(normal) = self {
            numbers.iter_mut().zip(normal).for_each(|(number, n)| *number *= n);
        }
        !matches!(self, Slope::Zero)
    }
}

impl VectorElement {
    /// The bonds of a law in 2 or 3 dimensions: each of its variables is their length or an axis.
    pub fn new(dimension: usize, law: Box<dyn CoupledLaw>) -> VectorElement {
        VectorElement { dimension, law }
    }

    /// Lengths, normals and what the law takes of the bonds of a batch.
    fn measured<const D: usize>(&self, batch: &InteractionBatch) -> Room {
        let n = batch.len();
        let mut room = Room {
            n,
            current: [0.0; VARIABLES * CAPACITY],
            change: [0.0; VARIABLES * CAPACITY],
            given: [0.0; (VARIABLES + MAX_FIELDS) * CAPACITY],
            lengths: [0.0; CAPACITY],
            normal: [[0.0; CAPACITY]; 3],
        };
        let (mut rest, mut changes) = ([0.0; CAPACITY], [0.0; CAPACITY]);
        for lane in 0..n {
            let at_rest: [f64; D] = std::array::from_fn(|axis| batch.reference[axis][lane]);
            let moved: [f64; D] = std::array::from_fn(|axis| batch.displacement[axis][lane]);
            let Change { measure, reference, change, .. } =
                <Bond as Geometry<D>>::change(&at_rest, &moved);
            (rest[lane], changes[lane], room.lengths[lane]) = (reference, change, measure);
            for axis in 0..D {
                room.normal[axis][lane] = (at_rest[axis] + moved[axis]) / measure;
            }
        }
        let parts = self.law.parts();
        for (k, part) in parts.iter().enumerate() {
            let own = k * n..(k + 1) * n;
            match part.axis {
                Some(axis) => {
                    room.current[own.clone()].copy_from_slice(&batch.displacement[axis][..n]);
                    room.given[own].fill(1.0);
                }
                None => {
                    room.current[own.clone()].copy_from_slice(&room.lengths[..n]);
                    room.change[own.clone()].copy_from_slice(&changes[..n]);
                    room.given[own].copy_from_slice(&rest[..n]);
                }
            }
        }
        for k in 0..self.n_fields() {
            let own = &batch.fields[k * batch.padded_len()..][..n];
            room.given[(parts.len() + k) * n..][..n].copy_from_slice(own);
        }
        room
    }

    fn variables<'a>(&self, room: &'a Room) -> Variables<'a> {
        let all = self.law.parts().len() * room.n;
        Variables {
            n: room.n,
            current: &room.current[..all],
            change: &room.change[..all],
            given: &room.given[..all + self.n_fields() * room.n],
            laws: &[],
        }
    }

    fn slope<'a>(&self, part: usize, axis: usize, room: &'a Room) -> Slope<'a> {
        match self.law.parts()[part].axis {
            None => Slope::Normal(&room.normal[axis]),
            Some(own) if own == axis => Slope::One,
            Some(_) => Slope::Zero,
        }
    }

    /// The weighted gradients of all bonds by `w`.
    fn add_gradients(&self, weight: &[f64], of_law: &[f64], room: &Room, out: &mut [Channel]) {
        for (axis, to) in out.iter_mut().enumerate().take(self.dimension) {
            to[..room.n].fill(0.0);
            for (part, own) in of_law.chunks_exact(room.n).enumerate() {
                let mut term = [0.0; CAPACITY];
                let term = &mut term[..room.n];
                term.iter_mut().zip(own).zip(weight).for_each(|((to, own), w)| *to = own * w);
                if self.slope(part, axis, room).scale(term) {
                    to.iter_mut().zip(term).for_each(|(to, term)| *to += *term);
                }
            }
        }
    }

    /// The weighted Hessians of all bonds by `w`.
    fn add_hessians(&self, weight: &[f64], of_law: &[f64], room: &Room, out: &mut [Channel]) {
        let (d, n, n_parts) = (self.dimension, room.n, self.law.parts().len());
        let at = self.variables(room);
        let mut second = [0.0; VARIABLES * VARIABLES * CAPACITY];
        let mut direction = [0.0; VARIABLES * CAPACITY];
        let all = n_parts * n;
        for (k, product) in second[..n_parts * all].chunks_exact_mut(all).enumerate() {
            direction.fill(0.0);
            direction[k * n..(k + 1) * n].fill(1.0);
            self.law.product(at, &direction[..all], product);
        }
        let length = self.law.parts().iter().position(|part| part.axis.is_none());
        for (row, column) in (0..d).flat_map(|row| (row..d).map(move |column| (row, column))) {
            let to = &mut out[packed(d, row, column)][..n];
            to.fill(0.0);
            for (place, second) in second[..n_parts * all].chunks_exact(n).enumerate() {
                let slopes = [(place / n_parts, row), (place % n_parts, column)]
                    .map(|(part, axis)| self.slope(part, axis, room));
                let mut term = [0.0; CAPACITY];
                let term = &mut term[..n];
                term.iter_mut().zip(second).zip(weight).for_each(|((to, x), w)| *to = x * w);
                if slopes.into_iter().all(|slope| slope.scale(term)) {
                    to.iter_mut().zip(term).for_each(|(to, term)| *to += *term);
                }
            }
            let Some(length) = length else { continue };
            let own = &of_law[length * n..][..n];
            let unit = f64::from(u8::from(row == column));
            let (x, y) = (&room.normal[row], &room.normal[column]);
            for lane in 0..n {
                let across = (unit - x[lane] * y[lane]) / room.lengths[lane];
                to[lane] += weight[lane] * own[lane] * across;
            }
        }
    }
}

impl Element for VectorElement {
    fn measure(&self) -> Measure {
        Measure::Length
    }

    fn argument(&self) -> &str {
        self.law.argument()
    }

    fn dimension(&self) -> usize {
        self.dimension
    }

    fn forbids_inversion(&self) -> bool {
        false
    }

    fn n_fields(&self) -> usize {
        self.law.fields().len()
    }

    fn evaluate(
        &self,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        let room = match self.dimension {
            2 => self.measured::<2>(batch),
            _ => self.measured::<3>(batch),
        };
        let (n, weight) = (room.n, &batch.weight[..room.n]);
        let all = if order == Order::Energy { 0 } else { self.law.parts().len() * n };
        let (mut psi, mut gradient) = ([0.0; CAPACITY], [0.0; VARIABLES * CAPACITY]);
        let (psi, gradient) = (&mut psi[..n], &mut gradient[..all]);
        self.law.evaluate(self.variables(&room), psi, gradient);
        out.energy.iter_mut().zip(psi).zip(weight).for_each(|((to, psi), w)| *to = w * *psi);
        if order != Order::Energy {
            self.add_gradients(weight, gradient, &room, &mut out.gradient);
        }
        if order == Order::Tangent {
            self.add_hessians(weight, gradient, &room, &mut out.hessian);
        }
        match (0..n).find(|lane| !out.is_finite(*lane, order, self.dimension)) {
            None => Ok(()),
            Some(lane) => {
                let rest = (0..self.dimension).map(|axis| batch.reference[axis][lane]);
                let reference = rest.fold(0.0, |square, x| square + x * x).sqrt();
                Err(NonFiniteLane { lane, value: room.lengths[lane], reference })
            }
        }
    }
}
