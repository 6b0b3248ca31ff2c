"""Solution of a run: columns, rows, files and events."""

import gc
import json
import weakref
from dataclasses import replace
from importlib import metadata

import control
import numpy as np
import pandas as pd
import pytest
from benchmarks.cases import pendulum
from conformance import integrators
from mechanisms import driven, free_ball, hinged, hinged_body, rectangle
from numpy.testing import assert_allclose

import beamdae as bd

WORKS = ["work_of_loads", "work_of_drivers", "dissipated"]
LEDGER = [f"energy.{name} [J]" for name in ("kinetic", "strain", "gravity", *WORKS, "imbalance")]


def swing():
    """Return a rigid pendulum whose center of mass is observed."""
    mech, bar = hinged(bd.RigidBody("bar", mass=2.0, inertia=0.3, center=(0.5, 0.0)), gravity=9.81)
    hinge = mech.part("hinge")
    mech.observe("center", bar.at(0.5, 0.0))
    mech.observe("hinge", hinge.reaction)
    return mech


def driven_bar(law):
    """Return the same bar without weight, rotated by a driver."""
    mech, _ = driven(bd.RigidBody("bar", mass=2.0, inertia=0.3, center=(0.5, 0.0)), law)
    mech.observe("motor", mech.part("motor").reaction)
    return mech


def pushed(law):
    """Return a free particle of 2 kg under a force in x."""
    mech, particle = free_ball(mass=2.0, name="particle")
    mech.add(bd.Force("push", particle.point, (law, 0.0)))
    return mech


ALPHA = bd.GeneralizedAlpha(step=1e-3)

# At this tolerance an adaptive method of second order takes ten times as long as the others. The
# stabilized form takes the same steps.
every_integrator = integrators(
    rtol=1e-8, step=1e-3, slow=("alpha adaptive", "alpha stabilized"), max_steps=50_000
)


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7])
def test_regression_the_energy_of_long_steps_balances_to_the_tolerance(rtol):
    """With powers at the ends of steps only, the imbalance was 8e-6 at 1e-7, 2e-3 at 1e-3."""
    solution = bd.simulate(driven_bar(lambda t: 3.0 * t**2 - t**3), bd.Radau(rtol), 2.0)
    assert solution.quality.energy_imbalance < 0.1 * rtol
    exchanged = solution.energies["energy.work_of_drivers [J]"].abs().max()
    assert solution.energies["energy.imbalance [J]"].abs().max() < rtol * exchanged


@every_integrator
def test_output_times_need_not_be_steps(integrator):
    solution = bd.simulate(pushed(3.0), integrator, 1.0, output_step=0.0371)
    assert_allclose(solution.t[:-1], 0.0371 * np.arange(27), rtol=0.0, atol=1e-15)
    assert solution.t[-1] == 1.0
    exact = 0.5 * 1.5 * solution.t**2
    # IDA controls positions to rtol per step.
    assert_allclose(solution.q[:, 0], exact, rtol=0.0, atol=1e-6)
    assert_allclose(solution.v[:, 0], 1.5 * solution.t, rtol=0.0, atol=1e-5)


@every_integrator
def test_rows_do_not_depend_on_the_output_step(integrator):
    coarse = bd.simulate(swing(), integrator, 1.0, output_step=0.25)
    fine = bd.simulate(swing(), integrator, 1.0, output_step=0.01)
    assert len(coarse.t) == 5
    assert_allclose(fine.q[::25], coarse.q, rtol=0.0, atol=1e-12)
    assert_allclose(fine.lam[::25], coarse.lam, rtol=0.0, atol=1e-9)
    assert coarse.quality == fine.quality


def test_an_output_step_longer_than_the_run_gives_two_rows():
    solution = bd.simulate(pushed(1.0), bd.GeneralizedAlpha(step=0.1), 0.5, output_step=2.0)
    assert_allclose(solution.t, [0.0, 0.5], rtol=0.0, atol=0.0)


def test_the_default_output_step_is_a_thousandth_of_the_run():
    solution = bd.simulate(pushed(1.0), bd.GeneralizedAlpha(step=0.1), 0.3)
    assert_allclose(solution.t, np.linspace(0.0, 0.3, 1001), rtol=0.0, atol=1e-15)


@every_integrator
def test_accelerations_and_reactions_are_consistent_with_positions(integrator):
    # Bar of inertia 0.3 + 2 * 0.25 about the hinge, released from the horizontal.
    solution = bd.simulate(swing(), integrator, 0.3, output_step=0.01)
    angle = solution.q[:, 2]
    assert_allclose(solution.a[:, 2], -9.81 * np.cos(angle) / 0.8, rtol=0.0, atol=1e-3)
    fx = solution.observed["hinge.Fx [N]"]
    assert_allclose(fx, 2.0 * solution.a[:, 0], rtol=0.0, atol=1e-2)


@every_integrator
def test_kinetic_and_gravitational_energy_of_a_bar(integrator):
    solution = bd.simulate(swing(), integrator, 1.0, output_step=0.1)
    ledger = solution.energies
    height, rate = solution.q[:, 1], solution.v
    kinetic = 0.5 * (2.0 * np.sum(rate[:, :2] ** 2, axis=1) + 0.3 * rate[:, 2] ** 2)
    assert_allclose(ledger["energy.kinetic [J]"], kinetic, rtol=0.0, atol=1e-5)
    assert_allclose(ledger["energy.gravity [J]"], 2.0 * 9.81 * height, rtol=0.0, atol=1e-5)
    for name in ("strain", *WORKS):
        assert_allclose(ledger[f"energy.{name} [J]"], 0.0, rtol=0.0, atol=1e-12)
    energy = ledger["energy.kinetic [J]"] + ledger["energy.gravity [J]"]
    assert_allclose(ledger["energy.imbalance [J]"], energy - energy[0], rtol=0.0, atol=1e-12)


@every_integrator
def test_the_work_of_a_driver_is_the_energy_of_the_bar(integrator):
    solution = bd.simulate(driven_bar(lambda t: 1.0 - np.cos(3.0 * t)), integrator, 2.0, 0.05)
    rate = 3.0 * np.sin(3.0 * solution.t)
    work = 0.5 * 0.8 * rate**2
    ledger = solution.energies
    # Tolerance: the second-order error of the reaction at this step, (3 h)^2 = 1e-5 of 3.6 J.
    assert_allclose(ledger["energy.work_of_drivers [J]"], work, rtol=0.0, atol=1e-3)
    assert_allclose(ledger["energy.kinetic [J]"], work, rtol=0.0, atol=1e-3)
    assert_allclose(ledger["energy.work_of_loads [J]"], 0.0, rtol=0.0, atol=0.0)
    assert_allclose(ledger["energy.dissipated [J]"], 0.0, rtol=0.0, atol=0.0)
    torque = 0.8 * 9.0 * np.cos(3.0 * solution.t)
    assert_allclose(solution.observed["motor.M [N m]"], torque, rtol=0.0, atol=1e-2)
    assert solution.quality.energy_imbalance < 1e-3


def test_drift_of_each_formulation():
    equations = pendulum(9.81, 1.0).equations
    drift = {}
    for form in ("index1", "index3", "ggl", "stabilized-index1"):
        integrator = bd.Ida(
            rtol=1e-6, formulation=form, error_control="positions", max_order=5, max_steps=20_000
        )
        drift[form] = bd.simulate(equations, integrator, 5.0).quality
    # Index 1 does not enforce the circle. Index 3 enforces positions, the other two also
    # velocities, to the tolerance of Newton's iteration.
    for form in ("index3", "ggl", "stabilized-index1"):
        quality = drift[form]
        assert quality.max_position_drift < 1e-6 < 1e-5 < drift["index1"].max_position_drift
        # 2e-5 to 2e-4 for all three, depending on the last iteration of single steps.
        assert quality.max_velocity_drift < 1e-3


def test_the_residual_of_generalized_alpha_follows_the_newton_tolerance():
    tight = bd.simulate(swing(), bd.GeneralizedAlpha(step=1e-2, newton_tolerance=1e-9), 1.0)
    loose = bd.simulate(swing(), bd.GeneralizedAlpha(step=1e-2, newton_tolerance=1e-3), 1.0)
    assert tight.quality.max_residual < 1e-8
    assert tight.quality.max_residual < loose.quality.max_residual < 1e-2


def test_the_table_has_time_observed_columns_and_the_ledger():
    table = bd.simulate(swing(), ALPHA, 0.1, 0.01).table()
    motion = ["x [m]", "y [m]", "angle [rad]", "x_dot [m/s]", "y_dot [m/s]", "angle_dot [rad/s]"]
    hinge = ["hinge.Fx [N]", "hinge.Fy [N]"]
    assert list(table.columns) == ["t [s]", *(f"center.{m}" for m in motion), *hinge, *LEDGER]
    assert len(table) == 11
    assert np.all(np.isfinite(table.to_numpy()))


def test_without_observables_the_table_has_time_and_energies():
    mech = bd.Mechanism()
    mech.add(bd.PointMass("particle", 1.0, at=(0.0, 0.0), velocity=(1.0, 0.0)))
    table = bd.simulate(mech, ALPHA, 0.1, 0.05).table()
    assert list(table.columns) == ["t [s]", *LEDGER]
    assert_allclose(table["energy.kinetic [J]"], 0.5, rtol=1e-12)


def test_coordinates_are_named_by_part():
    solution = bd.simulate(swing(), ALPHA, 0.1, 0.05)
    coordinates = solution.coordinates()
    assert list(coordinates.columns) == [
        "t [s]",
        *("bar.x [m]", "bar.y [m]", "bar.angle [rad]"),
        *("bar.x_dot [m/s]", "bar.y_dot [m/s]", "bar.angle_dot [rad/s]"),
        *("lam.hinge.x [N]", "lam.hinge.y [N]"),
    ]
    assert_allclose(coordinates["bar.angle_dot [rad/s]"], solution.v[:, 2], rtol=0.0, atol=0.0)


@bd.model(t_end=0.2)
def swing_model(mass=2.0):
    """Pendulum with one parameter."""
    mech, bob = hinged_body(mass, 0.1, (1.0, 0.0), name="bob", gravity=9.81)
    mech.observe("bob", bob.at(1.0, 0.0))
    return mech


def test_csv_contains_the_table_and_json_the_metadata(tmp_path):
    solution = bd.simulate(swing_model, bd.Ida(rtol=1e-6), output_step=0.01)
    path = solution.to_csv(tmp_path / "deep" / "result.csv")
    assert path == tmp_path / "deep" / "result.csv"
    table = pd.read_csv(path)
    assert list(table.columns) == list(solution.table().columns)
    # All digits are written.
    assert_allclose(table.to_numpy(), solution.table().to_numpy(), rtol=1e-15)

    sidecar = json.loads(path.with_suffix(".json").read_text())
    assert sidecar["model"] == {"name": "swing_model", "parameters": {"mass": 2.0}, "t_end": 0.2}
    assert sidecar["integrator"]["integrator"] == "Ida"
    assert sidecar["integrator"]["rtol"] == 1e-6
    assert isinstance(sidecar["integrator"]["max_order"], int)
    assert sidecar["result"]["success"] is True
    assert sidecar["result"]["last_time"] == 0.2
    assert sidecar["result"]["steps"] == solution.statistics.steps > 0
    assert sidecar["result"]["energy_imbalance"] == solution.quality.energy_imbalance
    assert set(sidecar["versions"]) == {"beamdae", "casadi", "scikit-sundae", "numpy", "scipy"}
    assert sidecar["versions"]["beamdae"] == bd.__version__
    others = ("casadi", "scikit-sundae", "numpy", "scipy")
    assert all(sidecar["versions"][x] == metadata.version(x) for x in others)


def test_a_run_that_fails_in_its_first_step_has_its_start():
    failing = pushed(lambda t: np.sqrt(0.001 - t))
    solution = bd.simulate(failing, bd.GeneralizedAlpha(step=0.02), 1.0)
    assert not solution.status.success
    assert_allclose(solution.t, [0.0], rtol=0.0, atol=0.0)
    assert solution.table().shape[0] == 1
    assert_allclose(solution.q[0], [0.0, 0.0], rtol=0.0, atol=0.0)


def test_results_tell_whether_they_have_a_column():
    mech, ball = free_ball((0.0, 2.0), gravity=9.81)
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 3.0), ball.point, stiffness=100.0))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), ball.point, (0.0, 1.0)))
    mech.observe("tip", ball.point)
    for result in (bd.simulate(mech, t_end=0.1), bd.equilibrium(mech)):
        assert all(name in result for name in ("tip.y", "tip.y [m]", "tip", "ball.y"))
        assert all(name not in result for name in ("tip.z", 3, None))


@pytest.mark.slow(reason="half a second")
@integrators(rtol=1e-4, step=1e-3)
def test_regression_results_are_freed_without_garbage_collection(integrator):
    mech = swing()
    beam = mech.add(
        bd.Beam(
            "beam",
            bd.Line((1.0, 0.0), (2.0, 0.0)),
            rectangle(0.02, 0.01),
            elements=2,
        )
    )
    mech.add(bd.Weld("weld", mech.parts["bar"].at(1.0, 0.0), beam.start))
    mech.observe("stress", beam.stress(0.1, "top"))
    gc.disable()
    try:
        solution = bd.simulate(mech, integrator, t_end=0.02)
        solution.metadata(), solution.table
        parts = (solution, solution.trajectory, *solution.trajectory.intervals)
        references = [weakref.ref(x) for x in parts]
        del solution, parts
        assert all(reference() is None for reference in references)
    finally:
        gc.enable()


def test_events_are_formatted_with_their_first_time():
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    mech.when("ball.y", crosses=1.0, name="half way", do="record")
    mech.when("ball.x", crosses=9.0, name="never", do="record")
    solution = bd.simulate(mech, bd.Radau(rtol=1e-6), 0.5)
    missing = "never did not occur (closest 0 m at 0 s, needed 9 m)"
    # sqrt(2 h / g), h = 1 m
    assert f"half way at 0.4515 s, {missing}" in solution._repr_html_()
    thrice = replace(solution, event_records=solution.event_records * 3)
    assert f"half way 3 times from 0.4515 s, {missing}" in thrice._repr_html_()


def test_regression_reports_name_events_that_did_not_occur():
    """A stop that was missed by 0.7 m, or in the other direction, was not in the report."""
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    mech.when("ball.y", crosses=0.0, name="floor")
    mech.when("ball.y", crosses=1.0, direction="up", name="return", do="record")
    solution = bd.simulate(mech, bd.Radau(rtol=1e-6), 0.5)
    # 2 m - g t^2 / 2
    assert (
        "floor did not occur (closest 0.7738 m at 0.5 s, needed 0 m), "
        "return did not occur (crossed only downward)"
    ) in solution._repr_html_()


def test_regression_deactivated_joints_have_no_drift():
    mech, bob = free_ball((1.0, 0.0), name="bob", gravity=9.81)
    string = mech.add(bd.Distance("string", mech.ground.at(0.0, 0.0), bob.point))
    mech.when("bob.x", direction="down", do=bd.deactivate(string), name="cut")
    solution = bd.simulate(mech, bd.Radau(rtol=1e-6), 1.5)
    (cut_record,) = solution.event_records
    drift = solution.drift
    # Between steps, the error of the dense output is a few times rtol.
    assert drift["drift.position"].max() < 1e-4
    assert drift["drift.position"][solution.t < cut_record.t].max() > 0.0
    assert (drift[solution.t > cut_record.t] == 0.0).all(axis=None)


# Rise time, settling time, overshoot and steady-state error, against python-control.

ROWS = 20_001


@pytest.fixture(scope="module", params=[0.2, 0.5, 1.2], ids=lambda x: f"damping ratio {x}")
def oscillator(request):
    """Return a step response of an oscillator from 0.5 to 2.5, 1 s after the start."""
    mech = bd.Mechanism()
    x, rate = mech.state("x", start=0.5), mech.state("rate")
    x.follows(rate)
    target = mech.input("target", bd.piecewise((1.0, 0.5), 2.5))
    rate.follows(target - x - 2.0 * request.param * rate)
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=41.0, output_step=2e-3)
    return request.param, run


@pytest.mark.slow(reason="a fifth of a second")
def test_characteristics_are_those_of_python_control(oscillator):
    damping, run = oscillator
    times = np.linspace(0.0, 40.0, ROWS)
    system = control.TransferFunction([2.0], [1.0, 2.0 * damping, 1.0])
    _, response = control.step_response(system, times)
    expected = control.step_info(response, times, final_output=2.0)
    step = run.step_response("x", target=2.5, t=1.0)
    one_row = 1.01 * 2e-3
    assert step.rise_time == pytest.approx(expected["RiseTime"], abs=one_row)
    assert step.settling_time == pytest.approx(expected["SettlingTime"], abs=one_row)
    assert 100.0 * step.overshoot == pytest.approx(expected["Overshoot"], abs=1e-3)
    if expected["Overshoot"] > 0.0:
        assert step.peak == pytest.approx(0.5 + expected["Peak"], rel=1e-6)
        assert step.peak_time == pytest.approx(expected["PeakTime"], abs=one_row)
    assert abs(step.steady_state_error) < 2e-3


@pytest.mark.slow(reason="a quarter of a second")
def test_steps_downwards_and_other_bands():
    mech = bd.Mechanism()
    mech.state("level", lambda level, t: -level - 3.0)
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=4.0, output_step=1e-3)
    step = run.step_response("level", target=-3.0, band=0.05)
    assert step.rise_time == pytest.approx(np.log(9.0), abs=1e-4)
    assert step.settling_time == pytest.approx(np.log(20.0), abs=1e-4)
    assert step.overshoot == 0.0
    assert step.steady_state_error == pytest.approx(-3.0 * np.exp(-4.0), rel=1e-5)
    short = run.step_response("level", target=-4.0)
    assert np.isnan([short.rise_time, short.settling_time]).all()


@pytest.mark.parametrize("scale", [0.01, 1.0, 100.0])
@pytest.mark.parametrize(
    ("duration", "damping", "is_steady"),
    [(40.0, 0.3, True), (8.0, 2.0, False), (0.1, 0.3, False), (20.0, 0.02, False)],
    ids=["settled", "slow", "short", "oscillating"],
)
def test_regression_errors_of_unsteady_responses_are_nan(scale, duration, damping, is_steady):
    """The last value of a vibration that had not settled was its steady state."""
    mech = bd.Mechanism()
    x, rate = mech.state("x", scale=scale), mech.state("rate", scale=scale)
    x.follows(rate)
    rate.follows(0.7 * scale - x - 2.0 * damping * rate)
    run = bd.simulate(mech, bd.Radau(1e-6), t_end=duration, output_step=duration / 400)
    step = run.step_response("x", target=scale)
    assert np.isnan(step.steady_state_error) != is_steady
    if is_steady:
        assert step.steady_state_error == pytest.approx(0.3 * scale, rel=1e-2)
        assert np.isnan(step.settling_time)


def test_responses_end_at_t_end():
    """A disturbance after the step was part of the response."""
    mech = bd.Mechanism()
    push = mech.input("push", bd.piecewise((5.0, 1.0), 3.0))
    x = mech.state("x")
    x.follows(push - x)
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=10.0, output_step=2e-3)
    assert run.step_response("x", target=1.0).overshoot > 1.0
    # The end is between two rows.
    step = run.step_response("x", target=1.0, t_end=4.999)
    assert step.settling_time == pytest.approx(np.log(50.0), abs=1e-4)
    assert (step.overshoot, step.peak_time) == (0.0, 4.999)
    assert step.steady_state_error == pytest.approx(np.exp(-4.999), rel=1e-4)
    ended = run.step_response("x", t_end=3.0)
    assert ended.peak == pytest.approx(1.0 - np.exp(-3.0), rel=1e-6)
    assert np.isnan(ended.steady_state_error)
    later = run.step_response("x", target=3.0, t=5.0)
    assert later == run.step_response("x", target=3.0, t=5.0, t_end=10.0)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"name": "x", "target": 0.5}, "x .* starts at 0.5, the target; pass target= and t= of"),
        ({"name": ["x", "rate"]}, r"\['x', 'rate'\] selects 2 columns; name one of them"),
        ({"name": "x", "t": 41.0}, "t must be within the run, 0 to 41 s, got 41 s"),
        ({"name": "x", "t": 2.0, "t_end": 2.0}, "t_end must be later than 2 s .* got 2 s"),
        ({"name": "x", "t_end": 42.0}, "t_end must be .* ends at 41 s, got 42 s"),
        ({"name": "x", "band": 0.0}, "band must be positive, got 0"),
        ({"name": "y"}, "y"),
    ],
)
def test_invalid_arguments_are_rejected(oscillator, options, reason):
    with pytest.raises(bd.BeamdaeError, match=reason):
        oscillator[1].step_response(**options)
