"""Observed forces, moments and powers of all loads, by the principle of virtual work."""

from functools import partial

import casadi as ca
import numpy as np
import pytest
from conformance import LOADS, integrators
from mechanisms import free_ball
from numpy.testing import assert_allclose
from scipy.integrate import simpson
from support import ARC, EXACT_VARIANT, UNEVEN_ELEMENTS, VARIANTS, NumericEquations

import beamdae as bd
from beamdae.equations.measures import ObservedRows
from beamdae.parts.forces.load_observables import ObservableBeamLoad
from beamdae.parts.forces.loads import PointForce

CHORD = VARIANTS[2]
TIME = (0.7, 0.7)
# A fixed mass is a body.
NAMES = [name for name in LOADS if name != "fixed mass"]


def mechanism(name, variant=CHORD):
    mech = bd.Mechanism(gravity=(0.2, -1.5))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(variant.beam(ARC, UNEVEN_ELEMENTS))
    return mech, mech.add(LOADS[name](mech, disk, beam))


def observe(mech, quantity, q, v):
    """Return the values of a quantity at one state."""
    mech.observables.clear()
    mech.observe("load", quantity)
    equations = bd.equations_of_motion(mech)
    rows = ObservedRows(equations)
    lam = np.zeros((1, equations.m))
    return rows(np.array([TIME]), q[None], v[None], 0.0 * v[None], lam)[0]


def random_state(mech, seed):
    numeric, rng = NumericEquations(mech, time=TIME), np.random.default_rng(seed)
    q = numeric.equations.q0 + 0.15 * rng.standard_normal(numeric.n)
    return numeric, q, rng.standard_normal(numeric.n)


def generalized_force(mech, numeric, load, q, v):
    """Return the generalized forces of the load: those of the mechanism with and without it."""
    del mech.parts[load.name]
    mech.observables.clear()
    without = NumericEquations(mech, time=TIME)
    mech.parts[load.name] = load
    zero = np.zeros(numeric.n)
    return without.force(q, v, zero) - numeric.force(q, v, zero)


def jacobian(at, mech, q):
    """Return the derivatives of position and rotation of a point by all coordinates."""
    first, slices = 0, {}
    for part in mech.parts.values():
        slices[part.name] = slice(first, first := first + len(part.coordinates))
    x = ca.SX.sym("x", at.size)
    placement = ca.vertcat(*at.checked_kinematics(x))
    local = ca.Function("local", [x], [ca.jacobian(placement, x)])
    operator, rows = at.operator.toarray(), slices[at.body.name]
    result = np.zeros((3, len(q)))
    result[:, rows] = np.array(local(operator @ q[rows])) @ operator
    return result if at.has_angle else result[:2]


@pytest.mark.parametrize("name", NAMES)
def test_power_is_the_rate_of_work_in_the_energy_ledger(name):
    """It is the power of the loads, less dissipation and the rate of the strain energy."""
    mech, load = mechanism(name)
    numeric, q, v = random_state(mech, 0)
    power = observe(mech, load.power, q, v)[0]
    del mech.parts[load.name]
    mech.observables.clear()
    without = NumericEquations(mech, time=TIME)

    def energies(at):
        return numeric.energies(at, v) - without.energies(at[: without.n], v[: without.n])

    h = 1e-3
    strain = [energies(q + k * h * v)[1] for k in (-2, -1, 1, 2)]
    rate = float(np.dot([1.0, -8.0, 8.0, -1.0], strain)) / (12.0 * h)
    supplied, dissipated = energies(q)[3:]
    # Rounding errors of energies of order one, divided by the step.
    assert_allclose(power, supplied - dissipated - rate, rtol=1e-9, atol=1e-9)
    assert power != 0.0


POINT_LOADS = [name for name in NAMES if isinstance(mechanism(name)[1], PointForce)]


@pytest.mark.parametrize("name", POINT_LOADS)
def test_loads_on_all_points_are_equivalent_to_the_generalized_forces(name):
    mech, load = mechanism(name)
    numeric, q, v = random_state(mech, 1)
    expected, total = generalized_force(mech, numeric, load, q, v), np.zeros(numeric.n)
    for place, point in load.points.items():
        if point.size:
            total += jacobian(point, mech, q).T @ observe(mech, load.load_on(place), q, v)
    assert np.any(total)
    # Rounding errors of forces up to 100.
    assert_allclose(total, expected, rtol=1e-9, atol=1e-11)


BEAM_LOADS = [name for name in NAMES if isinstance(mechanism(name)[1], ObservableBeamLoad)]


@pytest.mark.parametrize("variant", [CHORD, EXACT_VARIANT], ids=str)
@pytest.mark.parametrize("name", BEAM_LOADS)
def test_resultants_on_beams_are_the_work_on_rigid_motions(name, variant):
    mech, load = mechanism(name, variant)
    numeric, q, v = random_state(mech, 2)
    expected = generalized_force(mech, numeric, load, q, v)
    # Rigid motions, found from the motion of the sections: translations, and a rotation about the
    # start, which moves a section by its arm from the start.
    sections = [load.beam.at(s) for s in np.linspace(0.0, load.beam.length, 9)]
    gradients = np.concatenate([jacobian(at, mech, q) for at in sections])
    places = np.array([observe(mech, at, q, v)[:2] for at in sections])
    arms = places - places[0]
    for quantity, column, rate in (
        (load.force, 0, lambda arm: (1.0, 0.0, 0.0)),
        (load.force, 1, lambda arm: (0.0, 1.0, 0.0)),
        (load.moment, 0, lambda arm: (-arm[1], arm[0], 1.0)),
    ):
        motion = np.concatenate([rate(arm) for arm in arms])
        dq = np.linalg.lstsq(gradients, motion)[0]
        assert_allclose(gradients @ dq, motion, atol=1e-9)
        value = observe(mech, quantity, q, v)[column]
        assert_allclose(value, expected @ dq, rtol=1e-8, atol=1e-9)


def test_observed_loads_of_a_run_have_units_and_integrate_to_the_ledger():
    """A block slides on a guide with friction, pushed by a force and a follower moment."""
    mech = bd.Mechanism()
    block = mech.add(bd.RigidBody("block", 1.0, 0.01, velocity=(2.0, 0.0)))
    corner = block.at(0.1, 0.2)
    guide = mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.0), block.at(0.0, 0.0)))
    rub = mech.add(bd.Friction("rub", guide, 0.2, friction_speed=0.1, radius=0.1))
    push = mech.add(bd.Force("push", corner, (0.5, lambda t: -2.0 - t)))
    mech.observe("push", push.load_on("on"))
    mech.observe("push power", push.power)
    mech.observe("rub", rub.force)
    mech.observe("rub F", rub.reaction)
    mech.observe("rub power", rub.power)
    table = bd.simulate(mech, bd.Radau(1e-8), t_end=0.4, output_step=2e-3).table()
    t = table["t [s]"].to_numpy()
    assert_allclose(table["push.Fx [N]"], 0.5, rtol=1e-14)
    assert_allclose(table["push.Fy [N]"], -2.0 - t, rtol=1e-13)
    assert_allclose(table["push.M [N m]"], 0.0, atol=1e-14)
    assert_allclose(table["rub.Fx [N]"], table["rub F.F [N]"], rtol=1e-12)
    assert_allclose(table["rub.Fy [N]"], 0.0, atol=1e-12)
    for power, work in (
        ("push power.power [W]", table["energy.work_of_loads [J]"]),
        ("rub power.power [W]", -table["energy.dissipated [J]"]),
    ):
        # Simpson's rule with 200 intervals; the error of the run is less than 1e-7.
        integral = simpson(table[power].to_numpy(), x=t)
        assert_allclose(integral, work.to_numpy()[-1], rtol=1e-6)


def test_moments_refer_to_the_loaded_point():
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.1, (500.0, 400.0)))
    motor = mech.add(bd.Moment("motor", disk.at(501.0, 403.0), 2.5))
    spring = mech.add(
        bd.TorsionSpring("spring", mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0), stiffness=3.0)
    )
    pull = mech.add(bd.Force("pull", disk.at(0.0, 0.0), (1.0, 2.0), axes="body"))
    q, v = np.array([501.0, 402.0, 0.3]), np.array([0.1, 0.2, 0.4])
    assert_allclose(observe(mech, motor.moment, q, v), 2.5, rtol=1e-15)
    assert_allclose(observe(mech, motor.force, q, v), 0.0, atol=1e-15)
    assert_allclose(observe(mech, motor.power, q, v), 1.0, rtol=1e-15)
    assert_allclose(observe(mech, spring.moment, q, v), -0.9, rtol=1e-14)
    c, s = np.cos(0.3), np.sin(0.3)
    assert_allclose(observe(mech, pull.force, q, v), [c - 2.0 * s, s + 2.0 * c], rtol=1e-14)
    # Rounding error of a force of order one with an arm of 640 m.
    assert_allclose(observe(mech, pull.load_on("on", axes="body"), q, v), [1, 2, 0], atol=3e-13)


def two_bodies(torque, arm_inertia=0.02):
    """Return a mechanism of a free base and arm, and a motor between them, with its power."""
    mech = bd.Mechanism()
    base = mech.add(bd.RigidBody("base", 2.0, 0.1, (0.0, 0.0)))
    arm = mech.add(bd.RigidBody("arm", 0.5, arm_inertia, (0.4, 0.0)))
    mech.observe("base", base.at(0.0, 0.0))
    mech.observe("arm", arm.at(0.4, 0.0))
    on, reaction_on = arm.at(0.1, 0.0), base.at(0.1, 0.0)
    motor = mech.add(bd.Moment("motor", on, torque, reaction_on=reaction_on))
    mech.observe("motor", motor.power)
    mech.observe("torque", motor.moment)
    mech.observe("reaction", motor.load_on("reaction_on"))
    return mech


@integrators(rtol=1e-6, step=0.02)
@pytest.mark.parametrize(("torque", "arm_inertia"), [(0.3, 0.02), (-30.0, 2.0)])
def test_motors_exchange_angular_momentum_and_supply_the_kinetic_energy(
    integrator, torque, arm_inertia
):
    mech = two_bodies(torque, arm_inertia)
    table = bd.simulate(mech, integrator, t_end=1.0, output_step=0.1).table()
    t = table["t [s]"].to_numpy()
    # Rounding errors: all columns are polynomials of degree two.
    close = partial(assert_allclose, rtol=1e-9, atol=1e-9 * abs(torque))
    close(table["arm.angle_dot [rad/s]"], torque / arm_inertia * t)
    close(table["base.angle_dot [rad/s]"], -torque / 0.1 * t)
    power = torque**2 * (1.0 / arm_inertia + 1.0 / 0.1) * t
    close(table["motor.power [W]"], power)
    close(table["torque.M [N m]"], torque)
    close(table["reaction.M [N m]"], -torque)
    close(table["reaction.Fx [N]"], 0.0)
    close(table["energy.work_of_loads [J]"], 0.5 * power * t)
    close(table["energy.kinetic [J]"], 0.5 * power * t)
    close(table["energy.imbalance [J]"], 0.0)


def test_motors_within_a_rigid_body_do_nothing_and_those_on_the_ground_are_moments():
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("body", 1.0, 0.1, (0.0, 0.0)))
    on, ground = body.at(0.0, 0.0), mech.ground.at(0.0, 0.0)
    motor = mech.add(bd.Moment("motor", on, 2.0, reaction_on=ground))
    v = np.array([0.1, 0.2, 0.4])
    assert_allclose(observe(mech, motor.power, np.zeros(3), v), 0.8, rtol=1e-15)
    load = observe(mech, motor.load_on("reaction_on"), np.zeros(3), v)
    assert_allclose(load, (0.0, 0.0, -2.0), rtol=1e-15)
    inside = mech.add(bd.Moment("inside", on, 2.0, reaction_on=body.at(0.1, 0.0)))
    assert observe(mech, inside.power, np.zeros(3), v) == 0.0


BETWEEN_POINTS = [
    name
    for name in POINT_LOADS
    if (load := mechanism(name)[1]).acts_between_attachments and len(load.points) == 2
]


@pytest.mark.parametrize("name", BETWEEN_POINTS)
def test_loads_on_both_points_also_of_the_ground_are_in_equilibrium(name):
    mech, load = mechanism(name)
    _, q, v = random_state(mech, 3)
    total = np.zeros(3)
    for place, point in load.points.items():
        x, y = observe(mech, point, q, v)[:2]
        force = np.zeros(3)
        columns = observe(mech, load.load_on(place), q, v)
        force[: len(columns)] = columns
        total += (*force[:2], force[2] + x * force[1] - y * force[0])
    assert_allclose(total, 0.0, atol=1e-11)


def test_law_on_several_points_has_numbered_columns():
    _, load = mechanism("law of a force")
    assert [x.header for x in load.force.columns] == ["Fx1 [N]", "Fy1 [N]", "Fx2 [N]", "Fy2 [N]"]
    assert [x.header for x in load.moment.columns] == ["M1 [N m]", "M2 [N m]"]
    assert [x.header for x in load.load_on("2").columns] == ["Fx [N]", "Fy [N]", "M [N m]"]


def test_regression_loads_of_parts_that_were_not_added_are_refused_by_name():
    """A contact that was observed but not added had a force of 0.2 MN and no effect."""
    mech, ball = free_ball((0.0, 0.1), 0.2, gravity=9.81)
    contact = bd.Contact("floor", ball.point, bd.LineSurface(mech.ground.at(0.0, 0.0)), 1e6)
    mech.observe("force", contact.force)
    with pytest.raises(bd.BeamdaeError, match="force: 'floor' is not part of the mechanism, so it"):
        bd.equations_of_motion(mech)
    mech.add(contact)
    bd.equations_of_motion(mech)


def test_observed_loads_follow_changes_of_inputs():
    mech, ball = free_ball((0.0, 1.0))
    thrust = mech.input("thrust", default=2.0)
    push = mech.add(bd.Force("push", ball.point, (3.0 * thrust, 0.0)))
    mech.observe("push", push.force)
    solution = bd.simulate(mech, t_end=0.1, output_step=0.1, inputs={"thrust": 5.0})
    assert_allclose(solution.table()["push.Fx [N]"], 15.0, rtol=1e-14)


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_observed_loads_follow_variables_of_laws_in_a_second_run():
    """Observed columns were those of the laws at the call of `observe`, forces those of the run."""
    size = [1.0]
    mech = bd.Mechanism()
    block = mech.add(bd.RigidBody("block", mass=1.0, inertia=1.0))
    point = block.at(0.0, 0.0)
    ground = mech.ground.at(0.0, -1.0)
    loads = [
        bd.Force("force", point, (lambda t: size[0] + 0.0 * t, 0.0)),
        bd.Moment("moment", point, law=lambda t: size[0] + 0.0 * t),
        bd.ForceLaw("formula", point, lambda block, t: (size[0], 0.0)),
        bd.Spring("spring", ground, point, law=lambda s, v: size[0], free_length=1.0),
    ]
    for load in loads:
        mech.observe(load.name, mech.add(load).load_on("b" if load.name == "spring" else "on"))
    for size[:] in ([1.0], [2.0]):
        run = bd.simulate(mech, bd.GeneralizedAlpha(1e-3), t_end=0.01)
        observed = [run["force.Fx"], run["moment.M"], run["formula.Fx"]]
        observed.append(np.hypot(run["spring.Fx"], run["spring.Fy"]))
        assert_allclose(observed, size[0], rtol=1e-12)
        added = run.observe("added", loads[2].force)["added.Fx"]
        assert_allclose(added, size[0], rtol=1e-12)
