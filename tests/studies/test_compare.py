"""Comparison of cases: rows of the table, error columns, labels and failures."""

import warnings

import casadi as ca
import numpy as np
import pandas as pd
import pytest

import beamdae as bd
from beamdae.results.columns import observed_columns
from beamdae.studies import deviations, run_values
from beamdae.studies.case import default_integrators
from beamdae.studies.execution.case_run import run_task
from beamdae.studies.tasks import Task

ALPHA = bd.GeneralizedAlpha(step=2e-3)


@bd.model(t_end=0.4)
def swing(mass=2.0, tilt=0.0, torque=0.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, tilt)))
    hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, tilt), bob.at(0.0, tilt)))
    mech.add(bd.Moment("torque", on=bob.at(1.0, tilt), law=torque))
    mech.observe("end", bob.at(2.0, tilt))
    mech.observe("pin", bob.at(0.0, tilt))
    mech.observe("hinge", hinge.reaction)
    return mech


@bd.model(t_end=0.4)
def singular_torque(limit=0.2):
    """Its moment becomes complex at t = limit."""
    mech = bd.Mechanism()
    bob = mech.add(bd.RigidBody("bob", 2.0, inertia=0.1))
    mech.add(bd.Moment("torque", on=bob.at(0.0, 0.0), law=lambda t: (limit - t) ** 1.5))
    mech.observe("bob", bob.at(0.0, 0.0))
    return mech


@bd.model(t_end=0.4)
def redundant():
    mech = swing()
    mech.add(bd.Revolute("second hinge", mech.ground.at(0.0, 0.0), mech.part("bob").at(0.0, 0.0)))
    return mech


@bd.model(t_end=0.02)
def bending():
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material(E=7e10, nu=0.3, rho=2700.0), 0.02, 0.005)
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements=2))
    mech.add(bd.Moment("torque", on=beam.end, law=100.0))
    mech.observe("tip", beam.end)
    return mech


@pytest.fixture(scope="module")
def fine():
    return bd.simulate(swing, bd.GeneralizedAlpha(step=2.5e-4))


def test_grid_returns_all_combinations_in_order():
    assert bd.grid(a=[1, 2], b=["x", "y"]) == [
        {"a": 1, "b": "x"},
        {"a": 1, "b": "y"},
        {"a": 2, "b": "x"},
        {"a": 2, "b": "y"},
    ]
    assert bd.grid() == [{}]


@pytest.mark.parametrize("values", [8, "linear"])
def test_grid_requires_lists(values):
    with pytest.raises(bd.BeamdaeError, match=f"elements must be a list of values, got {values!r}"):
        bd.grid(elements=values)


def test_each_case_has_a_row_with_its_parameters():
    cases = [bd.Case(swing, p, ALPHA) for p in bd.grid(mass=[1.0, 3.0], tilt=[0.5])]
    table = bd.compare(cases, t_end=0.1, output_step=0.01)
    assert list(table["model"]) == ["swing", "swing"]
    assert list(table["mass"]) == [1.0, 3.0]
    assert list(table["tilt"]) == [0.5, 0.5]
    assert list(table["label"]) == ["GeneralizedAlpha(step=0.002)"] * 2
    assert list(table["integrator"]) == ["GeneralizedAlpha"] * 2
    assert list(table["status"]) == ["ok", "ok"]
    assert list(table["reached [s]"]) == [0.1, 0.1]
    assert list(table["steps"]) == [50, 50]
    assert (table["wall time [s]"] > 0.0).all()
    assert "error [-]" not in table


def test_rows_contain_the_summary_of_the_solution():
    case = bd.Case(swing, {}, ALPHA)
    (row,) = bd.compare([case]).to_dict("records")
    summary = case.solve().summary()
    for column, name in (run_values.COUNT_COLUMNS | run_values.MEASURE_COLUMNS).items():
        assert pd.notna(row[column])
        if "time" not in column:
            assert row[column] == summary[name]


def test_parameters_reach_the_model_and_the_solution():
    solution = bd.Case(swing, {"mass": 7}, ALPHA).solve(t_end=0.01)
    assert solution.model["parameters"]["mass"] == 7.0
    assert swing.parameters["mass"] == 2.0
    with pytest.raises(bd.BeamdaeError, match="no parameter 'mas'"):
        bd.Case(swing, {"mas": 7}, ALPHA).solve()


@pytest.mark.parametrize(
    ("integrator", "label"),
    [
        (bd.Ida(rtol=1e-4), "Ida(rtol=0.0001)"),
        (bd.Ida(rtol=1e-4, formulation="ggl"), "Ida(rtol=0.0001, formulation=ggl)"),
        (
            bd.GeneralizedAlpha(step=0.01, rho_inf=0.5),
            "GeneralizedAlpha(step=0.01, rho_inf=0.5)",
        ),
    ],
)
def test_labels_name_settings_that_differ_from_the_defaults(integrator, label):
    assert bd.Case(swing, {}, integrator).label == label


def test_error_is_the_largest_deviation_relative_to_the_amplitude(fine):
    coarse = bd.Case(swing, {}, bd.GeneralizedAlpha(step=0.02)).solve()
    columns = ["end.x [m]", "end.y [m]", "end.angle [rad]", "pin.angle [rad]"]
    exact = fine.observed[columns].to_numpy()
    difference = np.abs(coarse.observed[columns].to_numpy() - exact).max(axis=0)
    expected = np.max(2.0 * difference / (exact.max(axis=0) - exact.min(axis=0)))
    (error,) = bd.compare([bd.Case(swing, {}, bd.GeneralizedAlpha(step=0.02))], fine)["error [-]"]
    assert error == pytest.approx(expected, rel=1e-12)
    assert error > 1e-5


def test_constant_columns_and_rates_and_forces_are_left_out(fine):
    assert deviations.select_error_columns(fine.observed) == [
        "end.x [m]",
        "end.y [m]",
        "end.angle [rad]",
        "pin.angle [rad]",
    ]
    assert deviations.select_error_columns(fine.observed, ["hinge.Fx [N]"]) == ["hinge.Fx [N]"]


def test_columns_without_positions_are_all_compared():
    frame = pd.DataFrame({"q0 [-]": [0.0, 1.0], "q1 [-]": [0.0, 2.0], "q2 [-]": [0.0, 0.0]})
    assert deviations.select_error_columns(frame) == ["q0 [-]", "q1 [-]"]


def test_given_columns_must_exist_and_move(fine):
    with pytest.raises(bd.BeamdaeError, match=r"'end.z \[m\]'.*did you mean 'end.y \[m\]'"):
        deviations.select_error_columns(fine.observed, ["end.z [m]"])
    constant = pd.DataFrame({"end.x [m]": [1.0, 1.0]})
    with pytest.raises(bd.BeamdaeError, match=r"the reference is constant in end.x \[m\]"):
        deviations.select_error_columns(constant)
    with pytest.raises(bd.BeamdaeError, match="observes nothing to compare"):
        deviations.select_error_columns(pd.DataFrame(index=[0, 1]))


def test_errors_by_column_are_at_the_end_the_maximum_and_the_root_mean_square(fine):
    coarse = bd.Case(swing, {}, bd.GeneralizedAlpha(step=0.02))
    exact = fine.observed["end.x [m]"].to_numpy()
    error = np.abs(coarse.solve().observed["end.x [m]"].to_numpy() - exact)
    (row,) = bd.compare([coarse], fine).to_dict("records")
    assert row["error of end.x, end [m]"] == pytest.approx(error[-1])
    assert row["error of end.x, max [m]"] == pytest.approx(error.max())
    assert row["error of end.x, rms [m]"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert row["reaction error [-]"] > 0.0


def test_references_are_interpolated_at_the_output_times_of_a_case(fine):
    case = bd.Case(swing, {}, bd.GeneralizedAlpha(step=2.5e-4))
    # The same steps, interpolated at times without a row of the reference.
    assert bd.compare([case], fine, output_step=0.013)["error [-]"][0] < 1e-12


def test_errors_fall_with_the_step(fine):
    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=h)) for h in (0.02, 0.01)]
    coarse_error, error = bd.compare(cases, bd.Case(swing, {}, bd.GeneralizedAlpha(step=2.5e-4)))[
        "error [-]"
    ]
    assert coarse_error / error == pytest.approx(4.0, rel=0.1)


def test_a_model_without_a_consistent_start_is_a_row():
    table = bd.compare([bd.Case(redundant, {}, ALPHA), bd.Case(swing, {}, ALPHA)])
    assert table["status"][0] == "failed"
    assert "depend on each other" in table["reason"][0]
    assert np.isnan(table["reached [s]"][0])
    assert table["steps"].isna().tolist() == [True, False]
    assert table["status"][1] == "ok"


def test_failed_runs_are_compared_up_to_the_time_they_reached():
    reference = bd.Case(singular_torque, {"limit": 1.0}, ALPHA)
    (row,) = bd.compare([bd.Case(singular_torque, {}, ALPHA)], reference).to_dict("records")
    assert row["status"] == "failed"
    assert row["reason"].startswith("stopped at t = 0.2 s")
    assert row["reached [s]"] == pytest.approx(0.2)
    assert 0.0 < row["error [-]"] < 1.0
    assert np.isnan(row["error of bob.angle, end [rad]"])


def test_failed_references_raise():
    with pytest.raises(
        bd.BeamdaeError, match=r"singular_torque: the reference run with .*stopped at t = 0.2"
    ):
        bd.compare([bd.Case(swing, {}, ALPHA)], bd.Case(singular_torque, {}, ALPHA))


def test_invalid_cases_and_references_are_refused():
    with pytest.raises(bd.BeamdaeError, match="at least one Case"):
        bd.compare([])
    with pytest.raises(bd.BeamdaeError, match="reference must be a Case or a Solution, got 'fine'"):
        bd.compare([bd.Case(swing, {}, ALPHA)], "fine")


def test_cases_must_have_the_columns_of_the_reference(fine):
    with pytest.raises(
        bd.BeamdaeError, match=r"a case does not observe the column end.x \[m\] of the reference"
    ):
        bd.compare([bd.Case(singular_torque, {}, ALPHA)], fine)


def test_an_interrupted_comparison_returns_all_rows():
    def interrupt(label, t):
        raise KeyboardInterrupt

    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-3))] * 2
    table = bd.compare(cases, progress=interrupt, partial="return")
    assert list(table["status"]) == ["interrupted"] * 2
    first, second = table["reason"]
    assert first.startswith("interrupted at t = ")
    assert second == "not run because the study was interrupted"


def test_progress_receives_the_label_of_the_case():
    calls = []
    case = bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-3))
    bd.compare([case], progress=lambda label, t: calls.append((label, t)))
    assert {label for label, _ in calls} == {case.label}
    assert 0.0 < calls[0][1] <= 0.4


@pytest.mark.parametrize("failing", ["GeneralizedAlpha", "reference"])
def test_exceptions_of_progress_end_the_comparison(failing):
    """In the reference run, they were reported as a failure of the model."""

    def fail(label, t):
        if label.startswith(failing):
            raise ValueError("no display")

    case = bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-3))
    with pytest.raises(ValueError, match="no display") as caught:
        bd.compare([case], reference=case, progress=fail)
    assert caught.value.solution.t[0] == 0.0


def test_default_integrators_use_all_methods():
    types = {type(integrator) for integrator in default_integrators()}
    assert types == {bd.Ida, bd.Radau, bd.GeneralizedAlpha}


@bd.model(t_end=0.4)
def drifting(mass=2.0):
    """Its columns have the names of columns of the case table."""
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 1), ca.SX.sym("v", 1)
    return bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[mass], force=-q, q0=[1.0], v0=[0.0], names=("drift",),
        observe={"energy.x": q**2, "error": 2.0 * q},
    )  # fmt: skip


def test_regression_columns_with_names_of_table_columns_are_compared():
    mech = swing()
    mech.observe("drift", mech.part("bob").at(2.0, 0.0))
    columns = observed_columns(run_values.tabulate_trajectory(bd.simulate(mech, ALPHA, 0.1)))
    assert [name for name in columns if name.startswith("drift.")][:2] == [
        "drift.x [m]",
        "drift.y [m]",
    ]
    reference = bd.Case(drifting, {}, bd.GeneralizedAlpha(step=2.5e-4))
    table = bd.compare([bd.Case(drifting, {}, ALPHA)], reference)
    for name in ("drift", "energy.x", "error"):
        assert table[f"error of {name}, max [-]"][0] > 0.0


def test_observables_with_names_of_the_ledger_are_refused():
    mech = swing()
    for name in ("energy", "energy.x", "t"):
        with pytest.raises(bd.BeamdaeError, match=f"the observable name '{name}' is reserved for"):
            mech.observe(name, mech.part("bob").at(2.0, 0.0))


@pytest.mark.slow(reason="a second")
def test_warnings_of_a_run_are_in_its_row():
    with pytest.warns(bd.BeamdaeWarning, match="strip: the beam bends"):
        table = bd.compare([bd.Case(bending, {}, bd.GeneralizedAlpha(2e-4))])
    assert table["warnings"][0].startswith("energy: ")
    assert "strip: the beam bends" in table["warnings"][0]


@pytest.mark.slow(reason="a study; the row of one case is in the test above")
def test_cases_of_studies_do_not_emit_their_warnings():
    task = Task("bending", bd.Case(bending, {}, bd.Radau(rtol=1e-3)), 0.02, 0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error", bd.BeamdaeWarning)
        outcome = run_task(task.serialize({}))
    assert outcome.values["warnings"].startswith("strip: the beam bends")
