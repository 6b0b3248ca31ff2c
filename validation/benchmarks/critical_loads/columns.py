"""Columns and frames of straight members under dead loads: buckling without bending before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from benchmarks.critical_loads.case import branches
from benchmarks.critical_loads.frame_stability import (
    FrameDescription,
    Member,
    frame_critical_loads,
)
from benchmarks.critical_loads.structures import build_frame, stiffness

Springs = Mapping[str, tuple[float, float, float]]

# First-order difference between Engesser's formula with Green's stretch and frames that rotate
# with a chord, times the largest P / EA = P L^2 / (12 s^2 EI) of the cases.
_GREEN_DEPARTURE = 0.5


def frame(description: FrameDescription, end: float) -> dict[str, Any]:
    """Return the fields of the case of a frame loaded up to `end` [EI / L^2]."""
    return {
        "build": partial(build_frame, description),
        "reference": lambda slenderness, strain: branches(
            frame_critical_loads(description, stiffness(slenderness, strain), end)
        ),
        "path": lambda slenderness: {"to": end},
        "phase": description.wave_angle,
        "green_departure": _GREEN_DEPARTURE * end,
    }


def column(supports: Mapping[str, str], springs: Springs | None = None) -> FrameDescription:
    """Return a column from the foot "a" to the head "b", loaded at its head."""
    nodes = {"a": (0.0, 0.0), "b": (0.0, 1.0)}
    members = (Member("a", "b", 1.0),)
    return FrameDescription(nodes, members, supports, {"b": (0.0, -1.0)}, springs or {})


def stack(
    heights: tuple[float, ...],
    supports: Mapping[str, str],
    compressions: tuple[float, ...] | None = None,
    widths: tuple[float, ...] | None = None,
    springs: Springs | None = None,
    hinges: tuple[int, ...] = (),
) -> FrameDescription:
    """Return a straight column through nodes at the given heights, numbered from 0.

    `compressions` are the axial forces of the parts per unit load; each node carries the
    difference of the parts below and above it. `hinges` are the nodes with an internal hinge.
    """
    count = len(heights) - 1
    compressions, widths = compressions or (1.0,) * count, widths or (1.0,) * count
    members = tuple(
        Member(str(k), str(k + 1), compressions[k], widths[k], "a" if k in hinges else "")
        for k in range(count)
    )
    above = (*compressions[1:], 0.0)
    loads = {
        str(k + 1): (0.0, upper - lower)
        for k, (lower, upper) in enumerate(zip(compressions, above, strict=True))
        if lower != upper
    }
    return FrameDescription(
        {str(k): (0.0, height) for k, height in enumerate(heights)},
        members,
        supports,
        loads,
        springs or {},
    )


def winkler(count: int, modulus: float) -> FrameDescription:
    """Return a hinged column on `count` equal springs between its ends, of `modulus` [EI / L^4]."""
    heights = tuple(k / (count + 1) for k in range(count + 2))
    names = map(str, range(1, count + 1))
    springs = dict.fromkeys(names, (modulus / (count + 1), 0.0, 0.0))
    return stack(heights, {"0": "xy", str(count + 1): "x"}, springs=springs)


def portal(
    feet: str, braced: bool = False, beam: float = 1.0, bays: int = 1, stories: int = 1
) -> FrameDescription:
    """Return a frame of unit bays and stories under a unit load on the head of each column.

    `feet` are the fixed displacements of the feet; with `braced`, the floors do not sway. The
    inner columns of several bays are loaded like the outer ones. `beam` is the relative width of
    the beams.
    """
    nodes, members, supports, loads = {}, [], {}, {}
    for i in range(bays + 1):
        supports[f"{i}0"] = feet
        for j in range(stories + 1):
            nodes[f"{i}{j}"] = (float(i), float(j))
        members += [Member(f"{i}{j}", f"{i}{j + 1}", 1.0) for j in range(stories)]
        loads[f"{i}{stories}"] = (0.0, -1.0)
    for j in range(1, stories + 1):
        members += [Member(f"{i}{j}", f"{i + 1}{j}", width=beam) for i in range(bays)]
        if braced:
            supports[f"0{j}"] = "x"
    return FrameDescription(nodes, tuple(members), supports, loads)


def closed_square() -> FrameDescription:
    """Return a square of welded bars whose uprights are compressed, held against sway."""
    nodes = {"a": (0.0, 0.0), "b": (0.0, 1.0), "c": (1.0, 0.0), "d": (1.0, 1.0)}
    members = (Member("a", "b", 1.0), Member("c", "d", 1.0), Member("a", "c"), Member("b", "d"))
    loads = {"b": (0.0, -1.0), "d": (0.0, -1.0)}
    return FrameDescription(nodes, members, {"a": "xy", "c": "y", "b": "x"}, loads)


def leaning_column() -> FrameDescription:
    """Return a cantilever that stabilizes a hinged, equally loaded column through a link."""
    nodes = {"a": (0.0, 0.0), "b": (0.0, 1.0), "c": (0.5, 0.0), "d": (0.5, 1.0)}
    members = (
        Member("a", "b", 1.0),
        Member("c", "d", 1.0),
        Member("b", "d", hinges="ab"),
    )
    loads = {"b": (0.0, -1.0), "d": (0.0, -1.0)}
    return FrameDescription(nodes, members, {"a": "xyr", "c": "xy"}, loads)


def tie_braced_column() -> FrameDescription:
    """Return a hinged column with two stays from a cross-arm at mid-height, not prestressed."""
    nodes = {
        "a": (0.0, 0.0),
        "o": (0.0, 0.5),
        "b": (0.0, 1.0),
        "l": (-0.2, 0.5),
        "r": (0.2, 0.5),
    }
    members = (
        Member("a", "o", 1.0),
        Member("o", "b", 1.0),
        Member("o", "l"),
        Member("o", "r"),
    )
    springs = {"l": (40.0, 0.0, 0.0), "r": (40.0, 0.0, 0.0)}
    return FrameDescription(nodes, members, {"a": "xy", "b": "x"}, {"b": (0.0, -1.0)}, springs)


FRAMES: dict[str, Callable[..., FrameDescription]] = {
    "column": column,
    "stack": stack,
    "winkler": winkler,
    "portal": portal,
    "closed square": closed_square,
    "leaning column": leaning_column,
    "braced column": tie_braced_column,
}
