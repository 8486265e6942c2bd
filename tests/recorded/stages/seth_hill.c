/* seth_hill: energies and their derivatives over arrays. Compile without contraction of a*b + c. */
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
static inline double piola_log1pmx(double x) {
  if (fabs(x) >= 0.3 || isnan(x)) return log1p(x) - x;
  const double r = x / (2.0 + x), square = r * r;
  double sum = 0.0;
  for (int k = 11; k >= 1; k--) sum = square * (sum + 1.0 / (2 * k + 1));
  return r * (2.0 * sum - x);
}

void seth_hill_l(size_t n, const double *measure, const double *reference,
    const double *change, double *psi, double *dpsi, double *d2psi) {
  for (size_t i = 0; i < n; i++) {
    const double t0 = 1.0;
    const double t1 = 0.5;
    const double t2 = reference[i];
    const double t3 = measure[i];
    const double t4 = t3 / t2;
    const double t5 = t4 * t4;
    const double t6 = 2.0;
    const double t7 = 1.5;
    const double t8 = t7 * t5;
    const double t9 = -0.5;
    const double t10 = t9 + t8;
    const double t11 = t6 * t10;
    const double t12 = t11 / t2;
    const double t13 = change[i];
    const double t14 = t0 + t4;
    const double t15 = t13 * t14;
    const double t16 = t1 * t15;
    const double t17 = t16 * t16;
    const double t18 = t2 * t17;
    const double t19 = t4 * t15;
    psi[i] = t18;
    dpsi[i] = t19;
    d2psi[i] = t12;
  }
}

void seth_hill_a(size_t n, const double *measure, const double *reference,
    const double *change, double *psi, double *dpsi, double *d2psi) {
  for (size_t i = 0; i < n; i++) {
    const double t0 = 1.0;
    const double t1 = 0.5;
    const double t2 = 20.0;
    const double t3 = reference[i];
    const double t4 = t2 * t3;
    const double t5 = measure[i];
    const double t6 = t5 / t3;
    const double t7 = t6 * t6;
    const double t8 = 40.0;
    const double t9 = 1.5;
    const double t10 = t9 * t7;
    const double t11 = -0.5;
    const double t12 = t11 + t10;
    const double t13 = t8 * t12;
    const double t14 = t13 / t3;
    const double t15 = change[i];
    const double t16 = t0 + t6;
    const double t17 = t15 * t16;
    const double t18 = t1 * t17;
    const double t19 = t18 * t18;
    const double t20 = t4 * t19;
    const double t21 = t6 * t17;
    const double t22 = t2 * t21;
    psi[i] = t20;
    dpsi[i] = t22;
    d2psi[i] = t14;
  }
}
