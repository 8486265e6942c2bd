//! The kernels of the plain assembly: `C/2 M (m/M - 1)^2` with C = 1, eight interactions side by
//! side.
//!
//! One loop over the lanes, without inner loops and with outputs of its own: then the compiler
//! makes a vector loop of it. Written in pairs of lanes it is half as fast.

use super::{Vector, cross, dot};

/// Interactions of a batch.
pub(super) const LANES: usize = 8;

type Channel = [f64; LANES];

/// Eight triangles: vectors from the owner, and what their energy contributes.
#[derive(Default)]
pub(super) struct Triangles {
    x: [Channel; 6],
    /// `A^2`.
    squared: Channel,
    pub(super) out: TriangleSums,
}

/// Gradient, upper triangles of the members' own blocks, the block of the two members.
#[derive(Default)]
pub(super) struct TriangleSums {
    pub(super) gradient: [Channel; 6],
    pub(super) own: [[Channel; 6]; 2],
    pub(super) mixed: [Channel; 9],
}

impl Triangles {
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, first: &Vector, second: &Vector, squared: f64) {
        for axis in 0..3 {
            self.x[axis][lane] = first[axis];
            self.x[3 + axis][lane] = second[axis];
        }
        self.squared[lane] = squared;
    }

    #[inline(always)]
    pub(super) fn evaluate(&mut self) {
        triangles(&self.x, &self.squared, &mut self.out);
    }
}

/// With `s = a^2/2`: `dpsi/ds = 1/A - 1/a`, `d2psi/ds2 = 1/a^3`.
#[inline(always)]
fn triangles(x: &[Channel; 6], squared: &Channel, out: &mut TriangleSums) {
    for lane in 0..LANES {
        let p = [x[0][lane], x[1][lane], x[2][lane]];
        let q = [x[3][lane], x[4][lane], x[5][lane]];
        let c = cross(&p, &q);
        let root = 1.0 / dot(&c, &c).sqrt();
        let slope = 1.0 / squared[lane].sqrt() - root;
        let bend = root * root * root;
        let (gp, gq) = (cross(&q, &c), cross(&c, &p));
        let (bp, bq) = (times(bend, &gp), times(bend, &gq));
        let (sp, sq) = (times(slope, &p), times(slope, &q));
        let (pp, qq, pq) = (dot(&sp, &p), dot(&sq, &q), dot(&sp, &q));
        let gradient = &mut out.gradient;
        gradient[0][lane] = slope * gp[0];
        gradient[1][lane] = slope * gp[1];
        gradient[2][lane] = slope * gp[2];
        gradient[3][lane] = slope * gq[0];
        gradient[4][lane] = slope * gq[1];
        gradient[5][lane] = slope * gq[2];
        let [first, second] = &mut out.own;
        own_block(lane, &bp, &gp, &sq, &q, qq, first);
        own_block(lane, &bq, &gq, &sp, &p, pp, second);
        let mixed = &mut out.mixed;
        mixed[0][lane] = bp[0] * gq[0] + sp[0] * q[0] - pq;
        mixed[1][lane] = bp[0] * gq[1] + (2.0 * sp[0]) * q[1] - sq[0] * p[1];
        mixed[2][lane] = bp[0] * gq[2] + (2.0 * sp[0]) * q[2] - sq[0] * p[2];
        mixed[3][lane] = bp[1] * gq[0] + (2.0 * sp[1]) * q[0] - sq[1] * p[0];
        mixed[4][lane] = bp[1] * gq[1] + sp[1] * q[1] - pq;
        mixed[5][lane] = bp[1] * gq[2] + (2.0 * sp[1]) * q[2] - sq[1] * p[2];
        mixed[6][lane] = bp[2] * gq[0] + (2.0 * sp[2]) * q[0] - sq[2] * p[0];
        mixed[7][lane] = bp[2] * gq[1] + (2.0 * sp[2]) * q[1] - sq[2] * p[1];
        mixed[8][lane] = bp[2] * gq[2] + sp[2] * q[2] - pq;
    }
}

/// `b g - s x + square I`.
#[inline(always)]
fn own_block(
    lane: usize,
    b: &Vector,
    g: &Vector,
    s: &Vector,
    x: &Vector,
    square: f64,
    out: &mut [Channel; 6],
) {
    out[0][lane] = b[0] * g[0] - s[0] * x[0] + square;
    out[1][lane] = b[0] * g[1] - s[0] * x[1];
    out[2][lane] = b[0] * g[2] - s[0] * x[2];
    out[3][lane] = b[1] * g[1] - s[1] * x[1] + square;
    out[4][lane] = b[1] * g[2] - s[1] * x[2];
    out[5][lane] = b[2] * g[2] - s[2] * x[2] + square;
}

/// Eight tetrahedra.
#[derive(Default)]
pub(super) struct Tetrahedra {
    x: [Channel; 9],
    /// `V` with the sign of the tetrahedron.
    volume: Channel,
    pub(super) out: TetrahedronSums,
}

/// Gradient, upper triangles of the members' own blocks, blocks of members (1,2), (1,3), (2,3).
#[derive(Default)]
pub(super) struct TetrahedronSums {
    pub(super) gradient: [Channel; 9],
    pub(super) own: [[Channel; 6]; 3],
    pub(super) pairs: [[Channel; 9]; 3],
}

impl Tetrahedra {
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, corners: [&Vector; 3], volume: f64) {
        for (corner, vector) in corners.into_iter().enumerate() {
            for axis in 0..3 {
                self.x[3 * corner + axis][lane] = vector[axis];
            }
        }
        self.volume[lane] = volume;
    }

    #[inline(always)]
    pub(super) fn evaluate(&mut self) {
        tetrahedra(&self.x, &self.volume, &mut self.out);
    }
}

/// With the signed `v`: `dpsi/dv = v/V - 1` times the sign, `d2psi/dv2 = 1/abs(V)`.
#[inline(always)]
fn tetrahedra(x: &[Channel; 9], volume: &Channel, out: &mut TetrahedronSums) {
    for lane in 0..LANES {
        let (inverse, sign) = (1.0 / volume[lane], 1f64.copysign(volume[lane]));
        let p = [x[0][lane], x[1][lane], x[2][lane]];
        let q = [x[3][lane], x[4][lane], x[5][lane]];
        let r = [x[6][lane], x[7][lane], x[8][lane]];
        let (gp, gq, gr) = (cross(&q, &r), cross(&r, &p), cross(&p, &q));
        let slope = sign * (dot(&p, &gp) * inverse - 1.0);
        let bend = sign * inverse;
        let (bp, bq, br) = (times(bend, &gp), times(bend, &gq), times(bend, &gr));
        let gradient = &mut out.gradient;
        gradient[0][lane] = slope * gp[0];
        gradient[1][lane] = slope * gp[1];
        gradient[2][lane] = slope * gp[2];
        gradient[3][lane] = slope * gq[0];
        gradient[4][lane] = slope * gq[1];
        gradient[5][lane] = slope * gq[2];
        gradient[6][lane] = slope * gr[0];
        gradient[7][lane] = slope * gr[1];
        gradient[8][lane] = slope * gr[2];
        let [first, second, third] = &mut out.own;
        rank_one(lane, &bp, &gp, first);
        rank_one(lane, &bq, &gq, second);
        rank_one(lane, &br, &gr, third);
        let [pq, pr, qr] = &mut out.pairs;
        pair_block(lane, &bp, &gq, &times(slope, &r), pq);
        pair_block(lane, &bp, &gr, &times(-slope, &q), pr);
        pair_block(lane, &bq, &gr, &times(slope, &p), qr);
    }
}

/// The upper triangle of `b g`.
#[inline(always)]
fn rank_one(lane: usize, b: &Vector, g: &Vector, out: &mut [Channel; 6]) {
    out[0][lane] = b[0] * g[0];
    out[1][lane] = b[0] * g[1];
    out[2][lane] = b[0] * g[2];
    out[3][lane] = b[1] * g[1];
    out[4][lane] = b[1] * g[2];
    out[5][lane] = b[2] * g[2];
}

/// `b g` and the cross product with `t`.
#[inline(always)]
fn pair_block(lane: usize, b: &Vector, g: &Vector, t: &Vector, out: &mut [Channel; 9]) {
    out[0][lane] = b[0] * g[0];
    out[1][lane] = b[0] * g[1] + t[2];
    out[2][lane] = b[0] * g[2] - t[1];
    out[3][lane] = b[1] * g[0] - t[2];
    out[4][lane] = b[1] * g[1];
    out[5][lane] = b[1] * g[2] + t[0];
    out[6][lane] = b[2] * g[0] + t[1];
    out[7][lane] = b[2] * g[1] - t[0];
    out[8][lane] = b[2] * g[2];
}

#[inline(always)]
fn times(factor: f64, x: &Vector) -> Vector {
    [factor * x[0], factor * x[1], factor * x[2]]
}
