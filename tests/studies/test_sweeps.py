"""`bd.sweep`: table of responses, swept values, runs, and sweeps with a folder."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from mechanisms import EARTH, clamped_beam, rectangle
from numpy.testing import assert_allclose
from turning import ALPHA, THICK, THIN, run_sweep, turning

import beamdae as bd

# The table ----------------------------------------------------------------------------------------


def test_all_combinations_are_rows_and_failures_have_a_reason(speed_radius_sweep):
    assert list(speed_radius_sweep.table["speed [rad/s]"]) == [4.0] * 3 + [1.0] * 3 + [2.0] * 3
    assert list(speed_radius_sweep.table["radius"]) == [0.5, 0.0, 2.0] * 3
    assert list(speed_radius_sweep.table["status"]) == ["ok", "failed", "ok"] * 3
    assert speed_radius_sweep.table["reason"][1] == "turning: radius must be positive, got 0.0"
    assert speed_radius_sweep.table["tip.x max [m]"][[1, 4, 7]].isna().all()
    assert repr(speed_radius_sweep) == (
        "<SweepResults of turning_sweep over speed, radius: 9 cases, 6 reached the end time>"
    )
    assert "turning_sweep over speed, radius" in speed_radius_sweep._repr_html_()


def test_measures_match_the_exact_motion(speed_radius_sweep):
    completed = speed_radius_sweep.table[speed_radius_sweep.table["status"] == "ok"]
    w, r, t = completed["speed [rad/s]"].to_numpy(), completed["radius"].to_numpy(), 0.4
    # The driven angle is exact to rounding; the mean is computed by trapezoids of 1 ms.
    assert_allclose(completed["tip.x end [m]"], r * np.cos(w * t), atol=1e-9)
    assert_allclose(completed["tip.x max [m]"], r, atol=1e-9)
    assert_allclose(completed["tip.x min [m]"], r * np.cos(w * t), atol=1e-9)
    mean = r**2 * (0.5 + np.sin(2.0 * w * t) / (4.0 * w * t))
    assert_allclose(completed["tip.x RMS [m]"], np.sqrt(mean), rtol=1e-6)
    assert not any(c.startswith("tip.y") for c in speed_radius_sweep.table)


@pytest.mark.slow(reason="half a second and more")
def test_errors_of_the_checked_cases_are_those_of_the_runs():
    """Errors of every 20th case and of the last one are measured."""
    hub_beam = bd.load_model("example:hub_beam")
    swept = bd.sweep(hub_beam, {"elements": [1, 2, 4]}, t_end=1.0, integrator=bd.Radau())
    errors = swept.table["measured error [-]"]
    run = bd.simulate(hub_beam(elements=1), bd.Radau(), t_end=1.0)
    # A sweep has fewer output rows than a run.
    assert_allclose(errors[0], run.errors.largest, rtol=0.02)
    assert np.isnan(errors[1])
    assert errors[2] < 0.1 * errors[0]
    # Those of columns that are not selected do not count.
    total = np.where(run.errors.total > 0.0, run.errors.total, np.inf)
    chosen = run.errors.headers[int(np.argmin(total))]
    alone = bd.sweep(hub_beam, {"elements": [1]}, of=chosen, t_end=1.0, integrator=bd.Radau())
    of_column = run.errors.select([chosen]).largest
    assert of_column < 0.5 * run.errors.largest
    assert_allclose(alone.table["measured error [-]"], of_column, rtol=0.02)


@pytest.mark.slow(reason="a quarter of a second")
def test_outputs_are_columns():
    outputs = {
        "swing [m]": lambda run: np.ptp(run["tip.y"]),
        "far": lambda run: bool(run["tip.x"].iloc[-1] < 0.9),
        "label": lambda run: run.label,
        "nothing": lambda run: None,
    }
    swept = run_sweep({"speed": [1.0, 3.0]}, outputs=outputs, of=())
    assert list(swept.table)[:6] == ["speed [rad/s]", "status", *outputs]
    assert_allclose(swept.table["swing [m]"], np.sin(np.array([0.4, 1.2])), atol=1e-9)
    assert list(swept.table["far"]) == [False, True]
    assert set(swept.table["label"]) == {ALPHA.label}
    assert swept.table["nothing"].isna().all()
    assert {"tip.y_dot max [m/s]", "tip.angle RMS [rad]"} <= set(swept.table)


@pytest.mark.parametrize(
    ("output", "reason"),
    [
        (lambda run: run["tipp"], "the output 'peak' failed: BeamdaeError: "),
        (lambda run: 1 / 0, "the output 'peak' failed: ZeroDivisionError: division by zero"),
        (lambda run: run["tip.x"], "the output 'peak' must be a number, a bool, a string or"),
    ],
)
def test_failed_output_fails_its_row(output, reason):
    table = run_sweep({"speed": [1.0]}, outputs={"peak": output}).table
    assert table["status"][0] == "failed"
    assert table["reason"][0].startswith(reason)
    assert np.isnan(table["peak"][0])


# Values -------------------------------------------------------------------------------------------


@pytest.mark.slow(reason="many small runs")
def test_values_of_any_type_are_swept_and_labeled(tmp_path):
    sections = {"thin": THIN, "thick": THICK}
    swept = run_sweep({"section": sections, "turns": [1, 2], "color": ["red"]})
    assert list(swept.table["section"]) == ["thin", "thin", "thick", "thick"]
    assert swept.table["turns"].dtype == int
    assert swept.sweep.varied == ("section", "turns")
    assert swept.run(section="thick", turns=2).label == "section=thick, turns=2"
    unnamed = run_sweep({"section": [THIN, THICK]})
    assert all(x.startswith("Section #") for x in unnamed.table["section"])
    twice = run_sweep({"speed": [1.0, 1.0]})
    assert twice.run().label == twice.runs[1].label == "speed=1"
    thick = unnamed.run(section=THICK)
    assert thick.parameters["section"] == unnamed.table["section"][1]
    assert thick.to_csv(tmp_path / "thick.csv").with_suffix(".json").exists()


@pytest.mark.slow(reason="many small runs")
def test_listed_combinations_are_completed_by_the_model_defaults():
    swept = run_sweep([{"speed": 2.0}, {"speed": 3.0, "radius": 0.5}])
    assert swept.table[["speed [rad/s]", "radius"]].to_numpy().tolist() == [[2.0, 1.0], [3.0, 0.5]]
    assert run_sweep(bd.grid(speed=[1.0, 2.0])).table["speed [rad/s]"].tolist() == [1.0, 2.0]


@pytest.mark.slow(reason="many small runs")
def test_function_with_defaults_is_a_model():
    def plain(speed=1.0):
        return turning.build(speed)

    swept = bd.sweep(plain, {"speed": np.linspace(1.0, 2.0, 2)}, integrator=ALPHA, t_end=0.1)
    assert swept.sweep.name == "plain_sweep"
    assert list(swept.table["status"]) == ["ok", "ok"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"over": {"sped": [1.0]}},
            "turning: there is no parameter 'sped' .did you mean 'speed'..; avail",
        ),
        ({"over": {"speed": []}}, "turning_sweep: speed must have at least one value, got none."),
        ({"over": {"speed": "1,2"}}, "turning_sweep: speed must be a list of values, or a dict"),
        ({"over": {"speed": 1.0}}, "turning_sweep: speed must be a list of values, or a dict of"),
        ({"over": {"speed": {1.0, 2.0}}}, "turning_sweep: speed must be a list of values, or a"),
        ({"over": {"speed": ["fast"]}}, "turning: speed must be of type float, got 'fast'."),
        ({"over": {"turns": [1.5]}}, "turning: turns must be of type int, got 1.5."),
        ({"over": {}}, "turning_sweep: over must be a dict of values by parameter, or a list of"),
        ({"over": [1.0]}, "turning_sweep: over must be a dict of values by parameter, or a list"),
        ({"of": "tipp"}, "turning_sweep: there is no column 'tipp' .did you mean 'tip"),
        ({"of": 3}, "turning_sweep: columns must be a list of names of observed columns, got"),
        ({"outputs": {"speed": len}}, "turning_sweep: the table already has a column 'speed'; ren"),
        ({"outputs": {"a": 1}}, "turning_sweep: outputs must be a dict of functions of a sol"),
        *(({"outputs": {x: len}}, "turning_sweep: names of outputs must be") for x in (3, " ")),
        ({"outputs": [len]}, "turning_sweep: outputs must be a dict of functions of a solution"),
        ({"integrator": "ida"}, "sweep: integrator must be Ida"),
        ({"time_limit": 0.0}, "sweep: time_limit must be positive, got 0."),
        ({"jobs": 0}, "turning_sweep: jobs must be a whole number of at least 1, got 0."),
        ({"jobs": 10**6}, "turning_sweep: jobs must be at most"),
        ({"folder": 3}, "turning_sweep: folder must be the path of a results folder, got 3."),
        ({"progress": 3}, "turning_sweep: progress must be a function, got 3."),
        ({"progress": lambda: None}, "turning_sweep: progress must be a function that accepts 1 "),
        ({"model": 3}, "sweep: model must be a function that returns a mechanism"),
        ({"model": lambda speed=1.0: 0}, "sweep: <lambda> has no default end time; pass"),
        ({"measure": {}}, "sweep: measure must be a dict of functions of a model by name"),
        ({"measure": np.zeros(2)}, "sweep: measure must be a dict of functions of a model by name"),
        ({"measure": {"x": 3}}, "sweep: measure must be a dict of functions of a model by name, g"),
        ({"measure": {"x": len}, "of": "tip.x"}, "sweep: of is an option of runs"),
        ({"measure": {"x": len}, "t_end": 1.0}, "sweep: t_end is an option of runs"),
        (
            {"measure": {"x": len}, "outputs": {"y": len}},
            "sweep: outputs is an option of runs, but with measure the model is not run; omit",
        ),
        (
            {"over": None, "jobs": 2},
            "sweep: folder, jobs, scheduler, progress and partial are not arguments",
        ),
    ],
)
def test_wrong_arguments_are_rejected(arguments, message):
    call = {"model": turning, "over": {"speed": [1.0]}} | arguments
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.sweep(**call)


# Runs ---------------------------------------------------------------------------------------------


def test_runs_are_looked_up_by_their_parameters(speed_radius_sweep, tmp_path):
    run = speed_radius_sweep.run(speed=2, radius=0.5)
    assert run["tip.x"].iloc[0] == 0.5
    written = pd.read_csv(run.to_csv(tmp_path / "run.csv"))
    pd.testing.assert_frame_equal(written, run.table(), rtol=1e-14)
    parameters = json.loads((tmp_path / "run.json").read_text())["parameters"]
    assert parameters == {"speed": 2.0, "radius": 0.5}
    assert run.label == "speed=2, radius=0.5"
    assert [one.label for one in speed_radius_sweep.runs][:2] == [
        "speed=4, radius=0.5",
        "speed=4, radius=2",
    ]
    assert len(speed_radius_sweep.runs) == 6
    other = speed_radius_sweep.run(speed=2.0, radius=2.0)
    assert_allclose(run.difference(other, "tip.x").iloc[0], -1.5)
    with pytest.raises(bd.BeamdaeError, match=r"3 cases match speed=2.0; also give radius."):
        speed_radius_sweep.run(speed=2.0)
    with pytest.raises(bd.BeamdaeError, match=r"no case has speed=9.0"):
        speed_radius_sweep.run(speed=9.0)
    with pytest.raises(
        bd.BeamdaeError, match=r"no swept parameter 'sped' .did you mean 'speed'..; choose"
    ):
        speed_radius_sweep.run(sped=9.0)
    with pytest.raises(
        bd.BeamdaeError, match=r"radius=0 has no rows: turning: radius must .*, got 0.0.$"
    ):
        speed_radius_sweep.run(speed=2.0, radius=0.0)


def test_failed_runs_give_one_warning():
    with pytest.warns(
        bd.BeamdaeWarning, match="1 of 2 runs did not .* radius=-1: turning: ra"
    ) as caught:
        bd.sweep(turning, {"radius": [1.0, -1.0]}, integrator=ALPHA)
    assert len(caught) == 1
    assert caught[0].filename == __file__


# Decorated sweeps and folders --------------------------------------------------------------------


@bd.sweep(turning, of=["tip.y"], integrator=ALPHA, outputs={"rows": lambda run: len(run.t)})
def speeds():
    return {"speed": [1.0, 2.0, 3.0]}


@pytest.mark.slow(reason="many small runs")
def test_regression_warnings_of_runs_are_reported():
    """A strip bent beyond the validity of its strains used to be "ok" without a warning."""

    def falling(height=0.05):
        rubber = bd.Material(E=5e7, nu=0.3, rho=1000.0)
        section = rectangle(height, damping=1e-2, material=rubber)
        mech, beam = clamped_beam(section, 1, name="strip", gravity=9.81)
        mech.observe("tip", beam.end)
        return mech

    method = bd.GeneralizedAlpha(2e-3)
    with pytest.warns(bd.BeamdaeWarning, match=r"warnings in 1 of 2 cases, .*=0.01: tip"):
        swept = bd.sweep(falling, {"height": [0.1, 0.01]}, integrator=method, t_end=0.4)
    assert list(swept.table["status"]) == ["ok", "ok"]
    assert list(swept.table["warnings"] != "") == [False, True]
    assert "warnings" in swept._repr_html_()
    assert swept.run(height=0.1).warnings == ()
    assert "of strip" in swept.run(height=0.01).warnings[0]


@pytest.mark.slow(reason="many small runs")
def test_decorated_function_is_a_sweep_that_runs_when_called():
    assert isinstance(speeds, bd.results.Sweep)
    assert speeds.name == "speeds"
    assert list(speeds().table["rows"]) == [401.0] * 3


@pytest.mark.slow(reason="a fifth of a second")
def test_interrupted_sweep_resumes(tmp_path):
    done = []

    def stop(report):
        done.append(report.done)
        if report.done == 2:
            raise KeyboardInterrupt

    first = speeds(tmp_path, progress=stop, partial="return")
    assert first.interrupted
    assert list(first.table["status"]) == ["ok", "ok", "interrupted"]
    resumed = []
    second = speeds(tmp_path, progress=lambda report: resumed.append(report.done))
    assert (done, resumed) == ([0, 1, 2], [2, 3])
    assert list(second.table["status"]) == ["ok"] * 3
    table = pd.read_csv(tmp_path / "sweep.csv")
    assert_allclose(table["tip.y max [m]"], np.sin(0.4 * table["speed [rad/s]"]), atol=1e-9)
    assert all((tmp_path / name).is_file() for name in table["trajectory"])


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("stores", [False, True])
def test_exceptions_of_progress_have_the_results_so_far(tmp_path, stores):
    """The table used to be neither returned nor written."""

    def fail(report):
        if report.done == 2:
            raise RuntimeError("no display")

    with pytest.raises(RuntimeError, match=r"^no display$") as caught:
        speeds(tmp_path if stores else None, progress=fail)
    first = caught.value.partial
    assert list(first.table["status"]) == ["ok", "ok", "interrupted"]
    if stores:
        table = pd.read_csv(tmp_path / "sweep.csv")
        assert list(table["status"]) == ["ok", "ok", "interrupted"]


@pytest.mark.slow(reason="many small runs")
def test_changed_output_runs_the_cases_again(tmp_path):
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
swept = bd.sweep(fall, {"mass": [1.0, 2.0, 3.0]}, t_end=1.0, outputs=deep, jobs=2)
print(swept.table["deep"].round(3).tolist())
"""


@pytest.mark.slow(reason="starts worker processes")
def test_script_without_main_guard_runs_in_worker_processes(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    ran = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert ran.stdout.splitlines() == ["[-4.905, -4.905, -4.905]"]
    assert "Traceback" not in ran.stderr


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_parameters_without_effect_have_a_warning():
    """A sweep over a parameter that the model never read ended in silence."""

    @bd.model(t_end=0.1)
    def fall(height=1.0, color=0.0):
        mech = bd.Mechanism(gravity=EARTH)
        mech.observe("ball", mech.add(bd.PointMass("ball", 1.0, at=(0.0, height))).point)
        return mech

    with pytest.warns(bd.BeamdaeWarning, match="are equal for all values of color; the model may"):
        swept = bd.sweep(fall, {"height": [1.0, 2.0], "color": [0.0, 1.0]})
    (text,) = swept.warnings
    assert "color" in text
