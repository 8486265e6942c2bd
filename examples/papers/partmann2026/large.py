"""Figs. 10 and 11: large rotations with gradients at points."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import piola
from running import Run
from study import Claim, Cloud, Found, Line, Map, Number, Panel, Picture, Row, figure

from partmann2026.published import PAPER

Values = NDArray[np.float64]
Shown = Panel | Picture | Map | Cloud

# A body is free of what alternates from point to point where that is at most a hundredth of its displacements.
FREE = 0.01

WHY = """nothing grows and nothing is seen in a picture, but it is there: along X1 and X2, largest three points from the
faces, where families are cut, and some eighty times what gradients at bonds have in the same motion"""

WHY_LESS = "as on the coarser lattice, and a third of it: it falls with the spacing"


def alternating(frame: piola.Frame, spacing: float) -> float:
    """The largest amplitude in m by which displacements alternate from point to point along an axis.

    Third differences over 8 are that, and of third order in the spacing for what is smooth.
    """
    places = np.round((frame.positions - frame.positions.min(axis=0)) / spacing).astype(int)
    u = np.zeros((*(places.max(axis=0) + 1), 3))
    u[tuple(places.T)] = frame["displacement"]
    return max(float(np.abs(np.diff(u, n=3, axis=axis)).max()) / 8.0 for axis in range(3))


def share(frames: list[piola.Frame], spacing: float) -> float:
    """The same over the largest displacement of the motion, at its worst."""
    largest = max(float(np.linalg.norm(frame["displacement"], axis=1).max()) for frame in frames)
    return max(alternating(frame, spacing) for frame in frames) / largest


def twist(frame: piola.Frame, spacing: float) -> float:
    """How far the free end has turned about Z, in rad."""
    end = frame.positions[:, 2] > 0.5 - spacing
    X, x = frame.positions[end, :2], (frame.positions + frame["displacement"])[end, :2]
    turned = (X[:, 0] * x[:, 1] - X[:, 1] * x[:, 0]).sum()
    return math.atan2(float(turned), float((X * x).sum()))


def twisted(run: Run, across: int, turns: float, end: str, **scene: Any) -> piola.Result:
    """The bar with so many points across, and so many rad of phi0 for each of the paper's hertz."""
    spacing = 0.1 / across
    speed = f"{turns!r}*150*sin(pi/2*(Z + 0.5 - {3.01 * spacing!r}))"
    return run.solve("twist.toml", {
        "body.spacing": spacing,
        "sets.held": f"Z < {-0.5 + 3 * spacing!r}",
        "initial.0.v": [f"-{speed}*Y", f"{speed}*X", 0],
        "motion.end": end,
        **scene,
    }, threads=None if across > 10 else 1)


def drift(result: piola.Result) -> float:
    """The largest change of kinetic and stored energy less the work at prescribed points, over the largest energy."""
    table = result.table("motion")
    energy = table["kinetic"] + table["stored"] - table["prescribed"]
    return float(np.abs(energy - energy[0]).max() / (table["kinetic"] + table["stored"]).max())


def swung(young: float, density: float, phi0: float) -> float:
    """Largest twist of the end of a clamped square bar by linear torsion, in rad: phi0 over its lowest frequency."""
    waves = math.sqrt(young / 2.5 / density * 0.1406 / (1.0 / 6.0))
    return phi0 / (0.5 * math.pi * waves)


@figure(PAPER, "Fig. 10", "a bar that turns far about its axis, gradients at points")
def fig10(run: Run) -> Found:
    coarse = twisted(run, 10, 2.0 * math.pi, "6 ms")
    frames = coarse.frames
    angles = [twist(frame, 0.01) for frame in frames]
    largest = int(np.argmax(angles))
    rows = stable("N = 10", frames, coarse, 0.01, WHY)
    rows.insert(0, Claim(
        "twist of the free end, N = 10", "large rotations", f"up to {math.degrees(max(angles)):.0f} degrees",
        max(angles) > 0.5, correction="150 Hz are revolutions per second; theta is the polar angle",
        why="half a radian at least is taken as large",
    ))
    steel = twisted(run, 10, 1.0, "0.5 ms", **{
        "material.density": 8000.0, "material.parameters": {"lambda": 84e9, "mu": 84e9},
    })
    rows += [
        Number(
            "largest twist of the end, steel of section 4.4, phi0 = 150 rad/s",
            max(twist(frame, 0.01) for frame in steel.frames), None, unit="rad",
            independent=swung(210e9, 8e3, 150.0), source="linear torsion of a clamped bar of 1 m",
            why="material and angles are not printed; the bar here is three layers shorter",
        ),
        turning(),
    ]
    lines = [Line("CC, N = 10", [1e3 * frame.t for frame in frames], [math.degrees(one) for one in angles])]
    if run.full:
        rows += finer(run, angles, lines)
    panels: list[Shown] = [Panel("twist of the free end", "t, ms", "degrees", lines), *sides(frames, largest)]
    notes = """Material, time, step and how the end is held are not printed. With the steel of section 4.4 and phi0 as
    rad/s the end turns by two degrees, which is not what the figure is about: here the bar is of the plastic of
    Fig. 11, turns at 150 revolutions per second, and moves for a period of its torsion. Three layers are held, for
    (4.59) is zero behind the third. The update of Flanagan and Taylor (4.45) to (4.57) is not computed with, here or
    in the paper, since laws of C need none; of its formulas (4.49) is looked at below."""
    return Found(rows, panels, notes, columns=1)


def stable(name: str, frames: list[piola.Frame], result: piola.Result, spacing: float, why: str = "") -> list[Row]:
    """That nothing is created, and nothing alternates."""
    amplitude = share(frames, spacing)
    return [
        Claim(
            f"the motion, {name}", "stays stable", f"{result.summary['exit_reason']}; kinetic and stored energy less "
            f"work change by {drift(result):.0e} of the energy",
            result.summary["exit_reason"] == "completed" and drift(result) < 1e-2,
        ),
        Claim(
            f"displacements, {name}", "no modes without energy are seen",
            f"what alternates from point to point is at most {100 * amplitude:.2f} % of the largest displacement",
            amplitude < FREE, why=why,
        ),
    ]


def turning() -> Claim:
    """(4.58) with the arctangent that is printed: its moment of momentum over that of a rotation."""
    x, y = np.meshgrid(np.arange(-9.5, 10.0), np.arange(-9.5, 10.0))
    theta, r = np.arctan(y / x), np.hypot(x, y)
    v = r * np.sin(theta + np.pi), -r * np.cos(theta + np.pi)
    share = float((x * v[1] - y * v[0]).sum() / (r * r).sum())
    return Claim(
        "(4.58) with arctan(X2/X1) as printed", "a motion that twists the bar about its axis",
        f"the half X1 < 0 turns against the other: moment of momentum {share:.0e} of that of a rotation",
        share > 0.99, refuted=True, source="the sum over the points; the polar angle, atan2, makes it 1",
    )


def finer(run: Run, angles: list[float], lines: list[Line]) -> list[Row]:
    """Thirty points across as in the paper, and gradients at bonds."""
    fine = twisted(run, 30, 2.0 * math.pi, "3 ms")
    bonds = twisted(run, 30, 2.0 * math.pi, "3 ms", **{"correspondence.discretisation": "bond-quadrature"})
    frames = fine.frames
    turned = [twist(frame, 0.1 / 30.0) for frame in frames]
    other = [twist(frame, 0.1 / 30.0) for frame in bonds.frames]
    off = max(abs(a - b) for a, b in zip(turned, other, strict=True)) / max(turned)
    times = [1e3 * frame.t for frame in frames]
    lines.append(Line("CC, N = 30", times, [math.degrees(one) for one in turned]))
    lines.append(Line("BAQP, N = 30", times, [math.degrees(one) for one in other], style="--"))
    rows: list[Row] = [
        Claim(
            "twist of the free end, N = 30", "large rotations", f"up to {math.degrees(max(turned)):.0f} degrees",
            max(turned) > 0.5, correction="150 Hz are revolutions per second; theta is the polar angle", cheap=False,
        ),
        *stable("N = 30", frames, fine, 0.1 / 30.0, WHY_LESS),
        *stable("BAQP, N = 30", bonds.frames, bonds, 0.1 / 30.0),
        Claim(
            "BAQP beside CC, N = 30", "similar in numbers",
            f"largest twists of {math.degrees(max(other)):.1f} and {math.degrees(max(turned)):.1f} degrees; twists "
            f"differ by {100 * off:.1f} % of the largest at most", off < 0.05, cheap=False,
            why=f"linear torsion has {math.degrees(swung(2.3e9, 1.6e3, 300.0 * math.pi)):.0f} degrees; ten points "
            f"across are too soft, CC turns by {math.degrees(max(angles)):.0f} there",
        ),
    ]
    for row in rows:
        row.cheap = False
    return rows


def sides(frames: list[piola.Frame], largest: int) -> list[Cloud]:
    """The bar from the side, at its largest twist and at the end, coloured by where points were across."""
    clouds = []
    for number in (largest, len(frames) - 1):
        frame = frames[number]
        x = frame.positions + frame["displacement"]
        seen = np.argsort(x[:, 1])
        title = f"CC, N = 10, t = {1e3 * frame.t:.2f} ms, from the side"
        across = frame.positions[seen, 0]
        clouds.append(Cloud(title, x[seen, 2].tolist(), x[seen, 0].tolist(), across.tolist(), "X1 at rest, m", 5.0))
    return clouds


def elastica(chord: float) -> float:
    """Height of a bar without extension whose ends are so far apart, both over its length (Euler)."""
    m = brentq(lambda m: 2.0 * ellipe(m) / ellipk(m) - 1.0 - chord, 1e-9, 0.9)
    return float(math.sqrt(m) / ellipk(m))


def bent(run: Run, across: int, seconds: float) -> piola.Result:
    """The bar whose ends come together in so many seconds."""
    spacing = 0.01 / across
    way = 0.5 * (0.2 - spacing - 0.01)
    return run.solve("bend.toml", {
        "body.spacing": spacing,
        "sets.left": f"X < {spacing!r} and Z < {-0.005 + spacing!r}",
        "sets.right": f"X > {0.2 - spacing!r} and Z < {-0.005 + spacing!r}",
        "prescribe.0.v": [way / seconds, 0, 0],
        "prescribe.1.v": [-way / seconds, 0, 0],
        "motion.end": seconds,
    }, threads=1)


@figure(PAPER, "Fig. 11", "a bar that is bent until its ends meet, gradients at points")
def fig11(run: Run) -> Found:
    fast = bent(run, 4, 0.02)
    rows = shape("N = 4 in 0.02 s", fast, 2.5e-3)
    shown = fast, "N = 4 in 0.02 s"
    if run.full:
        slow, fine = bent(run, 4, 0.2), bent(run, 8, 0.02)
        more = [*shape("N = 4 in 0.2 s", slow, 2.5e-3), *shape("N = 8 in 0.02 s", fine, 1.25e-3)]
        for row in more:
            row.cheap = False
        rows += more
        shown = fine, "N = 8 in 0.02 s"
    notes = """How much the bar is bent at first, which edges move, and how, is not printed. Here it is pushed into an
    arch of 1 mm at first, and the lower edges of both ends, a row of points each, come together at a constant speed
    until 10 mm are between them. The lowest swing of the bar takes 7 ms, so that 0.02 s are not slow yet; the 0.2 s of
    the paper are computed with four points across. Heights are those of the middle of the bar over its ends, beside
    the curve of a thin bar without extension (Euler) whose ends are as far apart as the middles of the end faces."""
    panels = [profile(shown[0].frames[0], "at first"), profile(shown[0].frames[-1], f"at the end, {shown[1]}")]
    return Found(rows, list(panels), notes)


def shape(name: str, result: piola.Result, spacing: float) -> list[Row]:
    """How the bar is bent at the end, and whether it is stable."""
    frames = result.frames
    last = frames[-1]
    X, x = last.positions, last.positions + last["displacement"]
    ends = [x[places].mean(axis=0) for places in (X[:, 0] < spacing, X[:, 0] > 0.2 - spacing)]
    edges = [x[places].mean(axis=0) for places in (
        (X[:, 0] < spacing) & (X[:, 2] < -0.005 + spacing), (X[:, 0] > 0.2 - spacing) & (X[:, 2] < -0.005 + spacing),
    )]
    middle = x[np.abs(X[:, 0] - 0.1) < spacing].mean(axis=0)
    height = float(abs(middle[2] - 0.5 * (ends[0][2] + ends[1][2])))
    chord = float(np.linalg.norm(ends[1] - ends[0]))
    apart = float(np.linalg.norm(edges[1] - edges[0]))
    return [
        *stable(name, frames, result, spacing),
        Claim(
            f"ends, {name}", "nearly touch", f"the edges come as near as {1e3 * apart:.1f} mm, the bar bends by "
            f"{1e3 * height:.0f} mm", apart < 0.1 * 0.2 and height > 0.25 * 0.2,
        ),
        Number(
            f"height of the middle over the ends, {name}", height, None, unit="m",
            independent=0.2 * elastica(chord / 0.2), source="a thin bar without extension, in closed form",
            why="the paper prints no number",
        ),
    ]


def profile(frame: piola.Frame, title: str) -> Cloud:
    """The bar from the side."""
    x = frame.positions + frame["displacement"]
    size = np.linalg.norm(frame["displacement"], axis=1)
    return Cloud(title, x[:, 0].tolist(), x[:, 2].tolist(), size.tolist(), "displacement, m", 6.0)
