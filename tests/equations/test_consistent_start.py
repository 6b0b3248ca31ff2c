"""Consistent initial conditions: closed joints, projected velocities, accelerations, reactions."""

import casadi as ca
import numpy as np
import pytest
from mechanisms import (
    balance_wheel,
    clamped_beam,
    crank_and_ram,
    driven,
    free_ball,
    hinged_body,
    rectangle,
)
from numpy.testing import assert_allclose
from support import ARC, REPRESENTATIVE_VARIANTS, VARIANTS, NumericEquations

import beamdae as bd
from beamdae.equations.starts.consistent_start import ConsistencySolver

few_variants = pytest.mark.parametrize("variant", REPRESENTATIVE_VARIANTS, ids=str)
TIP = tuple(ARC.point(ARC.length))


def make_consistent(mech, t=0.0, q=None, v=None):
    numeric = NumericEquations(mech, time=(t, t))
    e = numeric.equations
    state = ConsistencySolver(e).state(
        numeric.time, e.q0 if q is None else q, e.v0 if v is None else v
    )
    return numeric, state


def crank_and_rod(variant, angle=0.0, gravity=(0.3, -2.0)):
    """Return a driven crank and a flexible rod whose end slides on a line."""
    mech = bd.Mechanism(gravity=gravity)
    crank = mech.add(bd.RigidBody("crank", mass=1.1, inertia=0.4, center=(0.1, -0.05)))
    beam = mech.add(variant.beam(ARC))
    hub = (mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0))
    mech.add(bd.Revolute("bearing", *hub))
    mech.add(bd.Driver("motor", *hub, law=lambda t: angle + 2.0 * t + t**2))
    mech.add(bd.Revolute("pin", crank.at(*ARC.start), beam.start))
    mech.add(bd.PointOnLine("guide", mech.ground.at(*TIP), beam.end, direction=(1.0, 0.2)))
    return mech


def assert_consistent(numeric, state):
    levels = [np.abs(level(state.q, state.v, state.a)).max() for level in numeric.levels]
    # Gaps are closed to 1e-12; the other errors are rounding of forces up to 100.
    assert levels[0] < 1e-11
    assert levels[1] < 1e-12
    assert levels[2] < 1e-11
    balance = numeric.force(state.q, state.v, state.a) + numeric.reaction(state.q, lam=state.lam)
    assert_allclose(balance, 0.0, atol=1e-10)


# Consistency -----------------------------------------------------------------------------------


@few_variants
def test_start_satisfies_constraints_and_equations_of_motion(variant):
    numeric, state = make_consistent(crank_and_rod(variant, angle=0.02), t=0.1)
    assert_consistent(numeric, state)


@few_variants
def test_a_consistent_start_does_not_change(variant):
    numeric, state = make_consistent(crank_and_rod(variant), t=0.1)
    again = ConsistencySolver(numeric.equations).state(numeric.time, state.q, state.v)
    assert_allclose(again.q, state.q, rtol=0.0, atol=0.0)
    # The velocity is projected once more.
    assert_allclose(again.v, state.v, atol=1e-13)


@few_variants
def test_velocities_change_least_in_kinetic_energy(variant):
    """v - v0 = -M^-1 G^T (G M^-1 G^T)^-1 (G v0 + dg/dt), written out with dense matrices."""
    mech = crank_and_rod(variant)
    rng = np.random.default_rng(0)
    requested = rng.standard_normal(NumericEquations(mech).n)
    numeric, state = make_consistent(mech, t=0.1, v=requested)
    mass, joint = numeric.mass(state.q), numeric.constraint_matrix(state.q)
    lever = np.linalg.solve(mass, joint.T)
    g_dot = numeric.levels[1](state.q, requested)
    expected = requested - lever @ np.linalg.solve(joint @ lever, g_dot)
    # The error is rounding times the condition number of the mass matrix, 1e3.
    assert_allclose(state.v, expected, atol=1e-10)
    # The change is orthogonal to all admissible velocities.
    _, _, right = np.linalg.svd(joint)
    admissible = right[numeric.m :].T
    assert_allclose(admissible.T @ mass @ (state.v - requested), 0.0, atol=1e-10)


# Closing joints --------------------------------------------------------------------------------


def test_two_disks_share_an_offset_in_inverse_proportion_to_inertia():
    """The change is least in the metric of the mass matrix: the heavier disk moves less."""
    mech = bd.Mechanism()
    for name, inertia in (("light", 1.0), ("heavy", 3.0)):
        body = mech.add(bd.RigidBody(name, mass=1.0, inertia=inertia))
        mech.add(bd.Revolute(f"{name} bearing", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
    light, heavy = mech.part("light"), mech.part("heavy")
    mech.add(bd.Driver("gear", light.at(0.0, 0.0), heavy.at(0.0, 0.0), law=0.1))
    numeric, state = make_consistent(mech)
    assert_consistent(numeric, state)
    # The constraint is linear in the angles: the error is rounding.
    assert_allclose(state.q[2], -0.075, rtol=1e-12)
    assert_allclose(state.q[5], 0.025, rtol=1e-12)


def strain_energy_of_an_offset(variant, height, offset):
    """Return the strain energy of a beam on a driven hub, relative to bending by the offset."""
    alloy = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
    strip = rectangle(height, 0.03, material=alloy)
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", mass=1.0, inertia=0.1, center=ARC.start))
    beam = mech.add(variant.beam(ARC, section=strip))
    center = (mech.ground.at(*ARC.start), hub.at(*ARC.start))
    mech.add(bd.Revolute("pivot", *center))
    mech.add(bd.Weld("root", hub.at(*ARC.start), beam.start))
    mech.add(bd.Driver("motor", *center, law=offset))
    numeric, state = make_consistent(mech)
    assert np.abs(numeric.levels[0](state.q)).max() < 1e-11
    assert_allclose(state.q[2], offset, rtol=1e-12)
    return numeric.energies(state.q)[1] / (0.5 * strip.EI / ARC.length * offset**2)


@pytest.mark.slow(reason="half a second")
@few_variants
@pytest.mark.parametrize("offset", [-2.0, 4.7])
def test_large_offsets_do_not_stretch_beams(variant, offset):
    assert strain_energy_of_an_offset(variant, height=0.03, offset=offset) < 1e-2


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize("thickness", [3e-5, 3e-7])
def test_wound_springs_are_only_bent(thickness):
    wheel = balance_wheel(thickness)
    spring = wheel.part("spring")
    wound = bd.simulate(wheel, t_end=1e-6, start={"wheel.angle": 3.0})
    stiffness = spring.section.EI / spring.curve.length
    # The forces of the clamps bend the coils a little more; 1.3 % on meshes of 29 to 80 elements.
    assert_allclose(wound["energy.strain"].iloc[0], 0.5 * stiffness * 3.0**2, rtol=2e-2)


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_regression_rods_follow_a_crank_that_starts_far_away(formulation):
    """Rods became twice as long, or turned several times."""
    mech = bd.load_model("example:slider_crank")(elements=2, formulation=formulation)
    # The crank starts at 1.5 pi.
    numeric, state = make_consistent(mech, t=1.75)
    bending_energy = 919.0 / 4.6  # EI / length [J]
    assert numeric.energies(state.q)[1] < 1e-2 * bending_energy
    names = [x.name for x in numeric.equations.coordinates]
    angles = [k for k, name in enumerate(names) if name in ("rod.theta", "rod.psi0")]
    assert np.all(np.abs(state.q[angles]) < 0.5 * np.pi)


def test_regression_four_bars_start_although_a_part_of_a_gap_cannot_be_closed():
    """The gap of the driver was closed at once, but not in two steps, and the start failed."""
    mech = bd.Mechanism()
    foot, crank_end, rocker_end = (1.18, 0.0), (0.923, -0.227), (1.086, -0.679)
    bars = {"crank": ((0, 0), crank_end), "rod": (crank_end, rocker_end)}
    bars |= {"rocker": (foot, rocker_end)}
    crank, rod, rocker = (
        mech.add(bd.RigidBody.rod(name, *ends, density=7800.0, area=1e-4))
        for name, ends in bars.items()
    )
    for point, first, second in (
        ((0.0, 0.0), mech.ground, crank),
        (crank_end, crank, rod),
        (rocker_end, rod, rocker),
        (foot, mech.ground, rocker),
    ):
        mech.add(bd.Revolute(f"pin {len(mech.parts)}", first.at(*point), second.at(*point)))
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0), 0.6))
    numeric, state = make_consistent(mech)
    assert_consistent(numeric, state)


def slider_crank(angle):
    """Return a 2 m crank with a 1.5 m rod, which does not reach the line beyond arcsin(3/4)."""
    crank = bd.RigidBody("crank", mass=1.0, inertia=1.0, center=(1.0, 0.0))
    mech, crank = driven(crank, angle)
    rod = mech.add(bd.RigidBody("rod", mass=1.0, inertia=1.0, center=(2.75, 0.0)))
    mech.add(bd.Revolute("pin", crank.at(2.0, 0.0), rod.at(2.0, 0.0)))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), rod.at(3.5, 0.0)))
    return mech


@pytest.mark.parametrize("angle", [0.01, 0.4, 0.8])
def test_joints_close_from_far_positions(angle):
    numeric, state = make_consistent(slider_crank(angle))
    assert_consistent(numeric, state)
    # The rod stays on its branch.
    assert_allclose(state.q[5], -np.arcsin(2.0 * np.sin(angle) / 1.5), atol=1e-11)


@pytest.mark.parametrize("angle", [0.9, 1.2, 2.0])
def test_an_unreachable_position_is_reported_in_one_sentence(angle):
    with pytest.raises(bd.BeamdaeError) as error:
        make_consistent(slider_crank(angle))
    message = str(error.value)
    assert "the joints cannot be closed at t = 0" in message
    assert message.split(".")[0] in ("hinge", "pin", "guide", "motor")
    assert "a gap of" in message
    assert message.endswith(".")
    assert "\n" not in message


# Refusals --------------------------------------------------------------------------------------


def pendulum(name, mech, x=0.0):
    body = mech.add(bd.RigidBody(name, mass=1.0, inertia=1.0, center=(x + 1.0, 0.0)))
    mech.add(bd.Revolute(f"{name} hinge", mech.ground.at(x, 0.0), body.at(x, 0.0)))
    return body


def test_only_dependent_constraints_are_named():
    mech = bd.Mechanism()
    body = pendulum("door", mech)
    pendulum("other", mech, x=5.0)
    mech.add(bd.Revolute("second hinge", mech.ground.at(0.0, 2.0), body.at(0.0, 2.0)))
    with pytest.raises(
        bd.BeamdaeError,
        match=r"^door hinge.y, second hinge.y: these constraints depend .*remove 1 of them .*: "
        r"door hinge and second hinge both block the translation of the door along \(0, 1\)\.$",
    ):
        make_consistent(mech)


def test_more_constraints_than_coordinates_are_named():
    mech = bd.Mechanism()
    body = pendulum("door", mech)
    mech.add(bd.Weld("lock", mech.ground.at(0.0, 2.0), body.at(0.0, 2.0)))
    with pytest.raises(bd.BeamdaeError, match=r"lock.y.*depend .*remove 2 of them"):
        make_consistent(mech)


def test_the_same_joint_twice_is_dependent():
    mech = bd.Mechanism()
    body = pendulum("door", mech)
    beam = mech.add(VARIANTS[0].beam(ARC))
    mech.add(bd.Revolute("again", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
    mech.add(bd.Revolute("beam pin", mech.ground.at(*ARC.start), beam.start))
    with pytest.raises(
        bd.BeamdaeError,
        match=r"^door hinge.x, door hinge.y, again.x, again.y: these .*remove 2 of them .*: "
        r"door hinge and again both block .*\.$",
    ):
        make_consistent(mech)


def solve_start(mass, force=None, constraints=None):
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", len(mass)), ca.SX.sym("v", len(mass))
    system = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=ca.DM(mass),
        force=ca.SX.ones(len(mass)) if force is None else force(t, q),
        constraints=None if constraints is None else constraints(q),
        q0=np.ones(len(mass)),
        v0=np.zeros(len(mass)),
        names=tuple("abc"[: len(mass)]),
    )
    e = system.equations
    return ConsistencySolver(e).state(np.zeros(2), e.q0, e.v0)


@pytest.mark.parametrize(
    ("mass", "constraints", "name"),
    [
        ([[1, 0], [0, 0]], None, "b"),
        ([[0, 0], [0, 1]], None, "a"),
        ([[1, -1, 0], [-1, 2, 0], [0, 0, 0]], None, "c"),
        ([[0, 0, 0], [0, 2, -2], [0, -2, 3]], None, "a"),
        ([[1, 0], [0, 0]], lambda q: q[0] - 1.0, "b"),
    ],
)
def test_a_coordinate_without_mass_is_named(mass, constraints, name):
    with pytest.raises(
        bd.BeamdaeError, match=f"^{name}: this coordinate has no inertia at t = 0 s; "
    ):
        solve_start(mass, constraints=constraints)


def test_a_joint_may_constrain_a_massless_coordinate():
    state = solve_start([[2, 0], [0, 0]], constraints=lambda q: q[0] - q[1])
    # Two forces of 1 N accelerate 2 kg; the constraint transmits the second one.
    assert_allclose(state.a, (1.0, 1.0), rtol=1e-14)
    assert_allclose(state.lam, (-1.0,), rtol=1e-14)


def test_infinite_forces_are_named():
    with pytest.raises(
        bd.BeamdaeError, match=r"^b: the force on this coordinate is not finite at t = 0"
    ):
        solve_start([[1, 0], [0, 1]], force=lambda t, q: ca.vertcat(1.0, 1.0 / (q[1] - 1.0)))


def test_dependent_constraints_are_named_among_many():
    """Beyond 100 constraints an SVD is computed only if they may be dependent."""
    mech = bd.Mechanism()
    before = mech.ground.at(0.0, 0.0)
    for k in range(52):
        link = mech.add(bd.RigidBody(f"link {k}", 1.0, 0.1, center=(k + 0.5, 0.0)))
        mech.add(bd.Revolute(f"hinge {k}", before, link.at(k, 0.0)))
        before = link.at(k + 1.0, 0.0)
    _, state = make_consistent(mech)
    assert_allclose(state.v, 0.0, atol=1e-15)
    mech.add(bd.Revolute("twice", mech.ground.at(0.0, 0.0), mech.part("link 0").at(0.0, 0.0)))
    pattern = r"hinge 0.x, hinge 0.y, twice.x, twice.y: .* depend .*remove 2 of them"
    with pytest.raises(bd.BeamdaeError, match=pattern):
        make_consistent(mech)


# Given velocities ------------------------------------------------------------------------------


@bd.model(t_end=0.02)
def flywheel(speed=12.0, formulation="floating frame", given=True):
    """Crank that turns at `speed` [rad/s], and an undamped steel rod to a ram in a guide."""
    turning = {"angular_velocity": speed} if given else {}
    section = rectangle(0.012, 0.03)
    mech, crank, rod = crank_and_ram(section, 2, formulation=formulation, **turning)
    mech.observe("crank", crank.at(0.0, 0.0))
    mech.observe("root", rod.stress(0.14, "top"))
    return mech


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
@pytest.mark.parametrize("given", [True, False])
def test_regression_connected_bodies_follow_a_given_velocity(formulation, given):
    """The crank turned at a quarter of the given speed, and the rod vibrated at 30 MPa."""
    model = flywheel(formulation=formulation, given=given)
    start = "as drawn" if given else {"crank.angle_dot": 12.0}
    solution = bd.simulate(model, start=start, t_end=2e-4)
    first = {name: solution[name].iloc[0] for name in ("crank.angle_dot", "ram.x_dot")}
    # The pin moves by 12 (-0.02, 0.02) m/s, and the rod does not change its length.
    speed = 12.0 * (-0.02 - 0.02 * 0.02 / 0.28)
    # The dependent constraints of the projection are regularized by 1e-13.
    assert_allclose(first["crank.angle_dot"], 12.0, rtol=1e-10)
    assert_allclose(first["ram.x_dot"], speed, rtol=1e-9)
    # Accelerations of 3 m/s^2 of a rod of 0.8 kg; vibrations would reach 10 MPa within 0.2 ms.
    assert solution["root"].abs().max() < 2e6
    assert not solution.start.warning


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_velocities_that_a_clamped_beam_stops_are_projected_with_a_warning(formulation):
    section = rectangle(0.002, 0.01)
    mech, beam = clamped_beam(section, 2, formulation=formulation)
    block = mech.add(bd.RigidBody("block", 0.1, 1e-4, center=(1.0, 0.0), velocity=(0.0, 2.0)))
    mech.add(bd.Weld("bolt", beam.end, block.at(1.0, 0.0)))
    mech.observe("block", block.at(1.0, 0.0))
    sentence = "starts with block.y_dot = 1.9.* m/s instead of 2 m/s"
    with pytest.warns(bd.BeamdaeWarning, match=sentence):
        solution = bd.simulate(mech, t_end=1e-5)
    # The momentum of 0.2 N s is shared with a beam of 0.157 kg whose far end is at rest.
    assert 0.2 / 0.257 < solution["block.y_dot"].iloc[0] < 2.0


@pytest.mark.parametrize("start", ["equilibrium", bd.rotation(3.0)], ids=["rest", "rotation"])
def test_regression_given_velocities_that_a_start_does_not_use_are_named(start):
    mech, _ = hinged_body(1.0, 0.1, angular_velocity=5.0, name="wheel")
    with pytest.warns(bd.BeamdaeWarning, match="the given velocity of wheel is not used"):
        solution = bd.simulate(mech, t_end=0.1, start=start)
    assert sum("is not used" in x for x in solution.warnings) == 1


def test_regression_given_velocities_are_vectors():
    """A bob near the vertical kept the small component of its velocity, and started at 11 m/s."""
    angle = np.radians(5.0)
    place = (np.sin(angle), -np.cos(angle))
    mech, bob = free_ball(place, name="bob", velocity=(0.0, 1.0))
    mech.add(bd.Distance("rope", mech.ground.at(0.0, 0.0), bob.point))
    with pytest.warns(bd.BeamdaeWarning, match="starts with bob.y_dot = 0.007596 m"):
        run = bd.simulate(mech, t_end=1e-3)
    along = np.array([np.cos(angle), np.sin(angle)])
    assert_allclose(run.v[0], along * along[1], atol=1e-12)


def test_a_struck_chain_keeps_the_given_velocity():
    """A mass and a body at rest that a rod connects move as one, without an impact."""
    mech, first = free_ball((1.0, 0.0), name="first", velocity=(0.5, 0.0))
    second = mech.add(bd.PointMass("second", 3.0, at=(2.0, 0.0)))
    mech.add(bd.Distance("rod", first.point, second.point))
    assert_allclose(bd.simulate(mech, t_end=1e-3).v[0], (0.5, 0.0, 0.5, 0.0), atol=1e-11)


def test_regression_lost_translations_of_turning_bodies_are_named():
    mech = bd.Mechanism()
    turning = {"velocity": (1.0, 5.0), "angular_velocity": 3.0}
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.1, **turning))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0), (1.0, 0.0)))
    with pytest.warns(bd.BeamdaeWarning, match="starts with disk.y_dot = .* instead of 5 m/s"):
        bd.simulate(mech, t_end=1e-3)


def test_named_velocities_are_components():
    """On an inclined guide, the prescribed component determines the other one."""
    mech, block = free_ball(name="block")
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), block.point, (1.0, 0.5)))
    solution = bd.simulate(mech, start={"block.x_dot": 2.0}, t_end=1e-3)
    first = [solution[f"block.{name}"].iloc[0] for name in ("x_dot", "y_dot")]
    assert_allclose(first, (2.0, 1.0), rtol=1e-11)


def test_regression_small_gaps_of_small_mechanisms_are_closed():
    """A gap of 7e-13 m, a millionth of the mechanism, stayed open and ended runs at their start."""
    length, gap = 1e-6, 7e-13
    mech = bd.Mechanism()
    corners = length * np.array([[0.0, 0.0], [0.3, 0.4], [1.1, 0.9], [1.5, 0.0]])
    bars = [
        mech.add(bd.RigidBody.rod(f"bar {k}", *map(tuple, corners[k : k + 2]), mass=1e-15))
        for k in range(3)
    ]
    bodies = [mech.ground, *bars, mech.ground]
    for k, corner in enumerate(corners):
        end = corner + (gap if k == 2 else 0.0)
        mech.add(bd.Revolute(f"pin {k}", bodies[k].at(*corner), bodies[k + 1].at(*end)))
    mech.add(bd.Moment("motor", bars[0].at(0.0, 0.0), 1e-20))
    mech.observe("bar 0", bars[0].at(*corners[1]))
    runs = [bd.simulate(mech, bd.Radau(rtol), t_end=1e-3) for rtol in (1e-5, 1e-8)]
    assert all(run.status.success for run in runs)
    assert np.ptp(runs[1]["bar 0.angle"]) > 0.1
    assert_allclose(*(run["bar 0.angle"] for run in runs), rtol=0.0, atol=1e-4)
    assert runs[1].drift.abs().to_numpy()[0].max() < 1e-20
