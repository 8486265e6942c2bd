/* Kernels as an expert would write them in C: energy, compact gradient and tangent of the Seth-Hill
 * energy C/2 M S(m/M)^2 with C = 1, in forms that keep their digits (strains from displacements,
 * log1p and expm1), without guards against thin or inverted interactions.
 *
 * Usage: kernels FILE. The file holds for bonds, triangles and tetrahedra, one after the other, 128
 * blocks of 8 interactions: relative positions, relative displacements, weights, each channel 8
 * doubles. Results go to a ring of 4 blocks, as an assembly takes them batch by batch: what it has
 * added up it needs no more. One line of output per kernel: its name, the least and the median time
 * in ns per interaction, the sums of squares of energies, gradients and tangents.
 */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define LANES 8
#define BLOCKS 128
#define RING 4
#define SAMPLES 61
#define INLINE static inline __attribute__((always_inline))

typedef double channel[LANES];
typedef struct { double x, y, z; } vector;

INLINE vector add(vector p, vector q) { return (vector){p.x + q.x, p.y + q.y, p.z + q.z}; }
INLINE vector times(double f, vector p) { return (vector){f * p.x, f * p.y, f * p.z}; }
INLINE double dot(vector p, vector q) { return p.x * q.x + p.y * q.y + p.z * q.z; }
INLINE vector cross(vector p, vector q) {
    return (vector){p.y * q.z - p.z * q.y, p.z * q.x - p.x * q.z, p.x * q.y - p.y * q.x};
}
INLINE vector at(const channel *in, int lane) {
    return (vector){in[0][lane], in[1][lane], in[2][lane]};
}

/* psi, psi', psi'' from the relative change e and the reference M; n = 27 means 2.7, 0 means ln. */
INLINE void law(int n, double e, double M, double *psi, double *first, double *second) {
    double x = 1.0 + e, S, d1, d2; /* S, M dS/dm, M^2 d2(S^2/2)/dm2 */
    if (n == 1) {
        S = e;
        d1 = 1.0;
        d2 = 1.0;
    } else if (n == 2) {
        S = e * (1.0 + 0.5 * e);
        d1 = x;
        d2 = x * x + S;
    } else if (n == 27) {
        S = expm1(2.7 * log1p(e)) * (1.0 / 2.7);
        double inverse = 1.0 / x;
        d1 = (1.0 + 2.7 * S) * inverse;
        d2 = d1 * d1 + 1.7 * S * d1 * inverse;
    } else {
        double inverse = 1.0 / x;
        S = log1p(e);
        d1 = inverse;
        d2 = inverse * inverse * (1.0 - S);
    }
    *psi = 0.5 * M * S * S;
    *first = S * d1;
    *second = d2 / M;
}

/* The upper triangle of b g - s x + square I. */
INLINE void own(channel *out, int lane, vector b, vector g, vector s, vector x, double square) {
    out[0][lane] = b.x * g.x - s.x * x.x + square;
    out[1][lane] = b.x * g.y - s.x * x.y;
    out[2][lane] = b.x * g.z - s.x * x.z;
    out[3][lane] = b.y * g.y - s.y * x.y + square;
    out[4][lane] = b.y * g.z - s.y * x.z;
    out[5][lane] = b.z * g.z - s.z * x.z + square;
}

/* The upper triangle of b g. */
INLINE void rank_one(channel *out, int lane, vector b, vector g) {
    out[0][lane] = b.x * g.x;
    out[1][lane] = b.x * g.y;
    out[2][lane] = b.x * g.z;
    out[3][lane] = b.y * g.y;
    out[4][lane] = b.y * g.z;
    out[5][lane] = b.z * g.z;
}

/* b g and the cross product with t. */
INLINE void pair(channel *out, int lane, vector b, vector g, vector t) {
    out[0][lane] = b.x * g.x;
    out[1][lane] = b.x * g.y + t.z;
    out[2][lane] = b.x * g.z - t.y;
    out[3][lane] = b.y * g.x - t.z;
    out[4][lane] = b.y * g.y;
    out[5][lane] = b.y * g.z + t.x;
    out[6][lane] = b.z * g.x + t.y;
    out[7][lane] = b.z * g.y - t.x;
    out[8][lane] = b.z * g.z;
}

INLINE void put(channel *out, int lane, vector p) {
    out[0][lane] = p.x;
    out[1][lane] = p.y;
    out[2][lane] = p.z;
}

INLINE void bond(int n, const channel *restrict in, channel *restrict out) {
    for (int lane = 0; lane < LANES; lane++) {
        vector rest = at(in, lane), eta = at(in + 3, lane), p = add(rest, eta);
        double L = sqrt(dot(rest, rest)), l = sqrt(dot(p, p));
        double e = dot(eta, add(rest, p)) / (L * (l + L)), w = in[6][lane];
        double psi, first, second, inverse = 1.0 / l;
        law(n, e, L, &psi, &first, &second);
        double slope = w * first * inverse;
        double bend = (w * second - slope) * inverse * inverse;
        vector b = times(bend, p);
        out[0][lane] = w * psi;
        put(out + 1, lane, times(slope, p));
        own(out + 4, lane, b, p, (vector){0, 0, 0}, p, slope);
    }
}

INLINE void triangle(int n, const channel *restrict in, channel *restrict out) {
    for (int lane = 0; lane < LANES; lane++) {
        vector P = at(in, lane), Q = at(in + 3, lane), u = at(in + 6, lane), v = at(in + 9, lane);
        vector p = add(P, u), q = add(Q, v), N = cross(P, Q), c = cross(p, q);
        vector grown = add(cross(P, v), cross(u, q));
        double A = sqrt(dot(N, N)), a = sqrt(dot(c, c)), w = in[12][lane];
        double e = dot(grown, add(N, c)) / (A * (a + A));
        double psi, first, second, inverse = 1.0 / a;
        law(n, e, A, &psi, &first, &second);
        double slope = w * first * inverse;
        double bend = (w * second - slope) * inverse * inverse;
        vector gp = cross(q, c), gq = cross(c, p), bp = times(bend, gp), bq = times(bend, gq);
        vector sp = times(slope, p), sq = times(slope, q);
        double pp = dot(sp, p), qq = dot(sq, q), pq = dot(sp, q);
        out[0][lane] = w * psi;
        put(out + 1, lane, times(slope, gp));
        put(out + 4, lane, times(slope, gq));
        own(out + 7, lane, bp, gp, sq, q, qq);
        own(out + 13, lane, bq, gq, sp, p, pp);
        channel *mixed = out + 19;
        mixed[0][lane] = bp.x * gq.x + sp.x * q.x - pq;
        mixed[1][lane] = bp.x * gq.y + (2.0 * sp.x) * q.y - sq.x * p.y;
        mixed[2][lane] = bp.x * gq.z + (2.0 * sp.x) * q.z - sq.x * p.z;
        mixed[3][lane] = bp.y * gq.x + (2.0 * sp.y) * q.x - sq.y * p.x;
        mixed[4][lane] = bp.y * gq.y + sp.y * q.y - pq;
        mixed[5][lane] = bp.y * gq.z + (2.0 * sp.y) * q.z - sq.y * p.z;
        mixed[6][lane] = bp.z * gq.x + (2.0 * sp.z) * q.x - sq.z * p.x;
        mixed[7][lane] = bp.z * gq.y + (2.0 * sp.z) * q.y - sq.z * p.y;
        mixed[8][lane] = bp.z * gq.z + sp.z * q.z - pq;
    }
}

INLINE void tetrahedron(int n, const channel *restrict in, channel *restrict out) {
    for (int lane = 0; lane < LANES; lane++) {
        vector P = at(in, lane), Q = at(in + 3, lane), R = at(in + 6, lane);
        vector u = at(in + 9, lane), v = at(in + 12, lane), t = at(in + 15, lane);
        vector p = add(P, u), q = add(Q, v), r = add(R, t);
        vector gp = cross(q, r), gq = cross(r, p), gr = cross(p, q);
        double V = dot(P, cross(Q, R)), w = in[18][lane], sign = copysign(1.0, V);
        double grown = dot(u, gp) + dot(P, add(cross(Q, t), cross(v, r)));
        double psi, first, second;
        law(n, grown / V, sign * V, &psi, &first, &second);
        double slope = w * sign * first, bend = w * second;
        vector bp = times(bend, gp), bq = times(bend, gq), br = times(bend, gr);
        out[0][lane] = w * psi;
        put(out + 1, lane, times(slope, gp));
        put(out + 4, lane, times(slope, gq));
        put(out + 7, lane, times(slope, gr));
        rank_one(out + 10, lane, bp, gp);
        rank_one(out + 16, lane, bq, gq);
        rank_one(out + 22, lane, br, gr);
        pair(out + 28, lane, bp, gq, times(slope, r));
        pair(out + 37, lane, bp, gr, times(-slope, q));
        pair(out + 46, lane, bq, gr, times(slope, p));
    }
}

#define KERNEL(shape, n, inputs, outputs)                                                  \
    static __attribute__((noinline)) void shape##_##n(const channel *in, channel *out,     \
                                                      int blocks) {                        \
        for (int block = 0; block < blocks; block++)                                       \
            shape(n, in + block * inputs, out + block % RING * outputs);                   \
    }
#define SHAPE(shape, inputs, outputs)                                                      \
    KERNEL(shape, 1, inputs, outputs)                                                      \
    KERNEL(shape, 2, inputs, outputs)                                                      \
    KERNEL(shape, 27, inputs, outputs)                                                     \
    KERNEL(shape, 0, inputs, outputs)
SHAPE(bond, 7, 10)
SHAPE(triangle, 13, 28)
SHAPE(tetrahedron, 19, 55)

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1e9 + t.tv_nsec;
}

static int ascending(const void *p, const void *q) {
    double x = *(const double *)p, y = *(const double *)q;
    return (x > y) - (x < y);
}

typedef void kernel(const channel *in, channel *out, int blocks);

/* Sums of squares of what a kernel returns, a ring of it at a time. */
static void square(kernel *kernel, const channel *in, channel *out, int inputs, int gradients,
                   int outputs, double *sums) {
    for (int first = 0; first < BLOCKS; first += RING) {
        kernel(in + first * inputs, out, RING);
        for (int block = 0; block < RING; block++)
            for (int c = 0; c < outputs; c++)
                for (int lane = 0; lane < LANES; lane++) {
                    double x = out[block * outputs + c][lane];
                    sums[c == 0 ? 0 : c <= gradients ? 1 : 2] += x * x;
                }
    }
}

static void measure(const char *name, kernel *kernel, const channel *in, int inputs,
                    int gradients, int outputs) {
    static channel out[RING * 55];
    double times[SAMPLES], sums[3] = {0, 0, 0};
    square(kernel, in, out, inputs, gradients, outputs, sums);
    kernel(in, out, BLOCKS);
    for (int sample = 0; sample < SAMPLES; sample++) {
        double start = now();
        kernel(in, out, BLOCKS);
        times[sample] = (now() - start) / (BLOCKS * LANES);
    }
    qsort(times, SAMPLES, sizeof times[0], ascending);
    printf("%s %.6g %.6g %.17g %.17g %.17g\n", name, times[0], times[SAMPLES / 2], sums[0],
           sums[1], sums[2]);
}

int main(int count, char **arguments) {
    static channel in[BLOCKS * (7 + 13 + 19)];
    FILE *file = count == 2 ? fopen(arguments[1], "rb") : NULL;
    if (!file || fread(in, sizeof in, 1, file) != 1) return 2;
    const channel *triangles = in + BLOCKS * 7, *tetrahedra = triangles + BLOCKS * 13;
    measure("bond 1", bond_1, in, 7, 3, 10);
    measure("bond 2", bond_2, in, 7, 3, 10);
    measure("bond 2.7", bond_27, in, 7, 3, 10);
    measure("bond ln", bond_0, in, 7, 3, 10);
    measure("triangle 1", triangle_1, triangles, 13, 6, 28);
    measure("triangle 2", triangle_2, triangles, 13, 6, 28);
    measure("triangle 2.7", triangle_27, triangles, 13, 6, 28);
    measure("triangle ln", triangle_0, triangles, 13, 6, 28);
    measure("tetrahedron 1", tetrahedron_1, tetrahedra, 19, 9, 55);
    measure("tetrahedron 2", tetrahedron_2, tetrahedra, 19, 9, 55);
    measure("tetrahedron 2.7", tetrahedron_27, tetrahedra, 19, 9, 55);
    measure("tetrahedron ln", tetrahedron_0, tetrahedra, 19, 9, 55);
    return 0;
}
