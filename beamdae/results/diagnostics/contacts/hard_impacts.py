"""Warnings about contact forces that rise faster than elements of beams resolve."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from beamdae.beams.beam import BeamAttachment
from beamdae.beams.sections import Section
from beamdae.equations.assembly.building import NumberStore, build_observable
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import format_error, name_with_others
from beamdae.results.diagnostics.contacts.model_contacts import attached_mass, contacts_of
from beamdae.results.trajectory import Trajectory
from beamdae.symbolic.statements import Quantity

Array = np.ndarray

# Largest products of wave number and element length of a resolved rise. Measured on steel beams and
# rods of 2 to 16 elements that fall on a free end, a quarter point or a tip mass, or on which a
# mass falls, with damping of 0 to 2e-5 s and stiffnesses of 1e8 to 1e14 N/m^1.5, in both
# formulations, against 96 and 128 elements. Of 882 runs below these limits, none has an error of
# the peak of the force above 1 %, and 12 have one of the largest stress above 5 %; of 1777 above,
# 8 % have errors of both below 1 %.
_MAX_BENDING_PRODUCT = math.pi  # elements as long as half a wave
_MAX_AXIAL_PRODUCT = 1.0
# Damped rods do not ring behind the front of a wave: increase of the second one at large damping,
# and the retardation time, relative to the travel time of an axial wave through the element, from
# which on damping is large.
_INCREASE_BY_DAMPING = 3.0
_LARGE_DAMPING = 0.05
# Larger one of the errors of the force and of the stress over the ratio of product and largest
# product. In half of these runs, it is 0.02 to 0.08.
_ERROR_PER_RATIO = 0.05
# Smaller errors, as of elements beside a heavy mass, have no warning.
_MIN_ERROR = 0.02
# Above this ratio, the force is that of the mass of the node, whose frequency changes with the root
# of the element length: rise times of shorter elements are shorter.
_RATIO_OF_NODAL_MASS = 6.0
_DIGITS, _LARGE_ERROR = 1, 1.0  # of stated errors
_MAX_ELEMENTS = 1000  # larger recommended numbers have no use
# Share of a failed run at its end, in which forces diverge: they rise in 1e-16 s there.
_SHARE_OF_FAILURE = 1e-3
_MIN_STEP = 1e-12  # relative to the end time; differences over shorter steps are rounding


class HardImpact(NamedTuple):
    """Contact force whose rise the elements of a beam do not resolve.

    Attributes
    ----------
    part, beam
        Names of the contact and of the touched beam.
    rise_time
        Largest force over largest rate of the force [s].
    ratio
        Wave number times element length, relative to the largest resolved product.
    error
        Estimated error of the peak of the force and of the stresses, to a factor of 2 to 3.
    elements
        Length of the beam over that of the element at the contact.
    """

    part: str
    beam: str
    rise_time: float
    ratio: float
    error: float
    elements: float

    @property
    def required_elements(self) -> int:
        """Estimated number of elements of the beam that resolves the rise."""
        refinement = self.ratio * max(1.0, self.ratio / _RATIO_OF_NODAL_MASS)
        refinement = min(refinement, max(1.0, self.error / _MIN_ERROR))
        return math.ceil(refinement * self.elements)


def find_hard_impacts(
    equations: EquationsOfMotion, trajectory: Trajectory, has_failed: bool = False
) -> tuple[HardImpact, ...]:
    """Return the contacts whose force rises faster than a touched beam resolves.

    With the largest force F, the rate w = max|dF/dt| / F is the angular frequency of the waves that
    an impact emits. Their wave numbers in the beam, of axial waves by the axial component of the
    rate and of bending waves by the transverse one, are compared with the length of the element at
    the contact. Runs of which only some steps are stored may miss fast rises.

    Parameters
    ----------
    equations
        The equations of motion of all parts.
    trajectory
        The steps of the run.
    has_failed
        True for a run that has failed, whose last thousandth is ignored.
    """
    impacts = []
    end = trajectory.end
    if has_failed:
        end -= _SHARE_OF_FAILURE * (end - trajectory.start)
    for part in contacts_of(equations).values():
        # Reversals of friction are fast, too, but their forces are known.
        smooth = replace(part, friction=0.0, static=None, stribeck=None)
        of_part = [
            _measure(
                equations, trajectory, part.name, x.at, smooth.load_on(place, axes="body"), end
            )
            for place, x in smooth.loaded_points.items()
            if isinstance(x.at, BeamAttachment) and x.at.s is not None
        ]
        unresolved = [x for x in of_part if x.ratio > 1.0 and x.error > _MIN_ERROR]
        if unresolved:
            impacts.append(max(unresolved, key=lambda x: x.error))
    return tuple(impacts)


def hard_impact_warnings(impacts: tuple[HardImpact, ...]) -> Iterator[str]:
    """Yield one warning about the impact that is resolved worst."""
    if not impacts:
        return
    worst = max(impacts, key=lambda x: x.error)
    others = [x.part for x in impacts if x is not worst]
    error = format_error(worst.error, _LARGE_ERROR, _DIGITS)
    error = error.replace("about", "roughly")
    remedy = "use a lower stiffness that represents the local compliance of the bodies (Hertz)"
    if worst.required_elements <= _MAX_ELEMENTS:
        remedy = f"use about {worst.required_elements} elements, or {remedy.removeprefix('use ')}"
    yield (
        f"{name_with_others(worst.part, others)}: this force rises within "
        f"{worst.rise_time:.2g} s, faster than waves pass the elements of {worst.beam}, so its "
        f"peak and the stresses may be wrong by {error}; {remedy}."
    )


def _measure(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    part: str,
    at: BeamAttachment,
    load: Quantity,
    end: float,
) -> HardImpact:
    """Compare the fastest rise of a contact force before `end` [s] with the element there."""
    size, rate = _measure_rates(equations, trajectory, part, load, at.inclination, end)
    beam = at.body
    element, _ = beam.mesh.locate(at.s)
    length = float(beam.mesh.element_lengths[element])
    frequency = np.zeros(2) if size == 0.0 else rate / size
    section = beam.section.at(at.s)
    speed = math.sqrt(section.EA / section.rhoA)
    axial, transverse = frequency.tolist()
    damping = section.damping * speed / length
    increase = _INCREASE_BY_DAMPING * damping / (damping + _LARGE_DAMPING)
    ratio = length * max(
        _axial_wave_number(section, axial) / (_MAX_AXIAL_PRODUCT + increase),
        _bending_wave_number(section, transverse) / _MAX_BENDING_PRODUCT,
    )
    # The force on a heavy mass hardly depends on the elements, but the stress beside it does.
    mass = section.rhoA * length
    share = math.sqrt(mass / (mass + attached_mass(equations, beam, at.s)))
    highest = float(np.max(rate))
    rise_time = size / highest if highest > 0.0 else math.inf
    error = share * _ERROR_PER_RATIO * ratio
    return HardImpact(part, beam.name, rise_time, ratio, error, beam.length / length)


def _measure_rates(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    part: str,
    load: Quantity,
    inclination: float,
    end: float,
) -> tuple[float, Array]:
    """Return the largest force [N], and the largest axial and transverse rates [N/s], (2,).

    Steps that end after the time `end` [s] are ignored.
    """
    assert equations.mechanism is not None
    numbers = NumberStore()
    o = build_observable(part, load, map_coordinates(equations.mechanism), numbers, {})
    p = numbers.all(equations.mechanism.inputs)
    cosine, sine = math.cos(inclination), math.sin(inclination)
    to_section = np.array([[cosine, -sine], [sine, cosine]])
    size, rate = 0.0, np.zeros(2)
    for interval in trajectory.intervals:
        if part in interval.inactive:
            continue
        times, state = interval.times[:: interval.nodes_per_step], interval.state
        values = o.evaluate(p, times, state.q, state.v, np.zeros((len(times), 0)))
        forces, steps = values[:, :2] @ to_section, np.diff(interval.t)
        is_before = interval.t <= end
        size = max(size, float(np.max(np.hypot(*forces[is_before].T), initial=0.0)))
        is_step = (steps > _MIN_STEP * trajectory.end) & is_before[1:]
        rates = np.abs(np.diff(forces, axis=0)[is_step]) / steps[is_step, None]
        rate = np.maximum(rate, np.max(rates, axis=0, initial=0.0))
    return size, rate


def _axial_wave_number(section: Section, frequency: float) -> float:
    """Return |k| [1/m] of axial waves in a damped beam at a frequency [rad/s]."""
    modulus = 1.0 + 1j * frequency * section.damping
    return frequency * math.sqrt(abs(section.rhoA / (section.EA * modulus)))


def _bending_wave_number(section: Section, frequency: float) -> float:
    """Return |k| [1/m] of bending waves in a damped Timoshenko beam at a frequency [rad/s].

    The larger one of the two (Graff, Wave Motion in Elastic Solids, 1975, section 3.4), with the
    complex moduli (1 + i w tau) E and G of Kelvin-Voigt damping: it increases with the frequency,
    although damped waves are longer than undamped ones.
    """
    modulus = 1.0 + 1j * frequency * section.damping
    axial, shear = (section.rhoA / (x * modulus) for x in (section.EA, section.GA))
    half_sum, half_difference = (0.5 * frequency**2 * (shear + x * axial) for x in (1.0, -1.0))
    bending = frequency**2 * section.rhoA / (section.EI * modulus)
    return math.sqrt(abs(half_sum + cmath.sqrt(half_difference**2 + bending)))
