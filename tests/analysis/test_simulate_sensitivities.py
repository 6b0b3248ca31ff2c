"""Derivatives of columns of `simulate`, and of periodic motions."""

import pickle

import numpy as np
import pytest
from command_line import invoke
from mechanisms import clamped_beam, free_ball, mass_on_rail, rectangle
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.sensitivities import differentiable_run as implementation
from beamdae.report.pictures.figures import characteristic_columns
from beamdae.report.run_pages import build_run_page
from beamdae.results.columns import Header

HEADER = "d(mass.x)/d(stiffness) [m per unit of stiffness]"
ALPHA = bd.GeneralizedAlpha(step=0.02)


@bd.model(t_end=0.4)
def oscillator(stiffness=40.0, speed=0.2):
    """Mass on a spring, on a rail."""
    mech, mass = mass_on_rail(x=1.0, velocity=(speed, 0.0), spring=(stiffness,))
    mech.observe("mass", mass.point)
    return mech


@bd.model(t_end=0.4)
def driven(stiffness=40.0):
    """Oscillator with an input."""
    mech = oscillator(stiffness=stiffness)
    mech.add(bd.Force("load", mech.part("mass").point, (mech.input("push", unit="N"), 0.0)))
    return mech


@pytest.fixture(scope="module")
def solution():
    return bd.simulate(oscillator, ALPHA, output_step=0.05, sensitivities=["stiffness", "speed"])


def test_derivatives_are_those_of_sensitivities(solution):
    result = bd.sensitivities(oscillator, ["stiffness", "speed"], ALPHA, output_step=0.05)
    for name in ("mass.x", "mass.y_dot", *solution.coordinates().columns[-1:]):
        assert solution.sensitivity(name, "speed").equals(result.sensitivity(name, "speed"))
    table = result.table()
    assert solution.table()[list(table)].equals(table)
    assert solution[HEADER].equals(result.sensitivity("mass.x", "stiffness"))
    assert len(solution["d(mass)/d(speed)"].columns) == len(solution["mass"].columns)


@pytest.mark.slow(reason="a fifth of a second")
def test_a_parameter_name_or_a_built_mechanism_is_accepted():
    stiff = bd.simulate(oscillator(stiffness=90.0), ALPHA, sensitivities="stiffness")
    expected = bd.sensitivities(oscillator, "stiffness", ALPHA, parameters={"stiffness": 90.0})
    assert stiff.sensitivity("mass.x", "stiffness").equals(
        expected.sensitivity("mass.x", "stiffness")
    )
    assert stiff.derivatives.parameters == {"stiffness": 90.0}


@pytest.mark.slow(reason="half a second and more")
def test_inputs_are_those_of_the_run():
    push = 3.0
    run = bd.simulate(driven, ALPHA, inputs={"push": push}, sensitivities="stiffness")
    ends = [
        bd.simulate(driven(stiffness=40.0 + x), ALPHA, inputs={"push": push})["mass.x"].iloc[-1]
        for x in (-1e-3, 1e-3)
    ]
    end = run.sensitivity("mass.x", "stiffness").iloc[-1]
    assert end == pytest.approx((ends[1] - ends[0]) / 2e-3, rel=1e-6)


def test_saved_and_pickled_solutions_keep_derivatives(solution, tmp_path):
    path = solution.save(tmp_path / "run.beamdae")
    derivative = solution.sensitivity("mass.x", "stiffness")
    for copy in (pickle.loads(pickle.dumps(solution)), bd.load(path, oscillator), bd.load(path)):
        assert copy.sensitivity("mass.x", "stiffness").equals(derivative)
        assert copy.table().equals(solution.table())
        rows = copy.at_times(solution.t[2:5])
        assert rows.sensitivity("mass.x", "stiffness").equals(derivative.iloc[2:5])
        with pytest.raises(bd.BeamdaeError, match=r"at_times: the .*run"):
            copy.at_times([0.07])


def test_derivatives_at_other_times(solution):
    result = bd.sensitivities(oscillator, ["stiffness", "speed"], ALPHA, output_step=0.05)
    expected = result.at_times([0.07, 0.33]).sensitivity("mass.x", "speed")
    assert solution.at_times([0.07, 0.33]).sensitivity("mass.x", "speed").equals(expected)


def test_tables_files_and_pages_contain_derivatives(solution, tmp_path):
    csv = solution.to_csv(tmp_path / "run.csv").read_text().partition("\n")[0].split(",")
    assert HEADER in csv
    assert csv.index(HEADER) < csv.index("energy.kinetic [J]")
    page = build_run_page(solution, "run")
    assert HEADER in page["cases"][0]["curves"]["observed"]
    assert any(HEADER in row for x in page["tables"] for row in x["rows"])
    assert not any(x.startswith("d(") for x in characteristic_columns(solution.all_columns()))
    assert Header.of(HEADER) == ("d(mass)/d(stiffness)", "x", "m per unit of stiffness")


def test_a_run_that_is_stopped_has_no_derivatives():
    with pytest.warns(bd.BeamdaeWarning, match="not finished"):
        run = bd.simulate(oscillator, bd.Radau(max_steps=3), sensitivities="speed")
    assert not run.status.success
    assert "mass.x" in run
    with pytest.raises(bd.BeamdaeError, match="no derivatives; name the parameters"):
        run.sensitivity("mass.x", "speed")


@pytest.mark.parametrize("partial", ["raise", "return"])
def test_an_interrupt_of_the_derivatives_preserves_the_run(partial, monkeypatch):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(implementation, "differentiate_states", interrupt)
    if partial == "return":
        run = bd.simulate(oscillator, ALPHA, sensitivities="speed", partial="return")
        assert run.status.kind == "interrupted"
    else:
        with pytest.raises(bd.Interrupted) as problem:
            bd.simulate(oscillator, ALPHA, sensitivities="speed")
        run = problem.value.solution
    assert run.t[-1] == 0.4
    assert run["mass.x"].iloc[-1] != 1.0


def changed():
    mech = oscillator()
    mech.add(bd.PointMass("other", 1.0, at=(0.0, 1.0)))
    return mech


@pytest.mark.parametrize(
    ("model", "names", "sentence"),
    [
        (oscillator, "stifness", "simulate: .*did you mean 'stiffness'"),
        (oscillator, [], "simulate: sensitivities must contain each parameter once"),
        (changed, "speed", "simulate: the mechanism was changed after oscillator had built it"),
        (lambda: oscillator.build(), "speed", "simulate: sensitivities need a model function"),
    ],
)
def test_mistakes(model, names, sentence):
    model = model if model is oscillator else model()
    with pytest.raises(bd.BeamdaeError, match=sentence):
        bd.simulate(model, ALPHA, t_end=0.1, sensitivities=names)


def test_a_solution_without_derivatives():
    run = bd.simulate(oscillator, ALPHA)
    with pytest.raises(bd.BeamdaeError, match=r"simulate\(..., sensitivities="):
        run.sensitivity("mass.x", "speed")
    assert not np.any([x.startswith("d(") for x in run.table()])


MODEL = """
import beamdae as bd


@bd.model(t_end=0.2)
def fall(mass=1.0, drag=0.3):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", mass, at=(0.0, 1.0)))
    mech.add(bd.Spring("drag", mech.ground.at(0.0, 0.0), ball.point, damping=drag))
    mech.observe("ball", ball.point)
    return mech
"""


@pytest.mark.slow(reason="a fifth of a second")
def test_the_command_writes_derivatives(tmp_path):
    (tmp_path / "fall.py").write_text(MODEL)

    def run(*arguments):
        command = ("run", str(tmp_path / "fall.py"), "--out", str(tmp_path), *arguments)
        return invoke(*command, "--no-picture", "--no-page", "--no-estimate")

    result = run("--sensitivities", "mass, drag", "--output-step", "0.1")
    assert result.exit_code == 0, result.output
    assert "d(ball.y)/d(mass)" in result.output
    header = (tmp_path / "fall.csv").read_text().partition("\n")[0]
    assert "d(ball.y_dot)/d(drag) [m/s per unit of drag]" in header.split(",")
    for option, value in (("--continue", "x.json"), ("--accuracy", "1%")):
        result = run("--sensitivities", "mass", option, value)
        assert result.exit_code == 2
        message = " ".join(result.output.split())
        assert f"--sensitivities and {option} are mutually exclusive" in message


# Derivatives of periodic motions: closed forms, scaling laws and differences.


@bd.model(t_end=1.0)
def shaker(stiffness=9.0, mass=1.0, damping=0.5, frequency=0.3, load=1.0):
    """Mass on a spring and a damper under a harmonic force."""
    mech, bob = mass_on_rail(mass, 1.0, name="bob")
    hook = mech.ground.at(0.0, 0.0)
    mech.add(bd.Spring("spring", hook, bob.point, stiffness, damping))
    mech.add(bd.Force("load", bob.point, (bd.sine(load, frequency=frequency), 0.0)))
    mech.observe("bob", bob.point)
    return mech


def response(t, stiffness, mass, damping, frequency, load):
    """Return the periodic displacement; analytic in all arguments."""
    rate = 2.0 * np.pi * frequency
    elastic, viscous = stiffness - mass * rate**2, damping * rate
    size = load / (elastic**2 + viscous**2)
    return size * (elastic * np.sin(rate * t) - viscous * np.cos(rate * t))


@pytest.mark.slow(reason="a quarter of a second")
def test_forced_oscillator_has_a_closed_form():
    names = ["stiffness", "mass", "damping", "load"]
    result = bd.periodic_sensitivities(shaker, names, period=1.0 / 0.3)
    values = dict(shaker.parameters)
    for name in names:
        step = {**values, name: values[name] * (1.0 + 1e-30j)}
        exact = response(result.motion.solution.t, **step).imag / (1e-30 * values[name])
        # The run has a relative tolerance of 1e-8.
        actual = result.sensitivity("bob.x", name)
        assert_allclose(actual, exact, rtol=0.0, atol=1e-8 * np.abs(exact).max())
        assert result.periods[name] == 0.0


@pytest.mark.slow(reason="half a second and more")
def test_parameter_that_changes_the_period_of_the_load():
    with pytest.raises(bd.BeamdaeError, match="frequency of shaker changes the period of loads"):
        bd.periodic_sensitivities(shaker, "frequency", period=1.0 / 0.3)
    result = bd.periodic_sensitivities(
        shaker, "frequency", period=lambda **values: 1.0 / values["frequency"]
    )
    assert result.periods["frequency"] == pytest.approx(-1.0 / 0.3**2, rel=1e-9)
    # At fixed phases, time is proportional to the period.
    phase = result.motion.solution.t * 0.3
    values = {**shaker.parameters, "frequency": 0.3 * (1.0 + 1e-30j)}
    exact = response(phase / values["frequency"], **values).imag / 0.3e-30
    actual = result.sensitivity("bob.x", "frequency")
    assert_allclose(actual, exact, rtol=0.0, atol=1e-7 * np.abs(exact).max())


@bd.model(t_end=60.0)
def van_der_pol(excitation=0.5, stiffness=1.0, size=1.0):
    mech, bob = mass_on_rail(x=5.0 + size, name="bob")

    def law(elongation, rate):
        return stiffness * elongation - excitation * (1.0 - (elongation / size) ** 2) * rate

    hook = mech.ground.at(0.0, 0.0)
    mech.add(bd.Spring("spring", hook, bob.point, law=law, free_length=5.0))
    mech.observe("bob", bob.point)
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_self_excited_motion_has_a_derivative_of_its_period():
    names = ["excitation", "stiffness", "size"]
    result = bd.periodic_sensitivities(van_der_pol, names, period_guess=6.3)
    period, rates = result.motion.period, result.periods
    # T = f(e / sqrt(k)) / sqrt(k) for the mass 1; the size does not matter.
    assert rates["stiffness"] == pytest.approx(-0.5 * period - 0.25 * rates["excitation"], rel=1e-7)
    assert rates["size"] == pytest.approx(0.0, abs=1e-7)
    # T = 2 pi (1 + e^2 / 16 - 5 e^4 / 3072 + ...), Buonomo, SIAM J. Appl. Math. 59 (1998) 156.
    series = 2.0 * np.pi * (0.5 / 8.0 - 20.0 * 0.5**3 / 3072.0)
    assert rates["excitation"] == pytest.approx(series, rel=5e-3)
    # The largest displacement, where phases do not matter, is proportional to the size.
    x = result.motion.solution.columns["bob.x [m]"] - 5.0
    largest = int(np.argmax(x))
    amplitude = result.sensitivity("bob.x", "size").iloc[largest]
    assert amplitude == pytest.approx(x[largest], rel=1e-3)


@bd.model(t_end=3.0)
def pendulum(length=1.0):
    mech, bob = free_ball((length, 0.0), name="bob", gravity=9.81)
    mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), bob.point))
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_refusals():
    # Free motions of all amplitudes are periodic.
    with pytest.raises(bd.BeamdaeError, match="neighboring motions of pendulum are periodic, too"):
        bd.periodic_sensitivities(pendulum, "length", period_guess=2.3)
    with pytest.raises(bd.BeamdaeError, match="integrator must be Radau"):
        bd.periodic_sensitivities(shaker, "mass", 1.0 / 0.3, bd.Ida())
    with pytest.raises(bd.BeamdaeError, match="no parameter 'mas'"):
        bd.periodic_sensitivities(shaker, "mas", 1.0 / 0.3)


@bd.model(t_end=1.0)
def strip(length=0.5, formulation="exact"):
    """Damped curved cantilever with a mass at its tip, which is shaken."""
    plastic = bd.Material(E=2e9, nu=0.35, rho=1200.0)
    section = rectangle(0.004, damping=2e-3, material=plastic)
    mech, beam = clamped_beam(
        section, 1, bd.Arc(1.25, length), name="strip", formulation=formulation
    )
    tip = mech.add(bd.PointMass("tip", 0.05, at=beam.end.point))
    mech.add(bd.Revolute("pin", beam.end, tip.point))
    mech.add(bd.Force("shake", tip.point, (0.0, bd.sine(0.2, frequency=2.0))))
    mech.observe("tip", beam.end)
    return mech


@pytest.mark.slow(reason="three periodic motions of a beam")
def test_shaken_strip_agrees_with_differences():
    # The length changes the operator of the joint at the tip.
    settings = {"period": 0.5, "settle": 1, "integrator": bd.Radau(1e-6)}
    values = {"formulation": "floating frame"}
    result = bd.periodic_sensitivities(strip, "length", **settings, parameters=values)
    delta = 5e-4
    last, first = (
        bd.periodic(strip(**values, length=0.5 + x), **settings).solution.columns["tip.y [m]"]
        for x in (delta, -delta)
    )
    expected = (last - first) / (2.0 * delta)
    error = np.abs(result.sensitivity("tip.y", "length") - expected)
    # Differences of second order for relative changes of 1e-3.
    assert error.max() <= 1e-4 * np.abs(expected).max()
