"""Linear state-space models against transfer functions and nonlinear runs."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import EARTH, clamped_beam, free_ball, hinged_beam, hinged_body, rectangle, symbols
from numpy.testing import assert_allclose
from scipy.signal import StateSpace, lsim
from voice_coil_stage import voice_coil_stage

import beamdae as bd
from beamdae.symbolic.statements import Quantity, Variable

ALLOY = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
STRIP = rectangle(0.0025, 0.03, damping=1e-3, material=ALLOY)


def mount(push=0.0):
    """Return a mass on a spring and a damper above a foot that a driver shakes."""
    mech = bd.Mechanism(gravity=EARTH)
    foot = mech.add(bd.RigidBody("foot", 0.5, 0.1, center=(0.0, 0.0)))
    mech.add(bd.Prismatic("rail", mech.ground.at(0.0, 0.0), foot.at(0.0, 0.0), (0.0, 1.0)))
    mech.add(
        bd.TranslationalDriver(
            "shaker", mech.ground.at(0, 0), foot.at(0, 0), law=0.0, direction=(0.0, 1.0)
        )
    )
    load = mech.add(bd.RigidBody("load", 2.0, 0.1, center=(0.0, 1.0)))
    mech.add(bd.Prismatic("column", foot.at(0.0, 1.0), load.at(0.0, 1.0), (0.0, 1.0)))
    ends = (foot.at(0.0, 0.0), load.at(0.0, 1.0))
    mech.add(bd.Spring("leg", *ends, 200.0, 3.0))
    mech.add(bd.Force("push", load.at(0.0, 1.0), (0.0, push)))
    mech.observe("load", load.at(0.0, 1.0))
    mech.observe("foot", foot.at(0.0, 0.0))
    mech.observe("shaker", mech.part("shaker").reaction)
    return mech


def strip(push=0.0):
    mech = bd.Mechanism(gravity=EARTH)
    arc = bd.Arc(radius=0.85, length=0.8, start=(0.0, 0.0), angle=-0.6)
    beam = mech.add(bd.Beam("beam", arc, STRIP, elements=2))
    mech.add(bd.PointMass("tip mass", 0.06, on=beam.end))
    root = mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (0.0, push)))
    mech.observe("tip", beam.end)
    mech.observe("forces", beam.section_forces(0.4))
    mech.observe("root", root.reaction)
    return mech


def test_shaken_mass_has_the_transfer_function_of_its_equation():
    """m y'' + c (y' - u') + k (y - u) = F; the driver force is M u'' + m y'' - F plus weight."""
    model = bd.linearize(mount(), about="equilibrium")
    assert [x.header for x in model.inputs] == [
        "shaker.travel_ddot [m/s^2]",
        "push.Fx [N]",
        "push.Fy [N]",
    ]
    assert len(model.states) == 4
    f = np.array([0.3, 1.0, 5.0])
    s = 2j * np.pi * f
    m, c, k = 2.0, 3.0, 200.0
    dynamic_stiffness = m * s**2 + c * s + k
    response = model.frequency_response(f)
    outputs = [x.name for x in model.outputs]
    load, force = outputs.index("load.y"), outputs.index("shaker.F")
    assert_allclose(response[:, load, 2], 1.0 / dynamic_stiffness, rtol=1e-9)
    by_u = (c * s + k) / dynamic_stiffness
    assert_allclose(response[:, load, 0], by_u / s**2, rtol=1e-9)
    # Magnitude of the driver force per unit of acceleration.
    assert_allclose(np.abs(response[:, force, 0]), np.abs(0.5 + m * by_u), rtol=1e-9)
    assert_allclose(response[:, force, 2], -(c * s + k) / dynamic_stiffness, rtol=1e-9)
    assert_allclose(model.output_values[force], 2.5 * 9.81, rtol=1e-9)


@pytest.mark.slow(reason="a run of a curved beam")
def test_regression_slow_poles_of_stiff_structures_are_accurate():
    """A steel strip of 1 m x 0.2 mm: elements of A are up to 1e17, its slowest modes 1 rad/s."""
    strip = rectangle(2e-4, damping=1e-4)
    mech, _ = clamped_beam(strip, 3, formulation="exact")
    poles, modes = bd.linearize(mech).poles, bd.modes(mech, n=4).eigenvalues
    assert len(poles) == 2 * 27
    assert_allclose(poles[poles.imag > 0.0][:4], modes, rtol=1e-6)
    assert np.all(np.diff(np.abs(poles)) >= -1e-6 * np.abs(poles[1:]))


@pytest.mark.parametrize("damping", [0.0, 1e-5])
@pytest.mark.parametrize("ratio", [150, 1500, 15000])
def test_poles_of_thin_hanging_beams_are_their_modes(ratio, damping):
    """On a hinge, the slowest poles were 0.3 % off, and grew without damping."""
    h = 0.06 / ratio
    section = rectangle(h, 10.0 * h, damping=damping)
    mech, leaf = hinged_beam(
        section, 8, (0.0, -0.06), name="leaf", gravity=9.81, formulation="floating frame"
    )
    mech.add(bd.PointMass("mass", 6e-4, on=leaf.end))
    poles = bd.linearize(mech, "equilibrium").poles
    modes = bd.modes(mech, "equilibrium", n=5).eigenvalues
    assert_allclose(poles[poles.imag > 0.0][:5], modes, rtol=1e-7)
    assert np.all(poles.real <= 0.0)
    assert damping > 0.0 or np.all(poles[np.abs(poles) < 1e4].real == 0.0)


@pytest.mark.slow(reason="a quarter of a second")
def test_small_step_response_matches_the_nonlinear_run():
    model = bd.linearize(strip(), about="equilibrium")
    force = 1e-4
    at_rest = bd.equations_of_motion(strip(), "equilibrium")
    with_step = replace(bd.equations_of_motion(strip(force)), q0=at_rest.q0, v0=0.0 * at_rest.v0)
    run = bd.simulate(with_step, bd.Radau(1e-10), 0.3, output_step=2e-3)
    assert run.status.success
    _, expected, _ = lsim(model.state_space(), np.tile([0.0, force], (len(run.t), 1)), run.t)
    for k, output in enumerate(model.outputs):
        deviation = run.columns[output.header] - model.output_values[k]
        size = np.max(np.abs(expected[:, k]))
        assert_allclose(
            deviation, expected[:, k], rtol=0.0, atol=1e-3 * size, err_msg=output.header
        )


def test_linear_model_converts_to_scipy_with_named_states():
    model = bd.linearize(mount(), inputs=["push"], outputs=["load"])
    a, b, c, d = model
    assert isinstance(model.state_space(), StateSpace)
    assert (a.shape, b.shape, c.shape, d.shape) == ((2, 2), (2, 2), (6, 2), (6, 2))
    assert [x.header for x in model.states] == ["load.y [m]", "load.y_dot [m/s]"]
    assert_allclose(a, [[0.0, 1.0], [-100.0, -1.5]], rtol=1e-9)
    assert_allclose(b[:, 1], [0.0, 0.5], atol=1e-12)


@pytest.mark.parametrize(("stiffness", "poles"), [(8.0, [-2j, 2j]), (0.0, [0, 0]), (-8.0, [-2, 2])])
def test_regression_constrained_systems_are_linearized(stiffness, poles):
    """They raised an AssertionError."""
    t, q, v = symbols(1)
    force = -stiffness * q
    linear = bd.linearize(bd.ConstrainedSystem(t, q, v, [2.0], force, q0=[0.0], v0=[0.0]))
    assert_allclose(linear.A, [[0.0, 1.0], [-0.5 * stiffness, 0.0]], atol=1e-12)
    assert_allclose(np.sort_complex(linear.poles), poles, rtol=1e-12)


def test_skate_removes_one_state():
    """A sled pushed at its center moves ahead but not sideways."""
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sled", 2.0, 0.1, center=(0.0, 0.0)))
    mech.add(bd.Skate("blade", body.at(0.0, 0.0), (1.0, 0.0)))
    mech.add(bd.Force("push", body.at(0.0, 0.0), (0.0, 0.0)))
    mech.observe("sled", body.at(0.0, 0.0))
    model = bd.linearize(mech)
    assert len(model.states) == 5
    response = model.frequency_response([1.0])[0]
    names = [x.name for x in model.outputs]
    assert_allclose(response[names.index("sled.x"), 0], -0.5 / (2.0 * np.pi) ** 2, rtol=1e-12)
    assert_allclose(response[names.index("sled.y"), 1], 0.0, atol=1e-15)


def test_moving_skate_steers():
    """At speed v, a rotation by phi causes the lateral velocity y' = v phi."""
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sled", 2.0, 0.1, velocity=(3.0, 0.0)))
    mech.add(bd.Skate("blade", body.at(0.0, 0.0), (1.0, 0.0)))
    mech.add(bd.Moment("helm", body.at(0.0, 0.0), 0.0))
    mech.observe("sled", body.at(0.0, 0.0))
    run = bd.simulate(mech, bd.Radau(1e-8), 0.1)
    model = bd.linearize(mech, about=run.at(0.0))
    names, w = [x.name for x in model.outputs], 2.0 * np.pi
    response = model.frequency_response([1.0])[0][:, 0]
    turn = -1.0 / (0.1 * w**2)
    assert_allclose(response[names.index("sled.angle")], turn, rtol=1e-9)
    assert_allclose(response[names.index("sled.y")], 3.0 * turn / (1j * w), rtol=1e-9)


def test_states_and_outputs_refer_to_the_rotating_frame():
    """In the rotating frame, a disk under a moment is a double integrator."""
    mech, disk = hinged_body(1.0, 0.3, name="disk")
    mech.add(bd.Moment("motor", disk.at(0.0, 0.0), 0.0))
    model = bd.linearize(mech, about=bd.rotation(4.0))
    assert_allclose(model.A, [[0.0, 1.0], [0.0, 0.0]], atol=1e-12)
    assert_allclose(model.B, [[0.0], [1.0 / 0.3]], rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"inputs": ["puhs"]}, "did you mean 'push'"),
        ({"inputs": ["push.Fz"]}, r"did you mean 'push\.F[xy]'"),
        ({"inputs": [["push"]]}, "no input"),
        ({"inputs": "push"}, "inputs must be names"),
        ({"inputs": ["rail"]}, "no input 'rail'"),
        ({"outputs": ["lode"]}, "there is no column 'lode' .did you mean"),
        ({"outputs": [3]}, "there is no column 3"),
        ({"about": "down"}, "about"),
    ],
)
def test_invalid_arguments_are_rejected(arguments, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.linearize(mount(), **arguments)


def test_inactive_drivers_are_no_inputs():
    mech = mount()
    mech.deactivate(mech.part("shaker"))
    with pytest.raises(bd.BeamdaeError, match=r"^linearize: shaker\.travel is inactive"):
        bd.linearize(mech, inputs=["shaker"])


@pytest.mark.slow(reason="half a second")
def test_regression_inputs_are_selected_by_columns():
    """The columns of inputs in tables and `margins` were refused: there is no input 'push.Fy'."""
    whole = bd.linearize(mount(), inputs=["shaker", "push"])
    names = [x.header for x in whole.inputs]
    for name in ("push.Fy", "push.Fy [N]"):
        model = bd.linearize(mount(), inputs=["shaker.travel_ddot", name])
        assert [x.header for x in model.inputs] == [names[0], names[2]]
        assert_allclose(model.B, whole.B[:, [0, 2]], rtol=1e-12)
        assert_allclose(model.D, whole.D[:, [0, 2]], rtol=1e-12)
        assert bd.margins(model, name, [0.0, 1.0] + [0.0] * (len(model.outputs) - 2))


def test_regression_outputs_are_selected_by_columns():
    whole = bd.linearize(mount(), inputs=["push"])
    names = [x.header for x in whole.outputs]
    for name, header in ((names[1], names[1]), (names[-1].partition(" [")[0], names[-1])):
        model = bd.linearize(mount(), inputs=["push"], outputs=[name])
        row = names.index(header)
        assert [x.header for x in model.outputs] == [header]
        np.testing.assert_array_equal(model.C, whole.C[[row]])
        np.testing.assert_array_equal(model.D, whole.D[[row]])
        np.testing.assert_array_equal(model.output_values, whole.output_values[[row]])


@pytest.mark.slow(reason="half a second")
def test_discrete_model_predicts_the_samples_of_a_controlled_run():
    """The run with a `Controller`, and the exact discretization of a wheel of 0.5 kg m^2."""
    every, gains = 0.05, np.array([[8.0, 1.0]])
    mech, wheel = hinged_body(1.0, 0.5, name="wheel", angular_velocity=2.0)
    torque = mech.input("torque", unit="N m")
    mech.add(bd.Moment("motor", wheel.at(0.0, 0.0), torque))
    reads = [mech.sensor(x, wheel.at(0.0, 0.0), x) for x in ("angle", "angle_dot")]
    plant = bd.linearize(mech, inputs=["torque"], outputs=["angle", "angle_dot"])
    sampled = plant.state_space(every)
    assert sampled.dt == every
    assert_allclose(sampled.A, [[1.0, every], [0.0, 1.0]], atol=1e-14)
    assert_allclose(sampled.B, [[every**2], [2.0 * every]], atol=1e-14)
    loop = sampled.A - sampled.B @ gains @ sampled.C
    mech.add(bd.Controller("servo", every, reads, [torque], lambda x: float(-gains[0] @ x.reads)))
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=1.0, output_step=every)
    states = [np.linalg.matrix_power(loop, k) @ [0.0, 2.0] for k in range(21)]
    observed = run.table()[["angle [rad]", "angle_dot [rad/s]"]].to_numpy()
    assert_allclose(observed, states, rtol=0.0, atol=1e-7)


def test_discrete_model_of_a_stiff_structure_is_accurate():
    """Without balancing, the eigenvalues were 1e-6 and more off."""
    plant = bd.linearize(voice_coil_stage(), inputs=[])
    for every in (1e-4, 1e-3):
        values = np.abs(np.linalg.eigvals(plant.state_space(every).A))
        expected = np.abs(np.exp(every * plant.poles))
        assert_allclose(np.sort(values), np.sort(expected), rtol=0.0, atol=2e-8)


def test_discrete_model_rejects_invalid_intervals():
    plant = bd.linearize(mount(), inputs=["push"], outputs=["load"])
    with pytest.raises(bd.BeamdaeError, match=r"state_space: every must be positive, got 0\."):
        plant.state_space(0.0)
    unstable = replace(plant, A=np.diag([1e3, 1.0]))
    with pytest.raises(bd.BeamdaeError, match="exceeds the range of numbers within 10 s"):
        unstable.state_space(10.0)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("about", ["reference", bd.rotation(10.0)], ids=["rest", "rotation"])
def test_regression_largest_magnitudes_are_no_outputs(about):
    """The transfer function of the largest stress was zero."""
    mech = bd.Mechanism()
    blade = mech.add(bd.Beam("blade", bd.Line((0.1, 0.0), (0.5, 0.0)), STRIP, elements=1))
    hub = mech.add(bd.RigidBody("hub", 8.0, 0.08))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Weld("clamp", hub.at(0.1, 0.0), blade.start))
    mech.add(bd.Moment("drive", hub.at(0.0, 0.0), 0.0))
    mech.observe("largest", blade.largest_stress())
    mech.observe("peak", blade.largest_stress(exponent=150))
    mech.observe("root", blade.stress(0.0, "top"))
    linear = bd.linearize(mech, about)
    assert not linear.warnings  # no outputs are requested
    assert [x.header for x in linear.outputs] == ["root [Pa]"]
    assert linear.C.shape[0] == linear.D.shape[0] == len(linear.output_values) == 1
    assert not bd.linearize(mech, about, outputs=["root"]).warnings
    for name in ("largest", "peak.bound", "largest.largest [Pa]"):
        with pytest.raises(bd.BeamdaeError, match="is a largest magnitude, whose derivatives"):
            bd.linearize(mech, about, outputs=[name])


def ball_above_floor():
    mech, ball = free_ball((0.0, 1.0))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 2.0), ball.point, 100.0))
    mech.add(bd.Force("push", ball.point, (0.0, 0.0)))
    floor = mech.add(bd.Contact("floor", ball.point, bd.LineSurface(mech.ground.at(0, 0)), 1e4))
    mech.observe("floor", floor.force)
    return mech, ball


def test_regression_forces_of_open_contacts_are_outputs():
    """Their derivatives by the exponent of the stiffness, a constant, are not finite.

    The response at the first frequency was said to be infinite because of an undamped mode.
    """
    linear = bd.linearize(ball_above_floor()[0])
    rows = [k for k, x in enumerate(linear.outputs) if x.name.startswith("floor.")]
    assert len(rows) == 2
    assert_allclose(np.hstack([linear.C, linear.D])[rows], 0.0)
    assert np.all(np.isfinite(linear.frequency_response([0.5, 3.0])))


def test_regression_inputs_and_outputs_without_finite_derivatives_are_omitted():
    mech, ball = ball_above_floor()
    column = Variable("root", "-")
    root = Quantity((column,), (ball.point.piece,), lambda local: local.q[0] ** 0.5)
    mech.observe("path", root)
    u = mech.input("u")
    mech.add(bd.Force("jet", ball.point, (u**0.5, 0.0)))
    with pytest.warns(bd.BeamdaeWarning) as caught:
        linear = bd.linearize(mech)
    assert [str(x.message).partition(",")[0] for x in caught] == [
        "u: omitted from the inputs of the linear model",
        "path.root [-]: omitted from the outputs of the linear model",
    ]
    assert linear.warnings == tuple(str(x.message) for x in caught)
    assert "u" not in [x.name for x in linear.inputs]
    names = [x.name for x in linear.outputs]
    assert "path.root" not in names
    assert "floor.N" in names
    assert all(np.all(np.isfinite(x)) for x in linear)
    assert bd.bode(linear).warnings == linear.warnings
    with pytest.raises(bd.BeamdaeError, match=r"root \[-\] cannot be one of the outputs"):
        bd.linearize(mech, inputs=["push"], outputs=["path", "ball"])
    with pytest.raises(bd.BeamdaeError, match="u cannot be one of the inputs"):
        bd.linearize(mech, inputs=["u"])
