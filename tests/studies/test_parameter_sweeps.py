"""`bd.sweep`: a model over values of its parameters, its table and its runs."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from turning import ALPHA, THICK, THIN, run_sweep, turning

import beamdae as bd
from beamdae.studies.sweeps.responses import MEASURES


@pytest.fixture(scope="module")
def found():
    return run_sweep({"speed": [4.0, 1.0, 2.0], "radius": [0.5, 0.0, 2.0]})


# The table ----------------------------------------------------------------------------------------


def test_all_combinations_are_rows_and_failures_tell_their_reason(found):
    assert list(found.table["speed"]) == [4.0] * 3 + [1.0] * 3 + [2.0] * 3
    assert list(found.table["radius"]) == [0.5, 0.0, 2.0] * 3
    assert list(found.table["status"]) == ["ok", "failed", "ok"] * 3
    assert found.table["reason"][1] == "turning: radius must be positive, got 0.0."
    assert found.table["tip.x max [m]"][[1, 4, 7]].isna().all()
    assert repr(found) == (
        "<SweepResults of turning_sweep over speed, radius: 9 cases, 6 reached their end>"
    )
    assert "turning_sweep over speed, radius" in found._repr_html_()


def test_measures_are_those_of_the_motion(found):
    ended = found.table[found.table["status"] == "ok"]
    w, r, t = ended["speed"].to_numpy(), ended["radius"].to_numpy(), 0.4
    # The driver holds the angle to rounding; the mean is one by trapezoids of 1 ms.
    assert_allclose(ended["tip.x end [m]"], r * np.cos(w * t), atol=1e-9)
    assert_allclose(ended["tip.x max [m]"], r, atol=1e-9)
    assert_allclose(ended["tip.x min [m]"], r * np.cos(w * t), atol=1e-9)
    mean = r**2 * (0.5 + np.sin(2.0 * w * t) / (4.0 * w * t))
    assert_allclose(ended["tip.x RMS [m]"], np.sqrt(mean), rtol=1e-6)
    assert not any(c.startswith("tip.y") for c in found.table)


def test_a_root_mean_square_is_one_over_time_and_not_over_rows():
    t, x = np.array([0.0, 1.0, 1.0, 1.0, 3.0]), np.array([1.0, 1.0, 5.0, 1.0, 1.0])
    assert MEASURES["RMS"](t, x) == pytest.approx(1.0)
    assert MEASURES["RMS"](t[:1], -x[:1]) == 1.0


def test_functions_of_a_solution_are_columns_of_their_own():
    outputs = {
        "swing [m]": lambda run: np.ptp(run["tip.y"]),
        "far": lambda run: bool(run["tip.x"].iloc[-1] < 0.9),
        "label": lambda run: run.label,
        "nothing": lambda run: None,
    }
    found = run_sweep({"speed": [1.0, 3.0]}, outputs=outputs, of=())
    assert list(found.table)[:6] == ["speed", "status", *outputs]
    assert_allclose(found.table["swing [m]"], np.sin(np.array([0.4, 1.2])), atol=1e-9)
    assert list(found.table["far"]) == [False, True]
    assert set(found.table["label"]) == {ALPHA.label}
    assert found.table["nothing"].isna().all()
    assert {"tip.y_dot max [m/s]", "tip.angle RMS [rad]"} <= set(found.table)


@pytest.mark.parametrize(
    ("output", "reason"),
    [
        (lambda run: run["tipp"], "the output 'peak' failed, BeamdaeError: "),
        (lambda run: 1 / 0, "the output 'peak' failed, ZeroDivisionError: division by zero."),
        (lambda run: run["tip.x"], "the output 'peak' must be a number, a bool, a string or"),
    ],
)
def test_an_output_that_fails_is_a_failed_row(output, reason):
    table = run_sweep({"speed": [1.0]}, outputs={"peak": output}).table
    assert table["status"][0] == "failed"
    assert table["reason"][0].startswith(reason)
    assert np.isnan(table["peak"][0])


# Values -------------------------------------------------------------------------------------------


@pytest.mark.slow(reason="many small runs")
def test_values_of_any_kind_are_swept_and_told_by_names():
    sections = {"thin": THIN, "thick": THICK}
    found = run_sweep({"section": sections, "turns": [1, 2], "color": ["red"]})
    assert list(found.table["section"]) == ["thin", "thin", "thick", "thick"]
    assert found.table["turns"].dtype == int
    assert found.sweep.varied == ["section", "turns"]
    assert found.run(section="thick", turns=2).label == "section=thick, turns=2"
    unnamed = run_sweep({"section": [THIN, THICK]})
    assert all(x.startswith("Section #") for x in unnamed.table["section"])
    twice = run_sweep({"speed": [1.0, 1.0]})
    assert twice.run().label == twice.runs[1].label == "speed=1"
    assert unnamed.run(section=THICK).parameters["section"] == unnamed.table["section"][1]


@pytest.mark.slow(reason="many small runs")
def test_combinations_may_be_listed_and_what_they_leave_open_is_the_models():
    found = run_sweep([{"speed": 2.0}, {"speed": 3.0, "radius": 0.5}])
    assert found.table[["speed", "radius"]].to_numpy().tolist() == [[2.0, 1.0], [3.0, 0.5]]
    assert run_sweep(bd.grid(speed=[1.0, 2.0])).table["speed"].tolist() == [1.0, 2.0]


@pytest.mark.slow(reason="many small runs")
def test_a_function_with_defaults_is_a_model():
    def plain(speed=1.0):
        return turning.build(speed)

    found = bd.sweep(plain, {"speed": np.linspace(1.0, 2.0, 2)}, integrator=ALPHA, t_end=0.1)
    assert found.sweep.name == "plain_sweep"
    assert list(found.table["status"]) == ["ok", "ok"]


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"over": {"sped": [1.0]}}, "turning: no parameter 'sped' .did you mean 'speed'.., the"),
        ({"over": {"speed": []}}, "turning_sweep: speed must have at least one value, got none."),
        ({"over": {"speed": "1,2"}}, "turning_sweep: speed must be a list of values, or a dict"),
        ({"over": {"speed": 1.0}}, "turning_sweep: speed must be a list of values, or a dict of"),
        ({"over": {"speed": {1.0, 2.0}}}, "turning_sweep: speed must be a list of values, or a"),
        ({"over": {"speed": ["fast"]}}, "turning: speed must be of type float, got 'fast'."),
        ({"over": {"turns": [1.5]}}, "turning: turns must be of type int, got 1.5."),
        ({"over": {}}, "turning_sweep: over must be a dict of values by parameter, or a list of"),
        ({"over": [1.0]}, "turning_sweep: over must be a dict of values by parameter, or a list"),
        ({"of": "tipp"}, "turning_sweep: no observed column 'tipp' .did you mean 'tip"),
        ({"of": 3}, "turning_sweep: columns must be a list of names of observed columns, got"),
        ({"outputs": {"speed": len}}, "turning_sweep: the table already has a column 'speed'; ren"),
        ({"outputs": {"a": 1}}, "turning_sweep: outputs must be a dict of functions of a sol"),
        ({"outputs": [len]}, "turning_sweep: outputs must be a dict of functions of a solution"),
        ({"integrator": "ida"}, "sweep: integrator must be Ida"),
        ({"time_limit": 0.0}, "sweep: time_limit must be positive, got 0."),
        ({"jobs": 0}, "turning_sweep: jobs must be a whole number of at least 1, got 0."),
        ({"jobs": 10**6}, "turning_sweep: jobs must be at most"),
        ({"folder": 3}, "turning_sweep: folder must be the path of a folder of results, got 3."),
        ({"progress": 3}, "turning_sweep: progress must be a function, got 3."),
        ({"model": 3}, "sweep: model must be a function with parameters that builds a mechanism"),
        ({"model": lambda speed=1.0: 0}, "sweep: <lambda> has no default end time; give"),
        (
            {"over": None, "jobs": 2},
            "sweep: folder, jobs, scheduler and progress are not arguments",
        ),
    ],
)
def test_mistakes_are_told_in_a_sentence(given, sentence):
    call = {"model": turning, "over": {"speed": [1.0]}, "integrator": ALPHA} | given
    with pytest.raises(bd.BeamdaeError, match=sentence):
        bd.sweep(**call)


# Runs ---------------------------------------------------------------------------------------------


def test_runs_are_found_by_their_parameters(found):
    run = found.run(speed=2, radius=0.5)
    assert run["tip.x"].iloc[0] == 0.5
    assert run.label == "speed=2, radius=0.5"
    assert [one.label for one in found.runs][:2] == ["speed=4, radius=0.5", "speed=4, radius=2"]
    assert len(found.runs) == 6
    other = found.run(speed=2.0, radius=2.0)
    assert_allclose(run.difference(other, "tip.x").iloc[0], -1.5)
    with pytest.raises(bd.BeamdaeError, match=r"3 cases have speed=2.0; also give radius."):
        found.run(speed=2.0)
    with pytest.raises(bd.BeamdaeError, match=r"no case has speed=9.0"):
        found.run(speed=9.0)
    with pytest.raises(
        bd.BeamdaeError, match=r"no parameter 'sped' .did you mean 'speed'.. is swe"
    ):
        found.run(sped=9.0)
    with pytest.raises(
        bd.BeamdaeError, match=r"radius=0 has no rows, turning: radius must .*, got 0.0.$"
    ):
        found.run(speed=2.0, radius=0.0)


def test_failures_are_warned_of_once():
    with pytest.warns(
        bd.BeamdaeWarning, match="1 of 2 runs did not .* radius=-1: turning: ra"
    ) as x:
        bd.sweep(turning, {"radius": [1.0, -1.0]}, integrator=ALPHA)
    assert len(x) == 1
    assert x[0].filename == __file__


# A decorated sweep, and a folder ------------------------------------------------------------------


@bd.sweep(turning, of=["tip.y"], integrator=ALPHA, outputs={"rows": lambda run: len(run.t)})
def speeds():
    return {"speed": [1.0, 2.0, 3.0]}


@pytest.mark.slow(reason="many small runs")
def test_regression_what_a_run_warns_of_is_told():
    """A strip that bends beyond the reach of its strains was "ok", and that was all."""

    def falling(height=0.05):
        mech = bd.Mechanism(gravity=(0.0, -9.81))
        rubber = bd.Material(E=5e7, nu=0.3, rho=1000.0)
        section = bd.Section.rectangle(rubber, width=0.02, height=height, damping=1e-2)
        line = bd.Line((0.0, 0.0), (1.0, 0.0))
        beam = mech.add(bd.Beam("strip", line, section, elements=1))
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
        mech.observe("tip", beam.end)
        return mech

    with pytest.warns(bd.BeamdaeWarning, match=r"1 of 2 runs have warnings, .* height=0.01: strip"):
        found = bd.sweep(falling, {"height": [0.1, 0.01]}, integrator=ALPHA, t_end=0.4)
    assert list(found.table["status"]) == ["ok", "ok"]
    assert list(found.table["warnings"] != "") == [False, True]
    assert "warnings" in found._repr_html_()
    assert found.run(height=0.1).warnings == ()
    assert "strip" in found.run(height=0.01).warnings[0]


@pytest.mark.slow(reason="many small runs")
def test_a_decorated_function_is_a_sweep_that_runs_when_it_is_called():
    assert isinstance(speeds, bd.Sweep)
    assert speeds.name == "speeds"
    assert list(speeds().table["rows"]) == [401.0] * 3


def test_an_interrupted_sweep_goes_on_where_it_stopped(tmp_path):
    done = []

    def stop(standing):
        done.append(standing.done)
        if standing.done == 2:
            raise KeyboardInterrupt

    first = speeds(tmp_path, progress=stop)
    assert first.interrupted
    assert list(first.table["status"]) == ["ok", "ok", "interrupted"]
    again = []
    second = speeds(tmp_path, progress=lambda standing: again.append(standing.done))
    assert (done, again) == ([0, 1, 2], [2, 3])
    assert list(second.table["status"]) == ["ok"] * 3
    table = pd.read_csv(tmp_path / "sweep.csv")
    assert_allclose(table["tip.y max [m]"], np.sin(0.4 * table["speed"]), atol=1e-9)
    assert all((tmp_path / name).is_file() for name in table["trajectory"])


@pytest.mark.slow(reason="many small runs")
def test_another_output_is_another_result(tmp_path):
    speeds(tmp_path)
    other = replace(speeds, outputs={"rows": lambda run: -len(run.t)})
    assert list(other(tmp_path).table["rows"]) == [-401.0] * 3


SCRIPT = """
import beamdae as bd

def fall(mass=1.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mech.observe("ball", mech.add(bd.PointMass("ball", mass, at=(0.0, 0.0))).point)
    return mech

deep = {"deep": lambda run: run["ball.y"].min()}
found = bd.sweep(fall, {"mass": [1.0, 2.0, 3.0]}, t_end=1.0, outputs=deep, jobs=2)
print(found.table["deep"].round(3).tolist())
"""


@pytest.mark.slow(reason="processes of their own")
def test_a_script_needs_no_guard_to_run_in_processes(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    ran = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert ran.stdout.splitlines() == ["[-4.905, -4.905, -4.905]"]
    assert "Traceback" not in ran.stderr
