
#ifndef PIOLA_AXES
#define PIOLA_AXES
/* Principal stretches s, s - 1 and principal axes after and before deformation, F = sum_i s_i n_i N_i,
   of the place at x: F, or near rest F - I; component k stands at x[k * n]. */
static double piola_dot(int d, const double *x, const double *y, int step) {
  double sum = x[0] * y[0];
  for (int k = 1; k < d; k++) sum += x[k * step] * y[k * step];
  return sum;
}
static void piola_turn(int d, double c, double s, double *x, double *y, int step) {
  for (int k = 0; k < d; k++) {
    const double before = x[k * step];
    x[k * step] = c * before - s * y[k * step];
    y[k * step] = s * before + c * y[k * step];
  }
}
static void piola_complete(int d, const double *stretches, double *left) {
  for (int i = 0; i < d; i++) {
    double longest = 0.0, best[3] = {0.0, 0.0, 0.0};
    if (stretches[i] != 0.0) continue;
    for (int unit = 0; unit < d; unit++) {
      double candidate[3] = {0.0, 0.0, 0.0}, square = 0.0;
      candidate[unit] = 1.0;
      for (int j = 0; j < d; j++) {
        if (j >= i && stretches[j] == 0.0) continue;
        for (int a = 0; a < d; a++) candidate[a] -= left[3 * j + unit] * left[3 * j + a];
      }
      for (int a = 0; a < d; a++) square += candidate[a] * candidate[a];
      if (sqrt(square) > longest) {
        longest = sqrt(square);
        for (int a = 0; a < d; a++) best[a] = candidate[a];
      }
    }
    for (int a = 0; a < d; a++) left[3 * i + a] = best[a] / longest;
  }
}
static void piola_axes(int d, int near, const double *x, size_t n, double *axes) {
  double tensor[9] = {0.0}, left[9] = {0.0}, right[9] = {0.0}, stretches[3], changes[3];
  double largest = 0.0, scale = 1.0;
  for (int i = 0; i < d; i++) right[4 * i] = 1.0;
  /* C - I, or the columns of F as rows. */
  for (int i = 0; i < d; i++) {
    for (int j = 0; j < d; j++) {
      if (near) {
        double product = 0.0;
        for (int r = 0; r < d; r++) product += x[(r * d + i) * n] * x[(r * d + j) * n];
        tensor[3 * i + j] = (x[(i * d + j) * n] + x[(j * d + i) * n]) + product;
      } else {
        tensor[3 * i + j] = x[(j * d + i) * n];
      }
      largest = fmax(largest, fabs(tensor[3 * i + j]));
    }
  }
  if (!near && isnormal(largest)) scale = ldexp(1.0, ilogb(largest));
  for (int k = 0; k < 9; k++) tensor[k] /= scale;
  for (int sweep = 0, turned = 1; sweep < 30 && turned; sweep++) {
    turned = 0;
    for (int p = 0; p < d; p++) {
      for (int q = p + 1; q < d; q++) {
        double *rows = tensor + 3 * p, *others = tensor + 3 * q;
        const double product = near ? rows[q] : piola_dot(d, rows, others, 1);
        const double first = near ? rows[p] : piola_dot(d, rows, rows, 1);
        const double second = near ? others[q] : piola_dot(d, others, others, 1);
        const double size = near ? largest : sqrt(first) * sqrt(second);
        if (!(fabs(product) > 0x1p-52 * size)) continue;
        const double cotangent = (second - first) / (2.0 * product);
        const double length = fabs(cotangent) + sqrt(1.0 + cotangent * cotangent);
        const double tangent = copysign(1.0 / length, cotangent);
        const double c = 1.0 / sqrt(1.0 + tangent * tangent), s = c * tangent;
        piola_turn(d, c, s, rows, others, 1);
        if (near) piola_turn(d, c, s, tensor + p, tensor + q, 3);
        piola_turn(d, c, s, right + 3 * p, right + 3 * q, 1);
        turned = 1;
      }
    }
  }
  for (int i = 0; i < d; i++) {
    double *axis = left + 3 * i;
    if (near) {
      const double square = tensor[4 * i];
      changes[i] = square / (1.0 + sqrt(1.0 + square));
      stretches[i] = 1.0 + changes[i];
      for (int a = 0; a < d; a++) {
        double moved = 0.0;
        for (int b = 0; b < d; b++) moved += x[(a * d + b) * n] * right[3 * i + b];
        axis[a] = right[3 * i + a] + moved;
      }
    } else {
      for (int a = 0; a < d; a++) axis[a] = tensor[3 * i + a];
    }
    const double square = piola_dot(d, axis, axis, 1);
    double length = sqrt(square);
    if (!near && square < 1e-280) {
      length = 0.0;
      for (int a = 0; a < d; a++) length = hypot(length, axis[a]);
    }
    for (int a = 0; a < d; a++) axis[a] /= length;
    if (!near) {
      stretches[i] = length * scale;
      changes[i] = stretches[i] - 1.0;
    }
  }
  if (!near) piola_complete(d, stretches, left);
  for (int i = 0; i < d; i++) {
    axes[i] = stretches[i];
    axes[d + i] = changes[i];
    for (int a = 0; a < d; a++) {
      axes[2 * d + i * d + a] = left[3 * i + a];
      axes[2 * d + d * d + i * d + a] = right[3 * i + a];
    }
  }
}
#endif
