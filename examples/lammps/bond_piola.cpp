// bond_style piola: bonds of LAMMPS whose energy is a psi(l) that piola compiled.
//
// A bond between the points i and j stores V_i V_j psi(l; L). L is its length at rest. Points have their
// volume and their place at rest from `fix NAME all property/atom d_volume d2_rest 3 ghost yes`, and
// `bond_coeff TYPE LENGTH` says how long bonds are at most, at rest.
// LAW_HEADER and LAW, the kernel in it, are given to the compiler.

#include <algorithm>
#include <cmath>
#include <vector>

#include "atom.h"
#include "bond.h"
#include "domain.h"
#include "error.h"
#include "force.h"
#include "memory.h"
#include "neighbor.h"

#include LAW_HEADER

using namespace LAMMPS_NS;

namespace {

class BondPiola : public Bond {
 public:
  explicit BondPiola(LAMMPS *lmp) : Bond(lmp) {}

  ~BondPiola() override
  {
    if (allocated) memory->destroy(setflag);
  }

  void coeff(int narg, char **arg) override
  {
    if (narg != 2) error->all(FLERR, "bond_coeff of piola: a type, and the longest bond at rest");
    const int types = atom->nbondtypes;
    if (!allocated) {
      memory->create(setflag, types + 1, "bond:setflag");
      std::fill(setflag, setflag + types + 1, 0);
      longest.assign(types + 1, 0.0);
      allocated = 1;
    }
    int low, high;
    utils::bounds(FLERR, arg[0], 1, types, low, high, error);
    for (int type = low; type <= high; type++) {
      longest[type] = utils::numeric(FLERR, arg[1], false, lmp);
      setflag[type] = 1;
    }
  }

  void init_style() override
  {
    if (domain->xperiodic || domain->yperiodic || domain->zperiodic)
      error->all(FLERR, "bond style piola: places at rest know no periodic images");
    int is_double, columns, ghost;
    const int rest = atom->find_custom_ghost("rest", is_double, columns, ghost);
    if (rest < 0 || !is_double || columns != 3 || !ghost)
      error->all(FLERR, "bond style piola needs d2_rest 3 of fix property/atom, with ghost yes");
    rest_index = rest;
    const int volume = atom->find_custom_ghost("volume", is_double, columns, ghost);
    if (volume < 0 || !is_double || columns != 0 || !ghost)
      error->all(FLERR, "bond style piola needs d_volume of fix property/atom, with ghost yes");
    volume_index = volume;
  }

  void compute(int eflag, int vflag) override
  {
    ev_init(eflag, vflag);
    const int count = neighbor->nbondlist;
    const int *const *const bonds = neighbor->bondlist;
    if (neighbor->ago == 0 || (int) at_rest.size() != count) {
      at_rest.resize(count);
      for (int n = 0; n < count; n++) at_rest[n] = rest_of(bonds[n][0], bonds[n][1]);
    }
    const double *const *const x = atom->x;
    double *const *const f = atom->f;
    const int nlocal = atom->nlocal;
    const bool newton = force->newton_bond;

    constexpr int BLOCK = 256;
    double l[BLOCK], L[BLOCK], change[BLOCK], psi[BLOCK], dpsi[BLOCK], d2psi[BLOCK];
    double d[BLOCK][3];
    for (int first = 0; first < count; first += BLOCK) {
      const int many = std::min(BLOCK, count - first);
      for (int k = 0; k < many; k++) {
        const int *const bond = bonds[first + k];
        measure(x[bond[0]], x[bond[1]], at_rest[first + k], d[k], l[k], change[k]);
        L[k] = at_rest[first + k].length;
      }
      LAW(many, l, L, change, psi, dpsi, d2psi);
      for (int k = 0; k < many; k++) {
        const int i = bonds[first + k][0], j = bonds[first + k][1];
        const double weight = at_rest[first + k].weight, pull = -weight * dpsi[k] / l[k];
        for (int c = 0; c < 3; c++) {
          if (newton || i < nlocal) f[i][c] += pull * d[k][c];
          if (newton || j < nlocal) f[j][c] -= pull * d[k][c];
        }
        if (evflag)
          ev_tally(i, j, nlocal, newton, weight * psi[k], pull, d[k][0], d[k][1], d[k][2]);
      }
    }
  }

  double single(int, double, int i, int j, double &pull) override
  {
    const Rest rest = rest_of(i, j);
    double d[3], l, change, psi, dpsi, d2psi;
    measure(atom->x[i], atom->x[j], rest, d, l, change);
    LAW(1, &l, &rest.length, &change, &psi, &dpsi, &d2psi);
    pull = -rest.weight * dpsi / l;
    return rest.weight * psi;
  }

  double equilibrium_distance(int type) override { return longest[type]; }
  void write_restart(FILE *) override {}
  void read_restart(FILE *) override {}    // bond_coeff is given again

 private:
  struct Rest {
    double vector[3], length, weight;
  };
  std::vector<Rest> at_rest;    // in the order of the neighbor's list of bonds
  std::vector<double> longest;
  int rest_index = -1, volume_index = -1;

  Rest rest_of(int i, int j) const
  {
    const double *const X = atom->darray[rest_index][i], *const Y = atom->darray[rest_index][j];
    const double *const V = atom->dvector[volume_index];
    const double a = X[0] - Y[0], b = X[1] - Y[1], c = X[2] - Y[2];
    return {{a, b, c}, std::sqrt(a * a + b * b + c * c), V[i] * V[j]};
  }

  // d, l and (l - L)/L, the last from displacements, for l - L would lose digits at small strains.
  static void measure(const double *x, const double *y, const Rest &rest, double *d, double &l,
                      double &change)
  {
    double square = 0.0, more = 0.0;
    for (int c = 0; c < 3; c++) {
      d[c] = x[c] - y[c];
      square += d[c] * d[c];
      more += (d[c] - rest.vector[c]) * (d[c] + rest.vector[c]);    // of l^2 - L^2
    }
    l = std::sqrt(square);
    change = more / (rest.length * (l + rest.length));
  }
};

Bond *create(LAMMPS *lmp)
{
  return new BondPiola(lmp);
}

// What lammpsplugin.h of the sources says, for packages that come without it.
struct Plugin {
  const char *version, *style, *name, *info, *author;
  Bond *(*creator)(LAMMPS *);
  void *handle;
};

}    // namespace

extern "C" void lammpsplugin_init(void *lmp, void *handle, void *enrol)
{
  Plugin plugin = {static_cast<LAMMPS *>(lmp)->version, "bond", "piola",
                   "bonds of a law compiled by piola", "piola", create, handle};
  reinterpret_cast<void (*)(Plugin *, void *)>(enrol)(&plugin, lmp);
}
