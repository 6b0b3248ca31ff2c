"""Columns and frames of straight members under dead loads: buckling without bending before it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from benchmarks.critical_loads.case import BRANCH, CriticalLoad, CriticalLoadCase
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


def reference(
    frame: FrameDescription, end: float, slenderness: float, strain: str
) -> tuple[CriticalLoad, ...]:
    """Return the branch points of a frame up to the load `end`."""
    loads = frame_critical_loads(frame, stiffness(slenderness, strain), end)
    return tuple(CriticalLoad(BRANCH, load) for load in loads)


def frame_case(
    group: str,
    name: str,
    source: str,
    frame: FrameDescription,
    end: float,
    published: float | None = None,
    digits: float = 1e-3,
    **settings: Any,
) -> CriticalLoadCase:
    """Return the case of a frame loaded up to `end` [EI / L^2] under load control."""
    return CriticalLoadCase(
        group,
        name,
        source,
        build=partial(build_frame, frame),
        reference=partial(reference, frame, end),
        path=lambda slenderness: {"to": end},
        phase=frame.wave_angle,
        published=published,
        digits=digits,
        green_departure=_GREEN_DEPARTURE * end,
        **settings,
    )


def column(supports: Mapping[str, str], springs: Springs | None = None) -> FrameDescription:
    """Return a column from the foot "a" to the head "b", loaded at its head."""
    nodes = {"a": (0.0, 0.0), "b": (0.0, 1.0)}
    members = (Member("a", "b", 1.0),)
    return FrameDescription(nodes, members, supports, {"b": (0.0, -1.0)}, springs or {})


def stack(
    heights: tuple[float, ...],
    supports: Mapping[int, str],
    compressions: tuple[float, ...] | None = None,
    widths: tuple[float, ...] | None = None,
    springs: Mapping[int, tuple[float, float, float]] | None = None,
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
        {str(k): axes for k, axes in supports.items()},
        loads,
        {str(k): value for k, value in (springs or {}).items()},
    )


def winkler(count: int, modulus: float) -> FrameDescription:
    """Return a hinged column on `count` equal springs between its ends, of `modulus` [EI / L^4]."""
    heights = tuple(k / (count + 1) for k in range(count + 2))
    springs = dict.fromkeys(range(1, count + 1), (modulus / (count + 1), 0.0, 0.0))
    return stack(heights, {0: "xy", count + 1: "x"}, springs=springs)


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


TIMOSHENKO = "Timoshenko & Gere, Theory of Elastic Stability (1961)"
BAZANT = "Bazant & Cedolin, Stability of Structures (1991)"
CHARACTERISTIC = "stability functions, Wittrick & Williams (1971)"


def _column(name, supports, end, published, source="Euler", springs=None, digits=1e-7):
    return frame_case("column", name, source, column(supports, springs), end, published, digits)


def _stack(name, source, end, published, *description, digits=2e-4, **options):
    frame = stack(*description, **options)
    return frame_case("column", name, source, frame, end, published, digits)


def _frame(name, source, end, published, frame, digits=2e-4):
    return frame_case("frame", name, source, frame, end, published, digits)


COLUMN_CASES = (
    _column("clamped, free", {"a": "xyr"}, 40.0, 2.46740110),
    _column("hinged, hinged", {"a": "xy", "b": "x"}, 60.0, 9.86960440),
    _column("clamped, hinged", {"a": "xyr", "b": "x"}, 80.0, 20.1907286),
    _column("clamped, clamped", {"a": "xyr", "b": "xr"}, 100.0, 39.4784176),
    _column("guided, clamped", {"a": "yr", "b": "xr"}, 60.0, 9.86960440),
    _column("guided, hinged", {"a": "yr", "b": "x"}, 40.0, 2.46740110),
    _column(
        "elastic clamp, c = 2 EI / L",
        {"a": "xy"},
        30.0,
        1.1597,
        f"{TIMOSHENKO}: k L tan k L = c L / EI",
        {"a": (0.0, 0.0, 2.0)},
        2e-4,
    ),
    _column(
        "elastic clamps at both ends, c = 5 EI / L",
        {"a": "xy", "b": "x"},
        60.0,
        None,
        f"{TIMOSHENKO}: tan(k L / 2) = -k EI / c",
        {"a": (0.0, 0.0, 5.0), "b": (0.0, 0.0, 5.0)},
    ),
    _column(
        "cantilever, soft spring at the head",
        {"a": "xyr"},
        60.0,
        None,
        f"{TIMOSHENKO}: tan k L = k L - (k L)^3 EI / (k L^3)",
        {"b": (10.0, 0.0, 0.0)},
    ),
    _column(
        "cantilever, stiff spring at the head",
        {"a": "xyr"},
        60.0,
        None,
        f"{TIMOSHENKO}: tan k L = k L - (k L)^3 EI / (k L^3)",
        {"b": (1000.0, 0.0, 0.0)},
    ),
    _stack(
        "soft spring at mid-height",
        f"{TIMOSHENKO}",
        60.0,
        None,
        (0.0, 0.5, 1.0),
        {0: "xy", 2: "x"},
        springs={1: (50.0, 0.0, 0.0)},
    ),
    _stack(
        # Above 16 pi^2 EI / L^3, the column buckles in two half waves.
        "stiff spring at mid-height",
        f"{TIMOSHENKO}",
        60.0,
        39.4784176,
        (0.0, 0.5, 1.0),
        {0: "xy", 2: "x"},
        springs={1: (250.0, 0.0, 0.0)},
        digits=1e-7,
    ),
    _stack(
        "two equal spans",
        f"{TIMOSHENKO}",
        100.0,
        39.4784176,
        (0.0, 0.5, 1.0),
        {0: "xy", 1: "x", 2: "x"},
        digits=1e-7,
    ),
    _stack(
        "spans 1 : 2",
        f"{BAZANT}",
        70.0,
        None,
        (0.0, 1.0 / 3.0, 1.0),
        {0: "xy", 1: "x", 2: "x"},
    ),
    _stack(
        "three equal spans",
        f"{TIMOSHENKO}",
        150.0,
        88.8264396,
        (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0),
        {0: "xy", 1: "x", 2: "x", 3: "x"},
        digits=1e-7,
    ),
    _stack(
        "cantilever stepped at mid-height, EI 1 : 0.5",
        f"{TIMOSHENKO}: tan k1 l1 tan k2 l2 = k1 / k2",
        40.0,
        None,
        (0.0, 0.5, 1.0),
        {0: "xyr"},
        widths=(1.0, 0.5),
    ),
    _stack(
        "hinged, middle half stiffer, EI 0.4 : 1 : 0.4",
        f"{TIMOSHENKO}",
        40.0,
        None,
        (0.0, 0.25, 0.75, 1.0),
        {0: "xy", 3: "x"},
        widths=(0.4, 1.0, 0.4),
    ),
    _stack(
        "hinged, half of the load at mid-height",
        f"{TIMOSHENKO}",
        60.0,
        None,
        (0.0, 0.5, 1.0),
        {0: "xy", 2: "x"},
        (1.0, 0.5),
    ),
    _stack(
        "cantilever, three quarters of the load at mid-height",
        f"{TIMOSHENKO}",
        40.0,
        None,
        (0.0, 0.5, 1.0),
        {0: "xyr"},
        (1.0, 0.25),
    ),
    _stack(
        "load at mid-height of a clamped, hinged column, tension above",
        CHARACTERISTIC,
        200.0,
        None,
        (0.0, 0.5, 1.0),
        {0: "xyr", 2: "x"},
        (1.0, -0.5),
    ),
    _stack(
        "hinge at mid-height on a spring",
        f"{BAZANT}: 2 P = k L / 2",
        9.0,
        5.0,
        (0.0, 0.5, 1.0),
        {0: "xy", 2: "x"},
        springs={1: (20.0, 0.0, 0.0)},
        hinges=(1,),
        digits=1e-7,
    ),
    frame_case(
        "column",
        "three springs, modulus 100 EI / L^4",
        f"{TIMOSHENKO}: elastic foundation, springs",
        winkler(3, 100.0),
        60.0,
    ),
    frame_case(
        "column",
        "three springs, modulus 1500 EI / L^4",
        f"{TIMOSHENKO}: elastic foundation, springs",
        winkler(3, 1500.0),
        120.0,
    ),
)
FRAME_CASES = (
    _frame("portal, clamped, sway", f"{BAZANT}: k L / tan k L = -6", 45.0, 7.3790, portal("xyr")),
    _frame("portal, hinged, sway", f"{BAZANT}: k L tan k L = 6", 25.0, 1.8213, portal("xy")),
    _frame("portal, clamped, braced", TIMOSHENKO, 45.0, None, portal("xyr", True)),
    _frame("portal, hinged, braced", TIMOSHENKO, 25.0, None, portal("xy", True)),
    _frame("portal, hinged, stiff beam", CHARACTERISTIC, 15.0, None, portal("xy", beam=20.0)),
    _frame("two bays, clamped", CHARACTERISTIC, 20.0, None, portal("xyr", bays=2)),
    _frame("two stories, clamped", CHARACTERISTIC, 20.0, None, portal("xyr", stories=2)),
    _frame(
        "two stories, hinged, braced", CHARACTERISTIC, 22.0, None, portal("xy", True, stories=2)
    ),
    _frame("closed square, braced", f"{TIMOSHENKO}", 30.0, 16.463, closed_square()),
    _frame("leaning column", f"{BAZANT}: sway of a group", 15.0, None, leaning_column()),
    _frame("column with cross-arm on springs", CHARACTERISTIC, 60.0, None, tie_braced_column()),
)
