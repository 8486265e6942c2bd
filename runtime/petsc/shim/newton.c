/* Newton's method, linear systems and their preconditioners: SNES, KSP and PC on one matrix. */
#include "shim.h"

#include <string.h>

struct PiolaNewton {
  PetscInt  n, first, d; /* points of this rank, the first one's number, numbers a point */
  int64_t  *starts;
  PetscInt *columns;
  double   *row; /* room for the widest row */
  Mat       tangent;
  Mat       parts[2]; /* of the tangent, borrowed: columns of own points, and of others; null where unknown */
  Vec       x, r;
  SNES      snes;
  KSP       ksp;
  PetscReal linear_tolerance;
  PetscBool adapts; /* the linear tolerance to the residual, after Eisenstat and Walker */
  /* Of the solve that runs. */
  const PiolaCallbacks *callbacks;
  PetscBool             failed, outside, has_tangent; /* the last one of this rank */
  PetscReal             norm, first_norm;
};

/* Weighs what callbacks of all ranks say; an error where one failed, on every rank. */
static PetscErrorCode hear(PiolaNewton *newton, int32_t own, int32_t *all)
{
  PetscFunctionBegin;
  *all = piola_agree(own);
  if (*all == PIOLA_FAILED) {
    newton->failed = PETSC_TRUE;
    SETERRQ(PETSC_COMM_SELF, PETSC_ERR_USER, "a callback failed");
  }
  PetscFunctionReturn(0);
}

/* Outside of the domain the residual is infinite on all ranks: the line search goes shorter. PETSc's own flag
 * for this stays set when a shorter step is inside again, and would refuse that step too. */
static PetscErrorCode residual(SNES snes, Vec x, Vec r, void *context)
{
  PiolaNewton       *newton = context;
  const PetscScalar *u;
  PetscScalar       *values;
  int32_t            all;
  PetscFunctionBegin;
  (void)snes;
  PetscCall(VecGetArrayRead(x, &u));
  PetscCall(VecGetArrayWrite(r, &values));
  int32_t own = newton->callbacks->residual(newton->callbacks->problem, u, values);
  PetscCall(VecRestoreArrayWrite(r, &values));
  PetscCall(VecRestoreArrayRead(x, &u));
  PetscCall(hear(newton, own, &all));
  newton->outside = all == PIOLA_OUTSIDE ? PETSC_TRUE : PETSC_FALSE;
  if (newton->outside) PetscCall(VecSet(r, PETSC_INFINITY));
  PetscFunctionReturn(0);
}

/* Blocks of a row from the other side; zeros where there is no tangent. */
static inline int32_t fill(PiolaNewton *newton, PetscInt i, double *values)
{
  const size_t count = (size_t)(newton->starts[i + 1] - newton->starts[i]), size = (size_t)(newton->d * newton->d);
  if (!newton->has_tangent) {
    memset(values, 0, count * size * sizeof *values);
    return PIOLA_FINE;
  }
  return newton->callbacks->row(newton->callbacks->problem, i, values, (int64_t)(count * size));
}

static PetscErrorCode insert_slowly(PiolaNewton *newton, int32_t *worst)
{
  PetscFunctionBegin;
  for (PetscInt i = 0; i < newton->n && *worst == PIOLA_FINE; i++) {
    const PetscInt *columns = newton->columns + newton->starts[i];
    const PetscInt  count = (PetscInt)(newton->starts[i + 1] - newton->starts[i]), row = newton->first + i;
    *worst = fill(newton, i, newton->row);
    PetscCall(MatSetValuesBlocked(newton->tangent, 1, &row, count, columns, newton->row, INSERT_VALUES));
  }
  PetscFunctionReturn(0);
}

/* Whether this rank owns the point of a column. */
static inline PetscBool is_own(const PiolaNewton *newton, int64_t k)
{
  const PetscInt place = newton->columns[k] - newton->first;
  return place >= 0 && place < newton->n ? PETSC_TRUE : PETSC_FALSE;
}

/* Whether the rows of a part of the matrix are as long as those of the pattern. */
static PetscErrorCode is_exact(PiolaNewton *newton, Mat part, PetscBool own, PetscBool *exact)
{
  const PetscInt *starts, *columns, d = newton->d;
  PetscInt        n, at           = 0;
  PetscBool       given;
  PetscFunctionBegin;
  PetscCall(MatGetRowIJ(part, 0, PETSC_FALSE, PETSC_FALSE, &n, &starts, &columns, &given));
  *exact = given && n == newton->n * d ? PETSC_TRUE : PETSC_FALSE;
  for (PetscInt i = 0; *exact && i < newton->n; i++) {
    PetscInt count = 0;
    for (int64_t k = newton->starts[i]; k < newton->starts[i + 1]; k++) count += is_own(newton, k) == own;
    for (PetscInt a = 0; a < d; a++, at += count * d)
      if (starts[i * d + a] != at) *exact = PETSC_FALSE;
  }
  PetscCall(MatRestoreRowIJ(part, 0, PETSC_FALSE, PETSC_FALSE, &n, &starts, &columns, &given));
  PetscFunctionReturn(0);
}

/* Finds the compressed rows of the two parts of the matrix, columns of own points and of others, where it is
 * of the type that has them. To search every entry's place takes longer than to compute the tangent. */
static PetscErrorCode find_parts(PiolaNewton *newton)
{
  PetscBool one, two, exact = PETSC_FALSE;
  PetscFunctionBegin;
  PetscCall(PetscObjectTypeCompare((PetscObject)newton->tangent, MATSEQAIJ, &one));
  PetscCall(PetscObjectTypeCompare((PetscObject)newton->tangent, MATMPIAIJ, &two));
  newton->parts[0] = one ? newton->tangent : NULL;
  newton->parts[1] = NULL;
  if (two) PetscCall(MatMPIAIJGetSeqAIJ(newton->tangent, &newton->parts[0], &newton->parts[1], NULL));
  if (newton->parts[0]) PetscCall(is_exact(newton, newton->parts[0], PETSC_TRUE, &exact));
  if (exact && newton->parts[1]) PetscCall(is_exact(newton, newton->parts[1], PETSC_FALSE, &exact));
  if (!exact) newton->parts[0] = newton->parts[1] = NULL;
  PetscFunctionReturn(0);
}

/* Numbers of one row of blocks go to the two parts: those of own points are together in the middle of every
 * line, for columns ascend. `values` are where the row begins in each part, and then where it ends. */
static void split(PiolaNewton *newton, PetscInt i, PetscScalar *values[2])
{
  const size_t d = (size_t)newton->d;
  int64_t      begin = newton->starts[i], end = newton->starts[i + 1];
  const size_t all = (size_t)(end - begin) * d;
  while (!is_own(newton, begin)) begin++;
  while (!is_own(newton, end - 1)) end--;
  const size_t before = (size_t)(begin - newton->starts[i]) * d, own = (size_t)(end - begin) * d, after = all - before - own;
  for (size_t a = 0; a < d; a++) {
    const double *line = newton->row + a * all;
    memcpy(values[0], line + before, own * sizeof *line);
    values[0] += own;
    if (before) memcpy(values[1], line, before * sizeof *line);
    if (after) memcpy(values[1] + before, line + before + own, after * sizeof *line);
    if (all > own) values[1] += all - own;
  }
}

/* Lines of a row follow one another in the compressed rows as they come from the other side. */
static PetscErrorCode insert_directly(PiolaNewton *newton, int32_t *worst)
{
  PetscScalar *values[2] = {NULL, NULL}, *at[2];
  PetscFunctionBegin;
  for (int part = 0; part < 2; part++) {
    if (newton->parts[part]) PetscCall(MatSeqAIJGetArray(newton->parts[part], &values[part]));
    at[part] = values[part];
  }
  for (PetscInt i = 0; i < newton->n && *worst == PIOLA_FINE; i++) {
    *worst = fill(newton, i, newton->parts[1] ? newton->row : at[0]);
    if (newton->parts[1]) split(newton, i, at);
    else at[0] += (newton->starts[i + 1] - newton->starts[i]) * newton->d * newton->d;
  }
  for (int part = 0; part < 2; part++)
    if (newton->parts[part]) PetscCall(MatSeqAIJRestoreArray(newton->parts[part], &values[part]));
  PetscFunctionReturn(0);
}

/* The first time makes the rows, all others write into them. */
static PetscErrorCode insert(PiolaNewton *newton)
{
  int32_t worst = PIOLA_FINE, all;
  PetscFunctionBegin;
  if (newton->parts[0]) PetscCall(insert_directly(newton, &worst));
  else PetscCall(insert_slowly(newton, &worst));
  PetscCall(hear(newton, worst, &all));
  PetscCall(MatAssemblyBegin(newton->tangent, MAT_FINAL_ASSEMBLY));
  PetscCall(MatAssemblyEnd(newton->tangent, MAT_FINAL_ASSEMBLY));
  if (!newton->parts[0]) PetscCall(find_parts(newton));
  PetscFunctionReturn(0);
}

static PetscErrorCode tangent(SNES snes, Vec x, Mat given, Mat preconditioned, void *context)
{
  PiolaNewton       *newton = context;
  const PetscScalar *u;
  int32_t            all;
  PetscFunctionBegin;
  PetscCall(VecGetArrayRead(x, &u));
  int32_t own = newton->callbacks->tangent(newton->callbacks->problem, u);
  PetscCall(VecRestoreArrayRead(x, &u));
  PetscCall(hear(newton, own, &all));
  newton->has_tangent = own == PIOLA_FINE ? PETSC_TRUE : PETSC_FALSE;
  if (all == PIOLA_OUTSIDE) PetscCall(SNESSetJacobianDomainError(snes));
  PetscCall(insert(newton));
  /* Without a matrix (-snes_mf_operator) the first one is a product that PETSc assembles. */
  if (given != preconditioned) {
    PetscCall(MatAssemblyBegin(given, MAT_FINAL_ASSEMBLY));
    PetscCall(MatAssemblyEnd(given, MAT_FINAL_ASSEMBLY));
  }
  PetscFunctionReturn(0);
}

/* Whoever poses the problem says when it is solved; PETSc says when there is no hope. */
static PetscErrorCode converged(SNES snes, PetscInt iteration, PetscReal x, PetscReal step, PetscReal norm, SNESConvergedReason *reason,
                                void *context)
{
  PiolaNewton *newton = context;
  PetscReal    worse;
  int32_t      all;
  PetscFunctionBegin;
  (void)x, (void)step;
  *reason      = SNES_CONVERGED_ITERATING;
  newton->norm = norm;
  if (iteration == 0) newton->first_norm = norm;
  if (PetscIsInfOrNanReal(norm)) {
    *reason = SNES_DIVERGED_FNORM_NAN;
    PetscFunctionReturn(0);
  }
  PetscCall(hear(newton, newton->callbacks->is_converged(newton->callbacks->problem, iteration, norm), &all));
  PetscCall(SNESGetDivergenceTolerance(snes, &worse));
  if (all == PIOLA_FINE) *reason = SNES_CONVERGED_FNORM_ABS;
  else if (iteration > 0 && worse > 0 && norm > worse * newton->first_norm) *reason = SNES_DIVERGED_DTOL;
  PetscFunctionReturn(0);
}

/* Room for the pattern, exactly: an entry outside of it is an error and not a slow insertion. */
static PetscErrorCode make_matrix(PiolaNewton *newton, int64_t all, const int64_t *columns)
{
  const PetscInt n = newton->n, d = newton->d;
  PetscInt       rows, all_rows, entries, *own, *others, widest = 0;
  PetscFunctionBegin;
  PetscCall(piola_narrow((int64_t)n * d, "unknowns of a rank", &rows));
  PetscCall(piola_narrow(all * d, "unknowns", &all_rows));
  PetscCall(piola_narrow(newton->starts[n] * d * d, "entries of the tangent on a rank", &entries));
  PetscCall(PetscMalloc1(newton->starts[n], &newton->columns));
  PetscCall(PetscCalloc2(n, &own, n, &others));
  for (PetscInt i = 0; i < n; i++) {
    for (int64_t k = newton->starts[i]; k < newton->starts[i + 1]; k++) {
      newton->columns[k]   = (PetscInt)columns[k];
      const PetscInt place = newton->columns[k] - newton->first;
      if (place >= 0 && place < n) own[i]++;
      else others[i]++;
    }
    widest = PetscMax(widest, own[i] + others[i]);
  }
  PetscCall(PetscCalloc1(d * d * widest, &newton->row));
  PetscCall(MatCreate(PETSC_COMM_WORLD, &newton->tangent));
  PetscCall(MatSetSizes(newton->tangent, rows, rows, all_rows, all_rows));
  PetscCall(MatSetBlockSize(newton->tangent, d));
  PetscCall(MatSetType(newton->tangent, MATAIJ));
  PetscCall(MatSetFromOptions(newton->tangent));
  PetscCall(MatXAIJSetPreallocation(newton->tangent, d, own, others, NULL, NULL));
  PetscCall(MatSetOption(newton->tangent, MAT_NEW_NONZERO_ALLOCATION_ERR, PETSC_TRUE));
  PetscCall(MatSetOption(newton->tangent, MAT_NO_OFF_PROC_ENTRIES, PETSC_TRUE));
  PetscCall(PetscFree2(own, others));
  PetscFunctionReturn(0);
}

/* Orthonormal over all ranks, twice as once leaves what rounding makes of nearly parallel ones; what depends
 * on earlier ones is left out. */
static PetscErrorCode set_modes(PiolaNewton *newton, int32_t n_modes, const double *const *modes)
{
  Vec         *vectors;
  MatNullSpace space;
  PetscInt     kept = 0;
  PetscFunctionBegin;
  if (n_modes == 0) PetscFunctionReturn(0);
  PetscCall(VecDuplicateVecs(newton->x, n_modes, &vectors));
  for (int32_t mode = 0; mode < n_modes; mode++) {
    Vec          vector = vectors[kept];
    PetscScalar *values;
    PetscReal    before, after;
    PetscCall(VecGetArrayWrite(vector, &values));
    PetscCall(PetscArraycpy(values, modes[mode], newton->n * newton->d));
    PetscCall(VecRestoreArrayWrite(vector, &values));
    PetscCall(VecNorm(vector, NORM_2, &before));
    for (PetscInt k = 0; k < 2 * kept; k++) {
      PetscScalar along;
      PetscCall(VecDot(vector, vectors[k % kept], &along));
      PetscCall(VecAXPY(vector, -along, vectors[k % kept]));
    }
    PetscCall(VecNorm(vector, NORM_2, &after));
    if (!(after > 1e-10 * before)) continue;
    PetscCall(VecScale(vector, 1 / after));
    kept++;
  }
  if (kept > 0) {
    PetscCall(MatNullSpaceCreate(PETSC_COMM_WORLD, PETSC_FALSE, kept, vectors, &space));
    PetscCall(MatSetNearNullSpace(newton->tangent, space));
    PetscCall(MatNullSpaceDestroy(&space));
  }
  PetscCall(VecDestroyVecs(n_modes, &vectors));
  PetscFunctionReturn(0);
}

/* What converges without options; the user's come last. A linear tolerance that follows the residual
 * (-snes_ksp_ew) saves a third of the linear steps and takes two steps of Newton's method more: with as many
 * neighbours as peridynamics has, to set up multigrid for a step takes longer than to apply it. */
static PetscErrorCode set_defaults(PiolaNewton *newton)
{
  SNESLineSearch search;
  PC             pc;
  PetscBool      given;
  PetscFunctionBegin;
  PetscCall(SNESSetType(newton->snes, SNESNEWTONLS));
  PetscCall(SNESGetLineSearch(newton->snes, &search));
  PetscCall(SNESLineSearchSetType(search, SNESLINESEARCHBT));
  PetscCall(SNESSetCheckJacobianDomainError(newton->snes, PETSC_TRUE));
  PetscCall(SNESSetTolerances(newton->snes, 0, 0, 0, 50, 100000));
  PetscCall(SNESGetKSP(newton->snes, &newton->ksp));
  PetscCall(KSPSetType(newton->ksp, KSPFGMRES));
  PetscCall(KSPSetTolerances(newton->ksp, 1e-8, 1e-50, 1e5, 2000));
  PetscCall(KSPGetPC(newton->ksp, &pc));
  PetscCall(PCSetType(pc, PCGAMG));
  PetscCall(SNESSetFromOptions(newton->snes));
  /* A restart belongs to the method, and is lost where the user takes another one of the kind. */
  PetscCall(PetscOptionsHasName(NULL, NULL, "-ksp_gmres_restart", &given));
  if (!given) PetscCall(KSPGMRESSetRestart(newton->ksp, 100));
  PetscCall(KSPGetTolerances(newton->ksp, &newton->linear_tolerance, NULL, NULL, NULL));
  PetscCall(SNESKSPGetUseEW(newton->snes, &newton->adapts));
  PetscFunctionReturn(0);
}

static PetscErrorCode make_solver(PiolaNewton *newton)
{
  PetscFunctionBegin;
  PetscCall(SNESCreate(PETSC_COMM_WORLD, &newton->snes));
  PetscCall(SNESSetFunction(newton->snes, newton->r, residual, newton));
  PetscCall(SNESSetJacobian(newton->snes, newton->tangent, newton->tangent, tangent, newton));
  PetscCall(SNESSetConvergenceTest(newton->snes, converged, newton, NULL));
  PetscCall(set_defaults(newton));
  PetscFunctionReturn(0);
}

static PetscErrorCode fill_in(PiolaNewton *newton, int64_t own, int64_t first, int64_t all, int32_t d, const int64_t *starts,
                              const int64_t *columns, int32_t n_modes, const double *const *modes)
{
  PetscFunctionBegin;
  PetscCall(piola_narrow(own, "points of a rank", &newton->n));
  PetscCall(piola_narrow(first, "the first point of a rank", &newton->first));
  newton->d = d;
  PetscCall(PetscMalloc1(own + 1, &newton->starts));
  PetscCall(PetscArraycpy(newton->starts, starts, own + 1));
  PetscCall(make_matrix(newton, all, columns));
  PetscCall(MatCreateVecs(newton->tangent, &newton->x, &newton->r));
  PetscCall(set_modes(newton, n_modes, modes));
  PetscCall(make_solver(newton));
  PetscFunctionReturn(0);
}

int piola_newton_new(int64_t own, int64_t first, int64_t all, int32_t d, const int64_t *starts, const int64_t *columns, int32_t n_modes,
                     const double *const *modes, PiolaNewton **made)
{
  PiolaNewton *newton;
  PetscFunctionBegin;
  *made = NULL;
  PetscCall(PetscNew(&newton));
  PetscErrorCode code = fill_in(newton, own, first, all, d, starts, columns, n_modes, modes);
  if (code) piola_newton_free(newton);
  else *made = newton;
  PetscFunctionReturn(code);
}

static PetscErrorCode copy_in(PiolaNewton *newton, Vec vector, const double *values)
{
  PetscScalar *inside;
  PetscFunctionBegin;
  PetscCall(VecGetArrayWrite(vector, &inside));
  PetscCall(PetscArraycpy(inside, values, newton->n * newton->d));
  PetscCall(VecRestoreArrayWrite(vector, &inside));
  PetscFunctionReturn(0);
}

static PetscErrorCode copy_out(PiolaNewton *newton, Vec vector, double *values)
{
  const PetscScalar *inside;
  PetscFunctionBegin;
  PetscCall(VecGetArrayRead(vector, &inside));
  PetscCall(PetscArraycpy(values, inside, newton->n * newton->d));
  PetscCall(VecRestoreArrayRead(vector, &inside));
  PetscFunctionReturn(0);
}

/* The name of a reason is one of PETSc's table, from the least negative number on. */
static const char *linear_reason(KSP ksp)
{
  KSPConvergedReason reason;
  return KSPGetConvergedReason(ksp, &reason) ? NULL : KSPConvergedReasons[reason];
}

static void begin(PiolaNewton *newton, const PiolaCallbacks *callbacks)
{
  newton->callbacks = callbacks;
  newton->failed = newton->outside = PETSC_FALSE;
  newton->norm                     = PETSC_INFINITY;
  newton->has_tangent              = PETSC_TRUE;
}

int piola_newton_solve(PiolaNewton *newton, const PiolaCallbacks *callbacks, double *u, PiolaOutcome *outcome)
{
  SNESConvergedReason reason;
  PetscInt            iterations, linear_iterations;
  PetscFunctionBegin;
  begin(newton, callbacks);
  PetscCall(copy_in(newton, newton->x, u));
  PetscErrorCode code = SNESSolve(newton->snes, NULL, newton->x);
  newton->callbacks   = NULL;
  if (newton->failed) PetscFunctionReturn(PIOLA_CALLBACK_FAILED);
  PetscCall(code);
  PetscCall(copy_out(newton, newton->x, u));
  PetscCall(SNESGetConvergedReason(newton->snes, &reason));
  PetscCall(SNESGetIterationNumber(newton->snes, &iterations));
  PetscCall(SNESGetLinearSolveIterations(newton->snes, &linear_iterations));
  if (reason == SNES_DIVERGED_FNORM_NAN && newton->outside) reason = SNES_DIVERGED_FUNCTION_DOMAIN;
  *outcome = (PiolaOutcome){reason > 0,           iterations, linear_iterations, newton->norm, SNESConvergedReasons[reason],
                            reason == SNES_DIVERGED_LINEAR_SOLVE ? linear_reason(newton->ksp) : NULL};
  /* Nothing takes this flag of PETSc back: a solver that has it refuses every tangent from then on. */
  if (reason == SNES_DIVERGED_JACOBIAN_DOMAIN) {
    PetscCall(SNESDestroy(&newton->snes));
    PetscCall(make_solver(newton));
  }
  PetscFunctionReturn(0);
}

/* By the user's own tolerance, which Newton's method may have changed for its last step. */
static PetscErrorCode solve_linear(PiolaNewton *newton)
{
  PetscReal absolute, worse;
  PetscInt  most;
  PetscFunctionBegin;
  PetscCall(SNESKSPSetUseEW(newton->snes, PETSC_FALSE));
  PetscCall(KSPGetTolerances(newton->ksp, NULL, &absolute, &worse, &most));
  PetscCall(KSPSetTolerances(newton->ksp, newton->linear_tolerance, absolute, worse, most));
  PetscCall(KSPSetOperators(newton->ksp, newton->tangent, newton->tangent));
  PetscCall(KSPSolve(newton->ksp, newton->r, newton->x));
  PetscCall(SNESKSPSetUseEW(newton->snes, newton->adapts));
  PetscFunctionReturn(0);
}

int piola_newton_solve_linear(PiolaNewton *newton, const PiolaCallbacks *callbacks, const double *right, double *x,
                              PiolaOutcome *outcome)
{
  KSPConvergedReason reason;
  PetscInt           iterations;
  PetscReal          norm;
  PetscFunctionBegin;
  begin(newton, callbacks);
  PetscErrorCode code = insert(newton);
  newton->callbacks   = NULL;
  if (newton->failed) PetscFunctionReturn(PIOLA_CALLBACK_FAILED);
  PetscCall(code);
  PetscCall(copy_in(newton, newton->r, right));
  PetscCall(solve_linear(newton));
  PetscCall(copy_out(newton, newton->x, x));
  PetscCall(KSPGetConvergedReason(newton->ksp, &reason));
  PetscCall(KSPGetIterationNumber(newton->ksp, &iterations));
  PetscCall(KSPGetResidualNorm(newton->ksp, &norm));
  *outcome = (PiolaOutcome){reason > 0, 0, iterations, norm, KSPConvergedReasons[reason], NULL};
  PetscFunctionReturn(0);
}

void piola_newton_free(PiolaNewton *newton)
{
  if (!newton) return;
  /* Errors here have nobody who could act on them. */
  (void)SNESDestroy(&newton->snes);
  (void)MatDestroy(&newton->tangent);
  (void)VecDestroy(&newton->x);
  (void)VecDestroy(&newton->r);
  (void)PetscFree(newton->starts);
  (void)PetscFree(newton->columns);
  (void)PetscFree(newton->row);
  (void)PetscFree(newton);
}
