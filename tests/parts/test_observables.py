"""Displacements, motions and accelerations, also relative to another body."""

import inspect

import numpy as np
import pytest
from mechanisms import free_ball, mass_on_rail, rectangle
from numpy.testing import assert_allclose
from support import ARC, VARIANTS, NumericEquations, random_state

import beamdae as bd

CENTER = (-0.4, 0.1)
# The motion of a section relative to its body does not depend on strain and quadrature.
FIELDS = [v for v in VARIANTS if v.strain == "nonlinear" and v.damping > 0.0]


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def test_relative_displacement_of_disks_by_hand():
    mech = bd.Mechanism()
    table = mech.add(bd.RigidBody("table", mass=1.0, inertia=1.0, center=(1.0, 0.0)))
    cup = mech.add(bd.RigidBody("cup", mass=1.0, inertia=1.0, center=(3.0, 0.0)))
    of = cup.at(3.0, 1.0)
    mech.observe("on table", bd.relative_displacement(of=of, on=table.at(1.0, 1.0)))
    mech.observe("on ground", bd.relative_displacement(of=of, on=mech.ground.at(7.0, 7.0)))
    numeric = NumericEquations(mech)
    headers = [header for o in numeric.equations.observables for header in o.headers]
    assert headers[:3] == ["on table.u [m]", "on table.v [m]", "on table.phi [rad]"]
    # The table rotates by 90 degrees about (1, 0), which moves (1, 1) to (0, 0), (3, 1) to (0, 2).
    # The center of the cup moves to (3, 4), and it rotates by 180 degrees: its rim is at (3, 3).
    q = np.array([1.0, 0.0, 0.5 * np.pi, 3.0, 4.0, np.pi])
    assert_allclose(numeric.observed("on table", q=q), (3.0, 1.0, 0.5 * np.pi), atol=1e-14)
    assert_allclose(numeric.observed("on ground", q=q), (0.0, 2.0, np.pi), atol=1e-14)


@pytest.mark.parametrize("reference", [0.0, ARC.length])
@pytest.mark.parametrize("variant", FIELDS, ids=str)
def test_deflection_is_relative_to_the_section_at_the_reference(variant, reference):
    """Compared with the observed positions and angles of both sections, in a rotated state."""
    mech = bd.Mechanism()
    beam = mech.add(variant.beam(ARC))
    places = (0.0, 0.35 * ARC.length, ARC.length)
    mech.observe("root", beam.at(reference))
    for s in places:
        mech.observe(f"at {s}", beam.at(s))
        mech.observe(f"deflection {s}", beam.deflection(s, reference))
        relative = bd.relative_displacement(beam.at(s), beam.at(reference))
        mech.observe(f"relative {s}", relative)
    numeric = NumericEquations(mech)
    q, _, _ = random_state(numeric, seed=0)
    root = numeric.observed("root", q=q)[:3]
    drawn_root = numeric.observed("root", q=numeric.equations.q0)[:3]
    for s in places:
        at = numeric.observed(f"at {s}", q=q)[:3]
        drawn = numeric.observed(f"at {s}", q=numeric.equations.q0)[:3]
        expected = np.append(
            rotation(-root[2]) @ (at - root)[:2]
            - rotation(-drawn_root[2]) @ (drawn - drawn_root)[:2],
            (at - root - drawn + drawn_root)[2],
        )
        deflection = numeric.observed(f"deflection {s}", q=q)
        # Rounding error.
        assert_allclose(deflection, expected, atol=1e-13)
        relative = numeric.observed(f"relative {s}", q=q)
        assert_allclose(deflection[:2], rotation(-root[2]) @ relative[:2], atol=1e-13)
        assert_allclose(deflection[2], relative[2], atol=1e-13)
        assert (np.linalg.norm(deflection) > 0.05) == (s != reference)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_regression_the_tip_of_a_rotating_blade_deflects(formulation):
    """`deformation` at the tip of a chord frame read 1e-3 of the deflection, without a message.

    A constant angular acceleration bends the blade like a load per length of -rhoA alpha s.
    """
    strip = rectangle(0.01, damping=5e-3)
    length, alpha = 1.0, 2.0
    mech = bd.Mechanism()
    blade = mech.add(
        bd.Beam("blade", bd.Line((0.0, 0.0), (0.0, length)), strip, formulation=formulation)
    )
    axle = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("axle", axle, blade.start))
    mech.add(bd.Driver("motor", axle, blade.start, lambda t: 0.5 * alpha * t**2))
    mech.observe("tip", blade.deflection(length))
    hub = mech.add(bd.RigidBody("hub", 1.0, 1.0))
    mech.add(bd.Weld("flange", hub.at(0.0, 0.0), blade.start))
    mech.observe("on hub", bd.relative_displacement(blade.end, hub.at(0.0, 0.0), axes="section"))
    columns = bd.simulate(mech, bd.Radau(1e-6), 1.0).columns
    # The deflection of a cantilever under a load proportional to s is 11 w L^4 / (120 EI) with
    # w = rhoA alpha L; the rotation speed of up to 2 rad/s stiffens the blade by 0.1 %.
    expected = -11.0 * strip.rhoA * alpha * length**5 / (120.0 * strip.EI)
    # The start excites a vibration, which decays to 0.2 %.
    assert_allclose(columns["tip.transverse [m]"][-100:], expected, rtol=1e-2)
    # The blade points along y of the hub, so that its left normal is -x of the hub.
    assert_allclose(columns["on hub.u [m]"], -columns["tip.transverse [m]"], atol=1e-9)
    assert_allclose(columns["on hub.v [m]"], columns["tip.axial [m]"], atol=1e-9)


def test_deformation_in_a_tangent_frame_includes_the_ends():
    beam = bd.Beam("beam", ARC, bd.Section(bd.Material(1e9, 0.3, 1e3), 1e-4, 1e-9), frame="tangent")
    assert [column.name for column in beam.deformation(ARC.length).columns] == ["u", "v", "phi"]


@pytest.mark.parametrize("axes", ["section", "inertial"])
def test_relative_motion_is_the_motion_seen_by_an_observer_on_the_body(axes):
    """Position and angle follow from the absolute motions, and rates are their derivatives."""
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", mass=1.1, inertia=0.4, center=CENTER))
    beam = mech.add(FIELDS[0].beam(ARC))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.3, 0.7)))
    sensor, tip = disk.at(0.2, 0.5), beam.at(0.6 * ARC.length)
    for name, at in (("sensor", sensor), ("tip", tip), ("ball", ball.point)):
        mech.observe(name, at)
    mech.observe("tip on disk", bd.relative_motion(tip, sensor, axes))
    mech.observe("disk on tip", bd.relative_motion(sensor, tip, axes))
    mech.observe("ball on tip", bd.relative_motion(ball.point, tip, axes))
    numeric = NumericEquations(mech)
    q, v, _ = random_state(numeric, seed=3)
    sensor, tip, ball = (numeric.observed(name, q=q, v=v) for name in ("sensor", "tip", "ball"))
    for name, of, on in (
        ("tip on disk", tip, sensor),
        ("disk on tip", sensor, tip),
        ("ball on tip", ball, tip),
    ):
        turn = rotation(-on[2] if axes == "section" else 0.0)
        values = numeric.observed(name, q=q, v=v)
        assert_allclose(values[:2], turn @ (of[:2] - on[:2]), rtol=1e-13)
        count = len(values) // 2
        if count == 3:
            assert_allclose(values[2], of[2] - on[2], rtol=1e-13)
        h = 1e-5
        before, after = (numeric.observed(name, q=q + x * v, v=v) for x in (-h, h))
        assert_allclose(values[count:], (after - before)[:count] / (2.0 * h), rtol=1e-7)


def test_relative_motion_has_no_angle_with_particles_and_no_axes_on_them():
    mech, ball = free_ball((0.3, 0.7))
    seen = bd.relative_motion(ball.point, mech.ground.at(0.0, 0.0))
    headers = [column.header for column in seen.columns]
    assert headers == ["x [m]", "y [m]", "x_dot [m/s]", "y_dot [m/s]"]


@pytest.mark.parametrize("axes", ["section", "inertial"])
def test_accelerations_are_the_second_derivatives_of_the_motion(axes):
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", mass=1.1, inertia=0.4, center=CENTER))
    beam = mech.add(FIELDS[0].beam(ARC))
    places = {"disk": disk.at(0.2, 0.5), "beam": beam.at(0.6 * ARC.length)}
    for name, at in places.items():
        mech.observe(name, at)
        mech.observe(f"{name} acceleration", bd.acceleration(at, axes))
    numeric = NumericEquations(mech)
    q, v, a = random_state(numeric, seed=3)
    h = 1e-5
    for name in places:
        before, after = (
            numeric.observed(name, q=q + x * v + 0.5 * x * x * a, v=v + x * a) for x in (-h, h)
        )
        expected = (after - before)[3:] / (2.0 * h)
        angle = numeric.observed(name, q=q)[2]
        expected[:2] = rotation(-angle if axes == "section" else 0.0) @ expected[:2]
        values = numeric.observed(f"{name} acceleration", q=q, v=v, a=a)
        assert_allclose(values, expected, rtol=1e-6)


def swing(length=0.5, mass=2.0, torque=0.0, gravity=9.81, hangs=False):
    """Return a rod on a hinge, with the acceleration of its free end in both axes."""
    mech = bd.Mechanism(gravity=(gravity, 0.0) if hangs else (0.0, -gravity))
    rod = mech.add(bd.RigidBody("rod", mass=mass, inertia=1e-3, center=(length, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    mech.add(bd.Moment("torque", rod.at(0.0, 0.0), torque))
    mech.observe("end", rod.at(length, 0.0))
    mech.observe("inertial", bd.acceleration(rod.at(length, 0.0)))
    mech.observe("sensor", bd.acceleration(rod.at(length, 0.0), axes="section"))
    return mech


SWING = bd.model(t_end=1.0)(swing)


def test_accelerations_are_outputs_of_linear_models():
    """Hanging at rest, the rod is accelerated by its torque and, after a turn, by gravity."""
    model = bd.linearize(swing(hangs=True), inputs=["torque"], outputs=["sensor"])
    inertia = 2.0 * 0.25 + 1e-3
    assert_allclose(model.D[:, 0], [0.0, 0.5 / inertia, 1.0 / inertia], rtol=1e-9, atol=1e-12)
    assert_allclose(model.C[2, 0] / model.C[1, 0], 2.0, rtol=1e-9)
    assert_allclose(model.poles.imag.max() ** 2, 2.0 * 9.81 * 0.5 / inertia, rtol=1e-9)
    with pytest.raises(bd.BeamdaeError, match="sensor cannot be an output in a rotating frame"):
        bd.linearize(swing(gravity=0.0), about=bd.rotation(4.0), outputs=["sensor"])


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.filterwarnings("ignore:.*not an equilibrium:beamdae.errors.BeamdaeWarning")
def test_regression_accelerations_of_moving_states_are_refused():
    """The changes of constraints along the motion were missing: -3 instead of -6."""
    for about in (bd.simulate(swing(), t_end=0.1).at(0.1), "reference"):
        with pytest.raises(bd.BeamdaeError, match="sensor cannot be an output of a moving state"):
            bd.linearize(swing(), about=about, outputs=["sensor"])
    path = bd.equilibrium(swing(hangs=True))
    assert bd.linearize(swing(hangs=True), about=path, outputs=["sensor"]).C.shape == (3, 2)


@pytest.mark.slow(reason="compiles derivatives")
def test_regression_accelerations_of_forced_periodic_motions_have_derivatives():
    """They were refused after the analysis, although the period is given."""

    @bd.model(t_end=1.0)
    def shaken(stiffness=100.0):
        mech, ball = mass_on_rail(1.0, 1.0, name="ball")
        spring = bd.Spring("spring", mech.ground.at(0.0, 0.0), ball.point, stiffness, 2.0)
        mech.add(spring)
        mech.add(bd.Force("force", ball.point, (lambda t: 5.0 * np.sin(8.0 * t), 0.0)))
        mech.observe("ball acceleration", bd.acceleration(ball.point))
        return mech

    result = bd.periodic_sensitivities(shaken, ["stiffness"], period=np.pi / 4.0)
    t = result.motion.solution.t
    # x = Im(H f e^(i w t)), dH/dk = -H^2, a = -w^2 x.
    response = 5.0 / (100.0 - 64.0 + 16.0j) ** 2
    expected = 64.0 * (response * np.exp(8.0j * t)).imag
    computed = result.sensitivity("ball acceleration.ax", "stiffness")
    # The tolerance of the motion is 1e-6 of its amplitude.
    assert_allclose(computed, expected, atol=1e-5 * np.max(np.abs(expected)))


@pytest.mark.slow(reason="compiles derivatives")
def test_accelerations_of_self_excited_motions_have_derivatives():
    """They satisfy the derivative of the equation of motion at each phase."""

    @bd.model(t_end=40.0)
    def self_excited(stiffness=2.0):
        mech, mass = mass_on_rail(2.0, velocity=(0.1, 0.0))

        def pull(x, rate):
            return stiffness * x + 2.0 * (x**2 - 1.0) * rate

        # The spring is anchored far away, since its direction reverses at the anchor.
        mech.add(bd.Spring("spring", mech.ground.at(-10.0, 0.0), mass.point, law=pull))
        mech.observe("mass", mass.point)
        mech.observe("acceleration", bd.acceleration(mass.point))
        return mech

    result = bd.periodic_sensitivities(self_excited, "stiffness", period_guess=6.5)
    table = result.motion.solution.columns
    x, v = table["mass.x [m]"], table["mass.x_dot [m/s]"]
    names = "mass.x", "mass.x_dot", "acceleration.ax"
    dx, dv, da = (result.sensitivity(name, "stiffness").to_numpy() for name in names)
    expected = -0.5 * (x + (2.0 + 4.0 * x * v) * dx + 2.0 * (x**2 - 1.0) * dv)
    assert_allclose(da, expected, atol=1e-3 * np.max(np.abs(expected)))


def test_accelerations_of_particles_have_no_angle_and_no_axes():
    _, ball = free_ball((0.3, 0.7))
    assert [x.header for x in bd.acceleration(ball.point).columns] == ["ax [m/s^2]", "ay [m/s^2]"]


def cross(mech, of):
    mech.observe("of", of)
    mech.when("of.ay", crosses=1.0)
    bd.simulate(mech, bd.Radau(), t_end=0.1)


def control(mech, of):
    push = mech.input("push", 0.0, "N m")
    mech.add(bd.Moment("motor", mech.parts["rod"].at(0.0, 0.0), push))
    mech.add(bd.Controller("pid", 0.01, [of], [push], lambda sample: 0.0))
    bd.simulate(mech, bd.Radau(), t_end=0.1)


def maximize(mech, of):
    bd.gradient(SWING, bd.quantities.EndValue("sensor.ay"), ["length"], bd.Radau(), t_end=0.1)


def reach(mech, of):
    bd.equilibrium(swing(hangs=True), to={"sensor.ay": 1.0})


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (cross, "an event cannot depend on accelerations"),
        (control, "a controller cannot read accelerations"),
        (lambda mech, of: mech.sensor("gauge", of, "ax"), "a sensor cannot measure accelerations"),
        (lambda mech, of: bd.export_fmu(mech, "swing.fmu", t_end=1.0), "which FMUs do not compute"),
        (maximize, "the objective must not contain accelerations"),
        (reach, "to must name an observed position, got 'sensor.ay'"),
    ],
)
def test_accelerations_are_refused_by_name_where_only_positions_and_velocities_are_known(
    use, message, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    mech = swing()
    with pytest.raises(bd.BeamdaeError, match=message):
        use(mech, bd.acceleration(mech.parts["rod"].at(0.5, 0.0)))


def test_columns_of_equilibria_contain_no_accelerations():
    assert not [x for x in bd.equilibrium(swing(hangs=True)).columns if x.startswith("sensor")]


# Mechanism: order of parts, headers, point masses and end times.

nan = float("nan")


def disk(name="disk", **words):
    return bd.RigidBody(name, **({"mass": 1.0, "inertia": 1.0} | words))


def test_parts_keep_their_order_and_are_accessible_by_name():
    mech = bd.Mechanism()
    wheel, bob = mech.add(disk("wheel")), mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
    pin = mech.add(bd.Revolute("pin", mech.ground.at(1.0, 0.0), bob.point))
    assert list(mech.parts) == ["wheel", "bob", "pin"]
    assert mech.part("wheel") is wheel
    assert mech.part("pin") is pin
    equations = bd.equations_of_motion(mech)
    assert equations.q_names == ("wheel.x", "wheel.y", "wheel.angle", "bob.x", "bob.y")
    assert equations.lam_names == ("pin.x", "pin.y")


def test_headers_name_columns_and_units():
    mech = bd.Mechanism()
    body = mech.add(disk())
    beam = mech.add(VARIANTS[0].beam(ARC))
    bob = mech.add(bd.PointMass("bob", 1.0, at=(0.0, 0.0)))
    mech.observe("hub", body.at(0.0, 0.0))
    mech.observe("bob", bob.point)
    mech.observe("gauge", beam.strain(0.5, offset=0.1))
    mech.observe("root", beam.section_forces(0.0))
    headers = [h for o in bd.equations_of_motion(mech).observables for h in o.headers]
    assert headers == [
        *("hub.x [m]", "hub.y [m]", "hub.angle [rad]"),
        *("hub.x_dot [m/s]", "hub.y_dot [m/s]", "hub.angle_dot [rad/s]"),
        *("bob.x [m]", "bob.y [m]", "bob.x_dot [m/s]", "bob.y_dot [m/s]"),
        "gauge [-]",
        *("root.N [N]", "root.Q [N]", "root.M [N m]"),
    ]


def test_free_and_fixed_point_masses():
    mech = bd.Mechanism(gravity=(1.0, -2.0))
    body = mech.add(disk(mass=2.0, inertia=0.5))
    mech.add(bd.PointMass("fixed", 3.0, on=body.at(0.0, 2.0)))
    free = mech.add(bd.PointMass("free", 4.0, at=(5.0, 6.0), velocity=(7.0, 8.0)))
    numeric = NumericEquations(mech)
    assert numeric.equations.q_names[3:] == ("free.x", "free.y")
    assert_allclose(numeric.equations.q0[3:], (5.0, 6.0), rtol=0.0)
    assert_allclose(numeric.equations.v0[3:], (7.0, 8.0), rtol=0.0)
    expected = np.diag([5.0, 5.0, 0.5 + 3.0 * 4.0, 4.0, 4.0])
    expected[0, 2] = expected[2, 0] = -3.0 * 2.0
    assert_allclose(numeric.mass(), expected, atol=1e-14)  # rounding
    # Weights, and the clockwise moment of gravity along x on the fixed mass at the arm (0, 2).
    assert_allclose(-numeric.force(), [5.0, -10.0, -6.0, 4.0, -8.0], atol=1e-14)
    assert free.point.point == (5.0, 6.0)
    massless = bd.PointMass("nothing", 0.0, on=body.at(0.0, 0.0))
    assert massless.coordinates == ()


def test_regression_models_without_an_end_time_are_explained():
    """The decorator without parentheses raised a TypeError."""
    for decorate in (lambda: bd.model(lambda: bd.Mechanism()), bd.model):
        with pytest.raises(bd.BeamdaeError, match=r"^model: the end time .* @bd\.model\(t_end=1"):
            decorate()


def test_regression_end_times_without_a_name_are_explained():
    """Signatures contained `*misplaced`."""
    with pytest.raises(bd.BeamdaeError, match=r"^model: the end time .* @bd\.model\(t_end=1"):
        bd.model(2.5)
    end_time = inspect.signature(bd.model).parameters["t_end"]
    assert end_time.kind is end_time.KEYWORD_ONLY
