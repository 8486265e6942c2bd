//! The kernels of the plain assembly: `C/2 M (m/M - 1)^2` with C = 1, eight interactions side by
//! side, one loop over the lanes that the compiler turns into vector code.

use super::{Vector, cross, dot};

/// Interactions of a batch.
pub(super) const LANES: usize = 8;

type Channel = [f64; LANES];

/// Eight triangles: vectors from the owner, and what their energy contributes.
#[derive(Default)]
pub(super) struct Triangles {
    x: [Channel; 6],
    /// `1/A`.
    inverse: Channel,
    pub(super) gradient: [Channel; 6],
    /// Upper triangles of the members' own blocks.
    pub(super) first: [Channel; 6],
    pub(super) second: [Channel; 6],
    /// The block of the two members.
    pub(super) mixed: [Channel; 9],
}

impl Triangles {
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, first: &Vector, second: &Vector, inverse: f64) {
        for axis in 0..3 {
            self.x[axis][lane] = first[axis];
            self.x[3 + axis][lane] = second[axis];
        }
        self.inverse[lane] = inverse;
    }

    /// With `s = a^2/2`: `dpsi/ds = 1/A - 1/a`, `d2psi/ds2 = 1/a^3`.
    #[inline(never)]
    pub(super) fn evaluate(&mut self) {
        let Triangles { x, inverse, gradient, first, second, mixed } = self;
        for lane in 0..LANES {
            let p = [x[0][lane], x[1][lane], x[2][lane]];
            let q = [x[3][lane], x[4][lane], x[5][lane]];
            let c = cross(&p, &q);
            let square = dot(&c, &c);
            let root = 1.0 / square.sqrt();
            let slope = inverse[lane] - root;
            let bend = root / square;
            let (gp, gq) = (cross(&q, &c), cross(&c, &p));
            let (bp, bq) = (gp.map(|g| bend * g), gq.map(|g| bend * g));
            let (sp, sq) = (p.map(|x| slope * x), q.map(|x| slope * x));
            let (pp, qq, pq) = (dot(&sp, &p), dot(&sq, &q), dot(&sp, &q));
            for axis in 0..3 {
                gradient[axis][lane] = slope * gp[axis];
                gradient[3 + axis][lane] = slope * gq[axis];
            }
            first[0][lane] = bp[0] * gp[0] - sq[0] * q[0] + qq;
            first[1][lane] = bp[0] * gp[1] - sq[0] * q[1];
            first[2][lane] = bp[0] * gp[2] - sq[0] * q[2];
            first[3][lane] = bp[1] * gp[1] - sq[1] * q[1] + qq;
            first[4][lane] = bp[1] * gp[2] - sq[1] * q[2];
            first[5][lane] = bp[2] * gp[2] - sq[2] * q[2] + qq;
            second[0][lane] = bq[0] * gq[0] - sp[0] * p[0] + pp;
            second[1][lane] = bq[0] * gq[1] - sp[0] * p[1];
            second[2][lane] = bq[0] * gq[2] - sp[0] * p[2];
            second[3][lane] = bq[1] * gq[1] - sp[1] * p[1] + pp;
            second[4][lane] = bq[1] * gq[2] - sp[1] * p[2];
            second[5][lane] = bq[2] * gq[2] - sp[2] * p[2] + pp;
            mixed[0][lane] = bp[0] * gq[0] + sp[0] * q[0] - pq;
            mixed[1][lane] = bp[0] * gq[1] + 2.0 * sp[0] * q[1] - sq[0] * p[1];
            mixed[2][lane] = bp[0] * gq[2] + 2.0 * sp[0] * q[2] - sq[0] * p[2];
            mixed[3][lane] = bp[1] * gq[0] + 2.0 * sp[1] * q[0] - sq[1] * p[0];
            mixed[4][lane] = bp[1] * gq[1] + sp[1] * q[1] - pq;
            mixed[5][lane] = bp[1] * gq[2] + 2.0 * sp[1] * q[2] - sq[1] * p[2];
            mixed[6][lane] = bp[2] * gq[0] + 2.0 * sp[2] * q[0] - sq[2] * p[0];
            mixed[7][lane] = bp[2] * gq[1] + 2.0 * sp[2] * q[1] - sq[2] * p[1];
            mixed[8][lane] = bp[2] * gq[2] + sp[2] * q[2] - pq;
        }
    }
}

/// Eight tetrahedra.
#[derive(Default)]
pub(super) struct Tetrahedra {
    x: [Channel; 9],
    /// `1/V` with the sign of the tetrahedron.
    inverse: Channel,
    sign: Channel,
    pub(super) gradient: [Channel; 9],
    /// Upper triangles of the members' own blocks.
    pub(super) own: [[Channel; 6]; 3],
    /// The blocks of members (1,2), (1,3), (2,3).
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
        self.inverse[lane] = 1.0 / volume;
        self.sign[lane] = 1f64.copysign(volume);
    }

    /// With the signed `v`: `dpsi/dv = v/V - 1` times the sign, `d2psi/dv2 = 1/abs(V)`.
    #[inline(never)]
    pub(super) fn evaluate(&mut self) {
        let Tetrahedra { x, inverse, sign, gradient, own, pairs } = self;
        for lane in 0..LANES {
            let p = [x[0][lane], x[1][lane], x[2][lane]];
            let q = [x[3][lane], x[4][lane], x[5][lane]];
            let r = [x[6][lane], x[7][lane], x[8][lane]];
            let g = [cross(&q, &r), cross(&r, &p), cross(&p, &q)];
            let slope = sign[lane] * (dot(&p, &g[0]) * inverse[lane] - 1.0);
            let bend = sign[lane] * inverse[lane];
            let b = g.map(|g| g.map(|g| bend * g));
            for corner in 0..3 {
                for axis in 0..3 {
                    gradient[3 * corner + axis][lane] = slope * g[corner][axis];
                }
                let (b, g, own) = (&b[corner], &g[corner], &mut own[corner]);
                own[0][lane] = b[0] * g[0];
                own[1][lane] = b[0] * g[1];
                own[2][lane] = b[0] * g[2];
                own[3][lane] = b[1] * g[1];
                own[4][lane] = b[1] * g[2];
                own[5][lane] = b[2] * g[2];
            }
            let twist = [r.map(|x| slope * x), q.map(|x| -slope * x), p.map(|x| slope * x)];
            for (number, (near, far)) in [(0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
                let (b, g, [x, y, z]) = (&b[near], &g[far], twist[number]);
                let pair = &mut pairs[number];
                pair[0][lane] = b[0] * g[0];
                pair[1][lane] = b[0] * g[1] + z;
                pair[2][lane] = b[0] * g[2] - y;
                pair[3][lane] = b[1] * g[0] - z;
                pair[4][lane] = b[1] * g[1];
                pair[5][lane] = b[1] * g[2] + x;
                pair[6][lane] = b[2] * g[0] + y;
                pair[7][lane] = b[2] * g[1] - x;
                pair[8][lane] = b[2] * g[2];
            }
        }
    }
}
