/* Start and end of MPI and PETSc, what ranks tell each other, and the text of errors. */
#include "shim.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Collectives of ours keep apart from PETSc's. */
static MPI_Comm world = MPI_COMM_NULL;
static char     message[2048];
/* What went wrong in a callback of this rank, for the case that only this rank can say it. */
static char failure[2048];

/* Most bytes of one message: MPI counts in int. */
#define MOST_BYTES ((int64_t)1 << 30)

/* Seconds that the ranks have to hear of a rank that failed, before the run is ended. */
#define GRACE 10.0

const char *piola_message(void)
{
  return message;
}

/* Keeps the text of an error where it arises; functions that pass it on add nothing. */
static PetscErrorCode keep(MPI_Comm comm, int line, const char *function, const char *file, PetscErrorCode code, PetscErrorType type,
                           const char *text, void *context)
{
  (void)comm, (void)line, (void)file, (void)context;
  if (type == PETSC_ERROR_INITIAL) {
    const char *general = NULL;
    PetscErrorMessage(code, &general, NULL);
    snprintf(message, sizeof message, "%s: %s%s%s", function ? function : "PETSc", text && *text ? text : "", text && *text ? ": " : "",
             general ? general : "unknown error");
    /* PETSc's texts go over several lines. */
    for (char *c = message; *c; c++)
      if (*c == '\n') *c = ' ';
  }
  return code;
}

static PetscErrorCode check_version(void)
{
  PetscInt major, minor;
  PetscFunctionBegin;
  PetscCall(PetscGetVersionNumber(&major, &minor, NULL, NULL));
  PetscCheck(major == PETSC_VERSION_MAJOR && minor == PETSC_VERSION_MINOR, PETSC_COMM_SELF, PETSC_ERR_LIB,
             "the library is PETSc %d.%d, and piola was built with %d.%d", (int)major, (int)minor, PETSC_VERSION_MAJOR,
             PETSC_VERSION_MINOR);
  PetscFunctionReturn(0);
}

/* What PETSc would do by itself and a library must not; an option of the user comes later and counts. */
static PetscErrorCode set_manners(void)
{
  PetscFunctionBegin;
  PetscCall(PetscOptionsSetValue(NULL, "-no_signal_handler", "true"));
  PetscCall(PetscOptionsSetValue(NULL, "-options_left", "false"));
  /* A run depends on its command line and not on files in a home folder. */
  PetscCall(PetscOptionsSetValue(NULL, "-skip_petscrc", "true"));
  PetscFunctionReturn(0);
}

int piola_start(int32_t argc, char **argv)
{
  int thread_level, n = argc;
  message[0] = 0;
  if (MPI_Init_thread(&n, &argv, MPI_THREAD_FUNNELED, &thread_level) != MPI_SUCCESS) {
    snprintf(message, sizeof message, "MPI did not start");
    return PETSC_ERR_MPI;
  }
  (void)MPI_Comm_dup(MPI_COMM_WORLD, &world);
  PetscCall(PetscPushErrorHandler(keep, NULL));
  PetscCall(set_manners());
  PetscCall(PetscInitialize(&n, &argv, NULL, NULL));
  PetscCall(check_version());
  return 0;
}

int piola_finalise(void)
{
  message[0] = 0;
  PetscErrorCode code = PetscFinalize();
  if (world != MPI_COMM_NULL) (void)MPI_Comm_free(&world);
  (void)MPI_Finalize();
  return code;
}

int32_t piola_rank(void)
{
  int rank;
  (void)MPI_Comm_rank(world, &rank);
  return rank;
}

int32_t piola_ranks(void)
{
  int ranks;
  (void)MPI_Comm_size(world, &ranks);
  return ranks;
}

/* `all` has room for n numbers of every rank on rank 0, and is not touched elsewhere. */
void piola_gather(const double *own, double *all, int32_t n)
{
  (void)MPI_Gather(own, n, MPI_DOUBLE, all, n, MPI_DOUBLE, 0, world);
}

void piola_broadcast(void *bytes, int64_t n, int32_t root)
{
  for (int64_t at = 0; at < n; at += MOST_BYTES) {
    int64_t part = n - at < MOST_BYTES ? n - at : MOST_BYTES;
    (void)MPI_Bcast((char *)bytes + at, (int)part, MPI_BYTE, root, world);
  }
}

void piola_all_gather(uint64_t own, uint64_t *all)
{
  (void)MPI_Allgather(&own, 1, MPI_UINT64_T, all, 1, MPI_UINT64_T, world);
}

void piola_send(const void *bytes, int64_t n, int32_t to)
{
  for (int64_t at = 0; at < n; at += MOST_BYTES) {
    int64_t part = n - at < MOST_BYTES ? n - at : MOST_BYTES;
    (void)MPI_Send((const char *)bytes + at, (int)part, MPI_BYTE, to, 0, world);
  }
}

void piola_receive(void *bytes, int64_t n, int32_t from)
{
  for (int64_t at = 0; at < n; at += MOST_BYTES) {
    int64_t part = n - at < MOST_BYTES ? n - at : MOST_BYTES;
    (void)MPI_Recv((char *)bytes + at, (int)part, MPI_BYTE, from, 0, world, MPI_STATUS_IGNORE);
  }
}

void piola_abort(int32_t code)
{
  (void)MPI_Abort(MPI_COMM_WORLD, code);
  abort();
}

void piola_note(const char *text)
{
  snprintf(failure, sizeof failure, "%s", text);
}

/* The greatest code of all ranks. A rank that failed may have done so before an exchange in which others
 * wait for it: it waits for them a while, and then ends the run with the reason, as nobody else can. */
int32_t piola_agree(int32_t own)
{
  int32_t     all = own;
  MPI_Request request;
  (void)MPI_Iallreduce(&own, &all, 1, MPI_INT32_T, MPI_MAX, world, &request);
  if (own == PIOLA_FAILED) {
    const double since = MPI_Wtime();
    int          done  = 0;
    while (MPI_Test(&request, &done, MPI_STATUS_IGNORE) == MPI_SUCCESS && !done) {
      if (MPI_Wtime() - since > GRACE) {
        fprintf(stderr, "error: rank %d: %s\n", (int)piola_rank(), failure);
        piola_abort(1);
      }
      (void)PetscSleep(0.001);
    }
  } else {
    (void)MPI_Wait(&request, MPI_STATUS_IGNORE);
  }
  return all;
}

/* A number as PETSc counts, or an error: an overflow would be a wrong matrix. */
PetscErrorCode piola_narrow(int64_t number, const char *what, PetscInt *narrow)
{
  PetscFunctionBegin;
  PetscCheck(number >= 0 && number <= (int64_t)PETSC_MAX_INT, PETSC_COMM_SELF, PETSC_ERR_ARG_OUTOFRANGE,
             "%s: %lld, and this PETSc counts to %lld; take more ranks, or a PETSc built with 64-bit indices", what,
             (long long)number, (long long)PETSC_MAX_INT);
  *narrow = (PetscInt)number;
  PetscFunctionReturn(0);
}

int64_t piola_most(void)
{
  return PETSC_MAX_INT;
}

/* Names of options that nothing has read, one a line. */
int piola_unused_options(char **joined)
{
  PetscInt n;
  char   **names, **values;
  size_t   room = 1;
  message[0] = 0;
  *joined    = NULL;
  PetscCall(PetscOptionsLeftGet(NULL, &n, &names, &values));
  for (PetscInt i = 0; i < n; i++) room += strlen(names[i]) + 1;
  char *text = calloc(room, 1);
  for (PetscInt i = 0; text && i < n; i++) {
    strcat(text, names[i]);
    strcat(text, "\n");
  }
  PetscCall(PetscOptionsLeftRestore(NULL, &n, &names, &values));
  PetscCheck(text, PETSC_COMM_SELF, PETSC_ERR_MEM, "no memory for the names of options");
  *joined = text;
  return 0;
}

void piola_free_text(char *text)
{
  free(text);
}
