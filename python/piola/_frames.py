"""Frames of a run, `.vtu` files or pieces that a `.pvtu` lists, as arrays."""

from __future__ import annotations

import operator
import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

_START = b'<AppendedData encoding="raw">\n_'


@dataclass
class Frame:
    """A body at one time: arrays with a row per point."""

    t: float
    """Load parameter, or time in s."""
    path: str
    """The file."""
    positions: NDArray[np.float64]
    """At rest, in m, with three components."""
    fields: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """`displacement` (m), `residual` (N), `volume` (m^d) and what else the scene asks for."""

    def __repr__(self) -> str:
        return f"<Frame t={self.t:g}: {', '.join(self.fields)} at {len(self.positions)} points>"

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.fields[name]


def read_frames(folder: str) -> list[Frame]:
    """The frames that `run.pvd` lists, without the meshes beside them."""
    root = ElementTree.parse(os.path.join(folder, "run.pvd")).getroot()
    sets = [one for one in root.iter("DataSet") if one.get("part") == "0"]
    return [read_frame(os.path.join(folder, str(one.get("file")))) for one in sets]


def read_frame(path: str) -> Frame:
    """One frame, whole or in the pieces that a `.pvtu` lists."""
    if not path.endswith(".pvtu"):
        return _read_file(path)
    sources = [str(one.get("Source")) for one in ElementTree.parse(path).getroot().iter("Piece")]
    pieces = [_read_file(os.path.join(os.path.dirname(path), os.path.basename(source))) for source in sources]
    places = [piece.fields.pop("point").astype(np.int64) for piece in pieces]
    n = 1 + max(int(own.max()) for own in places)

    def whole(of: Callable[[Frame], NDArray[np.float64]]) -> NDArray[np.float64]:
        rows = np.full((n, *of(pieces[0]).shape[1:]), np.nan)
        for piece, own in zip(pieces, places, strict=True):
            rows[own] = of(piece)
        return rows

    fields = {name: whole(operator.methodcaller("__getitem__", name)) for name in pieces[0].fields}
    return Frame(t=pieces[0].t, path=path, positions=whole(lambda piece: piece.positions), fields=fields)


def _read_file(path: str) -> Frame:
    with open(path, "rb") as file:
        raw = file.read()
    start = raw.index(_START)
    header = raw[:start].decode() + "</VTKFile>"
    appended = raw[start + len(_START) :]
    root = ElementTree.fromstring(header)
    time = next(one for one in root.iter("DataArray") if one.get("Name") == "TimeValue")
    t = float(time.text or "nan")
    fields = {}
    positions = np.zeros((0, 3))
    for data in root.iter("PointData"):
        for one in data.iter("DataArray"):
            fields[str(one.get("Name"))] = _array(one, appended)
    for data in root.iter("Points"):
        for one in data.iter("DataArray"):
            positions = _array(one, appended)
    return Frame(t=t, path=path, positions=positions, fields=fields)


def _array(element: ElementTree.Element, appended: bytes) -> NDArray[np.float64]:
    at = int(str(element.get("offset")))
    blocks = int.from_bytes(appended[at : at + 8], "little")
    sizes = np.frombuffer(appended, "<u8", blocks, at + 24)
    at += 24 + 8 * blocks
    parts = []
    for size in sizes:
        parts.append(zlib.decompress(appended[at : at + int(size)]))
        at += int(size)
    values = np.frombuffer(b"".join(parts), "<f8")
    width = int(element.get("NumberOfComponents") or 1)
    return values if width == 1 else values.reshape(-1, width)
