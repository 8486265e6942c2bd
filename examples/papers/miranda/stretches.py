"""The modified stretch against the stretch."""

from __future__ import annotations

import numpy as np
import piola

from running import Run
from study import Claim, Found, Line, Number, Panel, Row


def fig01(run: Run) -> Found:
    """Forces of the two laws over each other are the stretches over each other."""
    s = np.linspace(-1.0, 1.0, 81)[1:]
    true = piola.Law("silling2000", K=1.0, delta=1.0)
    along = piola.Law(run.path("modified_stretch_along_bonds.piola"), K=1.0, delta=1.0)
    fast = piola.Law("miranda_modified_stretch", K=1.0, delta=1.0)
    force = true.d1(1.0 + s, 1.0, measure="l")
    moved = np.abs(s) > 1e-9
    modified = np.zeros_like(s)
    modified[moved] = s[moved] * along.d1(1.0 + s, 1.0, measure="l")[moved] / force[moved]
    product = s[moved] * fast.d1(1.0 + s, 1.0, measure="l")[moved] / force[moved] / (1.0 + s[moved])
    slopes = float(along.d2(np.ones(1), 1.0, measure="l")[0] / true.d2(np.ones(1), 1.0, measure="l")[0])
    closed = s + s**2 / 2.0
    off = float(max(np.abs(modified - closed).max(), np.abs(product - closed[moved]).max()))
    rows: list[Row] = [
        Number("modified stretch at s = 1", float(modified[-1]), 1.5, 0.05),
        Number("relative difference at s = 1", 100.0 * float(modified[-1] / s[-1] - 1.0), 50.0, 0.5, "%"),
        Claim("the modified stretch is s + s^2/2", "eq. (26)", f"forces of the laws differ from it by {off:.0e}",
              off < 1e-12),
        Claim("the relative difference is s/2", "eq. (25)",
              f"{100 * float(modified[44] / s[44] - 1.0):.2f} % at s = {s[44]:.3f}",
              bool(np.abs(modified[moved] / s[moved] - 1.0 - s[moved] / 2.0).max() < 1e-12)),
        Claim("both tend to each other at small stretch", "equal to first order",
              f"slopes at rest {slopes:.12f} over each other", abs(slopes - 1.0) < 1e-12),
    ]
    lines = [Line("modified stretch", s.tolist(), modified.tolist(), style="-"),
             Line("stretch", s.tolist(), s.tolist(), style="--"),
             Line("printed at s = 1", [1.0], [1.5], published=True)]
    return Found(rows, [Panel("", "s", "modified stretch", lines)], columns=1)
