"""Arc lengths between which the stresses of a varying section have no further maxima.

With the section modulus W, the stress by a bending moment M is |M| / W. Let M be linear between two
arc lengths with the same stress at both. Then |M| is proportional to the linear interpolation of W,
and the stress between exceeds that at both by the ratio of this interpolation to W. With other
stresses at the arc lengths, it exceeds the larger one by less. The area A takes the place of W for
axial forces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from beamdae.beams.sections import Section, VaryingSection
from beamdae.curves.plane_curves import ARC_LENGTH_TOLERANCE

Array = np.ndarray

# Largest ratio, minus 1, by which a stress between two arc lengths exceeds those at both.
_MAX_EXCESS = 2e-3
# Places at which the section between two arc lengths is evaluated, and the degree of polynomials
# that represent sections without kinks and jumps: W of tapers has the degree 2 or 3.
_PROBES = np.arange(9) / 8.0
_SMOOTH_DEGREE = 4
# Places at which sections without larger stresses there are evaluated once more, and the least
# excess of short grooves: smooth sections have hardly more at these places than at the others.
_FINE_PROBES = np.arange(33) / 32.0
_MIN_EXCESS_OF_GROOVES = 0.01
# Residual of these polynomials, relative to the distance of W from its linear interpolation.
_MAX_SMOOTH_RESIDUAL = 0.02
_RESIDUAL_PROJECTION = np.eye(len(_PROBES)) - (
    np.vander(_PROBES, _SMOOTH_DEGREE + 1) @ np.linalg.pinv(np.vander(_PROBES, _SMOOTH_DEGREE + 1))
)
# Ratio of the decreases of the excess at a distance and at twice this distance from its maximum,
# above which the section has a kink or a jump there: 1/4 at smooth maxima, 1/2 at kinks.
_MIN_KINK_RATIO = 0.35
_KINK_DISTANCE = 1.0 / 1024.0  # relative to the distance of the two arc lengths
_GOLDEN_RATIO = 0.5 * (np.sqrt(5.0) - 1.0)
_LOCATION_TOLERANCE = 1e-3 * ARC_LENGTH_TOLERANCE  # relative to the length of the beam
# Locations are rounded to 12 digits if the excess decreases by less than the second value.
_LOCATION_DIGITS, _LOCATION_ROUNDING = 12, 1e-9
# Distance from a located section, relative to the length of the beam, at which stresses in a
# neighboring model are smaller if the kink is still there. It exceeds the rounding of locations.
_CHECKED_DISTANCE = 1e-9
_BREAK_INTERVALS, _MIN_JUMP = 7, 1e-3  # hardly any jump is at a multiple of 1/7
_MAX_HALVINGS = 10
_MAX_SECTIONS_PER_INTERVAL = 32

_Modulus = Callable[[float], Array]  # returns A [m^2] and W [m^3] at an arc length


class _LocatedMaximum(NamedTuple):
    """Section at a maximum that was searched, between two others; `kind` is 0 for A, 1 for W."""

    s: float
    start: float
    end: float
    kind: int


class StressSections(NamedTuple):
    """Arc lengths [m] of the sections of a beam, and those that a search located."""

    arc_lengths: tuple[float, ...]
    located: tuple[_LocatedMaximum, ...]

    def moved(self, key: tuple[float, ...], other_key: tuple[float, ...]) -> StressSections:
        """Return the sections after the given arc lengths `key` have become `other_key`."""
        if key == other_key:
            return self

        def move(*places: float) -> tuple[float, ...]:
            return tuple(np.interp(places, key, other_key).tolist())

        located = []
        for maximum in self.located:
            s, start, end = move(*maximum[:3])
            located.append(_LocatedMaximum(s, start, end, maximum.kind))
        return StressSections(move(*self.arc_lengths), tuple(located))


# Stress sections of a beam by given arc lengths, see `VaryingSection.stress_sections`.
KnownSections = Mapping[tuple[float, ...], StressSections]

# Known sections by the name of the beam, whose stress sections beams of these names have.
_REFERENCES: ContextVar[Mapping[str, KnownSections]] = ContextVar("_REFERENCES")


def list_known_sections(
    sections: Mapping[str, Section | VaryingSection],
) -> dict[str, KnownSections]:
    """Return the stress sections of beams that vary, given their sections by name of the beam."""
    varying = {name: x for name, x in sections.items() if isinstance(x, VaryingSection)}
    return {name: x.stress_sections for name, x in varying.items() if x.stress_sections}


@contextmanager
def keep_numbers_of_sections(sections: Mapping[str, Section | VaryingSection]) -> Iterator[None]:
    """Let beams have as many stress sections as those with given sections, by name of the beam.

    Models that differ in the value of a parameter then have columns of the same form. Sections are
    only searched again if a parameter moved a kink.
    """
    with keep_known_sections(list_known_sections(sections)):
        yield


@contextmanager
def keep_known_sections(known: Mapping[str, KnownSections]) -> Iterator[None]:
    """Do the same as `keep_numbers_of_sections`, for known sections by name of the beam."""
    token = _REFERENCES.set(known)
    try:
        yield
    finally:
        _REFERENCES.reset(token)


def stress_sections(
    section: Section | VaryingSection, arc_lengths: Sequence[float], beam: str = ""
) -> tuple[float, ...]:
    """Return ascending arc lengths [m], with those between at which stresses may be larger.

    Kinks and jumps at which the section is thin, and sections where it varies smoothly, are added,
    so that stresses by section forces that are linear between the result are missed by at most
    0.2 %. Grooves shorter than 1/32 of the distance of `arc_lengths` may be overlooked.

    Parameters
    ----------
    section
        Section of the beam.
    arc_lengths
        Ascending arc lengths, on both sides of the jumps that they contain.
    beam
        Name of the beam, see `keep_numbers_of_sections`.
    """
    if isinstance(section, Section):
        return tuple(arc_lengths)
    key = tuple(arc_lengths)
    known = _find_known(_REFERENCES.get({}).get(beam, {}), key)
    if key not in section.stress_sections:
        if known is not None and _are_maxima(section, known.located, key[-1] - key[0]):
            section.stress_sections[key] = known
        else:
            section.stress_sections[key] = _refine(section, key)
    result = section.stress_sections[key].arc_lengths
    return result if known is None or len(known[0]) == len(result) else known.arc_lengths


def find_breaks(section: Section | VaryingSection, length: float) -> tuple[float, ...]:
    """Return ascending arc lengths [m] of the kinks of a taper, or of the jumps of a function.

    Jumps are located in each seventh of the length, in which the first one is found.
    """
    if isinstance(section, Section):
        return ()
    if section.breaks is not None:
        return section.breaks
    arc_lengths = tuple(np.linspace(0.0, length, _BREAK_INTERVALS + 1).tolist())
    stress_sections(section, arc_lengths)
    located = section.stress_sections[arc_lengths].located
    step, jumps = _CHECKED_DISTANCE * length, []
    for maximum in located:
        before, after = (_evaluate_moduli(section, maximum.s + x) for x in (-step, step))
        if np.max(np.abs(after / before - 1.0)) > _MIN_JUMP:
            jumps.append(float(maximum.s))
    return tuple(sorted(jumps))


def _find_known(known: KnownSections, key: tuple[float, ...]) -> StressSections | None:
    """Return known sections, between arc lengths that a parameter may have moved to `key`."""
    if key in known:
        return known[key]
    others = (x.moved(other, key) for other, x in known.items() if len(other) == len(key))
    return next(others, None)


def _evaluate_moduli(section: VaryingSection, s: float) -> Array:
    """Return A [m^2] and W [m^3] at an arc length, the latter times a constant."""
    x = section.at(s)
    return np.array([x.area, x.second_moment / (x.height or 1.0)])


def _are_maxima(section: VaryingSection, located: Sequence[_LocatedMaximum], length: float) -> bool:
    """Return True if stresses decrease on both sides of located sections."""
    step = _CHECKED_DISTANCE * length
    modulus = partial(_evaluate_moduli, section)
    for maximum in located:
        excess = _Excess.between(modulus, *maximum[1:])
        s = maximum.s
        sides = [x for x in (s - step, s + step) if maximum.start <= x <= maximum.end]
        if not excess(s) > max(map(excess, sides)):
            return False
    return True


def _refine(section: VaryingSection, arc_lengths: tuple[float, ...]) -> StressSections:
    modulus = partial(_evaluate_moduli, section)
    length = arc_lengths[-1] - arc_lengths[0]
    result, located = [arc_lengths[0]], list[_LocatedMaximum]()
    for start, end in pairwise(arc_lengths):
        if end - start > 10.0 * ARC_LENGTH_TOLERANCE * length:
            between: list[float] = []
            tolerance = _LOCATION_TOLERANCE * length
            _add_between(modulus, start, end, tolerance, _MAX_HALVINGS, between, located)
            result += sorted(between)
        result.append(end)
    return StressSections(tuple(result), tuple(located))


@dataclass(frozen=True)
class _Excess:
    """Ratio of the linear interpolation of a modulus between two arc lengths to the modulus."""

    modulus: _Modulus
    start: float
    end: float
    kind: int
    values: tuple[float, float]

    @classmethod
    def between(cls, modulus: _Modulus, start: float, end: float, kind: int) -> _Excess:
        """Return the excess between two arc lengths [m]."""
        values = float(modulus(start)[kind]), float(modulus(end)[kind])
        return cls(modulus, start, end, kind, values)

    def __call__(self, s: float) -> float:
        """Return the ratio at an arc length [m]."""
        fraction = (s - self.start) / (self.end - self.start)
        chord = self.values[0] + fraction * (self.values[1] - self.values[0])
        return float(chord / self.modulus(s)[self.kind])


def _add_between(
    modulus: _Modulus,
    start: float,
    end: float,
    tolerance: float,
    depth: int,
    added: list[float],
    located: list[_LocatedMaximum],
) -> None:
    """Add arc lengths between two others to a list, until stresses between them are no larger.

    Those that a search located are also added to `located`.
    """
    s, values, linear = _evaluate_between(modulus, start, end, _PROBES)
    place, kind = _find_largest_excess(values, linear)
    is_short = False
    if linear[place, kind] <= (1.0 + _MAX_EXCESS) * values[place, kind]:
        if depth < _MAX_HALVINGS:
            return
        s, values, linear = _evaluate_between(modulus, start, end, _FINE_PROBES)
        place, kind = _find_largest_excess(values, linear)
        if linear[place, kind] <= (1.0 + _MIN_EXCESS_OF_GROOVES) * values[place, kind]:
            return
        is_short = True

    excess = _Excess.between(modulus, start, end, kind)

    def find_maximum() -> float:
        return _find_maximum(excess, float(s[place - 1]), float(s[place + 1]), tolerance)

    found = None
    if is_short:
        found = find_maximum()
    else:
        residual = np.max(np.abs(_RESIDUAL_PROJECTION @ values[:, kind]))
        distance = np.max(np.abs(linear[:, kind] - values[:, kind]))
        if residual > _MAX_SMOOTH_RESIDUAL * distance:
            kink = find_maximum()
            if _is_kink(excess, kink, start, end):
                found = kink
    split = 0.5 * (start + end) if found is None else found
    added.append(split)
    if found is not None:
        located.append(_LocatedMaximum(split, start, end, kind))
    if depth > 0 and len(added) < _MAX_SECTIONS_PER_INTERVAL:
        for a, b in ((start, split), (split, end)):
            if b - a > 1e3 * tolerance:
                _add_between(modulus, a, b, tolerance, depth - 1, added, located)


def _evaluate_between(
    modulus: _Modulus, start: float, end: float, probes: Array
) -> tuple[Array, Array, Array]:
    """Return arc lengths (k,), the values there, and their linear interpolation, (k, 2) each."""
    s = start + (end - start) * probes
    s[-1] = end
    values = np.array([modulus(x) for x in s.tolist()])
    return s, values, values[0] + np.outer(probes, values[-1] - values[0])


def _find_largest_excess(values: Array, linear: Array) -> tuple[int, int]:
    """Return row and column of the largest ratio of `linear` to `values`."""
    place, kind = np.unravel_index(np.argmax(linear / values), values.shape)
    return int(place), int(kind)


def _find_maximum(
    function: Callable[[float], float], start: float, end: float, tolerance: float
) -> float:
    """Return the place of the largest value that a golden-section search finds."""
    places = [end - _GOLDEN_RATIO * (end - start), start + _GOLDEN_RATIO * (end - start)]
    values = [function(x) for x in places]
    while end - start > tolerance:
        if values[0] > values[1]:
            end = places[1]
            places, values = [end - _GOLDEN_RATIO * (end - start), places[0]], [0.0, values[0]]
            values[0] = function(places[0])
        else:
            start = places[0]
            places, values = [places[1], start + _GOLDEN_RATIO * (end - start)], [values[1], 0.0]
            values[1] = function(places[1])
    best = int(np.argmax(values))
    rounded = float(f"{places[best]:.{_LOCATION_DIGITS}g}")
    is_same = function(rounded) >= (1.0 - _LOCATION_ROUNDING) * values[best]
    return rounded if is_same else places[best]


def _is_kink(function: Callable[[float], float], s: float, start: float, end: float) -> bool:
    """Return True if a maximum at `s` is a kink or a jump, False if it is smooth."""
    step = _KINK_DISTANCE * (end - start)
    if not start + 2.0 * step < s < end - 2.0 * step:
        return True
    top = function(s)
    drops = np.array(
        [[top - function(s + side * k * step) for k in (1.0, 2.0)] for side in (-1.0, 1.0)]
    )
    return bool(np.all(drops[:, 0] > _MIN_KINK_RATIO * drops[:, 1]))
