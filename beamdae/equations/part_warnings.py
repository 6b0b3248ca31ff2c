"""Warnings about parts without effect or bearing, friction peaks, starts and supplied energy.

`check` reports them before a run, `Solution.warnings` after a run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from beamdae.equations.assembly.coordinate_map import (
    CoordinateMap,
    locate_attachments,
    map_coordinates,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, PartStatements, State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.mobility import select_free_groups
from beamdae.equations.starts.rigid_motions import compute_rigid_motions
from beamdae.parts.events import select_impacts, select_switches
from beamdae.parts.forces.regularized_friction import suggest_speed
from beamdae.parts.joints.drivers import Driver
from beamdae.parts.mechanism import EQUILIBRIUM, Mechanism
from beamdae.parts.part import Part, SurfaceGap
from beamdae.symbolic.functions.compiled import Compiled
from beamdae.symbolic.kernel_groups import group_by_kernel
from beamdae.symbolic.statements import ForceStatement, Local, Quantity, QuantityKernel

Array = np.ndarray

# Penetration that is rounding noise of the drawing, relative to the length of the mechanism.
_MAX_ROUNDING_DEPTH = 1e-9
# Static forces explain a penetration if the energy stored in the contact is at most this multiple
# of the work of the other forces on one of its bodies over the penetration; the ratio is
# 1 / (1 + exponent) if a body rests on one contact.
_MAX_STATIC_RATIO = 10.0
# Stored energies below this fraction of the kinetic energy change velocities by less than 0.1 %.
_NEGLIGIBLE_ENERGY = 1e-6
# Random positions of a body, at which the distances of attachments are compared.
_RIGIDITY_SAMPLES = 4
_RIGIDITY_TOLERANCE = 1e-9  # relative to the coordinates
# Random velocities at which damping is evaluated before a run, relative to length / (1 s).
_VELOCITY_SAMPLES = 16
# Energy supplied by damping, relative to all energy that it or the run exchanges; less does not
# change the motion noticeably.
_MAX_SUPPLIED_SHARE = 1e-3
_POWER_ROUNDING = 1e-9  # rounding errors of the damping, relative to the work of the whole law
# The largest friction may be less than the static friction by this fraction. Near self-locking,
# forces change by ten times this fraction and more.
_MAX_PEAK_REDUCTION = 0.005
# Largest plausible friction coefficient; those of rubber and of clean metals reach about 3.
_MAX_FRICTION = 5.0
_SEED = 1


def idle_part_warnings(
    equations: EquationsOfMotion, start: float = 0.0, end: float | None = None
) -> Iterator[str]:
    """Yield warnings about parts that exert no force or never act, actions without effect.

    Friction whose peak is lost in its regularization is reported, too.

    Parameters
    ----------
    equations
        Equations of motion; those of a constrained system yield no warnings.
    start, end
        Time span of the run [s]. If `end` is None, a part without force is reported only if it
        exerts none at any time after `start`.
    """
    mechanism = equations.mechanism
    if mechanism is None:
        return
    coordinates, statements_of = map_coordinates(mechanism), _find_statements(equations)
    for part in mechanism.parts.values():
        if coordinates.sizes[id(part)]:
            continue
        if _is_within_rigid_body(part, coordinates):
            body = part.attachments[0].body.name
            yield (
                f"{part.name}: both ends are fixed to {body}, so the part does nothing; attach one "
                "end to another body or to the ground."
            )
        else:
            yield from _zero_force_warnings(statements_of(part), start, end)
    yield from _friction_warnings(mechanism)
    yield from _switch_warnings(mechanism)


def unguided_driver_warnings(
    equations: EquationsOfMotion, time: Array, q: Array, duration: float
) -> Iterator[str]:
    """Yield a warning per driver of a rotation whose bodies nothing else connects.

    Bodies that forces hold have no warning, see `select_free_groups`.

    Parameters
    ----------
    equations
        The equations of motion.
    time, q
        (t, branch) and coordinates at the start of the run.
    duration
        Time of the run [s].
    """
    mechanism = equations.mechanism
    if mechanism is None:
        return
    drivers = [part for part in mechanism.parts.values() if isinstance(part, Driver)]
    if not drivers:
        return
    group_of = _group_connected_bodies(mechanism)
    names = {part.name for part in equations.parts}
    for driver in drivers:
        ends = [group_of[x.body.name] for x in driver.attachments]
        if ends[0] == ends[1]:
            continue
        groups = [tuple(sorted(names & x)) for x in ends if mechanism.ground.name not in x]
        free = select_free_groups(equations, time, q, duration, groups)
        body, other = (x.body.name for x in reversed(driver.attachments))
        if free and not any(body in group for group in free):
            body, other = other, body
        if free:
            yield (
                f"{driver.name}: it prescribes the rotation of {body} relative to {other}, but "
                f"nothing holds {body} in translation; add a joint, such as a Revolute."
            )


def _group_connected_bodies(mechanism: Mechanism) -> dict[str, frozenset[str]]:
    """Return the bodies that parts other than drivers of rotations connect to each body."""
    groups = {name: frozenset([name]) for name in (mechanism.ground.name, *mechanism.parts)}
    for part in mechanism.parts.values():
        if not isinstance(part, Driver):
            connected = frozenset().union(*(groups[x.name] for x in (part, *part.bodies)))
            groups |= dict.fromkeys(connected, connected)
    return groups


def _find_statements(equations: EquationsOfMotion) -> Callable[[Part], PartStatements]:
    """Return a function that returns the statements of a part at constant gravity.

    Statements of the assembly are used if possible: stating a load with a table takes milliseconds.
    """
    mechanism = equations.mechanism
    assert mechanism is not None
    known = {} if mechanism.gravity_laws else {id(x.part): x for x in equations.statements}

    def find(part: Part) -> PartStatements:
        if id(part) in known:
            return known[id(part)]
        constraints, forces = part.constraints(), part.forces(mechanism.gravity)
        return PartStatements(part, tuple(constraints), tuple(forces))

    return find


def _zero_force_warnings(
    statements_of_part: PartStatements, start: float, end: float | None
) -> Iterator[str]:
    """Yield a warning if all forces of a part without coordinates and constraints are zero."""
    part, constraints, statements = statements_of_part
    if not statements or constraints:
        return
    breakpoints = sorted({b for law in part.laws for b in law.breakpoints})
    if end is not None:
        inside = [b for b in breakpoints if start < b < end]
        branches = [0.5 * (a + b) for a, b in pairwise((start, *inside, end))]
        if not all(_is_zero(statement, branches) for statement in statements):
            return
    later = [start, *(b for b in breakpoints if b > start)]
    always = [*(0.5 * (a + b) for a, b in pairwise(later)), np.nextafter(later[-1], np.inf)]
    if all(_is_zero(statement, always) for statement in statements):
        # Loads that are always zero are inputs of linear models.
        if not part.inputs:
            yield (
                f"{part.name}: the part exerts no force at any time; change its coefficients, "
                "start or law, or remove the part."
            )
    elif end is not None:
        yield (
            f"{part.name}: the part exerts no force from t = {start:g} to {end:g} s; change its "
            "start, speed or time law, or the end of the run."
        )


def _friction_warnings(mechanism: Mechanism) -> Iterator[str]:
    """Yield warnings about parts with implausible friction, or with reduced static friction."""
    for part in mechanism.parts.values():
        law = getattr(part, "regularized_friction", None)
        if law is None:
            continue
        largest = law.largest_coefficient
        if largest > _MAX_FRICTION:
            yield (
                f"{part.name}: the friction coefficient is {largest:g}, but those of dry surfaces "
                "are seldom above 1; if it is a percentage, divide it by 100."
            )
        if law.static is None or law.stribeck is None:
            continue
        if largest < (1.0 - _MAX_PEAK_REDUCTION) * law.static:
            yield (
                f"{part.name}: friction reaches a coefficient of {largest:.3g} instead of static = "
                f"{law.static:g}, because friction_speed ({law.speed:g} m/s) is too large for "
                f"stribeck ({law.stribeck:g} m/s); use friction_speed="
                f"{suggest_speed(law.stribeck):.3g} or less."
            )


def _is_zero(statement: ForceStatement, branches: Sequence[float]) -> bool:
    """Return True if the force of all copies is identically zero on these branches of its laws.

    A force that happens to be zero at a random state is examined symbolically.
    """
    kernel = statement.kernel
    x = kernel.local
    # Compiled once for all models with this kernel, whose data include all numbers.
    (group,) = group_by_kernel([statement])
    evaluate = Compiled(group.kernel.force_kernel.function)
    state = _random_state(3 * x.size + x.n_multipliers)
    copies = group.data if group.data.shape[1] == 1 else np.unique(group.data, axis=1)
    for numbers in copies.T if copies.size else [np.zeros(0)]:
        for branch in branches if kernel.has_branches else branches[:1]:
            time = np.array([branch, branch])
            if np.any(evaluate(time, np.concatenate([state, numbers]))[0]):
                return False
            symbols = [x.data, x.time[1]]
            values = [ca.DM(numbers[: x.data.numel()]), ca.DM(branch)]
            (force,) = ca.substitute([kernel.force], symbols, values)
            if not force.is_zero():
                return False
    return True


@lru_cache(maxsize=16)
def _random_state(size: int) -> Array:
    return np.random.default_rng(_SEED).standard_normal(size)


def _is_within_rigid_body(part: Part, coordinates: CoordinateMap) -> bool:
    """Return True if a part acts between points of one body whose distance cannot change."""
    if not part.acts_between_attachments:
        return False
    attachments = part.attachments
    if len({id(x.body) for x in attachments}) != 1:
        return False
    random = np.random.default_rng(_SEED)
    rows = coordinates.slice_of(attachments[0].body)
    distances = []
    for _ in range(_RIGIDITY_SAMPLES):
        q = np.zeros(coordinates.n)
        q[rows] = random.standard_normal(rows.stop - rows.start)
        positions = locate_attachments(attachments, q, coordinates)
        distances.append(np.linalg.norm(np.diff(positions, axis=0)))
    size = 1.0 + max(distances)
    return bool(np.ptp(distances) <= _RIGIDITY_TOLERANCE * size)


def _switch_warnings(mechanism: Mechanism) -> Iterator[str]:
    """Yield warnings about inactive parts that no event activates and actions without effect."""
    events = [*mechanism.events, *(x for part in mechanism.parts.values() for x in part.events)]
    switches = [(event, switch) for event in events for switch in select_switches(event.do)]
    activated = {name for _, switch in switches for name in switch.on}
    deactivated = {name for _, switch in switches for name in switch.off}
    impacts = [(event, impact) for event in events for impact in select_impacts(event.do)]
    # Impacts act on inactive joints.
    stops = {impact.on.name for _, impact in impacts if isinstance(impact.on, Part)}
    for name in sorted(mechanism.inactive - activated - stops):
        yield (
            f"{name}: the part is inactive from the start and no event activates it, so it never "
            "acts; add an event with activate, or do not deactivate the part."
        )
    for event, switch in switches:
        for name in switch.on:
            if name not in deactivated | mechanism.inactive | {*switch.as_is}:
                yield (
                    f"{event.name}: {name} is always active, so its activation does nothing; "
                    "deactivate the part first."
                )
        for name in switch.off:
            if name in mechanism.inactive - activated:
                yield (
                    f"{event.name}: {name} is never active, so its deactivation does nothing; "
                    "omit it, or do not deactivate the part at the start."
                )
    for event, impact in impacts:
        joint = impact.on
        if isinstance(joint, Part) and joint.name not in deactivated | mechanism.inactive:
            yield (
                f"{event.name}: {joint.name} is always active, so an impact on it does nothing; "
                "deactivate the joint at the start."
            )


class _StatementValues(NamedTuple):
    """Values of one statement: force on all coordinates (n,), energies (3,) and powers (2,)."""

    force: Array
    energies: Array
    powers: Array


def _evaluate_statement(
    statement: ForceStatement, coordinates: CoordinateMap, time: Array, q: Array, v: Array
) -> _StatementValues:
    """Evaluate a statement at zero accelerations and multipliers."""
    kernel, count = statement.kernel, statement.count
    operators = [coordinates.global_operator([piece]) for piece in statement.pieces]
    function = kernel.balance_kernel.function
    size, n_lam = kernel.local.size, kernel.local.n_multipliers
    force, energies, powers = np.zeros(coordinates.n), np.zeros(3), np.zeros(2)
    for copy in range(count):
        blocks = [np.arange(x.shape[0]).reshape(count, -1)[copy] for x in operators]
        rows = [x[block] for x, block in zip(operators, blocks, strict=True)]
        local = [np.concatenate([x @ z for x in rows]) for z in (q, v)]
        others = np.zeros(size + n_lam), statement.data[:, copy]
        values = function(time, np.concatenate([*local, *others])).full().ravel()
        first = 0
        for x in rows:
            force += x.T @ values[first : first + x.shape[0]]
            first += x.shape[0]
        energies += values[2 * size : 2 * size + 3]
        powers += values[2 * size + 3 :]
    return _StatementValues(force, energies, powers)


class _Penetration(NamedTuple):
    """Contact that starts inside its surface.

    Attributes
    ----------
    part
        The contact part.
    gap
        Gap that is negative, with its remedy.
    depth
        Penetration [m].
    force
        Generalized contact force, as a term of F, (n,).
    energy
        Energy stored in the contact [J].
    """

    part: Part
    gap: SurfaceGap
    depth: float
    force: Array
    energy: float


def start_inside_warnings(
    equations: EquationsOfMotion, active: EquationsOfMotion, time: Array, state: State
) -> Iterator[str]:
    """Yield one warning per contact that starts deeper in a surface than its load explains.

    Gaps of impacts that start inside a surface are also reported. Contacts in equilibrium may be
    as deep as they are.

    Parameters
    ----------
    equations
        Equations of all parts; those of a constrained system yield no warnings.
    active
        Equations of the active parts, without redundant constraints.
    time, state
        (t, branch), and the consistent state at the start of the run.
    """
    mechanism = equations.mechanism
    if mechanism is None or starts_in_equilibrium(equations):
        return
    coordinates = map_coordinates(mechanism)
    min_depth = _MAX_ROUNDING_DEPTH * equations.length
    penetrations = []
    for part in _active_parts(equations):
        gaps = part.gaps
        # `idle_part_warnings` reports parts within a rigid body.
        for gap in () if gaps and _is_within_rigid_body(part, coordinates) else gaps:
            depth = -_evaluate_gap(gap.quantity, coordinates, time, state)
            if depth > min_depth:
                terms = [
                    _evaluate_statement(x, coordinates, time, state.q, state.v)
                    for x in part.forces(mechanism.gravity)
                ]
                force = sum((x.force for x in terms), np.zeros(coordinates.n))
                energy = float(sum(x.energies.sum() for x in terms))
                penetrations.append(_Penetration(part, gap, depth, force, energy))
    if penetrations:
        solver = ConsistencySolver(active)
        # F without the contacts that penetrate.
        others = solver.force(time, state.q, state.v) - sum(x.force for x in penetrations)
        kinetic_energy = _kinetic_energy(solver, time, state)
        for x in penetrations:
            static_force = _smaller_resultant(x, equations, coordinates, state.q, others)
            if (
                x.energy <= _NEGLIGIBLE_ENERGY * kinetic_energy
                or x.energy <= _MAX_STATIC_RATIO * static_force * x.depth
            ):
                continue
            yield (
                f"{x.part.name}: {x.gap.point} starts {x.depth:.3g} m inside the "
                f"surface, far deeper than at rest, and the contact releases {x.energy:.3g} J; "
                f"{x.gap.remedy}, or build the model with bd.Mechanism(start='equilibrium') if it "
                "is a preload."
            )
    for event in mechanism.events:
        for impact in select_impacts(event.do):
            if isinstance(impact.on, Quantity):
                depth = -_evaluate_gap(impact.on.current, coordinates, time, state)
                if depth > min_depth:
                    yield (
                        f"{event.name}: the gap of the impact starts at {-depth:.3g} m, inside the "
                        "surface, where no impact occurs; reverse the surface, or move the body."
                    )


def _active_parts(equations: EquationsOfMotion) -> list[Part]:
    """Return the parts that are active at the start of a run."""
    assert equations.mechanism is not None
    configurations = equations.configurations
    inactive = frozenset() if configurations is None else configurations.initially_inactive
    return [x for name, x in equations.mechanism.parts.items() if name not in inactive]


def _evaluate_gap(
    quantity: Quantity, coordinates: CoordinateMap, time: Array, state: State
) -> float:
    operator = coordinates.global_operator(quantity.pieces)
    local = Local(operator.shape[0], len(quantity.data))
    kernel = QuantityKernel(local, quantity.expression(local))
    q, v = (operator @ x for x in (state.q, state.v))
    return float(kernel.function(time[None], q, v, quantity.data, np.zeros(0))[0, 0])


def _kinetic_energy(solver: ConsistencySolver, time: Array, state: State) -> float:
    mass = solver.linearize_forces(time, state)[2]
    return 0.5 * float(state.v @ (mass @ state.v))


def _smaller_resultant(
    penetration: _Penetration,
    equations: EquationsOfMotion,
    coordinates: CoordinateMap,
    q: Array,
    others: Array,
) -> float:
    """Return the smallest resultant [N] of the other forces on a movable body of a contact."""
    motions = compute_rigid_motions(equations, q) * equations.position_scales[:, None]
    resultants = []
    for body in penetration.part.bodies:
        rows = coordinates.slice_of(body)
        if rows.stop > rows.start:
            work = np.sum(np.abs(motions[rows].T @ others[rows]))
            resultants.append(float(work) / equations.length)
    return min(resultants)


def starts_in_equilibrium(equations: EquationsOfMotion) -> bool:
    """Return True if runs start in the equilibrium of the model."""
    return equations.start is not None and equations.start.description == EQUILIBRIUM


class MotionSamples(NamedTuple):
    """States at which the damping of user-written laws is evaluated.

    Attributes
    ----------
    times
        Rows (t, branch), (k, 2) [s]: ascending in a run, all equal without a run.
    q, v
        Coordinates and velocities, (k, n).
    exchanged_energy
        Energy exchanged in the run, but not less than its rounding noise [J]; 0 without a run.
    """

    times: Array
    q: Array
    v: Array
    exchanged_energy: float = 0.0


def supplied_energy_warnings(
    equations: EquationsOfMotion, sample: Callable[[], MotionSamples]
) -> Iterator[str]:
    """Yield one warning per part whose user-written damping supplies energy.

    Parameters
    ----------
    equations
        Equations of motion; those of a constrained system yield no warnings.
    sample
        Function that returns the states; called only if a part has user-written damping.
    """
    mechanism = equations.mechanism
    if mechanism is None:
        return
    coordinates, statements_of = map_coordinates(mechanism), _find_statements(equations)
    checked = {}
    for part in _active_parts(equations):
        if not coordinates.sizes[id(part)]:
            forces = statements_of(part).forces
            checked[part.name] = [x for x in forces if _has_checked_damping(x)]
    if not any(checked.values()):
        return
    times, q, v, exchanged_energy = sample()
    is_run = bool(times[-1, 0] > times[0, 0])
    weights = np.gradient(times[:, 0]) if is_run else np.ones(len(times))
    for name, statements in checked.items():
        dissipated, work_rate = np.zeros(len(times)), np.zeros(len(times))
        for statement in statements:
            powers = _dissipated_powers(statement, coordinates, times, q, v)
            dissipated += powers[0]
            work_rate += powers[1]
        supplied = float(weights @ np.maximum(-dissipated, 0.0))
        limits = (
            _MAX_SUPPLIED_SHARE * float(weights @ np.abs(dissipated)),
            _MAX_SUPPLIED_SHARE * exchanged_energy,
            _POWER_ROUNDING * float(weights @ work_rate),
        )
        if supplied > max(limits):
            amount = f"{supplied:.3g} J" if is_run else "energy at some velocities"
            yield (
                f"{name}: its law supplies {amount} although the law counts as damping; "
                "check the signs of its rate terms."
            )


def _has_checked_damping(statement: ForceStatement) -> bool:
    """Return True for user-written damping; built-in damping never supplies energy."""
    kernel = statement.kernel
    return not (kernel.reused or kernel.local.n_multipliers or kernel.powers[1].is_zero())


def _dissipated_powers(
    statement: ForceStatement, coordinates: CoordinateMap, times: Array, q: Array, v: Array
) -> tuple[Array, Array]:
    """Return the dissipated power and |force . velocity| of a statement [W], (k,) each."""
    rows = [
        _evaluate_statement(statement, coordinates, *row) for row in zip(times, q, v, strict=True)
    ]
    forces = np.array([x.force for x in rows])
    return np.array([x.powers[1] for x in rows]), np.abs(np.sum(forces * v, axis=1))


def sample_velocities(equations: EquationsOfMotion, time: Array, state: State) -> MotionSamples:
    """Return copies of a state with random velocities, at which `check` evaluates damping."""
    random = np.random.default_rng(_SEED).standard_normal((_VELOCITY_SAMPLES, equations.n))
    v = state.v + random * equations.position_scales
    times, q = (np.broadcast_to(x, (len(v), len(x))) for x in (time, state.q))
    return MotionSamples(times, q, v)
