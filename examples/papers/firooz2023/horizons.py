"""What the horizon does: firooz2023, Figs. 10 and 11."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import piola
from running import Run
from study import Claim, Cloud, Found, Line, Number, Panel, Picture, Row, figure

PAPER = "firooz2023"


def corner(run: Run, spacing: float, spacings: float) -> piola.Result:
    """The sheet of Fig. 10; C1 so that its modulus is the same: E of bonds grows with C1 delta^3."""
    held = 0.1
    return run.solve(
        "corner.toml",
        {
            "body.spacing": spacing,
            "horizon.spacings": spacings,
            "sets.foot": f"Y < {held}",
            "sets.end": f"X > {1 - held}",
            "material.parameters.C1": (spacing * spacings) ** -3.0,
        },
    )


def along(result: piola.Result, axis: int, spacing: float) -> tuple[list[float], list[float]]:
    """Von Mises' stress from the corner on into the sheet, horizontally (0) or vertically (1)."""
    frame = result.frames[-1]
    X, stress = frame.positions, frame.fields["von_mises"]
    if axis == 0:
        row = (np.abs(X[:, 1] - (0.5 + 0.5 * spacing)) < 1e-6) & (X[:, 0] < 0.5)
        away = 0.5 - X[row, 0]
    else:
        row = (np.abs(X[:, 0] - (0.5 - 0.5 * spacing)) < 1e-6) & (X[:, 1] > 0.5)
        away = X[row, 1] - 0.5
    order = np.argsort(away)
    return [float(one) for one in away[order]], [float(one) for one in stress[row][order]]


@figure(PAPER, "Fig. 10", "Von Mises' stress at the corner of an L against spacing and horizon")
def fig10(run: Run) -> Found:
    fixed_ratio = [(h, 3.0) for h in ((0.05, 0.025, 0.01, 0.005) if run.full else (0.05, 0.025))]
    fine = 0.01 if run.full else 0.025
    fixed_spacing = [(fine, m) for m in (2.0, 3.0, 4.0, 5.0)]
    rows: list[Row] = []
    panels: list[Panel | Cloud] = []
    for name, cases in (("horizon of 3 spacings", fixed_ratio), (f"spacing {fine:g}", fixed_spacing)):
        for axis, word in ((0, "horizontally"), (1, "vertically")):
            lines = []
            for h, m in cases:
                x, y = along(corner(run, h, m), axis, h)
                lines.append(Line(f"spacing {h:g}, {m:g} spacings", x, y))
            panels.append(Panel(f"{name}, {word}", "distance from the corner, m", "von Mises' stress, Pa", lines))
    for axis, word in ((0, "horizontally"), (1, "vertically")):
        for full, sizes in ((False, (0.05, 0.025)), (True, (0.05, 0.025, 0.01, 0.005))):
            if full and not run.full:
                continue
            peaks = [max(along(corner(run, h, 3.0), axis, h)[1]) for h in sizes]
            rows.append(
                Claim(
                    f"largest stress {word}, horizon of 3 spacings, spacings {sizes[0]:g} to {sizes[-1]:g}",
                    "decreases as the spacing grows, and is highest for the smallest",
                    ", ".join(f"{peak:.3e} at {h:g}" for h, peak in zip(sizes, peaks, strict=True)),
                    all(a < b for a, b in pairwise(peaks)),
                    cheap=not full,
                )
            )
        peaks = [max(along(corner(run, 0.025, m), axis, 0.025)[1]) for m in (2.0, 3.0, 4.0, 5.0)]
        rows.append(
            Claim(
                f"largest stress {word}, spacing 0.025, horizons of 2 to 5 spacings",
                "highest for the most local",
                ", ".join(f"{peak:.3e} at {m:g}" for m, peak in zip((2, 3, 4, 5), peaks, strict=True)),
                all(a > b for a, b in pairwise(peaks)),
            )
        )
    found = run.scene("corner.toml").moduli()
    rows.append(
        Number(
            "Poisson's ratio of bonds, horizon of 3 spacings",
            float(found["nu"]),
            0.33,
            reading=0.005,
            independent=0.31825,
            source="a lattice sum of another program",
            why="0.33 is that of the continuum; the lattice of the figure has less",
        )
    )
    notes = """The text says that the left plot is along the horizontal and the right one along the vertical, and that
        the spacing grows; the caption says that the left one has a fixed ratio of horizon and spacing, and the
        right one a fixed spacing. All four are here. Dimensions, clamps, displacement and coefficients are not
        printed: a square of 1 m without its lower right quarter, its foot of 0.1 m held, the end of the other
        leg raised by 1e-5 m, and C1 delta^3 kept at 1, so that all bodies have about one modulus. Stresses are
        the virial ones of piola."""
    return Found(rows, list(panels), notes, columns=2)


@figure(PAPER, "Fig. 11", "A block of soft tissue under a small shear")
def fig11(run: Run) -> Found:
    result = run.solve("block.toml")
    force = float(result.reactions["moved_x"][-1])
    found = run.scene("block.toml").moduli()
    rows: list[Row] = [
        Number(
            "shear modulus as a rheometer would have it, over that of the lattice inside",
            force / 1.0 / (1e-4 / 0.5) / float(found["mu" if "mu" in found else "G"]),
            None,
            why="the paper prints no geometry, no coefficient and no value",
        )
    ]
    notes = """The paper says no more than that a cut-out of a brain is sheared a little, and that its parameters are
        beyond its scope: neither geometry nor coefficients can be reproduced. A cuboid of bonds stands for it
        here."""
    return Found(rows, [Picture("displacement", result.picture())], notes)
