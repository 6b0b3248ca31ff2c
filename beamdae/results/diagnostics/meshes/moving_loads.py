"""Warnings about section forces and reactions in elements that a moving load passes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import format_percent
from beamdae.parts.signals import Sensor
from beamdae.results.diagnostics.meshes.beam_ranges import sample_positions, sample_times
from beamdae.results.trajectory import Trajectory
from beamdae.symbolic.statements import Quantity

Array = np.ndarray

# Error of the bending moment at a section while a load is on its element, relative to the product
# of load and element length, measured on a simply supported beam. The shear force is off by up to
# half of the load with any mesh.
_MOMENT_ERROR = 0.058
# Below this element length, relative to the beam, that error is less than 1 % of the largest moment
# of a simply supported beam, load times length / 4.
_MAX_ELEMENT_LENGTH = 0.01 * 0.25 / _MOMENT_ERROR
# A load that passes less than this share of the element, such as one that starts near its other
# end, causes small errors.
_MIN_PASSED_SHARE = 0.5
# Distance beyond an end, relative to the beam, up to which a sliding point has no warning.
_MAX_OVERRUN = 0.01


def moving_load_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning per observed section whose element a moving load passes during the run.

    Strains within an element are smooth, and do not follow the jump of the shear force below the
    load. Stresses and strains are exempt if the element is short. The warnings about sliding points
    come first: about those beyond an end of their beam, and about reactions.
    """
    mechanism = equations.mechanism
    parts = () if mechanism is None else mechanism.parts.values()
    loads: list[Any] = [x for x in parts if x.moves_along_beam]
    if mechanism is None or not loads:
        return
    # Imports large modules of SciPy, which other models do not need.
    from beamdae.results.diagnostics.meshes.sliding_errors import sliding_error_warnings

    for load in loads:
        if load.coordinates:
            yield from _overrun_warnings(load, equations, trajectory)
    yield from sliding_error_warnings(equations, trajectory)
    paths: dict[str, tuple[float, float]] = {}
    for name, observed in mechanism.observables.items():
        quantity, columns = measured_quantity(observed)
        section = None if columns == ("N",) else Beam.section_of_strains(quantity)
        for load in loads if section else ():
            beam, s = section  # type: ignore[misc]
            if load.beam is not beam:
                continue
            if load.name not in paths:
                paths[load.name] = _path(load, equations, trajectory)
            first, last = paths[load.name]
            element, _ = beam.mesh.locate(s)
            begin, end = beam.mesh.element_bounds[element : element + 2].tolist()
            length = end - begin
            is_passed = min(last, end) - max(first, begin) > _MIN_PASSED_SHARE * length
            has_shear_force = "Q" in columns
            is_wrong = has_shear_force or length > _MAX_ELEMENT_LENGTH * beam.length
            if not (is_passed and is_wrong):
                continue
            yield (
                f"{name}: {load.name} passes the element of this section (s = {begin:.4g} to "
                f"{end:.4g} m), in which strains do not follow the jump of the shear force: Q is "
                "off by up to half of the load, and M by up to its product with "
                f"{_MOMENT_ERROR * length:.2g} m; use solution.section_forces({beam.name!r}), or "
                "more elements for M."
            )


def _overrun_warnings(
    load: Any, equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[str]:
    """Yield a warning if a sliding point is more than 1 % of the beam beyond an end of it."""
    assert equations.mechanism is not None
    rows, beam = map_coordinates(equations.mechanism).slice_of(load), load.beam
    times = sample_times(trajectory)
    s = trajectory.positions_at(times)[:, rows].ravel()
    for end, overrun in (("start", -s), ("end", s - beam.length)):
        worst = float(np.max(overrun))
        if not worst > _MAX_OVERRUN * beam.length:
            continue
        # Rounding errors of a point that starts at the end are not the first passage.
        passed = int(np.argmax(overrun > _MAX_OVERRUN * beam.length))
        first = int(np.max(np.flatnonzero(overrun[:passed] <= 0.0), initial=-1)) + 1
        near = slice(max(first - 1, 0), first + 1)
        time = np.interp(0.0, overrun[near], times[near])
        stays = np.all(overrun[first:] > 0.0)
        when = f"from t = {time:.4g} s on" if stays else f"first at t = {time:.4g} s"
        yield (
            f"{load.name}: {load.a.body.name} is beyond the {end} of {beam.name} {when}, by up to "
            f"{format_percent(worst / beam.length)} of its length, where its tangent continues the "
            'beam; end the run earlier, set ends="stop", or check the unit of the speed.'
        )


def measured_quantity(observed: Quantity) -> tuple[Quantity, tuple[str, ...]]:
    """Return a quantity and the names of its observed columns; sensors measure one of them."""
    recipe = observed.recipe
    sensor = recipe.arguments[0] if recipe is not None and recipe.arguments else None
    if isinstance(sensor, Sensor):
        return sensor.of, (sensor.of.columns[sensor.column].name,)
    return observed, tuple(column.name for column in observed.columns)


def _path(load: Any, equations: EquationsOfMotion, trajectory: Trajectory) -> tuple[float, float]:
    """Return the range of the arc length of a load during the run [m]."""
    if load.coordinates:
        assert equations.mechanism is not None
        rows = map_coordinates(equations.mechanism).slice_of(load)
        places = sample_positions(trajectory)[:, rows]
    else:
        times = np.array([trajectory.start, trajectory.end])
        places = load.start + load.speed * times
    return float(np.min(places)), float(np.max(places))
