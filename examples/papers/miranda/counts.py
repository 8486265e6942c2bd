"""How many points and bonds the paper's models have, and what its horizon is."""

from __future__ import annotations

import numpy as np

import sources
from miranda import lattices
from miranda.lattices import LATTICES, bonds, printed
from running import Run
from study import Claim, Cloud, Found, Line, Number, Panel, Row

PROOF = """rounding of the axes' coordinates cannot: the four diagonals of every cube of two spacings then have the same
    three differences, so that the shell counts by fours, and 5517, 54,011, 5379 and 22,129 are odd; and the plate's
    spacing of 1/16 m is exact in binary"""
SEEDS = 12


def fig03(run: Run) -> Found:
    """Counts of the four models, and the search for the way of rounding."""
    rows: list[Row] = []
    for one in LATTICES:
        points = int(np.prod(one.points))
        said = {"A": ("table02", "points A"), "B": ("table02", "points B"), "cantilever": ("fig09", "points"),
                "plate": ("fig13", "points")}[one.name]
        rows.append(Number(f"points, {one.name}", points, printed(*said)))
        # Of model A by the program, to see that both count alike.
        whole = scene_counts(run) if one.name == "A" else one.within + one.shell
        rows.append(Number(f"bonds, {one.name}", whole - one.shell / 2, one.printed,
                           correction="half of the pairs at a distance of just delta are bonds",
                           why=f"{one.within} bonds are shorter than delta and {one.shell} as long: the printed number "
                               f"has {one.wanted / one.shell:.3f} of these"))
    found = lattices.search()
    wanted = np.array([one.wanted for one in LATTICES])
    met = [way for way, kept in found if (np.array(kept) == wanted).any()]
    rows.append(Claim("a rectangular lattice whose points within delta are joined",
                      "gives the printed numbers of bonds",
                      f"{len(met)} of {len(found)} ways of making coordinates and comparing distances give one of "
                      "the four", bool(met), refuted=all(one.wanted % 4 for one in LATTICES),
                      source="counting: bonds of length delta come in fours, and the printed numbers leave a remainder",
                      why=" ".join(PROOF.split())))
    shares = {one.name: [lattices.noisy(one, seed) / one.shell for seed in range(SEEDS)] for one in LATTICES}
    given = {one.name: one.wanted / one.shell for one in LATTICES}
    near = all(0.4 < value < 0.6 for value in [*given.values(), *np.concatenate(list(shares.values()))])
    rows.append(Claim("points that are off by their last digit, each on its own", "0.487, 0.502, 0.512 and 0.509",
                      ", ".join(f"{name} {np.mean(share):.3f}" for name, share in shares.items())
                      + " of the bonds of length delta", near,
                      correction="every point has a last digit of its own, as those that meshers interpolate"))
    apart = {tuple(kept): (way, kept) for way, kept in reversed(found)}
    best = sorted(apart.values(), key=lambda one: float(np.abs(np.array(one[1]) / wanted - 1.0).max()))[:3]
    share = np.array([one.shell for one in LATTICES])
    nearest = "; ".join(f"{way}: {', '.join(map(str, kept))}" for way, kept in best)
    lines = [
        Line("printed", [1.0, 2.0, 3.0, 4.0], list(given.values()), published=True),
        Line("last digits at random, mean", [1.0, 2.0, 3.0, 4.0],
             [float(np.mean(shares[one.name])) for one in LATTICES], style="o"),
        *[Line(way, [1.0, 2.0, 3.0, 4.0], (np.array(kept) / share).tolist(), style=":") for way, kept in best],
    ]
    notes = f"""Searched were {len(found)} ways: single, double and extended precision, metres and millimetres, thirteen
        ways to make an axis (multiples, sums, quotients, half a spacing off, from the middle, from 0.1, -0.3, 1.1), and
        seven tests (distance or its square, <= or <, 12 lambda^2, another order of the sum, delta of four decimals).
        Wanted of the shells are {', '.join(map(str, wanted))}. The nearest are {nearest}. None can give them:
        {PROOF}. So the points were not made axis by axis: with a last digit of its own for each coordinate of each
        point about half of the shell is left, in odd numbers. Boxes that Gmsh 4.15 meshed with transfinite hexahedra
        (both units, six orders of the axes, two origins) had 0.35 to 0.62 of it, in odd and even numbers, but not the
        printed ones."""
    return Found(rows, [points_of_model_a(),
                        Panel("share of the bonds of length delta", "A, B, cantilever, plate", "share", lines)],
                 notes, columns=1)


def points_of_model_a() -> Cloud:
    """As Fig. 3 has them: seen from aside and above, with the ends that are held."""
    x, y, z = (axis.ravel() for axis in np.meshgrid(*(0.05 * np.arange(n) for n in LATTICES[0].points), indexing="ij"))
    order = np.argsort(-y, kind="stable")
    held = ((x < 0.325) | (x > 3.775)).astype(float)
    return Cloud("model A and where it is held", (x + 0.5 * y)[order].tolist(), (z + 0.35 * y)[order].tolist(),
                 held[order].tolist(), "held", 2.0, (0.0, 1.0))


def scene_counts(run: Run) -> int:
    """Bonds of model A that the program makes."""
    result = run.solve("../../clamped_beam/scene.toml")
    return int(result.summary["interactions"]["bonds"])


def fig21(run: Run) -> Found:
    """The two models of section 5.2, which have more bonds than the horizon of the beams allows."""
    del run
    rows: list[Row] = []
    # Boxes with about the printed number of points, in the proportions of the bodies.
    cube, beam = (20, 20, 21), (9, 15, 100)
    for name, box, figure, limit in (("cube", cube, "fig21", 50_000), ("reinforced beam", beam, "fig16", 5_000)):
        points = int(np.prod(box))
        given, share = printed(figure, "points"), printed(figure, "bonds")
        rows.append(Number(f"points, {name}, {box[0]} x {box[1]} x {box[2]}", points, given, 50.0,
                           why="no box has the printed number" if name == "cube" else ""))
        rows.append(Claim(f"the printed bonds of the {name} with delta = 2 sqrt(3) lambda",
                          f"{share:.3g} bonds of {given:.0f} points",
                          f"at most 89 a point, {89 * given:.3g}", share <= 89 * given, refuted=True,
                          source="counting: 178 points of a lattice are within 2 sqrt(3) spacings of one",
                          why="printed are more than 200 a point"))
        least, most = bonds(box, 26), bonds(box, 27)
        scaled = (least + most) / 2 * given / points
        rows.append(Number(f"bonds, {name}, with delta = 3 sqrt(3) lambda", scaled, share, limit,
                           correction="delta is three times the diagonal of a cube of edge lambda, as the paper's "
                                      "words have it, and not 2 sqrt(3) lambda, as its formula has it",
                           why=f"{least} to {most} for {points} points, by whether those of length delta count; here "
                               "half of them, times the printed over this number of points"))
    notes = """The paper's sentence on the horizon says two things: 2 sqrt(3) lambda, and three times the diagonal,
        which is 3 sqrt(3) lambda. The beams and the plate were made with the former (Fig. 3), the cube and the
        reinforced beam have the numbers of bonds of the latter: 309 or 293 a point inside, 200 in bodies of this size.
        The reinforced beam's 2.71 million are those of 100 x 15 x 9 points, 13,500, with half of the bonds of length
        delta, as in Fig. 3. 8425 = 5 x 5 x 337 are no box of 150 x 150 x 170 mm."""
    shown = [Line("delta = 2 sqrt(3) lambda", [8400.0, 13500.0], [bonds(cube, 12) / 8400, bonds(beam, 12) / 13500]),
           Line("delta = 3 sqrt(3) lambda", [8400.0, 13500.0], [bonds(cube, 27) / 8400, bonds(beam, 27) / 13500]),
           Line("printed", [8425.0, 13500.0], [1.8e6 / 8425, 2.71e6 / 13500], published=True)]
    return Found(rows, [Panel("bonds per point", "points", "bonds per point", shown)], notes, columns=1)


def table01(run: Run) -> Found:
    """Eq. (37), with what lattices have inside."""
    del run
    given = sources.printed("miranda", "table01")
    at = [one.x for one in given]
    formula = [(m, 4.0 / 6.0 * np.pi * m**3 - 0.5) for m in at]
    lattice = [inside(int(m * m)) / 2 for m in at]
    rows: list[Row] = [
        Number(f"N/M of delta/lambda = {m:g}, by eq. (37)", float(value), one.y, one.reading)
        for (m, value), one in zip(formula, given, strict=True)
    ]
    worst = max(abs(exact / one.y - 1.0) for exact, one in zip(lattice[1:], given[1:], strict=True))
    rows.append(Claim("eq. (37) counts the bonds of a lattice", "approximately",
                      f"within {100 * worst:.0f} % from delta = 2 lambda on; 3 in place of 1.6 at delta = lambda",
                      worst < 0.1))
    lines = [Line("eq. (37)", at, [value for _, value in formula]), Line("a lattice inside", at, lattice, style="s--"),
             Line("Table 1", at, [one.y for one in given], published=True)]
    return Found(rows, [Panel("bonds per point", "delta/lambda", "N/M", lines, log="y")], columns=1)


def inside(squared: int) -> int:
    """Neighbours of a point inside a lattice."""
    reach = int(np.sqrt(squared)) + 1
    axis = np.arange(-reach, reach + 1) ** 2
    lengths = axis[:, None, None] + axis[None, :, None] + axis[None, None, :]
    return int((lengths <= squared).sum()) - 1
