"""Bodies between piola and LAMMPS: frames and tables in, data files out, dumps in."""

import json
import re
import struct
import zlib
from pathlib import Path

import numpy as np


def frame(path):
    """The arrays of a frame of piola, by their names; `Points` are places at rest."""
    raw = Path(path).read_bytes()
    head, _, data = raw.partition(b'<AppendedData encoding="raw">\n_')
    found = {}
    pattern = rb'type="Float64" Name="(\w+)" NumberOfComponents="(\d)" format="appended" offset="(\d+)"'
    for name, columns, offset in re.findall(pattern, head):
        at = int(offset)
        (blocks,) = struct.unpack_from("<Q", data, at)
        sizes = struct.unpack_from(f"<{blocks}Q", data, at + 24)
        at += 24 + 8 * blocks
        parts = []
        for size in sizes:
            parts.append(zlib.decompress(data[at : at + size]))
            at += size
        values = np.frombuffer(b"".join(parts))
        found[name.decode()] = values.reshape(-1, int(columns)).squeeze()
    return found


def bonds(points, horizon):
    """Pairs of points within the horizon, by their places in the list."""
    horizon *= 1 + 1e-6
    order = np.argsort(points[:, 0], kind="stable")
    sorted_points = points[order]
    ends = np.searchsorted(sorted_points[:, 0], sorted_points[:, 0] + horizon, side="right")
    pairs = []
    for i, end in enumerate(ends):
        away = sorted_points[i + 1 : end] - sorted_points[i]
        near = i + 1 + np.flatnonzero(np.einsum("ij,ij->i", away, away) <= horizon**2)
        pairs.append(np.column_stack([np.full(len(near), i), near]))
    return order[np.concatenate(pairs)]


def write_data(path, start, density, pairs):
    """A data file of LAMMPS with the points of a frame, in its order, and bonds of type 1."""
    rest, volume = start["Points"], start["volume"]
    x = rest + start["displacement"]
    number = np.arange(1, len(rest) + 1)
    margin = 1e-3 * np.ptp(x)
    with open(path, "w") as file:
        file.write("a body of piola\n\n")
        file.write(f"{len(rest)} atoms\n{len(pairs)} bonds\n1 atom types\n1 bond types\n")
        for axis, name in enumerate("xyz"):
            low, high = x[:, axis].min() - margin, x[:, axis].max() + margin
            file.write(f"{low:.17g} {high:.17g} {name}lo {name}hi\n")
        file.write("\nAtoms # bond\n\n")
        np.savetxt(file, np.column_stack([number, x]), fmt="%d 1 1 %.17g %.17g %.17g")
        file.write("\nVelocities\n\n")
        np.savetxt(file, np.column_stack([number, start["velocity"]]), fmt="%d" + 3 * " %.17g")
        file.write("\nPoints\n\n")
        rows = np.column_stack([number, density * volume, volume, rest])
        np.savetxt(file, rows, fmt="%d" + 5 * " %.17g")
        file.write("\nBonds\n\n")
        rows = np.column_stack([np.arange(1, len(pairs) + 1), pairs + 1])
        np.savetxt(file, rows, fmt="%d 1 %d %d")


def write_peri(path, start, density):
    """A data file of atom style peri with the points of a frame at rest and their velocities."""
    rest, volume = start["Points"], start["volume"]
    number = np.arange(1, len(rest) + 1)
    margin = 1e-3 * np.ptp(rest)
    with open(path, "w") as file:
        file.write(f"a body of piola\n\n{len(rest)} atoms\n1 atom types\n")
        for axis, name in enumerate("xyz"):
            low, high = rest[:, axis].min() - margin, rest[:, axis].max() + margin
            file.write(f"{low:.17g} {high:.17g} {name}lo {name}hi\n")
        file.write("\nAtoms # peri\n\n")
        rows = np.column_stack([number, volume, np.full(len(rest), density), rest])
        np.savetxt(file, rows, fmt="%d 1" + 5 * " %.17g")
        file.write("\nVelocities\n\n")
        np.savetxt(file, np.column_stack([number, start["velocity"]]), fmt="%d" + 3 * " %.17g")


def dump(path):
    """Every snapshot of a dump, as a table of its columns without the id."""
    snapshots = []
    lines = Path(path).read_text().splitlines()
    at = 0
    while at < len(lines):
        count = int(lines[at + 3])
        rows = np.array([line.split() for line in lines[at + 9 : at + 9 + count]], dtype=float)
        assert (rows[:, 0] == np.arange(1, count + 1)).all()
        snapshots.append(rows[:, 1:])
        at += 9 + count
    return snapshots


def log(path):
    """The thermo table of a log, and the wall time of its loop in s."""
    text = Path(path).read_text()
    table = re.search(r"^ *Step .*\n((?: *\d.*\n)+)Loop time of (\S+)", text, re.M)
    rows = [line.split() for line in table[1].splitlines()]
    return np.array(rows, dtype=float), float(table[2])


def summary(folder):
    return json.loads((Path(folder) / "summary.json").read_text())
