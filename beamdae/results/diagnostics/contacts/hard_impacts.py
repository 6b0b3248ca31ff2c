"""Warnings about contact forces that rise faster than elements of beams resolve."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from beamdae.beams.beam import Beam, BeamAttachment
from beamdae.beams.sections import Section
from beamdae.equations.assembly.building import NumberStore, build_observable
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, format_headers
from beamdae.errors import format_error, format_percent, list_first, name_with_others
from beamdae.parts.attachments import Attachment
from beamdae.parts.bodies.point_mass import PointMass
from beamdae.parts.bodies.rigid_body import RigidBody
from beamdae.parts.joints.joint import Joint
from beamdae.results.columns import Header, remove_unit
from beamdae.results.diagnostics.contacts.model_contacts import attached_mass, contacts_of
from beamdae.results.diagnostics.meshes.moving_loads import measured_quantity
from beamdae.results.diagnostics.resolution.missed_peaks import StepExtremes
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
# The error of the peak of a transverse force on a damped beam grows with the third power of this
# ratio r, and so do those of the accelerations of the beam, which contain the fastest waves. In 55
# runs of boards and beams that fall on stops or are struck (4 to 16 elements, r of 1 to 6, product
# of damping and rate of 0.08 to 13), against 64 elements, forces are off by up to 1.1 % for r < 2
# and by 0.2 to 48 % above, at most 1.8 times the estimate or 2 %; accelerations by up to 17 % for
# r < 1.6 and by up to 80 % for r < 2 (by a fifth of it at heavy chips). Of 4 beams with products of
# 0.03, two have forces that are off by 4 and 9 % for r = 1.3.
_FORCE_ERROR_OF_DAMPED_BENDING, _ACCELERATION_ERROR, _ERROR_EXPONENT = 0.002, 0.05, 3
_MIN_DAMPING_OF_FORCE = 0.05  # of the product of damping and rate
_MIN_ACCELERATION_SHARE = 1e-2  # of the largest one; smaller ones have no warning
# Smaller errors, as of elements beside a heavy mass, have no warning.
_MIN_ERROR = 0.02
# The force on a body to which a joint attaches a beam is wrong from a larger ratio on, and by the
# square of the share of the element in the mass.
_MIN_RATIO_AT_JOINT = 3.0
# Viscous stresses of bending waves follow the impact, and are too small by this error per ratio
# above the smallest ratio, also in beams on heavy bodies that strike something. The largest error
# is that of a ratio of 4. In 231 drops of boxes with cantilevers, clamped and hinged beams and rods
# (1 to 8 elements, damping of 0 to 1e-3 s, box of 0.05 to 30 times the mass of the beam, stiffness
# of 3e8 to 1e13 N/m^1.5), 12 of 60 errors of the force, of strains or of stresses above 5 % had no
# warning without this check, and 3 have none. Of 117 drops with errors below 1 %, none has this.
_VISCOUS_ERROR_PER_RATIO, _MIN_VISCOUS_RATIO, _MAX_VISCOUS_ERROR = 0.2, 0.8, 0.6
# Duration of an impact to either side of its fastest rise, in rise times of its angular frequency,
# in which stresses are compared with their largest ones in the run at this number of times.
_IMPACT_DURATION, _IMPACT_SAMPLES = 5.0, 101
# Above this ratio, the force is that of the mass of the node, whose frequency changes with the root
# of the element length: rise times of shorter elements are shorter.
_RATIO_OF_NODAL_MASS = 6.0
# Factor of the recommended number of elements. Of 57 drops with 2 to 6 elements, 3 with the
# estimated number had a ratio of 1.1 to 1.15.
_MARGIN = 1.2
_DIGITS, _LARGE_ERROR = 1, 1.0  # of stated errors
_MAX_NAMES = 3  # of accelerations in a warning
_MAX_ELEMENTS = 1000  # larger recommended numbers have no use
# Share of a failed run at its end, in which forces diverge: they rise in 1e-16 s there.
_SHARE_OF_FAILURE = 1e-3
_MIN_STEP = 1e-12  # relative to the end time; differences over shorter steps are rounding


class HardImpact(NamedTuple):
    """Contact force whose rise the elements of a beam do not resolve.

    Attributes
    ----------
    part, beam
        Names of the contact and of the beam.
    rise_time
        Largest force over largest rate of the force [s].
    ratio
        Wave number times element length, relative to the largest resolved product.
    error
        Estimated error of the stresses, to a factor of 2 to 3; at least that of the force.
    elements
        Length of the beam over that of the element at the contact.
    column
        Header of an observed stress with this error; empty if other stresses are wrong, too.
    force_error
        Estimated error of the peak of the force; larger ones than `error` count as `error`.
    acceleration_error, accelerations
        Estimated error of observed accelerations of the beam, and their headers.
    """

    part: str
    beam: str
    rise_time: float
    ratio: float
    error: float
    elements: float
    column: str = ""
    force_error: float = math.inf
    acceleration_error: float = 0.0
    accelerations: tuple[str, ...] = ()

    @property
    def required_elements(self) -> int:
        """Estimated number of elements of the beam that resolves the rise."""
        refinement = self.ratio * max(_MARGIN, self.ratio / _RATIO_OF_NODAL_MASS)
        refinement = min(refinement, max(1.0, self.error / _MIN_ERROR))
        return math.ceil(refinement * self.elements)


def find_hard_impacts(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    observe: Callable[[Array], Array],
    has_failed: bool = False,
) -> tuple[HardImpact, ...]:
    """Return the contacts whose force rises faster than a beam resolves.

    With the largest force F, the rate w = max|dF/dt| / F is the angular frequency of the waves that
    an impact emits. Their wave numbers in the beam, of axial waves by the axial component of the
    rate and of bending waves by the transverse one, are compared with the length of the element at
    the contact, or at a joint of the beam with a touched body. Runs of which only some steps are
    stored may miss fast rises.

    Parameters
    ----------
    equations
        The equations of motion of all parts.
    trajectory
        The steps of the run.
    extremes
        Extremes of the observed columns, by header.
    observe
        Function that returns the observed columns (k, n) at ascending times (k,).
    has_failed
        True for a run that has failed, whose last thousandth is ignored.
    """
    impacts = []
    end = trajectory.end
    if has_failed:
        end -= _SHARE_OF_FAILURE * (end - trajectory.start)
    run = _Run(equations, trajectory, extremes, observe, end)
    for part in contacts_of(equations).values():
        # Reversals of friction are fast, too, but their forces are known.
        smooth = replace(part, friction=0.0, static=None, stribeck=None)
        of_part = [
            _measure(run, part.name, section, smooth.load_on(place, axes="body"), mass)
            for place, x in smooth.loaded_points.items()
            for section, mass in _find_struck_sections(equations, x.at)
        ]
        unresolved = [x for x in of_part if x.ratio > 1.0 and x.error > _MIN_ERROR]
        if unresolved:
            impacts.append(max(unresolved, key=lambda x: x.error))
    return tuple(impacts)


class _Run(NamedTuple):
    """Arguments of `find_hard_impacts`, and the time [s] after which steps are ignored."""

    equations: EquationsOfMotion
    trajectory: Trajectory
    extremes: Mapping[str, StepExtremes]
    observe: Callable[[Array], Array]
    end: float


def _find_struck_sections(
    equations: EquationsOfMotion, at: Attachment
) -> Iterator[tuple[BeamAttachment, float]]:
    """Yield sections of beams that a force at a point strikes, and the mass of bodies between [kg].

    These are a touched section, or those that joints attach to the touched body and to further
    bodies which joints attach to it.
    """
    if isinstance(at, BeamAttachment):
        if at.s is not None:
            yield at, 0.0
        return
    mechanism = equations.mechanism
    parts = () if mechanism is None else mechanism.parts.values()
    joints = [x for x in parts if isinstance(x, Joint)]
    bodies = [at.body] if isinstance(at.body, (PointMass, RigidBody)) else []
    mass = 0.0
    for body in bodies:  # grows
        mass += body.mass
        for joint in (x for x in joints if any(y.body is body for y in x.attachments)):
            for other in joint.attachments:
                if isinstance(other, BeamAttachment):
                    if other.s is not None:
                        yield other, mass
                    continue
                is_new = not any(other.body is x for x in bodies)
                if is_new and isinstance(other.body, (PointMass, RigidBody)):
                    bodies.append(other.body)


def hard_impact_warnings(impacts: tuple[HardImpact, ...]) -> Iterator[str]:
    """Yield one warning about the impact that is resolved worst."""
    if not impacts:
        return
    worst = max(impacts, key=lambda x: x.error)
    others = [x.part for x in impacts if x is not worst]
    remedy = "use a lower stiffness that represents the local compliance of the bodies (Hertz)"
    if worst.required_elements <= _MAX_ELEMENTS:
        remedy = f"use about {worst.required_elements} elements, or {remedy.removeprefix('use ')}"
    yield (
        f"{name_with_others(worst.part, others)}: this force rises within "
        f"{worst.rise_time:.2g} s, faster than waves pass the elements of {worst.beam}, so "
        f"{_describe_errors(worst)}; {remedy}."
    )


def _describe_errors(impact: HardImpact) -> str:
    """Return a clause with the errors of the stresses, of accelerations and of the force."""
    size = _format_size(impact.error)
    if impact.column:
        return f"the peak of {remove_unit(impact.column)} may be wrong by {size}"
    accelerations = list_first([remove_unit(x) for x in impact.accelerations], _MAX_NAMES)
    of_accelerations = f"{accelerations} by {_format_size(impact.acceleration_error)}"
    of_force = _format_size(min(impact.force_error, impact.error))
    if of_force == size:
        clause = f"its peak and the stresses may be wrong by {size}"
        return f"{clause}, and {of_accelerations}" if accelerations else clause
    if impact.force_error < _MIN_ERROR:
        of_force = f"less than {format_percent(_MIN_ERROR)}"
    clause = f"the stresses near it may be wrong by {size}"
    if accelerations:
        clause += f", {of_accelerations}"
    return f"{clause}, and its peak by {of_force}"


def _format_size(error: float) -> str:
    return format_error(error, _LARGE_ERROR, _DIGITS).replace("about", "roughly")


def _measure(
    run: _Run, part: str, at: BeamAttachment, load: Quantity, struck_mass: float
) -> HardImpact:
    """Compare the fastest rise of a contact force with the element at a section of a beam.

    `struck_mass` [kg] is that of bodies between the contact and the section, 0 if it is touched.
    """
    size, rate, time = _measure_rates(run, part, load, at.inclination)
    beam = at.body
    element, _ = beam.mesh.locate(at.s)
    length = float(beam.mesh.element_lengths[element])
    frequency = np.zeros(2) if size == 0.0 else rate / size
    section = beam.section.at(at.s)
    speed = math.sqrt(section.EA / section.rhoA)
    axial, transverse = frequency.tolist()
    damping = section.damping * speed / length
    increase = _INCREASE_BY_DAMPING * damping / (damping + _LARGE_DAMPING)
    of_bending = length * _bending_wave_number(section, transverse) / _MAX_BENDING_PRODUCT
    of_tension = length * _axial_wave_number(section, axial) / (_MAX_AXIAL_PRODUCT + increase)
    ratio = max(of_bending, of_tension)
    # The force on a heavy mass hardly depends on the elements.
    mass = section.rhoA * length
    share = mass / (mass + max(struck_mass, attached_mass(run.equations, beam, at.s)))
    highest = float(np.max(rate))
    rise_time = size / highest if highest > 0.0 else math.inf
    error, column = share * _ERROR_PER_RATIO * ratio, ""
    if struck_mass > 0.0:
        error *= share if ratio > _MIN_RATIO_AT_JOINT else 0.0
    force_error = math.inf
    if section.damping * transverse > _MIN_DAMPING_OF_FORCE:
        in_bending = share * _FORCE_ERROR_OF_DAMPED_BENDING * of_bending**_ERROR_EXPONENT
        in_tension = share * _ERROR_PER_RATIO * of_tension if of_tension > 1.0 else 0.0
        force_error = max(in_bending, in_tension)
    of_acceleration = share * _ACCELERATION_ERROR * of_bending**_ERROR_EXPONENT
    errors = _acceleration_errors(run, beam, of_acceleration)
    if of_bending > 1.0 and section.damping > 0.0:
        viscous = section.damping * transverse / (1.0 + section.damping * transverse)
        missing = _VISCOUS_ERROR_PER_RATIO * (of_bending - _MIN_VISCOUS_RATIO)
        missing = viscous * min(missing, _MAX_VISCOUS_ERROR)
        of_stress, header = _largest_stress_error(run, beam, time, 1.0 / transverse, missing)
        if of_stress > error:
            column = header if error <= _MIN_ERROR else ""
            error = of_stress
    return HardImpact(
        part,
        beam.name,
        rise_time,
        ratio,
        error,
        beam.length / length,
        column,
        force_error,
        max(errors.values(), default=0.0),
        tuple(errors),
    )


def _acceleration_errors(run: _Run, beam: Beam, error: float) -> dict[str, float]:
    """Return the errors of observed accelerations of a beam that are not small, by header.

    The `error` without attached bodies decreases with the root of the share of the element in the
    mass.
    """
    mechanism, errors, sizes = run.equations.mechanism, {}, {}
    for name, observed in ({} if mechanism is None else mechanism.observables).items():
        quantity, _ = measured_quantity(observed)
        point = quantity.recipe.arguments[0] if quantity.recipe is not None else None
        if not quantity.has_accelerations or not isinstance(point, BeamAttachment):
            continue
        if point.body is not beam or point.s is None:
            continue
        element, _ = beam.mesh.locate(point.s)
        mass = beam.section.at(point.s).rhoA * float(beam.mesh.element_lengths[element])
        share = mass / (mass + attached_mass(run.equations, beam, point.s))
        for header in format_headers(name, observed.columns):
            if header in run.extremes and Header.of(header).unit == "m/s^2":
                x = run.extremes[header]
                sizes[header] = max(abs(x.max), abs(x.min))
                errors[header] = error * math.sqrt(share)
    smallest = _MIN_ACCELERATION_SHARE * max(sizes.values(), default=0.0)
    return {x: e for x, e in errors.items() if e > _MIN_ERROR and sizes[x] > smallest}


def _largest_stress_error(
    run: _Run, beam: Beam, time: float, rise_time: float, missing: float
) -> tuple[float, str]:
    """Return the largest error of a stress of a beam, and its header.

    Parameters
    ----------
    run, beam
        The run and the beam.
    time, rise_time
        Time of the fastest rise of the contact force, and its duration [s].
    missing
        Share of the change of stresses in the impact that the elements do not follow.
    """
    mechanism, reach = run.equations.mechanism, _IMPACT_DURATION * rise_time
    headers = []
    for name, observed in ({} if mechanism is None else mechanism.observables).items():
        sections = Beam.sections_of_strains(measured_quantity(observed)[0])
        if sections is not None and sections[0] is beam:
            headers += format_headers(name, observed.columns)
    # Strains are not viscous.
    headers = [x for x in headers if x in run.extremes and Header.of(x).unit != "-"]
    if not headers:
        return 0.0, ""
    start, end = max(time - reach, run.trajectory.start), min(time + reach, run.end)
    columns = [run.equations.observed_headers.index(x) for x in headers]
    values = run.observe(np.linspace(start, end, _IMPACT_SAMPLES))[:, columns]
    changes = np.abs(values - values[0])
    errors = []
    for k, header in enumerate(headers):
        peak = np.argmax(changes[:, k])
        # The value without the error of the change, beside the largest one of the run
        full = abs(values[0, k] + (values[peak, k] - values[0, k]) / (1.0 - missing))
        largest = max(abs(run.extremes[header].max), abs(run.extremes[header].min))
        errors.append(1.0 - largest / full if full > 0.0 else 0.0)
    worst = int(np.argmax(errors))
    return float(errors[worst]), headers[worst]


def _measure_rates(
    run: _Run, part: str, load: Quantity, inclination: float
) -> tuple[float, Array, float]:
    """Return the largest force [N], axial and transverse rate [N/s], (2,), and its time [s]."""
    e = run.equations
    assert e.mechanism is not None
    numbers = NumberStore()
    o = build_observable(part, load, map_coordinates(e.mechanism), numbers, {})
    p = numbers.all(e.mechanism.inputs)
    cosine, sine = math.cos(inclination), math.sin(inclination)
    to_section = np.array([[cosine, -sine], [sine, cosine]])
    size, rate, time = 0.0, np.zeros(2), run.trajectory.start
    for interval in run.trajectory.intervals:
        if part in interval.inactive:
            continue
        times, state = interval.times[:: interval.nodes_per_step], interval.state
        values = o.evaluate(p, times, state.q, state.v, np.zeros((len(times), 0)))
        forces, steps = values[:, :2] @ to_section, np.diff(interval.t)
        is_before = interval.t <= run.end
        size = max(size, float(np.max(np.hypot(*forces[is_before].T), initial=0.0)))
        is_step = (steps > _MIN_STEP * run.trajectory.end) & is_before[1:]
        if is_step.any():
            rates = np.abs(np.diff(forces, axis=0)[is_step]) / steps[is_step, None]
            if np.max(rates) > np.max(rate):
                time = float(interval.t[:-1][is_step][np.argmax(np.max(rates, axis=1))])
            rate = np.maximum(rate, np.max(rates, axis=0))
    return size, rate, time


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
