/* What owners of points tell those that hold them as ghosts, by a star forest. */
#include "shim.h"

struct PiolaHalo {
  PetscSF      forest;
  MPI_Datatype point; /* d numbers; one is a number itself, as sums of contiguous ones fail in PETSc 3.18 */
  PetscBool    own_type;
  size_t       ghosts_at;
};

/* Without ghosts of its own a rank still gives to others: every rank takes part in every call. */
static PetscErrorCode make_forest(PetscSF forest, int64_t own, int64_t n_ghosts, const int32_t *owners, const int64_t *places)
{
  PetscInt     n, m;
  PetscSFNode *nodes;
  PetscFunctionBegin;
  PetscCall(piola_narrow(own, "points of a rank", &n));
  PetscCall(piola_narrow(n_ghosts, "ghost points of a rank", &m));
  PetscCall(PetscMalloc1(m, &nodes));
  for (PetscInt i = 0; i < m; i++) {
    nodes[i].rank = owners[i];
    PetscCall(piola_narrow(places[i], "place of a ghost point", &nodes[i].index));
  }
  PetscCall(PetscSFSetFromOptions(forest));
  PetscCall(PetscSFSetGraph(forest, n, m, NULL, PETSC_OWN_POINTER, nodes, PETSC_OWN_POINTER));
  PetscCall(PetscSFSetUp(forest));
  PetscFunctionReturn(0);
}

int piola_halo_new(int64_t own, int64_t n_ghosts, const int32_t *owners, const int64_t *places, int32_t d, PiolaHalo **made)
{
  PiolaHalo *halo;
  PetscFunctionBegin;
  *made = NULL;
  PetscCall(PetscNew(&halo));
  halo->point    = MPI_DOUBLE;
  halo->own_type = d > 1 ? PETSC_TRUE : PETSC_FALSE;
  if (halo->own_type) {
    PetscCallMPI(MPI_Type_contiguous(d, MPI_DOUBLE, &halo->point));
    PetscCallMPI(MPI_Type_commit(&halo->point));
  }
  halo->ghosts_at = (size_t)own * (size_t)d;
  PetscCall(PetscSFCreate(PETSC_COMM_WORLD, &halo->forest));
  PetscCall(make_forest(halo->forest, own, n_ghosts, owners, places));
  *made = halo;
  PetscFunctionReturn(0);
}

int piola_halo_fill(PiolaHalo *halo, double *local)
{
  PetscFunctionBegin;
  PetscCall(PetscSFBcastBegin(halo->forest, halo->point, local, local + halo->ghosts_at, MPI_REPLACE));
  PetscCall(PetscSFBcastEnd(halo->forest, halo->point, local, local + halo->ghosts_at, MPI_REPLACE));
  PetscFunctionReturn(0);
}

int piola_halo_add_back(PiolaHalo *halo, double *local)
{
  PetscFunctionBegin;
  PetscCall(PetscSFReduceBegin(halo->forest, halo->point, local + halo->ghosts_at, local, MPI_SUM));
  PetscCall(PetscSFReduceEnd(halo->forest, halo->point, local + halo->ghosts_at, local, MPI_SUM));
  PetscFunctionReturn(0);
}

void piola_halo_free(PiolaHalo *halo)
{
  if (!halo) return;
  /* An error here has nobody who could act on it. */
  (void)PetscSFDestroy(&halo->forest);
  if (halo->own_type) (void)MPI_Type_free(&halo->point);
  (void)PetscFree(halo);
}
