"""The picture of a study: ours as lines, the paper's as crosses, in the same axes."""

from __future__ import annotations

import io
import math
import textwrap
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.colors as mcolors
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from PIL import Image

from study import Cloud, Found, Map, Panel, Picture

# Pages show some fifty of these, hence few colours: those of lines for certain, and the most frequent others.
COLOURS = 192
KEPT = [round(255 * part) for name in (*mcolors.TABLEAU_COLORS, "black", "white") for part in mcolors.to_rgb(name)]
# Of a picture in bytes; rather coarser than larger.
LARGEST = 190_000


def draw(found: Found, title: str, path: Path) -> None:
    """Writes the picture; nothing where there are no panels."""
    panels = found.panels
    if not panels:
        return
    columns = found.columns or min(len(panels), 3 if len(panels) in (3, 5, 6) else 2)
    rows = math.ceil(len(panels) / columns)
    size = (4.6 * columns if columns > 1 else 6.0, 3.6 * rows + 0.3)
    chart, axes = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    chart.suptitle(textwrap.fill(title, int(11 * size[0])), fontsize=11)
    places = axes.flatten()
    for place, panel in zip(places, panels, strict=False):
        place.set_title(panel.title, fontsize=9)
        match panel:
            case Panel():
                _lines(place, panel)
            case Picture():
                place.imshow(Image.open(io.BytesIO(panel.png)))
                place.axis("off")
            case Map():
                _map(place, panel)
            case Cloud():
                _cloud(place, panel)
    for place in places[len(panels) :]:
        place.axis("off")
    for dpi in (110, 90, 75, 60):
        drawn = io.BytesIO()
        chart.savefig(drawn, dpi=dpi)
        _reduced(Image.open(drawn).convert("RGB")).save(path, optimize=True)
        if path.stat().st_size <= LARGEST:
            break
    plt.close(chart)


def _reduced(picture: Image.Image) -> Image.Image:
    """By the most frequent colours alone, thin lines would take that of another."""
    own = picture.quantize(COLOURS - len(KEPT) // 3).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*own[: 3 * COLOURS - len(KEPT)], *KEPT])
    reduced = picture.quantize(palette=palette, dither=Image.Dither.NONE)
    # Pages are white where a picture is nearly so.
    shown = np.array(reduced.getpalette()).reshape(-1, 3)
    shown[shown.min(axis=1) >= 250] = 255
    reduced.putpalette(shown.flatten().tolist())
    return reduced


def _lines(place: Axes, panel: Panel) -> None:
    for line in panel.lines:
        if line.published:
            error = line.reading or None
            place.errorbar(line.x, line.y, yerr=error, fmt="x", color="black", ms=6, capsize=2, label=line.name)
        else:
            place.plot(line.x, line.y, line.style or "o-", ms=3.5, lw=1.2, label=line.name)
    if "x" in panel.log:
        place.set_xscale("log")
    if "y" in panel.log:
        place.set_yscale("log")
    place.set_xlabel(panel.x, fontsize=8)
    place.set_ylabel(panel.y, fontsize=8)
    place.tick_params(labelsize=7)
    place.grid(True, lw=0.3)
    if len(panel.lines) > 1:
        place.legend(fontsize=6.5)


def _map(place: Axes, panel: Map) -> None:
    low, high = panel.range or (None, None)
    shown = place.imshow(np.array(panel.values), origin="lower", cmap=panel.colours, vmin=low, vmax=high)
    place.set_xticks([])
    place.set_yticks([])
    place.figure.colorbar(shown, ax=place, shrink=0.8).set_label(panel.label, fontsize=7)


def _cloud(place: Axes, panel: Cloud) -> None:
    low, high = panel.range or (None, None)
    shown = place.scatter(panel.x, panel.y, c=panel.values, s=panel.size, vmin=low, vmax=high, linewidths=0)
    place.set_aspect("equal")
    place.tick_params(labelsize=6)
    place.figure.colorbar(shown, ax=place, shrink=0.8).set_label(panel.label, fontsize=7)
