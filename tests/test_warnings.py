"""Warnings that differ only in numbers are shown once per line."""

import re
import subprocess
import sys
import warnings

import numpy as np
import pytest
from mechanisms import EARTH, cantilever, clamped_beam, free_ball, rectangle, truss

import beamdae as bd
from beamdae.errors import (
    InputWarning,
    record_messages,
    warn_user,
)
from beamdae.model_checks import run_checks


def shown(action, messages, times=1):
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter(action)
        for message in times * messages:
            warn_user(message)
    return [str(x.message) for x in records]


def test_one_warning_of_a_kind_is_shown():
    runs = [f"arm: stopped at t = {t:g} s of 1e-3 s." for t in (0.25, -1e-9, 3e300, float("nan"))]
    assert shown("default", runs) == runs[:1]
    # New filters show it again, as in Python; all or no warnings are shown if filters say so.
    assert shown("default", runs) == runs[:1]
    assert shown("always", runs, 2) == 2 * runs
    assert shown("ignore", runs) == []
    names = ["leaf 1: bent by 2 rad.", "leaf 2: bent by 3 rad.", "leaf 1: bent by 4 m."]
    assert shown("default", names, 2) == names
    with pytest.raises(bd.BeamdaeWarning, match=r"0\.25 s"):
        shown("error", runs)


def test_regression_a_loop_over_models_warns_once_of_each_kind():
    steel = bd.Material.of("steel")
    strip = bd.Section.rectangle(steel, width=0.02, height=0.01)
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter("default")
        for length in (1.0, 1.1, 1.2):
            arc = bd.Arc(radius=0.03, length=0.1 * length, start=(0.0, 0.0), angle=0.0)
            bd.Beam("beam", arc, strip, elements=4)
            with warnings.catch_warnings():  # such as those of laws and curves
                warnings.simplefilter("ignore")
    assert [str(x.message)[:38] for x in records] == ["beam: the section height is 0.33 times"]
    assert records[0].filename == __file__


@pytest.mark.parametrize(
    ("filters", "is_checked"),
    [
        ([], True),
        ([("ignore", "", Warning)], False),
        ([("default", "", bd.BeamdaeWarning), ("ignore", "", UserWarning)], False),
        ([("ignore", "", bd.BeamdaeWarning), ("always", "", InputWarning)], True),
        ([("ignore", "", bd.BeamdaeWarning), ("always", "", DeprecationWarning)], False),
        ([("ignore", "", bd.BeamdaeWarning), ("error", "the run was not", Warning)], True),
        ([("default", "", Warning), ("ignore", "mass: ", bd.BeamdaeWarning)], True),
        ([("default", "", Warning), ("ignore", "", InputWarning)], True),
    ],
)
def test_runs_are_checked_unless_all_warnings_are_ignored(monkeypatch, filters, is_checked):
    checked = []
    check = {lambda run: checked.append(run) or ["mass: off."]}
    monkeypatch.setattr(run_checks, "RUN_CHECKS", check)
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("default")
        for action, message, category in filters:
            warnings.filterwarnings(action, message, category)
        run = bd.simulate(truss(), bd.Radau(), t_end=0.1)
        assert len(checked) == is_checked
        assert run.warnings == ("mass: off.",)
        assert len(checked) == 1
        # Recorded messages are part of a result.
        with record_messages() as messages:
            bd.simulate(truss(), bd.Radau(), t_end=0.1)
        assert "mass: off." in messages


def _stopped_run(number):
    return bd.simulate(truss(), bd.Radau(max_steps=5 + number // 2), t_end=10.0)


def _short_path(number):
    return bd.equilibrium(truss(), to=1.0 + number // 2, max_points=2)


@pytest.mark.parametrize("analyze", [_stopped_run, _short_path])
def test_regression_each_unfinished_result_is_announced(analyze):
    """Of results at one line that were not finished, only the first was announced."""
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter("default")
        results = [analyze(number) for number in range(4)]
    messages = [str(x.message) for x in records]
    reasons = [x.status.sentence for x in results]
    assert not any(x.status.success for x in results)
    assert len(set(reasons)) == 2  # two of four results are alike
    assert [sum(reason in x for x in messages) for reason in reasons] == [2, 2, 2, 2]


def test_regression_numbers_of_names_distinguish_parts():
    messages = ["run: error of x1 is 3 %.", "run: error of x2 is 900 %.", "run: link1 is bad."]
    assert shown("default", messages) == messages


def test_regression_warnings_are_shown_again_in_a_new_run_of_a_cell():
    """Notebooks clear the registry of shown warnings before they run a cell."""
    program = """
import warnings
warnings.simplefilter("default")
from beamdae.errors import warn_of_result, warn_user
for t in (1.0, 2.0):
    globals().pop("__warningregistry__", None)
    for k in (1, 2):
        warn_user(f"arm: stopped at t = {t * k:g} s.")
"""
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert re.findall(r"at t = (\d)", run.stderr) == ["1", "2"]


@bd.model(t_end=0.05)
def _mass_with_steep_table(stiffness=100.0):
    steps = bd.table([0.0, 1.0, 1.1, 2.0, 3.0], [0.0, 0.0, 1.0, 1.0, 1.0], "spline", name="stop")
    mech, mass = free_ball((1.0, 0.0), name="mass", spring=(stiffness, 1.0, 0.9))
    mech.add(bd.Force("push", mass.point, (float(steps(1.5)), 0.0)))
    return mech


def _fit_stiffness():
    times = [0.0, 0.01, 0.02, 0.03, 0.04, 0.05]
    data = {"t [s]": times, "mass.x [m]": [1.0 + 4.0 * t * t for t in times]}
    bd.fit(_mass_with_steep_table, data, "stiffness", max_evaluations=1)


def _optimize_stiffness():
    limit = bd.quantities.at_most(bd.quantities.EndValue("mass.x"), "2000 mm")
    bounds = {"stiffness": (50.0, 200.0)}
    objective = bd.quantities.EndValue("mass.x")
    bd.optimize(_mass_with_steep_table, objective, "stiffness", limit, bounds, max_evaluations=2)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("search", [_fit_stiffness, _optimize_stiffness])
def test_regression_searches_show_warnings_of_the_model_function_once(search):
    """The warning of the first model was repeated with the result."""
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter("always")
        search()
    messages = [str(x.message) for x in records]
    assert sum(x.startswith("stop: the spline reaches") for x in messages) == 1, messages


UPRIGHT = bd.Line((0.0, 0.0), (0.0, 1.0))


def _bend_column():
    return bd.buckling(cantilever(2, UPRIGHT, rectangle(), (0.05, -1.0)), n=1)


def _rotate_rubber():
    rubber = bd.Section.rectangle(bd.Material(1e6, 0.45, 1000.0), width=0.02, height=0.02)
    mech, _ = clamped_beam(rubber, 4, bd.Line((0.1, 0.0), (0.6, 0.0)), name="blade", strain="green")
    return bd.campbell(mech, [0.0, 30.0, 40.0], n=2)


def _swing():
    mech = cantilever(2, UPRIGHT, rectangle(), (bd.sine(6.0, frequency=0.5), 0.0))
    mech.add(bd.RayleighDamping("damping", mech.part("beam"), mass=50.0))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    ("analyze", "text"),
    [
        (_bend_column, "displacements before buckling are not negligible"),
        (_rotate_rubber, "at 40 rad/s, frequency "),
        pytest.param(
            lambda: bd.periodic(_swing(), 2.0, bd.Radau(1e-3), settle=0),
            "errors: not ",
            marks=pytest.mark.slow(reason="half a second and more"),
        ),
    ],
    ids=["buckling", "campbell", "periodic"],
)
def test_regression_analyses_issue_the_warnings_of_their_results(analyze, text):
    """`buckling`, `campbell` and `periodic` listed them in their results in silence."""
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter("always")
        result = analyze()
    messages = [str(x.message) for x in records if x.category is bd.BeamdaeWarning]
    assert any(text in x for x in messages)
    assert set(messages) <= set(result.warnings)
    assert len(messages) == len(set(messages))


def issued(mech, t_end):
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter("always")
        solution = bd.simulate(mech, t_end=t_end)
    return [str(x.message) for x in records], solution


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_searches_of_equilibria_in_checks_issue_no_warnings():
    """A strip that fell on a floor at 1.4 m/s was said not to use its velocity."""
    mech = bd.Mechanism(gravity=EARTH)
    aluminium = bd.Material(E=70e9, nu=0.33, rho=2700.0)
    section = bd.Section.rectangle(aluminium, 0.02, 0.01, damping=2e-5)
    line = bd.Line((-0.1, 0.0), (0.1, 0.0))
    strip = mech.add(bd.Beam("strip", line, section, elements=2, velocity=(0.0, -1.4)))
    mech.add(bd.PointMass("mass", 0.3, on=strip.at(0.1)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0), direction=(1.0, 0.0))
    for name, end in (("left", strip.start), ("right", strip.end)):
        foot = bd.Contact(name, end, floor, 2e6, restitution=0.7, impact_speed=1.4)
        mech.observe(name, mech.add(foot).force)
    mech.observe("section", strip.section_forces(0.08))
    messages, solution = issued(mech, 0.03)
    assert not [x for x in messages if "is not used" in x]
    assert set(messages) == set(solution.warnings)


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_finer_meshes_of_checks_issue_no_warnings():
    """Each of two meshes for the error of fast loads repeated the warning of the damping."""
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 0.02, damping=0.01)
    mech, rod = clamped_beam(section, 1, 2.0, name="rod")
    pulse = bd.piecewise((1e-4, lambda t: 1e3 * np.sin(1e4 * np.pi * t) ** 2), 0.0)
    mech.add(bd.Force("push", rod.end, (pulse, 0.0)))
    mech.observe("tip", rod.end)
    messages, _ = issued(mech, 1e-3)
    assert sum("`damping` is a time" in x for x in messages) == 1


def test_regression_alike_beams_have_one_warning_of_the_model():
    """Each of several leaves had the same sentence. Those of other kinds remain."""
    mech, steel = bd.Mechanism(), bd.Material.of("steel")
    for k, height in enumerate((0.4e-3, 0.42e-3, 0.41e-3)):
        section = bd.Section.rectangle(steel, width=0.02, height=height, damping=0.02)
        line = bd.Line((0.1 * k, 0.0), (0.1 * k, 0.05))
        leaf = mech.add(bd.Beam(f"leaf {k}", line, section, elements=1))
        mech.add(bd.Weld(f"clamp {k}", mech.ground.at(0.1 * k, 0.0), leaf.start))
    with pytest.warns(bd.BeamdaeWarning) as caught:
        equations = bd.equations_of_motion(mech)
    (sentence,) = equations.build_warnings
    assert [str(x.message) for x in caught] == [sentence]
    assert sentence.startswith("leaf 0 (also leaf 1, leaf 2): `damping` is a time [s]; 0.02 s")
