"""What a study of a figure or a table finds: lines to draw, and rows that compare with the paper."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from running import Run

PAPERS = ("javili2020", "firooz2023", "miranda", "ganzenmueller2015", "partmann2026")

# Numbers agree if they differ by no more than this part, or by what the paper's digits leave open.
AGREES = 0.01


@dataclass(kw_only=True)
class Judged:
    """What a row says beside what it compares."""

    source: str = ""
    """Who has the independent number."""
    correction: str = ""
    """What had to be changed in what the paper says so that its number comes out."""
    why: str = ""
    """Why the two differ, or cannot be compared."""
    timed: bool = False
    """A time, which no two runs have alike."""
    cheap: bool = True
    """Whether the short version of the study has this row, too."""

    def judged(self, holds: bool, refuted: bool) -> str:
        """The verdict on a row that can be compared."""
        if holds:
            return "agrees after a correction" if self.correction else "agrees"
        return "refuted" if refuted else "differs"


@dataclass
class Number(Judged):
    """A number of the paper beside ours."""

    what: str
    ours: float
    published: float | None = None
    """None where the paper prints no number: then `why` says so."""
    reading: float = 0.0
    """Half of the last digit that is printed, or what could be read off a figure; in the unit of the number."""
    unit: str = ""
    independent: float | None = None
    """The same quantity by another program or in closed form."""
    rounding: float = 0.0
    """What rounding leaves open of `ours`, where that is more than the digits of the page: processors differ by it."""

    @property
    def verdict(self) -> str:
        if self.published is None:
            return "not comparable"
        within = max(self.reading, AGREES * abs(self.published))
        other = self.independent
        refuted = other is not None and abs(self.ours - other) <= AGREES * abs(other)
        return self.judged(abs(self.ours - self.published) <= within, refuted)


@dataclass
class Claim(Judged):
    """A statement of the paper, and whether it holds here."""

    what: str
    published: str
    ours: str
    holds: bool
    refuted: bool = False
    """Whether an independent number, which `source` names, says as we do."""

    @property
    def verdict(self) -> str:
        return self.judged(self.holds, self.refuted)


Row = Number | Claim


@dataclass
class Line:
    """Values against values; published ones are drawn as crosses with their uncertainty."""

    name: str
    x: list[float]
    y: list[float]
    published: bool = False
    reading: float = 0.0
    style: str = ""
    """As Matplotlib has it, `"o-"`, `"--"`."""


@dataclass
class Panel:
    """Axes with lines."""

    title: str
    x: str
    y: str
    lines: list[Line]
    log: str = ""
    """Which axes are logarithmic: "", "x", "y", "xy"."""


@dataclass
class Picture:
    """A picture of a body, as the program draws it."""

    title: str
    png: bytes


@dataclass
class Map:
    """Values in a plane, a row of pixels per row: fields of lattices, patterns of matrices."""

    title: str
    values: list[list[float]]
    label: str
    range: tuple[float, float] | None = None
    colours: str = "viridis"


@dataclass
class Cloud:
    """Points in a plane with their colours."""

    title: str
    x: list[float]
    y: list[float]
    values: list[float]
    label: str
    size: float = 4.0
    range: tuple[float, float] | None = None


@dataclass
class Found:
    """What a study finds."""

    rows: list[Row]
    panels: list[Panel | Picture | Map | Cloud] = field(default_factory=list)
    notes: str = ""
    """A paragraph for the page: settings that the paper leaves open, what was tried, why numbers differ."""
    columns: int = 0
    """How many panels stand side by side; 0 for as many as look well."""


Body = Callable[["Run"], Found]


@dataclass
class Study:
    """A figure or table with what computes it. Nothing computes what only draws a concept: `draws` says what."""

    paper: str
    name: str
    """`fig08`, `table06`, in the order of the page."""
    label: str
    """`Fig. 8`."""
    title: str
    body: Body | None = None
    draws: str = ""

    @property
    def key(self) -> str:
        return f"{self.paper}/{self.name}"


STUDIES: list[Study] = []


def figure(paper: str, label: str, title: str) -> Callable[[Body], Body]:
    """Enters a study under the label of its figure or table."""

    def enter(body: Body) -> Body:
        STUDIES.append(Study(paper, _name(label), label, title, body))
        return body

    return enter


def drawing(paper: str, label: str, draws: str) -> None:
    """Enters a figure or table that reports no computation."""
    STUDIES.append(Study(paper, _name(label), label, "", None, draws))


def _name(label: str) -> str:
    match = re.fullmatch(r"(Fig\.|Table|Eq\.|Section|Algorithm) (\d+)(.*)", label)
    assert match, f"{label}: write `Fig. 8` or `Table 3`"
    rest = re.sub(r"[^a-z0-9]+", "-", match[3].lower()).rstrip("-")
    return f"{match[1].lower().rstrip('.')}{int(match[2]):02d}{rest}"


def plain_value(value: Any) -> Any:
    """A number or truth value of NumPy as one of Python."""
    return value.item() if hasattr(value, "item") else value


def as_json(found: Found) -> list[dict[str, Any]]:
    """The rows, each with its verdict, as they are recorded."""

    def plain(row: Row) -> dict[str, Any]:
        kept = {
            one.name: plain_value(getattr(row, one.name))
            for one in dataclasses.fields(row)
            if getattr(row, one.name) != one.default
        }
        return {"kind": type(row).__name__.lower(), **kept, "verdict": row.verdict}

    return [plain(row) for row in found.rows]


def counted(verdicts: Iterable[str]) -> dict[str, int]:
    """How often each verdict was given."""
    order = ("agrees", "agrees after a correction", "refuted", "differs", "not comparable")
    given = list(verdicts)
    assert set(given) <= set(order), given
    return {one: given.count(one) for one in order}
