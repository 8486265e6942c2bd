"""The reinforced beam of section 5.2.1, which fails in shear."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import piola
from numpy.typing import NDArray

from miranda.lattices import printed
from running import Run
from study import Claim, Cloud, Found, Line, Number, Panel, Row

Vector = NDArray[np.float64]

SCENE = "../../reinforced_beam/scene.toml"
H = 0.02
"""Spacing in m of 100 x 15 x 9 points, 13,500: 2 x 0.3 x 0.18 m."""
SPEED = 0.3
"""Of the load, m/s."""
RAMP = 1.0 / 150.0
"""The time in s in which it comes to that, so that 0.79 is reached at twice the time of 0.37."""
TIMES = {0.16: 0.014, 0.37: 0.028, 0.79: 0.056}
"""When so much of the displacement is reached, in s: as the beam fails here, and the paper's two."""


def settings() -> dict[str, Any]:
    """Of the scene, at the paper's number of points and with delta = 3 sqrt(3) lambda, which has its bonds."""
    cover, side = "Y > 0.04 and Y < 0.06", "(Z > 0.04 and Z < 0.06 or Z > 0.12 and Z < 0.14)"
    return {
        "body.box": [[0.0, 0.0, 0.0], [100 * H, 15 * H, 9 * H]],
        "body.spacing": H,
        "horizon.radius": 3.0 * np.sqrt(3.0) * H,
        # A row of points with bonds over five spacings is as stiff as 20 x 20 mm of E = 200 GPa; it stays elastic.
        "material.0.parameters.K": 200e9 * np.pi * 27.0**2 / 270.0,
        "material.0.parameters.sY": 1.0,
        "sets.bars": f"{cover} and {side}",
        "sets.left": "X > 0.1 and X < 0.18 and Y < 0.02",
        "sets.right": "X > 1.82 and X < 1.9 and Y < 0.02",
        "sets.load": "X > 0.96 and X < 1.04 and Y > 0.28",
        "prescribe.2.v": [0, f"-{SPEED}*min(t/{RAMP}, 1)", 0],
        "motion.end": TIMES[0.79],
        "output.frames": 8,
    }


@dataclass
class State:
    """The beam at a time."""

    at: Vector
    u: Vector
    damage: Vector
    concrete: NDArray[np.bool_]


def opened(result: piola.Result) -> dict[float, State]:
    """The beam at both times."""
    found = {}
    for part, t in TIMES.items():
        frame = min(result.frames, key=lambda one: abs(one.t - t))
        assert abs(frame.t - t) < 1e-4, frame.t
        found[part] = State(frame.positions, frame["displacement"], frame["damage"], frame["material"] > 0.5)
    return found


def solved(run: Run) -> piola.Result:
    """The whole motion, of which three figures tell."""
    return run.beside("fig17").solve(SCENE, settings())


def size(run: Run) -> list[Row]:
    """Points; bonds are those of Fig. 21."""
    body = run.scene(SCENE, settings()).body()
    return [
        Number("points", len(body.positions), printed("fig16", "points"), 50.0),
    ]


def regions(state: State) -> dict[str, float]:
    """The share of points that lost more than a third of their bonds, by where they are."""
    x, y = state.at[:, 0], state.at[:, 1]
    gone = (state.damage > 1.0 / 3.0) & state.concrete
    load = (np.abs(x - 1.0) < 0.2) & (y > 0.2)
    supports = ((np.abs(x - 0.14) < 0.2) | (np.abs(x - 1.86) < 0.2)) & (y < 0.1)
    web = (np.abs(np.abs(x - 1.0) - 0.43) < 0.2) & (np.abs(y - 0.15) < 0.05)
    middle = (np.abs(x - 1.0) < 0.1) & (np.abs(y - 0.15) < 0.05)
    ends = (np.abs(x - 1.0) > 0.6) & (y > 0.2)
    parts = {"at the load": load, "at the supports": supports, "in the middle of the shear spans": web,
             "under the load at half height": middle, "at the upper ends": ends}
    return {name: float(gone[part].mean()) for name, part in parts.items()}


def side(state: State, scale: float, whole: bool, title: str, z: float = 0.09) -> Cloud:
    """A cut along the beam at a width, with its damage; without `whole` points that lost all bonds are left out."""
    shown = np.isclose(state.at[:, 2], z)
    if not whole:
        shown &= state.damage < TOTAL
    now = state.at[shown] + scale * state.u[shown]
    x, y, damage = now[:, 0].tolist(), now[:, 1].tolist(), state.damage[shown].tolist()
    return Cloud(title, x, y, damage, "damage", 12.0, (0.0, 1.0))


TOTAL = 0.999
"""Damage of points that are totally damaged."""


def shares(found: dict[str, float]) -> str:
    """As a sentence."""
    return ", ".join(f"{100 * value:.0f} % {name}" for name, value in found.items())


def fig17(run: Run) -> Found:
    """Damage at 0.37 of the largest displacement."""
    rows = size(run)
    notes = """Open in the paper are all dimensions, the spacing, where the bars are, the time step, the density and the
        damping. Here 100 x 15 x 9 points of 20 mm, with delta = 3 sqrt(3) lambda, which have its bonds (Fig. 21), bars
        of one row of points each, 50 mm above the lower face, as stiff as 20 x 20 mm of E_s; bonds of concrete break at
        f_ct/E_c = 1e-4. The load goes down at 0.3 m/s, with damping of 100 1/s: slow against waves only."""
    if not run.full:
        return Found(rows, [], notes)
    result = solved(run)
    state = opened(result)[0.37]
    where = regions(state)
    t, force = result.reactions["t"], -result.reactions["load_y"] / 1e3
    rows += [
        Claim("spalling", "where the displacement is applied and near the supports",
              f"points that lost a third of their bonds: {shares(where)}",
              min(where["at the load"], where["at the supports"]) > 0.1 > where["at the upper ends"], cheap=False),
    ]
    way = 1e3 * SPEED * np.where(t < RAMP, 0.5 * t**2 / RAMP, t - RAMP / 2.0)
    mean = np.convolve(force, np.ones(9) / 9.0, mode="same")
    line = Line("load", way.tolist(), mean.tolist(), style="-")
    load = Panel("load, mean of nine rows", "displacement, mm", "kN", [line])
    earlier = side(opened(result)[0.16], 10.0, True, "0.16 of 20 mm, displacements ten times")
    return Found(rows, [side(state, 10.0, True, "0.37 of 20 mm, displacements ten times"), earlier, load], notes + f"""
        It carries {mean.max():.0f} kN at {way[np.argmax(mean)]:.1f} mm and has failed in shear at 4 mm, 0.2 of the
        largest displacement: at the paper's 0.37 it is in pieces, which ten times the displacements draw far apart.""",
                 columns=1)


def failed(run: Run) -> tuple[State, list[Row]]:
    """At 0.79 of the largest displacement, and what is said of it."""
    result = solved(run)
    state = opened(result)[0.79]
    where = regions(state)
    lost = state.damage >= TOTAL
    x = state.at[lost, 0]
    near = (np.abs(x - 1.0) < 0.25) | (np.abs(np.abs(x - 1.0) - 0.86) < 0.25)
    force = -result.reactions["load_y"]
    mean = np.convolve(force, np.ones(9) / 9.0, mode="same")
    return state, [
        Claim("totally damaged points", "at the load and near the supports",
              f"{int(lost.sum())} points, {100 * float(near.mean()) if lost.any() else 0.0:.0f} % of them within "
              "0.25 m of the load or a support along the beam", bool(lost.any()) and float(near.mean()) > 0.75,
              why="with f_ct/E_c = 1e-4 and at 0.3 m/s the beam fails before 0.2 of the displacement, and the concrete "
                  "of both shear spans above and below the diagonals loses all its bonds", cheap=False),
        Claim("failure in shear", "for want of vertical bars",
              f"points that lost a third of their bonds: {shares(where)}; the load ends at "
              f"{mean[-20:].mean() / mean.max():.2f} of its largest value",
              where["in the middle of the shear spans"] > where["under the load at half height"]
              and bool(mean[-20:].mean() < 0.8 * mean.max()), cheap=False),
    ]


def fig18(run: Run) -> Found:
    """In perspective."""
    rows = size(run)[:1]
    if not run.full:
        return Found(rows)
    state, more = failed(run)
    kept = state.damage < TOTAL
    now = (state.at + state.u)[kept]
    # Seen from the side, from above and from a little to the right; the nearest points are drawn last.
    turned = np.array([now[:, 0] + 0.5 * now[:, 2], now[:, 1] + 0.35 * now[:, 2]])
    order = np.argsort(-now[:, 2])
    cloud = Cloud("0.79 of 20 mm, without totally damaged points", turned[0][order].tolist(), turned[1][order].tolist(),
                  state.damage[kept][order].tolist(), "damage", 8.0, (0.0, 1.0))
    return Found(rows + more, [cloud], "The run of Fig. 17; displacements as they are.", columns=1)


def fig19(run: Run) -> Found:
    """From the side."""
    rows = size(run)[:1]
    if not run.full:
        return Found(rows)
    state, more = failed(run)
    pictures = [side(state, 1.0, False, "the middle, without totally damaged points"),
                side(state, 1.0, False, "the plane of a bar", 0.05)]
    return Found(rows + more[1:], list(pictures), "The run of Fig. 17; displacements as they are.", columns=1)
