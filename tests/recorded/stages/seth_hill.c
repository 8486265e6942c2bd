/* seth_hill: psi, psi' and psi'' over arrays. Compile without contraction of a*b + c. */
#include <math.h>
#include <stddef.h>

static inline double piola_min(double x, double y) {
  if (isnan(x) || isnan(y)) return NAN;
  return x < y || (x == y && signbit(x)) ? x : y;
}
static inline double piola_max(double x, double y) {
  if (isnan(x) || isnan(y)) return NAN;
  return x > y || (x == y && signbit(y)) ? x : y;
}
static inline double piola_sign(double x) { return x > 0 ? 1.0 : x < 0 ? -1.0 : x; }

void seth_hill_l(size_t n, const double *measure, const double *reference,
    const double *change, double *psi, double *dpsi, double *d2psi) {
  for (size_t i = 0; i < n; i++) {
    const double t0 = 1.0;
    const double t1 = 2.0;
    const double t2 = 0.5;
    const double t3 = reference[i];
    const double t4 = measure[i];
    const double t5 = t4 / t3;
    const double t6 = t5 * t5;
    const double t7 = t6 - t0;
    const double t8 = t2 * t7;
    const double t9 = t8 * t8;
    const double t10 = t3 * t9;
    const double t11 = t1 * t5;
    const double t12 = t5 * t7;
    const double t13 = t7 / t3;
    const double t14 = t5 * t11;
    const double t15 = t14 / t3;
    const double t16 = t13 + t15;
    psi[i] = t10;
    dpsi[i] = t12;
    d2psi[i] = t16;
  }
}

void seth_hill_a(size_t n, const double *measure, const double *reference,
    const double *change, double *psi, double *dpsi, double *d2psi) {
  for (size_t i = 0; i < n; i++) {
    const double t0 = 1.0;
    const double t1 = 2.0;
    const double t2 = 0.5;
    const double t3 = 20.0;
    const double t4 = reference[i];
    const double t5 = t3 * t4;
    const double t6 = measure[i];
    const double t7 = t6 / t4;
    const double t8 = t7 * t7;
    const double t9 = t8 - t0;
    const double t10 = t2 * t9;
    const double t11 = t10 * t10;
    const double t12 = t5 * t11;
    const double t13 = t1 * t7;
    const double t14 = t7 * t9;
    const double t15 = t3 * t14;
    const double t16 = t9 / t4;
    const double t17 = t7 * t13;
    const double t18 = t17 / t4;
    const double t19 = t16 + t18;
    const double t20 = t3 * t19;
    psi[i] = t12;
    dpsi[i] = t15;
    d2psi[i] = t20;
  }
}
