"""Studies: execution, case tables, failures, resumption and definitions."""

import sys
from dataclasses import dataclass, replace

import mechanisms
import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from study_models import singular_torque
from study_runs import LocalPool, ModelFile, SerialPool, run_study, summarize_cases

import beamdae as bd

ALPHA = bd.GeneralizedAlpha(step=2e-3)
REFERENCES = (bd.Ida(rtol=1e-7), bd.GeneralizedAlpha(step=5e-4, newton_tolerance=1e-10))
# For tests that do not check errors.
COARSE = (bd.Ida(rtol=1e-5), bd.GeneralizedAlpha(step=5e-3, newton_tolerance=1e-10))

swing = bd.model(t_end=0.4)(mechanisms.swing)


@bd.model(t_end=0.1)
def zero_division(mass=0.0):
    return 1.0 / mass


def create_study(cases, references=COARSE, **settings):
    return bd.results.Study("made", tuple(cases), references=references, **settings)


def run(study, folder, executor=None, progress=None):
    return run_study(study, folder, executor or SerialPool(), progress)


STEPS = (0.02, 0.01, 0.005)
SWINGS = [
    bd.Case(swing, {"mass": mass}, bd.GeneralizedAlpha(step=h))
    for mass in (1.0, 3.0)
    for h in STEPS
]


@pytest.fixture(scope="module")
def swings(tmp_path_factory):
    return run(create_study(SWINGS, REFERENCES), tmp_path_factory.mktemp("swings"))


# Executors ------------------------------------------------------------------------------------

TIME_AND_MEMORY_COLUMNS = [
    "wall time [s]",
    "setup time [s]",
    "measuring time [s]",
]


@pytest.mark.slow(reason="starts processes for a whole study")
def test_processes_and_serial_runs_give_the_same_table(tmp_path):
    study = create_study(
        [*SWINGS[:2], bd.Case(singular_torque, {}, ALPHA), bd.Case(zero_division, {}, ALPHA)]
    )
    executors = {"serial": SerialPool(), "processes": LocalPool(2)}
    results = [run(study, tmp_path / name, pool) for name, pool in executors.items()]
    serial, parallel = (x.table.drop(columns=TIME_AND_MEMORY_COLUMNS) for x in results)
    assert list(serial["status"][:2]) == ["ok", "ok"]
    assert serial["reason"][2].startswith("stopped at t = 0.2 s")
    assert "ZeroDivisionError" in serial["reason"][3]
    pd.testing.assert_frame_equal(parallel, serial)


# Tables ---------------------------------------------------------------------------------------


def test_each_case_is_a_row_in_order(swings):
    table = pd.read_csv(swings.folder / "cases.csv")
    assert list(table["label"]) == [case.label for case in SWINGS]
    assert list(table["mass"]) == [1.0, 1.0, 1.0, 3.0, 3.0, 3.0]
    assert set(table["status"]) == {"ok"}
    assert list(table["group"].unique()) == ["swing(mass=1.0)", "swing(mass=3.0)"]
    for column in ("wall time [s]", "setup time [s]", "steps", "residual calls", "solves"):
        assert (table[column] > 0).all()
    # Rounding.
    assert (table["max position drift"] < 1e-9).all()


def test_errors_are_relative_to_a_reference_of_two_methods(swings):
    for group, reference in swings.references.items():
        assert reference.methods == (
            "Ida(rtol=1e-07)",
            "GeneralizedAlpha(step=0.00025, newton_tolerance=1e-10), extrapolated",
        )
        rows = swings.table[swings.table["group"] == group]
        errors = rows["error [-]"].to_numpy()
        # Order 2, and above the resolution of the reference.
        assert_allclose(np.log2(errors[:-1] / errors[1:]), 2.0, atol=0.1)
        assert errors.min() > reference.resolution
        assert (rows["reference uncertainty [-]"] == reference.uncertainty).all()


@pytest.mark.slow(reason="half a second")
def test_unresolved_errors_are_bounds(tmp_path):
    """Plots showed them as errors."""
    cases = [bd.Case(swing, {}, method) for method in (bd.GeneralizedAlpha(0.02), bd.Radau(1e-9))]
    results = run(create_study(cases, REFERENCES), tmp_path)
    (reference,) = results.references.values()
    table = pd.read_csv(results.folder / "cases.csv")
    assert table["below resolution"].dtype == bool
    assert ",TRUE," in (results.folder / "cases.csv").read_text()
    assert list(table["below resolution"]) == [False, True]
    assert table["error bound [-]"][0] == table["error [-]"][0]
    assert np.isnan(table["error [-]"][1])
    assert_allclose(table["error bound [-]"][1], 10.0 * reference.uncertainty)
    assert table["error of end.x, max [m]"].isna().tolist() == [False, True]


@bd.model(t_end=0.4)
def springs():
    """Two masses; coarse fixed steps do not resolve the vibration of the fast one."""
    mech = bd.Mechanism()
    for name, stiffness in (("slow", 1e2), ("fast", 1e6)):
        mass = mech.add(bd.PointMass(name, 1.0, at=(1.0, 0.0), velocity=(0.1, 0.0)))
        mech.add(bd.Spring(f"{name} spring", mech.ground.at(0.0, 0.0), mass.point, stiffness))
        mech.observe(name, mass.point)
    return mech


@pytest.mark.slow(reason="one second")
def test_regression_columns_without_reference_do_not_hide_the_errors_of_others(tmp_path):
    """One column whose references differed left all columns without errors, and was not named."""
    cases = [bd.Case(springs, {}, bd.GeneralizedAlpha(step=h)) for h in (0.02, 0.01)]
    results = run(create_study(cases), tmp_path / "both")
    (reference,) = results.references.values()
    assert reference.columns == ("slow.x [m]",)
    assert " of the amplitude of slow.x, so errors below 10 times this are" in reference.sentence
    assert "no errors of columns that differ by more (fast.x [m] by " in reference.sentence
    assert results.table["error of slow.x, max [m]"].notna().all()
    hidden = run(create_study(cases, columns=("fast.x",)), tmp_path / "fast")
    (reference,) = hidden.references.values()
    assert reference.table is None
    assert "0.01 of the amplitude in all columns (fast.x [m] by " in reference.sentence


def test_the_summary_has_orders(swings):
    summary = pd.read_csv(swings.folder / "summary.csv")
    orders = summary[summary["what"] == "order in step"]
    assert_allclose(orders["value"], 2.0, atol=0.1)


def test_orders_are_slopes_of_errors_over_steps():
    rows = []
    for series, steps, order in (("coarse", (0.1, 0.01, 0.001), 1), ("fine", (0.5, 0.1, 0.03), 3)):
        for h in steps:
            row = {"group": "g", "status": "ok", "series": series, "label": f"{series}(step={h:g})"}
            row |= {"step [s]": h, "rtol": np.nan, "below resolution": False}
            row |= {"error [-]": h**order, "error bound [-]": h**order, "wall time [s]": 1e-4 / h}
            rows.append(row)
    summary = summarize_cases(pd.DataFrame(rows)).set_index("what")
    assert_allclose(summary.loc["order in step", "value"].astype(float), [1.0, 3.0], atol=1e-6)


@pytest.mark.slow(reason="half a second and more")
def test_mesh_studies_have_errors_in_space_only(tmp_path):
    from hub_beam import hub_beam

    cases = [
        bd.Case(hub_beam, {"elements": n}, bd.GeneralizedAlpha(step=0.01, newton_tolerance=1e-9))
        for n in (1, 2, 4, 8, 12)
    ]
    columns = ("deformation.u [m]", "deformation.v [m]")
    results = run(
        bd.results.Study("mesh", tuple(cases), columns=columns, over="elements"), tmp_path
    )
    assert len(results.references) == 1
    (reference,) = results.references.values()
    assert reference.methods == ("elements=12", "elements=8")
    orders = results.summary["value"].to_numpy(float)
    # The observed order is five and more.
    assert orders[-1] > 4.0
    assert (results.folder / "summary.csv").is_file()


# Failures -------------------------------------------------------------------------------------


@pytest.mark.slow(reason="half a second")
def test_failures_are_rows_with_a_reason(tmp_path):
    cases = [
        bd.Case(swing, {}, ALPHA),
        bd.Case(singular_torque, {"limit": 0.2}, ALPHA),
        bd.Case(swing, {}, bd.Ida(1e-9, formulation="index3", error_control="all", max_steps=300)),
        bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-6, time_limit=0.01)),
    ]
    results = run(create_study(cases), tmp_path)
    assert results.table["status"][0] == "ok"
    assert list(results.table["status"][1:]) == ["failed", "failed", "limited"]
    sentences = list(results.table["reason"][1:])
    assert sentences[0].startswith("stopped at t = 0.2 s: the residual is not finite")
    assert "stopped at" in sentences[1]
    assert sentences[2].endswith("reached the time limit of 0.01 s")
    assert results.table["reached [s]"][1] == pytest.approx(0.2)
    # Its reference fails as well.
    assert "no reference" in results.references["singular_torque(limit=0.2)"].sentence
    assert np.isnan(results.table["error [-]"][1])
    assert results.failed


# Resumption -------------------------------------------------------------------------------


def test_fingerprints_depend_on_model_parameters_integrator_and_times():
    case = SWINGS[0]
    base = case.fingerprint(0.4, 0.001)
    assert base == bd.Case(swing, {"mass": 1.0}, bd.GeneralizedAlpha(step=0.02)).fingerprint(
        0.4, 0.001
    )

    @dataclass(frozen=True)
    class SameName(bd.Ida):
        pass

    SameName.__name__ = "GeneralizedAlpha"
    others = [
        replace(case, integrator=SameName()).fingerprint(0.4, 0.001),
        replace(case, parameters={"mass": 1.5}).fingerprint(0.4, 0.001),
        replace(case, integrator=ALPHA).fingerprint(0.4, 0.001),
        replace(case, model=singular_torque, parameters={}).fingerprint(0.4, 0.001),
        case.fingerprint(0.3, 0.001),
        case.fingerprint(0.4, 0.002),
    ]
    assert len({base, *others}) == 7


STUDY_FILE = """
import beamdae as bd
from local_numbers import MASS
from local_parts import create_ball

@bd.model(t_end=0.01)
def falling():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(create_ball("ball", MASS))
    mech.observe("ball", ball.point)
    return mech

@bd.study(references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3)))
def falls():
    return [bd.Case(falling, {}, bd.Ida(rtol=1e-4))]
"""
PARTS_MODULE = """
from functools import cache, cached_property
import beamdae as bd

@cache
def heavier(mass):
    return 1.0 * mass

class Ball(bd.PointMass):
    @cached_property
    def twice(self):
        return 2.0 * self.mass

def create_ball(name, mass):
    return Ball(name, heavier(mass), at=(0.0, 0.0))
"""


def write_study(folder, mass=1.0, parts=PARTS_MODULE):
    folder.mkdir(exist_ok=True)
    (folder / "falls.py").write_text(STUDY_FILE)
    (folder / "local_numbers.py").write_text(f"MASS = {mass}\n")
    (folder / "local_parts.py").write_text(parts)
    studies = ModelFile(folder / "falls.py").studies
    return studies["falls"]


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "executor",
    [
        pytest.param(SerialPool(), id="serial"),
        pytest.param(LocalPool(1), id="process", marks=pytest.mark.slow(reason="starts a process")),
    ],
)
def test_regression_modules_next_to_a_study_are_sent_to_its_processes(tmp_path, executor):
    """Their classes may contain locks, as cached properties of CPython 3.11 do."""
    results = run(write_study(tmp_path / "a", mass=3.0), tmp_path / "out", executor)
    assert list(results.table["status"]) == ["ok"]
    assert "local_numbers" not in sys.modules
    # Another study may have modules of the same names.
    other = write_study(tmp_path / "b", mass=5.0).cases[0].model()
    assert other.part("ball").mass == 5.0


@pytest.mark.slow(reason="half a second")
def test_failures_under_other_limits_are_repeated(tmp_path):
    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=5e-4))]
    first = run(create_study(cases, time_limit=1e-3), tmp_path)
    assert first.table["reason"][0].endswith("reached the time limit of 0.001 s")
    second = run(create_study(cases, time_limit=60.0), tmp_path)
    assert list(second.table["status"]) == ["ok"]


def create_model(gravity):
    @bd.model(t_end=0.1)
    def falling(mass=1.0):
        mech = bd.Mechanism(gravity=(0.0, -gravity))
        mech.add(bd.PointMass("stone", mass, at=(0.0, 0.0)))
        return mech

    return falling


def test_different_models_of_the_same_name_are_refused():
    with pytest.raises(bd.BeamdaeError, match="two different models have the name 'falling'"):
        create_study(
            [bd.Case(create_model(1.0), {}, ALPHA), bd.Case(create_model(10.0), {}, ALPHA)]
        )


@pytest.mark.slow(reason="a fifth of a second")
def test_a_case_that_is_also_a_reference_runs_once_and_has_frames(tmp_path):
    results = run(create_study([bd.Case(swing, {}, COARSE[0])]), tmp_path)
    assert len(results.outcomes) == 3
    assert list(results.frames)


@pytest.mark.slow(reason="half a second and more")
def test_repetitions_give_the_median_wall_time_and_its_extremes(tmp_path):
    results = run(create_study(SWINGS[:1], repetitions=3), tmp_path)
    (line,) = results.table.to_dict("records")
    assert 0.0 < line["wall time min [s]"] <= line["wall time [s]"] <= line["wall time max [s]"]
    assert "wall time min [s]" not in run(create_study(SWINGS[:1]), tmp_path / "once").table


def test_parameters_with_names_of_columns_are_renamed():
    @bd.model(t_end=0.1)
    def colliding(steps=3, shape=(1, 2)):
        return swing()

    (row,) = bd.compare([bd.Case(colliding, {"steps": 5, "shape": (3, 4)}, ALPHA)]).to_dict(
        "records"
    )
    assert (row["parameter steps"], row["steps"]) == (5, 50)
    assert row["shape"] == "(3, 4)"


# Definitions ----------------------------------------------------------------------------------


def test_a_study_is_a_decorated_function():
    @bd.study(t_end=0.1, time_limit=5.0, columns=["end.x [m]"])
    def two():
        return SWINGS[:2]

    assert two.name == "two"
    assert two.cases == tuple(SWINGS[:2])
    assert two.columns == ("end.x [m]",)
    assert two.task(SWINGS[0]).time_limit == 5.0
    assert two.task(SWINGS[0], reference=True).time_limit == 50.0
    assert two.task(SWINGS[0]).t_end == 0.1


def test_unknown_columns_are_refused_after_the_first_run(tmp_path):
    with pytest.raises(bd.BeamdaeError, match=r"made: there is no column 'end.z \[m\]'.*did you"):
        run(create_study(SWINGS[:1], columns=("end.z [m]",)), tmp_path)
    assert not (tmp_path / "outcomes").exists()
