"""Content of HTML pages as plain data, which `page_file.write_page` writes.

A page with one case and without columns is the page of a run: it has no case table. The order of
every page is motion, curves, results, error budget, solver.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Required, TypedDict

# Animation, as returned by `beamdae.report.scene.frame_export.export_frames`.
Frames = Mapping[str, Any]

# Curves, as returned by `beamdae.report.page.page_data.select_curves`: arrays "t" [s] and, at these
# times, arrays by name for each panel: "observed", "energy", "error", "drift"; or "magnitude" and
# "phase" of a transfer function, with frequencies as "t".
Curves = Mapping[str, Any]

# Section of a page: "results" (default), "motion" (below the animation), "errors" or "solver".
Section = str


class PageReference(TypedDict, total=False):
    """Reference solution for the errors of a group."""

    methods: list[str]
    uncertainty: float | None  # the smallest error that the reference resolves
    accepted: Required[bool]
    sentence: Required[str]


class PageGroup(TypedDict, total=False):
    """Cases that are compared with each other, for example cases with equal parameters."""

    id: Required[str]
    label: str
    reference: PageReference | None
    frames: Frames | None


class PageColumn(TypedDict, total=False):
    """Column of the case table.

    Columns of the kinds "error" and "cost" show the entries "error" and "cost" of each case. The
    label of a case (key "label") and its status always come first. Columns with the section
    "solver" are hidden initially.
    """

    key: Required[str]
    label: Required[str]
    unit: Required[str]
    kind: Required[str]  # "text", "number", "status", "error" or "cost"
    section: Section


class PageTable(TypedDict, total=False):
    """Table of facts."""

    title: str
    head: list[str]  # names of the columns
    rows: Required[Sequence[Sequence[str]]]
    section: Section


class PageCase(TypedDict, total=False):
    """Run, design, mode or point, with a row of the case table and curves."""

    id: Required[str]
    group: Required[str]
    label: str
    family: str  # determines color and legend entry, for example the integrator
    series: str | None  # cases of the same series are connected by a line
    rank: float | None  # orders the cases of a series, and the table by label
    status: str  # "ok" or a sentence
    values: Mapping[str, Any]  # by key of the column
    error: float | None
    cost: float | None  # [s]
    below: bool  # True if the error is below the resolution of the reference
    limited: bool  # True if a limit stopped the run
    dashed: bool  # True if lines to the case are dashed
    at: Sequence[int] | None  # index of its value for each slider
    frames: Frames | None  # its own animation
    points: bool  # measured data, drawn as points and selected with their model at first
    file: str  # name of the file with its rows
    curves: Curves | None


class PageAxes(TypedDict, total=False):
    """Keys of the columns that a chart shows initially."""

    x: str
    y: str | None


class PageSlider(TypedDict):
    """Swept parameter; sliders select the motion of the nearest case with "frames"."""

    label: str
    unit: str
    values: Sequence[Any]  # ascending


class PageTime(TypedDict, total=False):
    """Quantity that takes the place of the time, such as the load factor of a path."""

    name: str
    unit: str
    log: bool  # True for a logarithmic axis


class PagePortrait(TypedDict):
    """Columns that a chart initially shows over each other."""

    x: str
    y: str
    marks: Sequence[Mapping[str, Any]]  # "t" and "label"


class PageOverlay(TypedDict):
    """Lines and marks of the scatter plot for a pair of axes.

    Lines and marks have the entries "label", "x" and "y": lists of numbers for lines, numbers for
    marks.
    """

    x: str  # key of the column
    y: str
    lines: Sequence[Mapping[str, Any]]
    marks: Sequence[Mapping[str, Any]]


class PageContent(TypedDict, total=False):
    """Content of a page."""

    title: str
    subtitle: str
    made: Mapping[str, str]  # versions by package name
    notes: list[str]
    noun: str  # what the cases are; "cases" by default
    groups: list[PageGroup]
    columns: list[PageColumn]
    # The scatter plot. The user can select error, cost and numeric columns. Defaults to error over
    # cost if available; None for no scatter plot.
    axes: PageAxes | None
    sliders: list[PageSlider]
    map: list[int] | None  # the two sliders that are the axes of a map of a response
    # Families that have the first colors and markers, in this order; with two or more, there is a
    # legend even if only one of them occurs. Others follow in the order of the cases.
    families: list[str]
    sequential: bool  # True if the families follow a parameter; their colors form a sequence
    time: PageTime
    portrait: PagePortrait | None
    overlays: list[PageOverlay]
    # Ranges that charts show first, by key of the chart ("scatter") and axis ("x", "y"), as pairs
    # of numbers; the button "Reset" shows all.
    views: Mapping[str, Mapping[str, Sequence[float]]]
    leads: bool  # True if the scatter plot is the main result, shown first beside the motion
    # Observed columns that are listed first. Defaults to those that characterize the motion.
    featured: list[str]
    tables: list[PageTable]
    cases: list[PageCase]
