//! The kernels of `kernels.c` in Rust, compiled alone for the processor at hand: the same formulas,
//! the same usage, the same output.

use std::time::Instant;

const LANES: usize = 8;
const BLOCKS: usize = 128;
/// Blocks of results that are kept.
const RING: usize = 4;
const SAMPLES: usize = 61;

type Channel = [f64; LANES];
type Vector = [f64; 3];

#[inline(always)]
fn add(p: Vector, q: Vector) -> Vector {
    [p[0] + q[0], p[1] + q[1], p[2] + q[2]]
}

#[inline(always)]
fn times(f: f64, p: Vector) -> Vector {
    [f * p[0], f * p[1], f * p[2]]
}

#[inline(always)]
fn dot(p: Vector, q: Vector) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

#[inline(always)]
fn cross(p: Vector, q: Vector) -> Vector {
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
}

/// psi, psi', psi'' from the relative change and the reference; 27 means n = 2.7, 0 means ln.
#[inline(always)]
fn law<const N: i32>(e: f64, reference: f64) -> [f64; 3] {
    let x = 1.0 + e;
    // S, M dS/dm, M^2 d2(S^2/2)/dm2.
    let (s, d1, d2) = match N {
        1 => (e, 1.0, 1.0),
        2 => {
            let s = e * (1.0 + 0.5 * e);
            (s, x, x * x + s)
        }
        27 => {
            let s = (2.7 * e.ln_1p()).exp_m1() * (1.0 / 2.7);
            let inverse = 1.0 / x;
            let d1 = (1.0 + 2.7 * s) * inverse;
            (s, d1, d1 * d1 + 1.7 * s * d1 * inverse)
        }
        _ => {
            let inverse = 1.0 / x;
            let s = e.ln_1p();
            (s, inverse, inverse * inverse * (1.0 - s))
        }
    };
    [0.5 * reference * s * s, s * d1, d2 / reference]
}

/// A channel of the outputs and the lane: `put!(out, lane, first channel; values..)`.
macro_rules! put {
    ($out:ident, $lane:ident, $first:expr; $($value:expr),* $(,)?) => {{
        let mut channel = $first;
        $($out[channel][$lane] = $value; channel += 1;)*
        let _ = channel;
    }};
}

macro_rules! own {
    ($out:ident, $lane:ident, $first:expr; $b:expr, $g:expr, $s:expr, $x:expr, $square:expr) => {{
        let (b, g, s, x, square) = ($b, $g, $s, $x, $square);
        put!($out, $lane, $first;
            b[0] * g[0] - s[0] * x[0] + square, b[0] * g[1] - s[0] * x[1], b[0] * g[2] - s[0] * x[2],
            b[1] * g[1] - s[1] * x[1] + square, b[1] * g[2] - s[1] * x[2],
            b[2] * g[2] - s[2] * x[2] + square);
    }};
}

macro_rules! rank_one {
    ($out:ident, $lane:ident, $first:expr; $b:expr, $g:expr) => {{
        let (b, g) = ($b, $g);
        put!($out, $lane, $first; b[0] * g[0], b[0] * g[1], b[0] * g[2], b[1] * g[1], b[1] * g[2], b[2] * g[2]);
    }};
}

macro_rules! pair {
    ($out:ident, $lane:ident, $first:expr; $b:expr, $g:expr, $t:expr) => {{
        let (b, g, t) = ($b, $g, $t);
        put!($out, $lane, $first;
            b[0] * g[0], b[0] * g[1] + t[2], b[0] * g[2] - t[1],
            b[1] * g[0] - t[2], b[1] * g[1], b[1] * g[2] + t[0],
            b[2] * g[0] + t[1], b[2] * g[1] - t[0], b[2] * g[2]);
    }};
}

#[inline(always)]
fn at(x: &[Channel], first: usize, lane: usize) -> Vector {
    [x[first][lane], x[first + 1][lane], x[first + 2][lane]]
}

#[inline(always)]
fn bond<const N: i32>(x: &[Channel; 7], out: &mut [Channel; 10]) {
    for lane in 0..LANES {
        let (rest, eta) = (at(x, 0, lane), at(x, 3, lane));
        let p = add(rest, eta);
        let (reference, length) = (dot(rest, rest).sqrt(), dot(p, p).sqrt());
        let (e, w) = (dot(eta, add(rest, p)) / (reference * (length + reference)), x[6][lane]);
        let [psi, first, second] = law::<N>(e, reference);
        let inverse = 1.0 / length;
        let slope = w * first * inverse;
        let bend = (w * second - slope) * inverse * inverse;
        put!(out, lane, 0; w * psi, slope * p[0], slope * p[1], slope * p[2]);
        own!(out, lane, 4; times(bend, p), p, [0.0; 3], p, slope);
    }
}

#[inline(always)]
fn triangle<const N: i32>(x: &[Channel; 13], out: &mut [Channel; 28]) {
    for lane in 0..LANES {
        let (rest_p, rest_q) = (at(x, 0, lane), at(x, 3, lane));
        let (u, v) = (at(x, 6, lane), at(x, 9, lane));
        let (p, q) = (add(rest_p, u), add(rest_q, v));
        let (normal, c) = (cross(rest_p, rest_q), cross(p, q));
        let grown = add(cross(rest_p, v), cross(u, q));
        let (reference, area) = (dot(normal, normal).sqrt(), dot(c, c).sqrt());
        let (e, w) = (dot(grown, add(normal, c)) / (reference * (area + reference)), x[12][lane]);
        let [psi, first, second] = law::<N>(e, reference);
        let inverse = 1.0 / area;
        let slope = w * first * inverse;
        let bend = (w * second - slope) * inverse * inverse;
        let (gp, gq) = (cross(q, c), cross(c, p));
        let (bp, bq) = (times(bend, gp), times(bend, gq));
        let (sp, sq) = (times(slope, p), times(slope, q));
        let (pp, qq, pq) = (dot(sp, p), dot(sq, q), dot(sp, q));
        put!(out, lane, 0; w * psi, slope * gp[0], slope * gp[1], slope * gp[2],
            slope * gq[0], slope * gq[1], slope * gq[2]);
        own!(out, lane, 7; bp, gp, sq, q, qq);
        own!(out, lane, 13; bq, gq, sp, p, pp);
        put!(out, lane, 19;
            bp[0] * gq[0] + sp[0] * q[0] - pq,
            bp[0] * gq[1] + (2.0 * sp[0]) * q[1] - sq[0] * p[1],
            bp[0] * gq[2] + (2.0 * sp[0]) * q[2] - sq[0] * p[2],
            bp[1] * gq[0] + (2.0 * sp[1]) * q[0] - sq[1] * p[0],
            bp[1] * gq[1] + sp[1] * q[1] - pq,
            bp[1] * gq[2] + (2.0 * sp[1]) * q[2] - sq[1] * p[2],
            bp[2] * gq[0] + (2.0 * sp[2]) * q[0] - sq[2] * p[0],
            bp[2] * gq[1] + (2.0 * sp[2]) * q[1] - sq[2] * p[1],
            bp[2] * gq[2] + sp[2] * q[2] - pq);
    }
}

#[inline(always)]
fn tetrahedron<const N: i32>(x: &[Channel; 19], out: &mut [Channel; 55]) {
    for lane in 0..LANES {
        let (rest_p, rest_q, rest_r) = (at(x, 0, lane), at(x, 3, lane), at(x, 6, lane));
        let (u, v, t) = (at(x, 9, lane), at(x, 12, lane), at(x, 15, lane));
        let (p, q, r) = (add(rest_p, u), add(rest_q, v), add(rest_r, t));
        let (gp, gq, gr) = (cross(q, r), cross(r, p), cross(p, q));
        let (volume, w) = (dot(rest_p, cross(rest_q, rest_r)), x[18][lane]);
        let sign = 1f64.copysign(volume);
        let grown = dot(u, gp) + dot(rest_p, add(cross(rest_q, t), cross(v, r)));
        let [psi, first, second] = law::<N>(grown / volume, sign * volume);
        let (slope, bend) = (w * sign * first, w * second);
        let (bp, bq, br) = (times(bend, gp), times(bend, gq), times(bend, gr));
        put!(out, lane, 0; w * psi, slope * gp[0], slope * gp[1], slope * gp[2],
            slope * gq[0], slope * gq[1], slope * gq[2],
            slope * gr[0], slope * gr[1], slope * gr[2]);
        rank_one!(out, lane, 10; bp, gp);
        rank_one!(out, lane, 16; bq, gq);
        rank_one!(out, lane, 22; br, gr);
        pair!(out, lane, 28; bp, gq, times(slope, r));
        pair!(out, lane, 37; bp, gr, times(-slope, q));
        pair!(out, lane, 46; bq, gr, times(slope, p));
    }
}

/// A kernel over all blocks, measured and checked.
macro_rules! measure {
    ($name:literal, $kernel:expr, $input:ident, $inputs:literal, $gradients:literal, $outputs:literal) => {{
        #[inline(never)]
        fn all(input: &[[Channel; $inputs]], out: &mut [[Channel; $outputs]; RING]) {
            for (block, input) in input.iter().enumerate() {
                $kernel(input, &mut out[block % RING]);
            }
        }
        let input: Vec<[Channel; $inputs]> =
            $input.chunks_exact($inputs).map(|block| block.try_into().unwrap()).collect();
        let mut out = [[[0.0; LANES]; $outputs]; RING];
        let mut sums = [0.0; 3];
        for input in input.chunks_exact(RING) {
            all(input, &mut out);
            for (channel, values) in out.iter().flat_map(|block| block.iter().enumerate()) {
                let kind = if channel == 0 { 0 } else { 1 + usize::from(channel > $gradients) };
                sums[kind] += values.iter().map(|x| x * x).sum::<f64>();
            }
        }
        all(&input, &mut out);
        let mut times: Vec<f64> = (0..SAMPLES)
            .map(|_| {
                let start = Instant::now();
                all(std::hint::black_box(&input), &mut out);
                std::hint::black_box(&out);
                start.elapsed().as_secs_f64() * 1e9 / (BLOCKS * LANES) as f64
            })
            .collect();
        times.sort_by(f64::total_cmp);
        let [energy, gradient, tangent] = sums;
        println!("{} {} {} {energy} {gradient} {tangent}", $name, times[0], times[SAMPLES / 2]);
    }};
}

fn main() {
    let path = std::env::args().nth(1).expect("usage: kernels FILE");
    let bytes = std::fs::read(path).expect("the file can be read");
    let numbers: Vec<f64> =
        bytes.chunks_exact(8).map(|b| f64::from_ne_bytes(b.try_into().unwrap())).collect();
    let channels: Vec<Channel> =
        numbers.chunks_exact(LANES).map(|c| c.try_into().unwrap()).collect();
    let (bonds, rest) = channels.split_at(BLOCKS * 7);
    let (triangles, tetrahedra) = rest.split_at(BLOCKS * 13);
    measure!("bond 1", bond::<1>, bonds, 7, 3, 10);
    measure!("bond 2", bond::<2>, bonds, 7, 3, 10);
    measure!("bond 2.7", bond::<27>, bonds, 7, 3, 10);
    measure!("bond ln", bond::<0>, bonds, 7, 3, 10);
    measure!("triangle 1", triangle::<1>, triangles, 13, 6, 28);
    measure!("triangle 2", triangle::<2>, triangles, 13, 6, 28);
    measure!("triangle 2.7", triangle::<27>, triangles, 13, 6, 28);
    measure!("triangle ln", triangle::<0>, triangles, 13, 6, 28);
    measure!("tetrahedron 1", tetrahedron::<1>, tetrahedra, 19, 9, 55);
    measure!("tetrahedron 2", tetrahedron::<2>, tetrahedra, 19, 9, 55);
    measure!("tetrahedron 2.7", tetrahedron::<27>, tetrahedra, 19, 9, 55);
    measure!("tetrahedron ln", tetrahedron::<0>, tetrahedra, 19, 9, 55);
}
