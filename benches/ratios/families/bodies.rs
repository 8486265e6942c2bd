//! Bodies as a program for one model would have them: lists of neighbours, reference data worked out
//! beforehand, loops over bonds that add to both ends, all compiled for the widest registers of the
//! machine. One thread, no energies, no checks.

use std::marker::PhantomData;
use std::ops::Range;

use piola_runtime::body::Body;
use piola_runtime::neighborhood::Neighborhood;

use super::Loops;
use super::laws::Derivatives;
use crate::tensors::{LANES, MU, Material, NO_TENSORS, Tensor, Tensors, lane_of, set_lane};

type Vector = [f64; 3];

const ZERO: Tensor = [[0.0; 3]; 3];
const ONE: Tensor = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// A bond from its lower point.
struct Bond {
    other: u32,
    dx: Vector,
}

/// Bonds of every point with later ones.
struct Bonds {
    start: Vec<usize>,
    bonds: Vec<Bond>,
    volumes: Vec<f64>,
}

impl Bonds {
    fn new(body: &Body, lists: &Neighborhood) -> Bonds {
        let (mut start, mut bonds) = (vec![0], Vec::new());
        let positions = body.positions().as_chunks::<3>().0;
        for i in 0..body.n_points() {
            for other in lists.upper(i) {
                let dx = minus(&positions[other as usize], &positions[i]);
                bonds.push(Bond { other, dx });
            }
            start.push(bonds.len());
        }
        Bonds { start, bonds, volumes: body.volumes().to_vec() }
    }

    fn n_points(&self) -> usize {
        self.volumes.len()
    }
}

#[inline(always)]
fn minus(x: &Vector, y: &Vector) -> Vector {
    [x[0] - y[0], x[1] - y[1], x[2] - y[2]]
}

#[inline(always)]
fn dot(x: &Vector, y: &Vector) -> f64 {
    x[0] * y[0] + x[1] * y[1] + x[2] * y[2]
}

#[inline(always)]
fn apply(a: &Tensor, x: &Vector) -> Vector {
    [dot(&a[0], x), dot(&a[1], x), dot(&a[2], x)]
}

#[inline(always)]
fn add_product(a: &mut Tensor, x: &Vector, y: &Vector) {
    for r in 0..3 {
        for c in 0..3 {
            a[r][c] += x[r] * y[c];
        }
    }
}

#[inline(always)]
fn scale(a: &mut Tensor, factor: f64) {
    a.as_flattened_mut().iter_mut().for_each(|x| *x *= factor);
}

/// `F` from displacements, and forces from stresses: `F = sum_j V_j (u_j - u_i) x K^-1 dX`.
struct Gradients {
    start: Vec<usize>,
    neighbors: Vec<u32>,
    /// `V_j K_i^-1 dX`.
    weights: Vec<Vector>,
}

impl Gradients {
    fn new(body: &Body, lists: &Neighborhood) -> Gradients {
        let positions = body.positions().as_chunks::<3>().0;
        let (mut start, mut neighbors, mut weights) = (vec![0], Vec::new(), Vec::new());
        for i in 0..body.n_points() {
            let offset = |j: u32| minus(&positions[j as usize], &positions[i]);
            let mut shape = ZERO;
            for j in lists.row(i) {
                let dx = offset(j);
                add_product(&mut shape, &dx.map(|x| body.volumes()[j as usize] * x), &dx);
            }
            let inverse = inverse(&shape);
            for j in lists.row(i) {
                neighbors.push(j);
                let weight = apply(&inverse, &offset(j));
                weights.push(weight.map(|x| body.volumes()[j as usize] * x));
            }
            start.push(neighbors.len());
        }
        Gradients { start, neighbors, weights }
    }

    #[inline(always)]
    fn family(&self, i: usize) -> impl Iterator<Item = (usize, &Vector)> {
        let places = self.start[i]..self.start[i + 1];
        let members = self.neighbors[places.clone()].iter().map(|&j| j as usize);
        members.zip(&self.weights[places])
    }

    #[inline(always)]
    fn at(&self, u: &[Vector], i: usize) -> Tensor {
        let mut h = ZERO;
        for (j, weight) in self.family(i) {
            add_product(&mut h, &minus(&u[j], &u[i]), weight);
        }
        h
    }

    #[inline(always)]
    fn scatter(&self, i: usize, stress: &Tensor, out: &mut [Vector]) {
        let mut own = [0.0; 3];
        for (j, weight) in self.family(i) {
            let force = apply(stress, weight);
            for c in 0..3 {
                out[j][c] += force[c];
                own[c] += force[c];
            }
        }
        for c in 0..3 {
            out[i][c] -= own[c];
        }
    }
}

fn inverse(a: &Tensor) -> Tensor {
    let minor = |r: usize, c: usize| {
        let (p, q, s, t) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        a[p][s] * a[q][t] - a[p][t] * a[q][s]
    };
    let determinant = (0..3).map(|c| a[0][c] * minor(0, c)).sum::<f64>();
    std::array::from_fn(|r| std::array::from_fn(|c| minor(c, r) / determinant))
}

#[inline(always)]
fn sum(a: &Tensor, b: &Tensor) -> Tensor {
    std::array::from_fn(|r| std::array::from_fn(|c| a[r][c] + b[r][c]))
}

/// CC: `sum_i V_i psi(F_i)`.
pub(super) struct Nodal<L> {
    gradients: Gradients,
    volumes: Vec<f64>,
    f: Vec<Tensor>,
    law: PhantomData<L>,
}

impl<L> Nodal<L> {
    pub(super) fn new(body: &Body, lists: &Neighborhood) -> Nodal<L> {
        let (volumes, f) = (body.volumes().to_vec(), vec![ZERO; body.n_points()]);
        Nodal { gradients: Gradients::new(body, lists), volumes, f, law: PhantomData }
    }

    #[inline(always)]
    fn scatter(&self, points: Range<usize>, stresses: &Tensors, out: &mut [Vector]) {
        for (lane, i) in points.enumerate() {
            let mut stress = lane_of(stresses, lane);
            scale(&mut stress, self.volumes[i]);
            self.gradients.scatter(i, &stress, out);
        }
    }
}

impl<L: Derivatives> Loops for Nodal<L> {
    #[inline(always)]
    fn forces(&mut self, u: &[Vector], out: &mut [Vector]) {
        out.fill([0.0; 3]);
        let n = self.f.len();
        for start in (0..n).step_by(LANES) {
            let points = start..n.min(start + LANES);
            let mut f = NO_TENSORS;
            for i in points.clone() {
                self.f[i] = sum(&self.gradients.at(u, i), &ONE);
                set_lane(&mut f, i - start, &self.f[i]);
            }
            self.scatter(points, &L::Solid::stress(&f).1, out);
        }
    }

    #[inline(always)]
    fn product(&mut self, p: &[Vector], out: &mut [Vector]) {
        out.fill([0.0; 3]);
        let n = self.f.len();
        for start in (0..n).step_by(LANES) {
            let points = start..n.min(start + LANES);
            let (mut f, mut change) = (NO_TENSORS, NO_TENSORS);
            for i in points.clone() {
                set_lane(&mut f, i - start, &self.f[i]);
                set_lane(&mut change, i - start, &self.gradients.at(p, i));
            }
            self.scatter(points, &L::Solid::stress_change(&f, &change), out);
        }
    }
}

/// BAQP: `sum over bonds of weight psi(F_ij)`.
pub(super) struct AtBonds<L> {
    gradients: Gradients,
    bonds: Bonds,
    /// `V_i V_j w (1/w0_i + 1/w0_j)`, and `dX/L^2`.
    weights: Vec<(f64, Vector)>,
    u: Vec<Vector>,
    h: Vec<Tensor>,
    change: Vec<Tensor>,
    duals: Vec<Tensor>,
    law: PhantomData<L>,
}

impl<L> AtBonds<L> {
    pub(super) fn new(body: &Body, lists: &Neighborhood) -> AtBonds<L> {
        let bonds = Bonds::new(body, lists);
        let n = body.n_points();
        let volumes = body.volumes();
        let around = |i: usize| lists.row(i).iter().map(|j| volumes[j as usize]).sum::<f64>();
        let sums: Vec<f64> = (0..n).map(around).collect();
        let mut weights = Vec::new();
        for i in 0..n {
            for bond in &bonds.bonds[bonds.start[i]..bonds.start[i + 1]] {
                let j = bond.other as usize;
                let squared = dot(&bond.dx, &bond.dx);
                let weight = volumes[i] * volumes[j] * (1.0 / sums[i] + 1.0 / sums[j]);
                weights.push((weight, bond.dx.map(|x| x / squared)));
            }
        }
        let tensors = || vec![ZERO; n];
        AtBonds {
            gradients: Gradients::new(body, lists),
            bonds,
            weights,
            u: vec![[0.0; 3]; n],
            h: tensors(),
            change: tensors(),
            duals: tensors(),
            law: PhantomData,
        }
    }

    /// `(H_i + H_j)/2 (I - dX x dX/L^2) + (u_j - u_i) x dX/L^2`.
    #[inline(always)]
    fn at(h: [&Tensor; 2], u: [&Vector; 2], dx: &Vector, along: &Vector) -> Tensor {
        let mut mean = *h[0];
        for r in 0..3 {
            for c in 0..3 {
                mean[r][c] = 0.5 * (mean[r][c] + h[1][r][c]);
            }
        }
        let carried = apply(&mean, dx);
        add_product(&mut mean, &minus(&minus(u[1], u[0]), &carried), along);
        mean
    }

    /// All bonds: `stress` of `at` of each goes to the ends and, by `H`, to their families.
    #[inline(always)]
    fn visit<const N: usize>(
        &mut self,
        out: &mut [Vector],
        at: impl Fn(&Self, usize, usize, &Bond, &Vector) -> [Tensor; N],
        stress: impl Fn(&[Tensors; N]) -> Tensors,
    ) {
        out.fill([0.0; 3]);
        self.duals.fill(ZERO);
        for i in 0..self.bonds.n_points() {
            let end = self.bonds.start[i + 1];
            for first in (self.bonds.start[i]..end).step_by(LANES) {
                let places = first..end.min(first + LANES);
                let mut tensors = [NO_TENSORS; N];
                for place in places.clone() {
                    let bond = &self.bonds.bonds[place];
                    let found = at(self, i, bond.other as usize, bond, &self.weights[place].1);
                    for (tensors, found) in tensors.iter_mut().zip(&found) {
                        set_lane(tensors, place - first, found);
                    }
                }
                let stresses = stress(&tensors);
                for place in places {
                    self.scatter(i, place, lane_of(&stresses, place - first), out);
                }
            }
        }
        for i in 0..self.bonds.n_points() {
            self.gradients.scatter(i, &self.duals[i], out);
        }
    }

    #[inline(always)]
    fn scatter(&mut self, i: usize, place: usize, mut stress: Tensor, out: &mut [Vector]) {
        let bond = &self.bonds.bonds[place];
        let (weight, along) = &self.weights[place];
        let j = bond.other as usize;
        scale(&mut stress, *weight);
        let pull = apply(&stress, along);
        for r in 0..3 {
            out[j][r] += pull[r];
            out[i][r] -= pull[r];
            for c in 0..3 {
                let half = 0.5 * (stress[r][c] - pull[r] * bond.dx[c]);
                self.duals[i][r][c] += half;
                self.duals[j][r][c] += half;
            }
        }
    }
}

impl<L: Derivatives> Loops for AtBonds<L> {
    #[inline(always)]
    fn forces(&mut self, u: &[Vector], out: &mut [Vector]) {
        self.u.copy_from_slice(u);
        for i in 0..u.len() {
            self.h[i] = self.gradients.at(u, i);
        }
        self.visit(
            out,
            #[inline(always)]
            |body, i, j, bond, along| {
                let h = Self::at([&body.h[i], &body.h[j]], [&u[i], &u[j]], &bond.dx, along);
                [sum(&h, &ONE)]
            },
            #[inline(always)]
            |[f]| L::Solid::stress(f).1,
        );
    }

    #[inline(always)]
    fn product(&mut self, p: &[Vector], out: &mut [Vector]) {
        for i in 0..p.len() {
            self.change[i] = self.gradients.at(p, i);
        }
        self.visit(
            out,
            #[inline(always)]
            |body, i, j, bond, along| {
                let u = [&body.u[i], &body.u[j]];
                let h = Self::at([&body.h[i], &body.h[j]], u, &bond.dx, along);
                let change = [&body.change[i], &body.change[j]];
                let change = Self::at(change, [&p[i], &p[j]], &bond.dx, along);
                [sum(&h, &ONE), change]
            },
            #[inline(always)]
            |[f, change]| L::Solid::stress_change(f, change),
        );
    }
}

/// LPS: `sum_i V_i (K - 5G/3)/2 theta_i^2 + sum over bonds of 15G/2 (1/m_i + 1/m_j) V_i V_j e^2`.
pub(super) struct Solid<L> {
    bonds: Bonds,
    rest: Vec<f64>,
    /// `3/m_i`.
    thirds: Vec<f64>,
    now: Vec<Now>,
    theta: Vec<f64>,
    pressure: Vec<f64>,
    law: PhantomData<L>,
}

/// A bond at the last displacements.
#[derive(Clone, Copy, Default)]
struct Now {
    length: f64,
    normal: Vector,
    /// The derivative of the energy by the length over the volumes.
    tension: f64,
    /// What the length changes by along a direction.
    change: f64,
}

impl<L> Solid<L> {
    pub(super) fn new(body: &Body, lists: &Neighborhood) -> Solid<L> {
        let bonds = Bonds::new(body, lists);
        let n = body.n_points();
        let rest: Vec<f64> =
            bonds.bonds.iter().map(|bond| dot(&bond.dx, &bond.dx).sqrt()).collect();
        let mut m = vec![0.0; n];
        for i in 0..n {
            for place in bonds.start[i]..bonds.start[i + 1] {
                let (j, squared) = (bonds.bonds[place].other as usize, rest[place] * rest[place]);
                m[i] += bonds.volumes[j] * squared;
                m[j] += bonds.volumes[i] * squared;
            }
        }
        let now = vec![Now::default(); rest.len()];
        let thirds = m.iter().map(|m| 3.0 / m).collect();
        let numbers = || vec![0.0; n];
        let (theta, pressure) = (numbers(), numbers());
        Solid { bonds, rest, thirds, now, theta, pressure, law: PhantomData }
    }

    /// `3/m_i sum_j V_j L extension`, by points.
    #[inline(always)]
    fn gather(
        &mut self,
        p: &[Vector],
        mut extension: impl FnMut(&mut Now, Vector, f64, &Vector) -> f64,
    ) -> Vec<f64> {
        let mut out = vec![0.0; p.len()];
        for i in 0..p.len() {
            let mut own = 0.0;
            for place in self.bonds.start[i]..self.bonds.start[i + 1] {
                let bond = &self.bonds.bonds[place];
                let (j, rest) = (bond.other as usize, self.rest[place]);
                let part =
                    rest * extension(&mut self.now[place], minus(&p[j], &p[i]), rest, &bond.dx);
                own += self.bonds.volumes[j] * part;
                out[j] += self.bonds.volumes[i] * part;
            }
            out[i] += own;
        }
        out.iter_mut().zip(&self.thirds).for_each(|(x, third)| *x *= third);
        out
    }
}

impl<L: Derivatives> Loops for Solid<L> {
    #[inline(always)]
    fn forces(&mut self, u: &[Vector], out: &mut [Vector]) {
        self.theta = self.gather(
            u,
            #[inline(always)]
            |now, moved, rest, dx| {
                let y = [dx[0] + moved[0], dx[1] + moved[1], dx[2] + moved[2]];
                now.length = dot(&y, &y).sqrt();
                let inverse = 1.0 / now.length;
                now.normal = y.map(|y| y * inverse);
                now.length - rest
            },
        );
        let pressure = |(theta, third): (&f64, &f64)| third * L::pressure(*theta);
        self.pressure = self.theta.iter().zip(&self.thirds).map(pressure).collect();
        out.fill([0.0; 3]);
        for i in 0..u.len() {
            let mut own = [0.0; 3];
            for place in self.bonds.start[i]..self.bonds.start[i + 1] {
                let j = self.bonds.bonds[place].other as usize;
                let (now, rest) = (&mut self.now[place], self.rest[place]);
                let scale = 5.0 * MU * (self.thirds[i] + self.thirds[j]);
                let shared = (self.pressure[i] + self.pressure[j]) * rest;
                now.tension = shared + L::tension(scale, now.length, rest);
                let force = self.bonds.volumes[i] * self.bonds.volumes[j] * now.tension;
                for c in 0..3 {
                    out[j][c] += force * now.normal[c];
                    own[c] += force * now.normal[c];
                }
            }
            for c in 0..3 {
                out[i][c] -= own[c];
            }
        }
    }

    #[inline(always)]
    fn product(&mut self, p: &[Vector], out: &mut [Vector]) {
        let changes = self.gather(
            p,
            #[inline(always)]
            |now, moved, _, _| {
                now.change = dot(&now.normal, &moved);
                now.change
            },
        );
        let change = |i: usize| self.thirds[i] * L::pressure_change(self.theta[i], changes[i]);
        let changes: Vec<f64> = (0..p.len()).map(change).collect();
        out.fill([0.0; 3]);
        for i in 0..p.len() {
            let mut own = [0.0; 3];
            for place in self.bonds.start[i]..self.bonds.start[i + 1] {
                let j = self.bonds.bonds[place].other as usize;
                let (now, rest) = (&self.now[place], self.rest[place]);
                let scale = 5.0 * MU * (self.thirds[i] + self.thirds[j]);
                let along = (changes[i] + changes[j]) * rest
                    + L::tension_change(scale, now.length, rest, now.change);
                let moved = minus(&p[j], &p[i]);
                let across = now.tension / now.length;
                let weight = self.bonds.volumes[i] * self.bonds.volumes[j];
                for c in 0..3 {
                    let turned = across * (moved[c] - now.change * now.normal[c]);
                    let force = weight * (along * now.normal[c] + turned);
                    out[j][c] += force;
                    own[c] += force;
                }
            }
            for c in 0..3 {
                out[i][c] -= own[c];
            }
        }
    }
}
