//! Second derivatives of all bonds and points, of which the stored Hessian is made: for small bodies, and as the
//! witness of the products.
//!
//! The fields are the gathered numbers that energies hold and that change with displacements, functions of
//! integrals among them: what these have in common with displacement gradients keeps its digits, while the
//! integrals they are made of may cancel. Where functions bend, their integrals are fields as well.

use rayon::prelude::*;

use piola_compiler::{FamilyKernel, Slot};

use super::VectorEnergy;
use super::passes::{At, Gathered, Room, Sought, of_slots};
use crate::energy::NonFinite;
use crate::fields::stored::{Linearised, Seen, Tensor};
use crate::neighborhood::Neighborhood;

/// Owners of bonds per task; fixed, so that results do not depend on threads.
const OWNERS: usize = 8;

/// Second derivatives of one bond, seen from its owner.
#[derive(Clone)]
struct OfBond {
    /// By the fields of the owner and of the other end: `m x m`, and turned around.
    across: [Vec<f64>; 2],
    /// By the fields of either end and the vector from the owner: `m x d`.
    mixed: [Vec<f64>; 2],
    /// By the vector twice: `d x d`.
    direct: Vec<f64>,
    /// By the fields of either end twice: `m x m`.
    own: [Vec<f64>; 2],
    /// What a displacement of the other end changes the fields of either end by: `m x d`.
    weights: [Vec<f64>; 2],
}

/// Second derivatives by the fields and by the vectors of bonds, at some displacements.
pub(super) struct VectorStiffness<'a, const D: usize> {
    energy: &'a VectorEnergy,
    n_fields: usize,
    /// `V_j g'` of all directed bonds, for each field.
    weights: Vec<[f64; D]>,
    /// By the fields of each point.
    points: Vec<f64>,
    bonds: Vec<OfBond>,
    has_neighbours: bool,
}

/// What gathered numbers are fields, and what functions of integrals change by with these.
struct FieldNumbers {
    numbers: Vec<usize>,
    /// The integrals that functions hold.
    integrals: Vec<usize>,
    /// `functions x integrals` of all points, functions as they are numbered among all.
    slopes: Vec<f64>,
    n_gathered: usize,
}

impl FieldNumbers {
    fn place(&self, number: usize) -> Option<usize> {
        self.numbers.binary_search(&number).ok()
    }

    /// What the fields of a point change by with an integral: their places, and by how much.
    fn by_integral(&self, point: usize, number: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let own = self.place(number).map(|place| (place, 1.0));
        let column = self.integrals.iter().position(|k| *k == number);
        let (n, m) = (self.n_gathered, self.integrals.len());
        let functions = self.numbers.iter().enumerate().filter_map(move |(place, field)| {
            let slope = self.slopes[(point * n + field) * m + column?];
            (slope != 0.0).then_some((place, slope))
        });
        own.into_iter().chain(functions)
    }
}

/// What a variable of a kernel is, of a bond that the first of two points sees.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Role {
    Vector(usize),
    /// A field of the end that sees, or of the other, by its place.
    Of(usize, usize),
}

fn roles(kernel: &FamilyKernel, fields: &FieldNumbers) -> Vec<Option<Role>> {
    let role = |slot: &Slot| match slot {
        Slot::Moved(axis) => Some(Role::Vector(*axis)),
        Slot::Own(k) => Some(Role::Of(0, fields.place(*k)?)),
        Slot::Neighbour(k) => Some(Role::Of(1, fields.place(*k)?)),
        _ => None,
    };
    kernel.variables().iter().map(role).collect()
}

impl<'a, const D: usize> VectorStiffness<'a, D> {
    /// Works out the second derivatives at `u`; refuses those that are not finite.
    pub(super) fn new(energy: &'a VectorEnergy, u: &[f64]) -> Result<Self, NonFinite> {
        let mut base = Gathered::default();
        energy.energies::<D>(u, &mut base, Sought::Adjoint)?;
        let at = At { u, values: &base.values, adjoint: &base.adjoint };
        let (fields, mut points) = energy.field_numbers(at);
        let (m, n) = (fields.numbers.len(), energy.body.n_points());
        energy.add_points(at, &fields, &mut points);
        let bonds = energy.second_of_bonds::<D>(at, &fields);
        let neighborhood = &energy.neighborhood;
        let mirrored = neighborhood.mirrored();
        let mut weights = vec![[0.0; D]; 2 * neighborhood.n_bonds() * m];
        for i in 0..n {
            let numbers = neighborhood.bonds(i);
            let later = neighborhood.places(i).end - numbers.len();
            for (k, (bond, j)) in numbers.zip(neighborhood.upper(i)).enumerate() {
                let place = later + k;
                let places = [place, mirrored[place] as usize];
                for ((place, of_end), end) in
                    places.into_iter().zip(&bonds[bond].weights).zip([i, j as usize])
                {
                    let own = &mut weights[place * m..(place + 1) * m];
                    own.copy_from_slice(of_end.as_chunks::<D>().0);
                    let of_bond = &bonds[bond].own[usize::from(end != i)];
                    let sums = points[end * m * m..(end + 1) * m * m].iter_mut();
                    sums.zip(of_bond).for_each(|(sum, x)| *sum += x);
                }
            }
        }
        let is_finite = points.iter().chain(weights.as_flattened()).all(|x| x.is_finite())
            && bonds.iter().all(|bond| bond.direct.iter().all(|x| x.is_finite()));
        if !is_finite {
            return Err(energy.named(0, base.values.first().copied(), u));
        }
        let has_neighbours = energy.laws.has_neighbours();
        Ok(VectorStiffness { energy, n_fields: m, weights, points, bonds, has_neighbours })
    }
}

impl VectorEnergy {
    /// The derivatives of a kernel at what is prepared, changed by one variable.
    fn by_variable(kernel: &FamilyKernel, variable: usize, room: &mut Room) {
        let n = room.ends.len();
        room.set_direction(kernel.variables().len() * n, variable * n..(variable + 1) * n);
        VectorEnergy::run(kernel, true, room);
    }

    /// The fields, and second derivatives by them through functions of integrals.
    fn field_numbers(&self, at: At<'_>) -> (FieldNumbers, Vec<f64>) {
        let held = |kernel: &FamilyKernel| -> Vec<usize> {
            let own = kernel.variables().iter().filter_map(|slot| match slot {
                Slot::Own(k) | Slot::Neighbour(k) => Some(*k),
                _ => None,
            });
            own.collect()
        };
        let (mut numbers, mut integrals) = (Vec::new(), Vec::new());
        for (_, kernels) in self.laws.present() {
            numbers.extend(kernels.points.iter().chain(&kernels.bonds).flat_map(held));
            integrals.extend(kernels.functions.iter().flat_map(held));
        }
        integrals.sort_unstable();
        integrals.dedup();
        let (n, n_gathered) = (self.body.n_points(), self.n_gathered());
        let m = integrals.len();
        let mut slopes = vec![0.0; n * n_gathered * m];
        let mut bends = Vec::new();
        for (law, kernels) in self.laws.present() {
            let Some(kernel) = &kernels.functions else { continue };
            let mut room = self.prepared_points((law, kernel), at);
            for (variable, slot) in kernel.variables().iter().enumerate() {
                let Slot::Own(number) = slot else { continue };
                let Some(column) = integrals.iter().position(|k| k == number) else { continue };
                VectorEnergy::by_variable(kernel, variable, &mut room);
                for (slot, along) in of_slots(kernel, &room) {
                    let places = room.ends.iter().map(|[i, _]| *i).zip(along.iter().copied());
                    match slot {
                        Slot::Multiplier(k) => places.for_each(|(i, slope)| {
                            slopes[(i * n_gathered + k) * m + column] = slope;
                        }),
                        Slot::Own(other) => {
                            let bent = places.filter(|(_, bend)| *bend != 0.0);
                            bends.extend(bent.map(|(i, bend)| (i, other, *number, bend)));
                        }
                        _ => {}
                    }
                }
            }
        }
        if !bends.is_empty() {
            numbers.extend(&integrals);
        }
        numbers.sort_unstable();
        numbers.dedup();
        let fields = FieldNumbers { numbers, integrals, slopes, n_gathered };
        let m = fields.numbers.len();
        let mut points = vec![0.0; n * m * m];
        for (i, row, column, bend) in bends {
            if let (Some(row), Some(column)) = (fields.place(row), fields.place(column)) {
                points[(i * m + row) * m + column] += self.body.volumes()[i] * bend;
            }
        }
        (fields, points)
    }

    /// Adds second derivatives of the energies of points.
    fn add_points(&self, at: At<'_>, fields: &FieldNumbers, points: &mut [f64]) {
        let m = fields.numbers.len();
        for (law, kernels) in self.laws.present() {
            let Some(kernel) = &kernels.points else { continue };
            let mut room = self.prepared_points((law, kernel), at);
            let roles = roles(kernel, fields);
            for (variable, role) in roles.iter().enumerate() {
                let Some(Role::Of(_, row)) = role else { continue };
                VectorEnergy::by_variable(kernel, variable, &mut room);
                let others = roles.iter().zip(of_slots(kernel, &room));
                for (other, (_, slopes)) in others {
                    let Some(Role::Of(_, column)) = other else { continue };
                    for ([i, _], slope) in room.ends.iter().zip(slopes) {
                        let weight = self.laws.thickness * self.body.volumes()[*i];
                        points[(i * m + row) * m + column] += weight * slope;
                    }
                }
            }
        }
    }

    /// All points of a law, ready for its kernel.
    fn prepared_points(&self, of: (usize, &FamilyKernel), at: At<'_>) -> Room {
        let mut room = Room::default();
        let all = (0..self.body.n_points()).map(|i| [i; 2]);
        room.ends = all.filter(|ends| self.is_of(of.0, ends)).collect();
        self.prepare(of, (at, None), &mut room);
        room
    }

    /// Second derivatives of all bonds, owner by owner.
    fn second_of_bonds<const D: usize>(&self, at: At<'_>, fields: &FieldNumbers) -> Vec<OfBond> {
        let n = self.body.n_points();
        let chunk = |chunk: usize| {
            let owners = chunk * OWNERS..n.min((chunk + 1) * OWNERS);
            let (mut all, mut room) = (Vec::new(), Room::default());
            self.both_ends(owners, &mut all);
            let m = fields.numbers.len();
            let empty = || OfBond {
                across: [vec![0.0; m * m], vec![0.0; m * m]],
                mixed: [vec![0.0; m * D], vec![0.0; m * D]],
                direct: vec![0.0; D * D],
                own: [vec![0.0; m * m], vec![0.0; m * m]],
                weights: [vec![0.0; m * D], vec![0.0; m * D]],
            };
            let n = all.len() / 2;
            let mut bonds = vec![empty(); n];
            for (law, kernels) in self.laws.present() {
                let places = (0..2 * n).filter(|place| self.gathers_by(law, &all[*place]));
                let mut seen: Vec<[usize; 2]> =
                    places.map(|place| [place % n, place / n]).collect();
                let ends = |[bond, end]: &[usize; 2]| all[end * n + bond];
                room.ends = seen.iter().map(ends).collect();
                let to = (&*seen, &mut *bonds);
                self.add_integrands::<D>((law, &kernels.integrands), (at, fields), &mut room, to);
                if let Some(kernel) = &kernels.bonds {
                    seen.retain(|place| self.is_of(law, &ends(place)));
                    room.ends = seen.iter().map(ends).collect();
                    let to = (&*seen, &mut *bonds);
                    self.add_bonds::<D>((law, kernel), (at, fields), &mut room, to);
                }
            }
            bonds
        };
        (0..n.div_ceil(OWNERS)).into_par_iter().map(chunk).collect::<Vec<_>>().concat()
    }

    /// What integrands change by with the vector, and what bonds pull with because of what their ends gather.
    /// Of each place `seen` has the bond, and whether it is its owner that sees it.
    fn add_integrands<const D: usize>(
        &self,
        (law, kernel): (usize, &FamilyKernel),
        (at, fields): (At<'_>, &FieldNumbers),
        room: &mut Room,
        (seen, bonds): (&[[usize; 2]], &mut [OfBond]),
    ) {
        let volumes = self.body.volumes();
        self.prepare((law, kernel), (at, None), room);
        for variable in 0..kernel.variables().len() {
            let Slot::Moved(axis) = kernel.variables()[variable] else { continue };
            VectorEnergy::by_variable(kernel, variable, room);
            for (slot, slopes) in of_slots(kernel, room) {
                for ((number, end), ([i, j], slope)) in
                    seen.iter().map(|[bond, end]| (*bond, *end)).zip(room.ends.iter().zip(slopes))
                {
                    let bond = &mut bonds[number];
                    match slot {
                        Slot::Moved(other) => {
                            bond.direct[other * D + axis] += volumes[*i] * volumes[*j] * slope;
                        }
                        Slot::Multiplier(k) => {
                            let weight = volumes[*j] * slope;
                            for (row, factor) in fields.by_integral(*i, k) {
                                bond.weights[end][row * D + axis] += factor * weight;
                            }
                        }
                        _ => {}
                    }
                }
            }
        }
    }

    /// Second derivatives of the energies of bonds.
    fn add_bonds<const D: usize>(
        &self,
        (law, kernel): (usize, &FamilyKernel),
        (at, fields): (At<'_>, &FieldNumbers),
        room: &mut Room,
        (seen, bonds): (&[[usize; 2]], &mut [OfBond]),
    ) {
        let (m, volumes) = (fields.numbers.len(), self.body.volumes());
        self.prepare((law, kernel), (at, None), room);
        let roles = roles(kernel, fields);
        for (variable, role) in roles.iter().enumerate() {
            let Some(role) = *role else { continue };
            VectorEnergy::by_variable(kernel, variable, room);
            for (other, (_, slopes)) in roles.iter().zip(of_slots(kernel, room)) {
                let Some(other) = *other else { continue };
                for ([number, seen], ([i, j], slope)) in
                    seen.iter().copied().zip(room.ends.iter().zip(slopes))
                {
                    let weight = 0.5 * self.laws.thickness * volumes[*i] * volumes[*j] * slope;
                    let bond = &mut bonds[number];
                    // The end that does not own a bond sees the vector turned around.
                    let sign = if seen == 0 { 1.0 } else { -1.0 };
                    match (role, other) {
                        (Role::Vector(axis), Role::Vector(row)) => {
                            bond.direct[row * D + axis] += weight;
                        }
                        (Role::Vector(axis), Role::Of(end, row)) => {
                            bond.mixed[end ^ seen][row * D + axis] += sign * weight;
                        }
                        (Role::Of(end, row), Role::Of(other_end, column)) => {
                            let out = match end == other_end {
                                true => &mut bond.own[end ^ seen],
                                false => &mut bond.across[end ^ seen],
                            };
                            out[row * m + column] += weight;
                        }
                        (Role::Of(..), Role::Vector(_)) => {}
                    }
                }
            }
        }
    }
}

impl<const D: usize> Linearised<D> for VectorStiffness<'_, D> {
    fn neighborhood(&self) -> &Neighborhood {
        &self.energy.neighborhood
    }

    fn n_fields(&self) -> usize {
        self.n_fields
    }

    fn weights(&self) -> &[[f64; D]] {
        &self.weights
    }

    fn at_point(&self, point: usize) -> &[f64] {
        let size = self.n_fields * self.n_fields;
        &self.points[point * size..(point + 1) * size]
    }

    fn across(&self, seen: Seen) -> Option<&[f64]> {
        let turned = usize::from(seen.sign < 0.0);
        self.has_neighbours.then(|| &self.bonds[seen.bond].across[turned][..])
    }

    fn is_across(&self) -> bool {
        self.has_neighbours
    }

    fn is_direct(&self) -> bool {
        true
    }

    fn is_mixed(&self) -> bool {
        self.energy.laws.has()[1]
    }

    fn mixed(&self, end: usize, seen: Seen, out: &mut [f64]) {
        let owner = seen.ends[usize::from(seen.sign < 0.0)];
        let mixed = &self.bonds[seen.bond].mixed[usize::from(end != owner)];
        out.iter_mut().zip(mixed).for_each(|(out, x)| *out = seen.sign * x);
    }

    fn direct(&self, seen: Seen) -> Tensor<D> {
        let direct = &self.bonds[seen.bond].direct;
        std::array::from_fn(|r| std::array::from_fn(|c| direct[r * D + c]))
    }
}
