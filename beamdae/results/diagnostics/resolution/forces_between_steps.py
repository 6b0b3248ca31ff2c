"""Warnings about stresses and section forces that are wrong between the steps of a run."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from math import ceil, log10
from typing import NamedTuple

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import format_percent, name_with_others
from beamdae.results.columns import Header, remove_unit
from beamdae.results.diagnostics.meshes.coarse_elements import headers_of_sections
from beamdae.results.diagnostics.meshes.moving_loads import measured_quantity
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Deviation between steps, relative to the largest value, from which on a column is reported, and
# which the named tolerance leaves.
_MAX_DEVIATION, _RECOMMENDED_DEVIATION = 0.02, 0.005
# Ratio of the deviation and of the curve of the column over the steps next to it, from which on the
# deviation is no vibration: those of 3 or more steps per period have at most 0.9.
_MIN_RATIO = 3.0
# Places in each step, near the extremes of the errors of collocation polynomials.
_PLACES = (0.3, 0.85)
_MIN_STEPS = 8
# Steps that are examined first, in groups of consecutive ones: evaluating all takes as long as a
# fifth of a run.
_GROUPS, _STEPS_OF_GROUP = 6, 16
_MIN_SHARE = 0.05  # of steps with such deviations; single ones belong to events and impacts
_MIN_FORCE_RATIO = 0.05  # of forces and moments over the length of the mechanism
_MAX_NAMES = 3


def between_step_warnings(
    equations: EquationsOfMotion, deviations: Mapping[str, float], rtol: float
) -> Iterator[str]:
    """Yield a warning if stresses and section forces vary between steps, but not over the steps.

    `deviations` is the result of `find_step_deviations` for a run with the tolerance `rtol`.
    """
    if not deviations:
        return
    worst, *others = sorted(deviations, key=lambda x: -deviations[x])
    also = [f"{remove_unit(x)} {format_percent(deviations[x])}" for x in others]
    power = ceil(log10(deviations[worst] / _RECOMMENDED_DEVIATION))
    yield (
        f"{remove_unit(worst)}: between the steps, it is wrong by up to "
        f"{name_with_others(format_percent(deviations[worst]), also, _MAX_NAMES)} of its largest "
        "value, because errors of positions within the tolerance strain a beam that is stiff "
        f"along its axis; use rtol={rtol * 10.0**-power:.0e}, or "
        f"solution.section_forces({_find_beam(equations, worst)!r})."
    )


def _find_beam(equations: EquationsOfMotion, header: str) -> str:
    """Return the name of the beam whose stresses or section forces are observed."""
    assert equations.mechanism is not None
    name = next(x.name for x in equations.observables if header in x.headers)
    observed = equations.mechanism.observables[name]
    sections = Beam.sections_of_strains(measured_quantity(observed)[0])
    assert sections is not None
    return sections[0].name


def find_step_deviations(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    compared: Collection[str],
    observe_at: Callable[[Array], Array],
) -> dict[str, float]:
    """Return errors of stresses and section forces between steps, relative to the largest value.

    At the ends of steps, beams are in equilibrium with their loads. Between them, errors of the
    interpolated shape, which are within the tolerance of positions, strain stiff beams along their
    axis.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    compared
        Headers of the columns that are not rounding errors, which vary between steps, too.
    observe_at
        Function that returns rows of the observed columns at ascending times [s].

    Returns
    -------
    dict
        Errors of over 2 %, by header.
    """
    e, of_sections = equations, headers_of_sections(equations)
    headers = [x for x in compared if x in of_sections]
    # Long runs store only some of their steps.
    stretches = [x.t for x in trajectory.intervals if x.record is None and len(x.t) >= _MIN_STEPS]
    if not headers or not stretches:
        return {}
    columns = [e.observed_headers.index(x) for x in headers]

    def observe(times: Array) -> Array:
        return observe_at(times)[:, columns]

    if not _measure_stretches(_select_steps(stretches), observe).is_wrong.any():
        return {}
    deviations = _measure_stretches(stretches, observe)
    # Forces that are small beside moments, such as those in pure bending, do not matter.
    sizes = dict(zip(headers, deviations.size.tolist(), strict=True))
    units = {x: Header.of(x).unit for x in headers}
    moment = max((x for header, x in sizes.items() if units[header] == "N m"), default=0.0)
    smallest = {"N": _MIN_FORCE_RATIO * moment / e.length}
    return {
        header: float(np.max(ratios[is_wrong]))
        for header, ratios, is_wrong in zip(
            headers, deviations.ratios.T, deviations.is_wrong.T, strict=True
        )
        if np.mean(is_wrong) > _MIN_SHARE and sizes[header] > smallest.get(units[header], 0.0)
    }


class _Deviations(NamedTuple):
    """Deviations within steps.

    Attributes
    ----------
    ratios
        Deviations relative to the largest value of each of n columns, (k, n).
    is_wrong
        True where deviations are large and no vibration, (k, n).
    size
        Largest magnitude of each column at the steps, (n,).
    """

    ratios: Array
    is_wrong: Array
    size: Array


def _select_steps(stretches: list[Array]) -> list[Array]:
    """Return a few groups of consecutive steps of these times (k,)."""
    selected = []
    for t in stretches:
        count = min(len(t), _STEPS_OF_GROUP)
        first = np.linspace(0, len(t) - count, _GROUPS).astype(int).tolist()
        selected += [t[k : k + count] for k in dict.fromkeys(first)]
    return selected


def _measure_stretches(stretches: list[Array], observe: Callable[[Array], Array]) -> _Deviations:
    """Return deviations within consecutive steps, whose ends are times (k,) [s]."""
    count = 1 + len(_PLACES)
    times = [
        np.append(t[:-1, None] + np.diff(t)[:, None] * np.append(0.0, _PLACES), t[-1])
        for t in stretches
    ]
    ends = np.cumsum([len(x) for x in times])[:-1]
    deviations, curves, values = [], [], []
    for t, observed in zip(stretches, np.split(observe(np.concatenate(times)), ends), strict=True):
        at_steps = observed[::count]
        for k, place in enumerate(_PLACES, 1):
            deviation, curve = _compare(t, at_steps, observed[k::count], place)
            deviations.append(deviation)
            curves.append(curve)
        values.append(at_steps)
    deviation, curve, at_steps = map(np.concatenate, (deviations, curves, values))
    size = np.max(np.abs(at_steps), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.nan_to_num(deviation / size)
    return _Deviations(ratios, (ratios > _MAX_DEVIATION) & (deviation > _MIN_RATIO * curve), size)


def _compare(t: Array, at_steps: Array, between: Array, place: float) -> tuple[Array, Array]:
    """Return deviations within steps from cubic polynomials, and of these from straight lines.

    Parameters
    ----------
    t
        Ends of the steps, (k,).
    at_steps, between
        Columns at the ends, (k, c), and within the steps, (k - 1, c).
    place
        Place within the steps, from 0 to 1.
    """
    nodes = np.stack([t[j : len(t) - 3 + j] for j in range(4)])
    times = nodes[1] + place * (nodes[2] - nodes[1])
    cubic = np.zeros((len(times), at_steps.shape[1]))
    for j in range(4):
        weight = np.ones(len(times))
        for i in range(4):
            if i != j:
                weight *= (times - nodes[i]) / (nodes[j] - nodes[i])
        cubic += weight[:, None] * at_steps[j : len(t) - 3 + j]
    straight = (1.0 - place) * at_steps[1:-2] + place * at_steps[2:-1]
    return np.abs(between[1:-1] - cubic), np.abs(cubic - straight)
