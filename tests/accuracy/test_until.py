"""Runs and analyses that are refined until their errors are small."""

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from mechanisms import EARTH, clamped_beam, free_ball, hinged_beam, mass_on_rail, rectangle
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.accuracy import until

ALLOY = bd.Material(E=7.1e10, nu=0.33, rho=2750.0)
STRIP = rectangle(0.002, 0.025, damping=2e-4, material=ALLOY)


def pendulum(elements=1, strain="exact"):
    """Return a slender pendulum that swings from the horizontal, with a mass inside the beam."""
    mech, beam = hinged_beam(STRIP, elements, 0.9, name="strip", gravity=9.81, strain=strain)
    mech.add(bd.PointMass("mass", 0.3, on=beam.at(0.7)))
    mech.observe("tip", beam.end)
    mech.observe("bow", beam.deformation(0.45, axes="frame"))
    return mech


def pushed_cantilever(elements=1, strain="exact", law=lambda t: 60.0 * t):
    """Return a clamped strip whose end a moment bends by about 1 rad in 0.05 s."""
    mech, beam = clamped_beam(STRIP, elements, (0.4, 0.1), strain=strain)
    mech.add(bd.Moment("moment", beam.end, law))
    mech.observe("tip", beam.end)
    return mech


def sliding_ball(elements=0, strain="", friction_speed=0.2):
    """Return a ball that slides on a rough floor; without a smoothed force, it stops at 0.34 m."""
    mech, ball = free_ball(velocity=(1.0, 0.0), mass=0.4, gravity=9.81)
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0), direction=(1.0, 0.0))
    contact = bd.Contact("c", ball.point, floor, 3e4, friction=0.15, friction_speed=friction_speed)
    mech.add(contact)
    return mech


def double_pendulum(angle):
    mech = bd.Mechanism(gravity=EARTH)
    joint, last = np.zeros(2), mech.ground.at(0.0, 0.0)
    for name in ("upper", "lower"):
        end = joint + 0.4 * np.array([np.sin(angle), -np.cos(angle)])
        rod = mech.add(bd.RigidBody.rod(name, tuple(joint), tuple(end), mass=1.0))
        mech.add(bd.Revolute(f"{name} hinge", last, rod.at(*joint)))
        last, joint = rod.at(*end), end
        mech.observe(name, last)
    return mech


def true_errors(solution, fine):
    """Return the errors of columns: of peaks, and root mean squares of deviations."""
    rows = solution.observed.iloc[: len(fine)]
    difference = rows - fine
    means = np.sqrt((difference**2).mean()) / fine.std(ddof=0)
    half_range = 0.5 * (fine.max() - fine.min())
    peaks = (rows.max() - fine.max()).abs(), (rows.min() - fine.min()).abs()
    return np.maximum(means, np.maximum(*peaks) / half_range)


@pytest.mark.slow(reason="two to four runs and a reference")
@pytest.mark.parametrize("accuracy", [0.03, 0.002])
@pytest.mark.parametrize(
    ("build", "t_end", "coarse", "fine"),
    [
        (pendulum, 0.4, {}, {"elements": 16}),
        (pendulum, 0.4, {"strain": "nonlinear"}, {"elements": 16}),
        (pushed_cantilever, 0.06, {"strain": "nonlinear"}, {"elements": 16}),
        (sliding_ball, 0.9, {}, {"friction_speed": 1e-4}),
    ],
)
def test_true_errors_are_below_the_accuracy(build, t_end, coarse, fine, accuracy):
    settings = {"t_end": t_end, "output_step": t_end / 500}
    solution = bd.simulate(build(**coarse), accuracy=accuracy, **settings)
    errors = solution.errors
    assert errors.status.success
    required = [x for x in errors.headers if x.endswith(("[m]", "[rad]"))]
    stated = errors.select(required).total
    assert stated.max() <= accuracy
    reference = bd.simulate(build(**fine), bd.Radau(1e-8), **settings).observed
    true = true_errors(solution, reference)[required].to_numpy()
    assert np.all(true <= accuracy)
    # Stated errors are those of the worst column within a factor of 2.
    assert 0.5 < stated[np.argmax(true)] / true.max() < 2.0


@pytest.mark.slow(reason="several runs")
def test_only_what_is_inaccurate_is_refined():
    settings = {"t_end": 0.3, "output_step": 0.003}
    fine = bd.simulate(pendulum(4), bd.Radau(2e-3), accuracy=0.02, **settings)
    assert fine.equations.mechanism.part("strip").mesh.elements == 5  # One ends at the mass.
    assert fine.made_by.rtol == 0.002
    coarse = pendulum(1, "nonlinear")
    written = coarse.part("strip")
    refined = bd.simulate(coarse, accuracy=1e-4, **settings)
    assert refined.equations.mechanism.part("strip").mesh.elements > 2
    assert (written.mesh.elements, written.kinematics.strain) == (2, "nonlinear")


@pytest.mark.slow(reason="a third of a second")
def test_named_columns_are_accurate():
    settings = {"t_end": 0.05, "output_step": 1e-4}
    sudden = pushed_cantilever(law=1.0)
    by_default = bd.simulate(sudden, accuracy=0.02, **settings)
    rates = bd.simulate(sudden, accuracy=0.02, accuracy_columns=["tip.angle_dot"], **settings)
    errors = [
        float(x.errors.select(["tip.angle_dot [rad/s]"]).largest) for x in (by_default, rates)
    ]
    assert errors[1] <= 0.02 < errors[0]
    # The advice was to require the accuracy that had been required.
    assert re.search(r"accuracy_columns=\[.*tip\.angle_dot", by_default.errors.recommend())


@pytest.mark.slow(reason="a second")
def test_runs_that_an_event_stops_are_refined():
    mech = double_pendulum(0.5)
    mech.when("lower.x", crosses=0.1, direction="down", do="stop")
    solution = bd.simulate(mech, accuracy=1e-3, t_end=2.0)
    assert solution.errors.status.success
    exact = bd.simulate(mech, bd.Radau(1e-10), t_end=2.0).trajectory.end
    assert_allclose(solution.trajectory.end, exact, rtol=1e-4)


@pytest.mark.slow(reason="runs at rtol down to 1e-9")
def test_a_chaotic_motion_is_refused():
    with pytest.warns(bd.BeamdaeWarning, match="accuracy: .*; errors do not decrease"):
        solution = bd.simulate(double_pendulum(2.6), accuracy=0.01, t_end=20.0)
    assert solution.errors.status.kind == "limited"
    assert solution.errors.largest > 0.3


def test_beams_with_custom_quantities_are_named():
    mech = pendulum(2)
    piece = mech.part("strip").end.piece
    from beamdae.symbolic.statements import Quantity, Variable

    mech.observe("custom", Quantity((Variable("x", "m"),), (piece,), lambda local: local.q[0]))
    solution = bd.simulate(mech, accuracy=0.1, t_end=0.02)
    status = solution.errors.status
    assert status.kind == "limited"
    assert "strip keeps its elements and strains, because the quantity 'custom'" in status.sentence


def at_second_run(act):
    """Return a function `progress` that calls `act` within the second run."""
    times = [0.0]
    runs = [1]

    def progress(t):
        runs[0] += t < times[0]
        times[0] = t
        return act() if runs[0] == 2 and t > 0.05 else None

    return progress


def interrupt():
    raise KeyboardInterrupt


def fail():
    raise RuntimeError("no display")


SHORT = {"integrator": bd.Radau(1e-4), "accuracy": 1e-3, "t_end": 0.2}


def test_a_stopped_second_run_leaves_the_first():
    with pytest.warns(bd.BeamdaeWarning, match="accuracy: .*enough"):
        solution = bd.simulate(
            double_pendulum(0.3), progress=at_second_run(lambda: "enough"), **SHORT
        )
    assert solution.errors.status.kind == "limited"
    assert solution.t[-1] == 0.2
    assert solution.errors.statuses[0].startswith("not checked")


@pytest.mark.parametrize(("act", "error"), [(interrupt, bd.Interrupted), (fail, RuntimeError)])
def test_interrupts_and_exceptions_contain_the_first_run(act, error):
    with pytest.raises(error) as caught:
        bd.simulate(double_pendulum(0.3), progress=at_second_run(act), **SHORT)
    assert caught.value.solution.t[-1] == 0.2


def test_a_time_limit_leaves_what_it_allows():
    limited = bd.Radau(time_limit=1e-9)
    with pytest.warns(bd.BeamdaeWarning, match="time limit"):
        solution = bd.simulate(double_pendulum(0.3), limited, t_end=50.0, accuracy=0.01)
    assert solution.status.kind == solution.errors.status.kind == "limited"
    assert 0.0 < solution.trajectory.end < 50.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"accuracy": 1.0}, "accuracy must lie in"),
        ({"accuracy": "1%"}, "accuracy must be a number"),
        ({"accuracy": 0.0}, r"accuracy must lie in \[1e-06, 0.1\], got 0"),
        ({"accuracy_columns": ["uper"]}, r"no column 'uper' \(did you mean 'upper"),
        (
            {"accuracy_columns": [3]},
            r"accuracy_columns must be a list of names of observed columns, got \[3\]",
        ),
        ({"accuracy_columns": []}, r"accuracy_columns must contain at least one name, got \[\]"),
        ({"t_end": None}, "no end time"),
        ({"start": 3.0}, "start must be"),
        ({"progress": 3.0}, "progress must be a function, got 3.0"),
    ],
)
def test_invalid_settings_are_rejected(settings, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.simulate(double_pendulum(0.3), **{"t_end": 0.1, "accuracy": 0.01} | settings)


def test_a_model_without_observables_is_rejected():
    mech = bd.Mechanism(gravity=EARTH)
    mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    with pytest.raises(bd.BeamdaeError, match="nothing is observed"):
        bd.simulate(mech, t_end=0.1, accuracy=0.01)


def test_all_runs_of_a_required_accuracy_show_progress():
    """Those that separate the causes, a third of the time, showed none."""
    shown = []

    class Watched(bd.Radau):
        def integrate(self, equations, times, progress=None):
            shown.append(progress is not None)
            return super().integrate(equations, times, progress)

    model = bd.load_model("example:hub_beam")(elements=2)
    bd.simulate(model, Watched(), t_end=0.5, accuracy=1e-4, progress=lambda t: None)
    assert len(shown) >= 4
    assert all(shown)


LENGTH = 0.9

# Shear and rotary inertia change frequencies and loads by less than 1e-4.
CLAMPED_STRIP = rectangle(0.002, 0.025, material=ALLOY)

# Euler-Bernoulli beams: roots of cos(b) cosh(b) = -1.
ROOTS = np.array([1.8751041, 4.6940911, 7.8547574])
FREQUENCIES = ROOTS**2 * np.sqrt(CLAMPED_STRIP.EI / CLAMPED_STRIP.rhoA) / (2.0 * np.pi * LENGTH**2)

ACCURACIES = (0.02, 5e-4)
MESHES = ({"elements": 1}, {})  # coarse, and chosen by the program


def cantilever(section=CLAMPED_STRIP, **settings):
    mech, leaf = clamped_beam(section, curve=LENGTH, name="leaf", **settings)
    mech.observe("tip", leaf.end)
    return mech


def bent(**settings):
    """Return a cantilever that a moment bends into an arc of 1.2 rad."""
    mech = cantilever(**settings)
    mech.add(bd.Moment("moment", mech.part("leaf").end, 1.2 * CLAMPED_STRIP.EI / LENGTH))
    return mech


def pressed(**settings):
    mech = cantilever(**settings)
    mech.add(bd.Force("press", mech.part("leaf").end, (-CLAMPED_STRIP.EI, 0.0)))
    return mech


def pushed(law=0.0, **settings):
    mech = cantilever(replace(CLAMPED_STRIP, damping=1e-3), **settings)
    mech.add(bd.Force("push", mech.part("leaf").end, (0.0, law)))
    return mech


@pytest.mark.slow(reason="several meshes")
@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("mesh", MESHES)
def test_equilibria_are_accurate(mesh, accuracy):
    path = bd.equilibrium(bent(**mesh), accuracy=accuracy)
    assert path.errors.status.success
    radius = LENGTH / 1.2
    exact = [radius * np.sin(1.2), radius * (1.0 - np.cos(1.2)), 1.2]
    moved = exact - np.array([LENGTH, 0.0, 0.0])
    end = [float(path[f"tip.{x}"].iloc[-1]) for x in ("x", "y", "angle")]
    assert np.all(np.abs((end - np.array(exact)) / moved) <= accuracy)


@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("mesh", MESHES)
def test_buckling_loads_are_accurate(mesh, accuracy):
    result = bd.buckling(pressed(**mesh), n=3, accuracy=accuracy)
    assert result.errors.status.success
    exact = ((np.arange(3) + 0.5) * np.pi / LENGTH) ** 2
    assert_allclose(result.factors, exact, rtol=accuracy)


@pytest.mark.slow(reason="several meshes")
@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("mesh", MESHES)
def test_modes_are_as_many_as_requested_and_accurate(mesh, accuracy):
    result = bd.modes(cantilever(**mesh), n=3, accuracy=accuracy)
    assert result.errors.status.success
    assert_allclose(result.frequencies, FREQUENCIES, rtol=accuracy)


def test_fewer_modes_need_fewer_elements():
    fewer, more = (
        bd.modes(cantilever(elements=1), n=6, accuracy=1e-3, accuracy_columns=columns)
        for columns in ("frequency 1", None)
    )
    counts = [x.mechanism.part("leaf").mesh.elements for x in (fewer, more)]
    assert counts[0] < counts[1]


@pytest.mark.slow(reason="several meshes")
@pytest.mark.parametrize("mesh", MESHES)
def test_frequency_responses_are_accurate(mesh):
    linear = bd.linearize(pushed(**mesh), inputs=["push.Fy"], outputs=["tip.y"])
    diagram = bd.bode(linear, between=(1.0, 1.2 * FREQUENCIES[2]), accuracy=1e-3)
    assert diagram.errors.status.success
    poles = np.unique(np.round(np.abs(diagram.model.poles) / (2.0 * np.pi), 9))
    assert_allclose(poles[:3], FREQUENCIES, rtol=1e-3)
    # The static response is L^3 / (3 EI).
    static = bd.bode(linear, frequencies=[1e-3], accuracy=1e-3).response[0, 0, 0]
    assert_allclose(abs(static), LENGTH**3 / (3.0 * CLAMPED_STRIP.EI), rtol=1e-3)


@pytest.mark.parametrize("mesh", MESHES)
def test_linear_models_are_accurate(mesh):
    linear = bd.linearize(cantilever(**mesh), accuracy=1e-3)
    assert linear.errors.status.success
    poles = np.unique(np.round(np.abs(linear.poles) / (2.0 * np.pi), 9))
    assert_allclose(poles[:3], FREQUENCIES, rtol=1e-3)


@pytest.mark.slow(reason="periodic motions of several meshes")
@pytest.mark.parametrize("mesh", MESHES)
def test_periodic_motions_are_accurate(mesh):
    law = bd.sine(0.02, frequency=3.0)
    motion = bd.periodic(pushed(law, **mesh), 1.0 / 3.0, settle=1, accuracy=1e-3)
    assert motion.errors.status.success
    linear = bd.linearize(pushed(elements=8), inputs=["push.Fy"], outputs=["tip.y"])
    amplitude = 0.02 * abs(linear.frequency_response([3.0])[0, 0, 0])
    largest = 0.5 * np.ptp(motion["tip.y"].to_numpy())
    assert_allclose(largest, amplitude, rtol=2e-3)  # of small motions, at discrete times


@pytest.mark.slow(reason="several meshes")
def test_paths_over_a_parameter_refine_the_model():
    @bd.model(t_end=1.0)
    def loaded(moment=0.1):
        mech = cantilever(elements=1)
        mech.add(bd.Moment("moment", mech.part("leaf").end, moment))
        return mech

    moment = 0.4 * CLAMPED_STRIP.EI / LENGTH
    path = bd.equilibrium(loaded, over="moment", to=moment, accuracy=1e-5)
    assert path.errors.status.success
    assert path.equations.mechanism.part("leaf").kinematics.strain == "exact"
    assert_allclose(path["tip.y"].iloc[-1], LENGTH / 0.4 * (1.0 - np.cos(0.4)), rtol=1e-5)
    assert path.model["name"] == "loaded"


@dataclass(frozen=True)
class Loose(bd.GeneralizedAlpha):
    """An integrator of somebody else."""


def oscillator():
    mech, bob = mass_on_rail(x=1.2, name="bob", spring=(100.0, 0.0, 1.0))
    mech.observe("bob", bob.point)
    return mech


@pytest.mark.parametrize(
    "integrator",
    [bd.Ida(1e-2), bd.Radau(1e-2), bd.GeneralizedAlpha(0.05), Loose(0.02), bd.Auto(1e-2)],
    ids=lambda x: type(x).__name__,
)
def test_every_integrator_is_refined_by_its_own_number(integrator):
    accuracy = 2e-3 if integrator.accuracy.name == "step" else 1e-5
    run = bd.simulate(oscillator(), integrator, t_end=2.0, accuracy=accuracy)
    assert run.errors.status.success
    # Steps are hardly smaller than necessary.
    assert integrator.accuracy.name == "rtol" or run.errors.largest > 0.2 * accuracy
    assert type(run.made_by) is type(integrator)
    assert run.made_by.accuracy.value < integrator.accuracy.value
    exact = 1.0 + 0.2 * np.cos(10.0 * run.t)
    assert_allclose(run["bob.x"].to_numpy(), exact, atol=2.0 * 0.2 * accuracy)


def test_an_accuracy_beyond_the_limits_is_stated(monkeypatch):
    monkeypatch.setattr(until, "_MAX_UNKNOWNS", 50)
    with pytest.warns(bd.BeamdaeWarning, match="accuracy: frequency .* has the largest error"):
        result = bd.modes(cantilever(elements=1), n=6, accuracy=1e-6)
    status = result.errors.status
    assert status.kind == "limited"
    assert "unknowns" in status.sentence


def test_states_of_other_meshes_and_wrong_columns_are_rejected():
    mech = bent(elements=1)
    path, run = bd.equilibrium(mech), bd.simulate(oscillator(), t_end=0.1)
    with pytest.raises(bd.BeamdaeError, match="modes: accuracy requires a state"):
        bd.modes(mech, about=path, accuracy=0.01)
    with pytest.raises(bd.BeamdaeError, match="modes: there is no column 'frequency 9'"):
        bd.modes(mech, n=2, accuracy=0.01, accuracy_columns="frequency 9")
    with pytest.raises(bd.BeamdaeError, match="simulate: accuracy requires a run that does not"):
        bd.simulate(oscillator(), t_end=0.2, start=run, accuracy=0.01)
    with pytest.raises(bd.BeamdaeError, match="equilibrium: accuracy cannot be combined"):
        bd.equilibrium(mech, start=path, accuracy=0.01)


def test_interrupts_keep_the_last_modes(monkeypatch):
    calls = []

    def interrupt(beam):
        calls.append(beam)
        if len(calls) > 4:
            raise KeyboardInterrupt
        return ()

    mech = cantilever(elements=1)
    monkeypatch.setattr(bd.Beam, "_with_exact_strains", lambda self: interrupt(self) or self)
    with pytest.raises(bd.Interrupted) as caught:
        bd.modes(mech, n=6, accuracy=1e-5)
    assert len(caught.value.partial) == 6
    assert caught.value.partial.errors.largest > 1e-5


@pytest.mark.parametrize(
    "analyze",
    [
        lambda **x: bd.simulate(pressed(), t_end=1e-3, **x),
        lambda **x: bd.equilibrium(pressed(), **x),
        lambda **x: bd.buckling(pressed(), n=1, **x),
        lambda **x: bd.modes(cantilever(), n=1, **x),
        lambda **x: bd.linearize(cantilever(), outputs=["tip"], **x),
        lambda **x: bd.bode(bd.linearize(cantilever(), outputs=["tip"]), [1.0], **x),
    ],
    ids=["simulate", "equilibrium", "buckling", "modes", "linearize", "bode"],
)
def test_columns_without_an_accuracy_are_rejected(analyze):
    with pytest.raises(bd.BeamdaeError, match="accuracy_columns requires accuracy"):
        analyze(accuracy_columns="tip")
