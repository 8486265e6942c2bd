"""The block of scene.toml by piola and by LAMMPS with its bonds, and pmb.toml against peri/pmb: `run` calls it."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import body

PIOLA, OUT = sys.argv[1], Path(sys.argv[2])
HERE = Path(__file__).parent
LMP, MPIEXEC = OUT / "venv/bin/lmp", OUT / "venv/bin/mpiexec"
HORIZON, SPACING, DENSITY, K = 3.015e-3, 1e-3, 7800.0, 140e9
C = 18 * K / (np.pi * HORIZON**4)


def call(words, name):
    """Runs a program, its messages to NAME.txt; its time on the clock and on processors in s."""
    with open(OUT / f"{name}.txt", "w") as said:
        began = time.perf_counter()
        process = subprocess.Popen([str(w) for w in words], stdout=said, stderr=subprocess.STDOUT)
        _, status, used = os.wait4(process.pid, 0)
        wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        sys.exit(f"{words[0]} failed:\n" + (OUT / f"{name}.txt").read_text()[-2000:].strip())
    return wall, used.ru_utime + used.ru_stime


def piola(scene, name, **settings):
    sets = [w for key, value in settings.items() for w in ("--set", f"{key.replace('__', '.')}={value}")]
    return call([PIOLA, "run", HERE / scene, "--threads", 1, "--out", OUT / name, *sets], name)


def lammps(script, name, before=(), **variables):
    variables["dump"] = OUT / f"{name}.dump"
    words = [w for key, value in variables.items() for w in ("-var", key, value)]
    return call([*before, LMP, "-in", HERE / script, "-log", OUT / f"{name}.log", *words], name)


def within(what, found, bound):
    print(f"{what:<72} {found:8.1e}, at most {bound:.0e}", flush=True)
    assert found <= bound, f"{what}: {found:.3e} is more than {bound:.0e}"


def off(found, expected):
    """The largest difference over the largest entry."""
    return np.abs(found - expected).max() / np.abs(expected).max()


def numbers_agree():
    piola("scene.toml", "piola")
    moved = body.summary(OUT / "piola")["motion"]
    step, steps = moved["step_seconds"], moved["steps_made"]
    start, end = (body.frame(OUT / f"piola/frames/frame_{k:06}.vtu") for k in (0, 1))
    account = np.genfromtxt(OUT / "piola/motion.csv", delimiter=",", names=True)
    pairs = body.bonds(start["Points"], HORIZON)
    expected = body.summary(OUT / "piola")["interactions"]["bonds"]
    assert len(pairs) == expected, f"{len(pairs)} bonds, of piola {expected}"
    body.write_data(OUT / "block.data", start, DENSITY, pairs)
    given = {"plugin": OUT / "hencky_bonds.so", "data": OUT / "block.data", "horizon": HORIZON}
    lammps("in.block", "lammps", step=repr(step), steps=steps, every=10, **given)
    first, last = body.dump(OUT / "lammps.dump")
    table, _ = body.log(OUT / "lammps.log")
    print(f"{len(start['Points'])} points, {len(pairs)} bonds, {steps} steps of {step:.1e} s")

    # The law once more, by hand.
    x, X, V = start["Points"] + start["displacement"], start["Points"], start["volume"]
    i, j = pairs.T
    d, D = x[i] - x[j], X[i] - X[j]
    l, L = np.linalg.norm(d, axis=1), np.linalg.norm(D, axis=1)
    weight = V[i] * V[j]
    energy = np.sum(weight * C / 2 * L * np.log(l / L) ** 2)
    pull = (weight * C * L * np.log(l / L) / l**2)[:, None] * d
    forces = np.zeros_like(x)
    np.add.at(forces, i, -pull)
    np.add.at(forces, j, pull)
    print(f"bonds at the start are {np.min(l / L):.3f} to {np.max(l / L):.3f} of their length at rest")

    within("forces at the start: LAMMPS and NumPy", off(first[:, 6:9], forces), 1e-12)
    within("forces at the start: LAMMPS and piola", off(first[:, 6:9], -start["residual"]), 1e-12)
    within("energy at the start: LAMMPS and NumPy", abs(table[0, 1] / energy - 1), 1e-12)
    rows = account[table[:, 0].astype(int)]
    assert (rows["step"] == table[:, 0]).all()
    within("potential energies of the motion: LAMMPS and piola", off(table[:, 1], rows["stored"]), 1e-11)
    within("kinetic energies of the motion: LAMMPS and piola", off(table[:, 2], rows["kinetic"]), 1e-11)
    u = end["displacement"]
    within("places at the end: LAMMPS and piola, of the largest displacement",
           np.abs(last[:, 0:3] - (end["Points"] + u)).max() / np.abs(u).max(), 1e-10)
    within("velocities at the end: LAMMPS and piola", off(last[:, 3:6], end["velocity"]), 1e-10)

    # Velocity Verlet: the total energy swings with the square of the step, and does not drift.
    lammps("in.block", "halved", step=repr(step / 2), steps=2 * steps, every=20, **given)
    total, halved = table[:, 3], body.log(OUT / "halved.log")[0][:, 3]
    swing, smaller = np.abs(total - total[0]).max(), np.abs(halved - total[0]).max()
    within("total energy: how far it swings", swing / total[0], 2e-2)
    within("total energy: the swing with half the step over that, less 1/4", abs(smaller / swing - 0.25), 3e-2)
    drift = np.polyfit(table[:, 0] / steps, total / total[0], 1)[0]
    within("total energy: drift of the whole run, as a straight line", abs(drift), 2e-3)

    lammps("in.block", "two", before=[MPIEXEC, "-n", 2], step=repr(step), steps=2, every=1, **given)
    within("forces at the start: LAMMPS on two processes and piola",
           off(body.dump(OUT / "two.dump")[0][:, 6:9], -start["residual"]), 1e-12)


def times():
    few, many, step = 100, 600, 1e-7
    piola("pmb.toml", "start", motion__end=repr(step))
    start = body.frame(OUT / "start/frames/frame_000000.vtu")
    pairs = body.bonds(start["Points"], HORIZON)
    body.write_data(OUT / "large.data", start, DENSITY, pairs)
    body.write_peri(OUT / "peri.data", start, DENSITY)

    def of_piola(name, volumes, **settings):
        return lambda steps: piola("pmb.toml", f"{name}_{volumes}_{steps}", motion__end=repr(steps * step),
                                   horizon__volumes=f'"{volumes}"', **settings)

    def of_plugin(name):
        return lambda steps: lammps("in.block", f"{name}_{steps}", plugin=OUT / f"{name}.so",
                                    data=OUT / "large.data", horizon=HORIZON, step=step, steps=steps,
                                    every=steps)

    def of_peri(steps):
        return lammps("in.peri", f"peri_{steps}", data=OUT / "peri.data", c=repr(C), horizon=HORIZON,
                      spacing=SPACING, step=step, steps=steps)

    def cost(label, run):
        """Times of the whole run; what a step takes is that of many steps less that of few."""
        (_, cpu_few), (wall, cpu) = run(few), run(many)
        per_step = (cpu - cpu_few) / (many - few)
        print(f"{label:<50} {wall:8.2f} {cpu:8.2f} {1e9 * per_step / len(pairs):12.1f}", flush=True)
        return wall, cpu, per_step

    print(f"\n{len(start['Points'])} points, {len(pairs)} bonds, {many} steps, one thread")
    print(f"{'':<50} {'clock, s':>8} {'cpu, s':>8} {'ns/bond/step':>12}")
    cost("law.piola: piola run", of_piola("law", "whole", material__potential='"law.piola"'))
    cost("law.piola: LAMMPS, bond_style piola", of_plugin("hencky_bonds"))
    cost("silling2000: piola run", of_piola("silling2000", "whole"))
    cost("silling2000: LAMMPS, bond_style piola", of_plugin("silling2000"))
    ours = cost("silling2000, partial volumes: piola run", of_piola("silling2000", "partial"))
    theirs = cost("silling2000, partial volumes: LAMMPS, peri/pmb", of_peri)
    ratios = [b / a for a, b in zip(ours, theirs)]
    print("peri/pmb over piola: clock {:.1f}, cpu {:.1f}, cpu of a step {:.1f}".format(*ratios))
    end = body.frame(OUT / f"silling2000_partial_{many}/frames/frame_000001.vtu")
    last, u = body.dump(OUT / f"peri_{many}.dump")[-1], end["displacement"]
    within("places at the end: peri/pmb and piola, of the largest displacement",
           np.abs(last[:, 0:3] - (end["Points"] + u)).max() / np.abs(u).max(), 1e-10)


numbers_agree()
times()
print("all within their bounds")
