/* What Rust sees of PETSc: numbers, pointers to numbers, and opaque structures.
 *
 * Every function that returns int returns 0, or a code of an error whose text piola_message() has. The
 * types of MPI and PETSc stay on this side: their sizes depend on how they were built.
 */
#ifndef PIOLA_SHIM_H
#define PIOLA_SHIM_H

#include <petscsf.h>
#include <petscsnes.h>
#include <stdint.h>

#if defined(PETSC_USE_COMPLEX)
#error "this PETSc was built for complex numbers; piola needs one for real numbers (petsc-dev, not petsc-complex-dev)"
#endif
_Static_assert(sizeof(PetscScalar) == sizeof(double), "piola needs a PETSc of double precision");
_Static_assert((PetscScalar)0.5 == 0.5, "piola needs a PETSc of floating point numbers");

/* Codes that callbacks return, in the order of their weight: over all ranks the greatest counts. */
enum { PIOLA_FINE = 0, PIOLA_OUTSIDE = 1, PIOLA_FAILED = 2 };
/* The error of a solve that a callback ended: Rust has the reason. No code of PETSc is negative. */
enum { PIOLA_CALLBACK_FAILED = -1 };

typedef struct PiolaHalo PiolaHalo;
typedef struct PiolaNewton PiolaNewton;

/* The problem of Rust's side, for the duration of one solve. */
typedef struct {
  void *problem;
  int32_t (*residual)(void *problem, const double *u, double *r);
  int32_t (*tangent)(void *problem, const double *u);
  /* Blocks of one row of the last tangent, `n` numbers in `d` lines of the matrix. */
  int32_t (*row)(void *problem, int64_t row, double *values, int64_t n);
  int32_t (*is_converged)(void *problem, int64_t iteration, double norm);
} PiolaCallbacks;

/* How a solve ended; names are PETSc's own and live as long as the program. */
typedef struct {
  int32_t     converged;
  int64_t     iterations;
  int64_t     linear_iterations;
  double      residual;
  const char *reason;
  const char *linear_reason; /* where the linear solver is why, else null */
} PiolaOutcome;

const char *piola_message(void);
int         piola_start(int32_t argc, char **argv);
int         piola_finalise(void);
int32_t     piola_rank(void);
int32_t     piola_ranks(void);
void        piola_gather(const double *own, double *all, int32_t n);
void        piola_broadcast(void *bytes, int64_t n, int32_t root);
void        piola_all_gather(uint64_t own, uint64_t *all);
void        piola_send(const void *bytes, int64_t n, int32_t to);
void        piola_receive(void *bytes, int64_t n, int32_t from);
void        piola_abort(int32_t code);
int64_t     piola_most(void);
void        piola_note(const char *text);
int         piola_unused_options(char **joined);
void        piola_free_text(char *text);

int  piola_halo_new(int64_t own, int64_t n_ghosts, const int32_t *owners, const int64_t *places, int32_t d, PiolaHalo **made);
int  piola_halo_fill(PiolaHalo *halo, double *local);
int  piola_halo_add_back(PiolaHalo *halo, double *local);
void piola_halo_free(PiolaHalo *halo);

int  piola_newton_new(int64_t own, int64_t first, int64_t all, int32_t d, const int64_t *starts, const int64_t *columns,
                      int32_t n_modes, const double *const *modes, PiolaNewton **made);
int  piola_newton_solve(PiolaNewton *newton, const PiolaCallbacks *callbacks, double *u, PiolaOutcome *outcome);
int  piola_newton_solve_linear(PiolaNewton *newton, const PiolaCallbacks *callbacks, const double *right, double *x,
                               PiolaOutcome *outcome);
void piola_newton_free(PiolaNewton *newton);

/* For the other files of the shim. */
PetscErrorCode piola_narrow(int64_t number, const char *what, PetscInt *narrow);
int32_t        piola_agree(int32_t own);

#endif
