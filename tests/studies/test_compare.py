"""Comparing here and now: what a row says, what errors are measured by."""

import warnings

import casadi as ca
import numpy as np
import pandas as pd
import pytest

import beamdae as bd
from beamdae.results.columns import observed_columns
from beamdae.studies import deviations
from beamdae.studies import run_values as told
from beamdae.studies.case import default_integrators
from beamdae.studies.execution import case_run as work
from beamdae.studies.execution.tasks import Task

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
def torn(limit=0.2):
    """The moment leaves the real numbers at t = limit."""
    mech = bd.Mechanism()
    bob = mech.add(bd.RigidBody("bob", 2.0, inertia=0.1))
    mech.add(bd.Moment("torque", on=bob.at(0.0, 0.0), law=lambda t: (limit - t) ** 1.5))
    mech.observe("bob", bob.at(0.0, 0.0))
    return mech


@bd.model(t_end=0.4)
def doubled():
    mech = swing()
    mech.add(bd.Revolute("again", mech.ground.at(0.0, 0.0), mech.part("bob").at(0.0, 0.0)))
    return mech


@bd.model(t_end=0.02)
def bent():
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material(E=7e10, nu=0.3, rho=2700.0), 0.02, 0.005)
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements=2))
    mech.add(bd.Moment("torque", on=beam.end, law=100.0))
    mech.observe("tip", beam.end)
    return mech


@pytest.fixture(scope="module")
def fine():
    return bd.simulate(swing, bd.GeneralizedAlpha(step=2.5e-4))


def test_grid_is_every_combination_in_order():
    assert bd.grid(a=[1, 2], b=["x", "y"]) == [
        {"a": 1, "b": "x"},
        {"a": 1, "b": "y"},
        {"a": 2, "b": "x"},
        {"a": 2, "b": "y"},
    ]
    assert bd.grid() == [{}]


@pytest.mark.parametrize("values", [8, "linear"])
def test_grid_wants_lists(values):
    with pytest.raises(bd.BeamdaeError, match=f"elements must be a list of values, got {values!r}"):
        bd.grid(elements=values)


def test_one_row_a_case_with_its_parameters():
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


def test_row_repeats_the_summary_of_the_solution():
    case = bd.Case(swing, {}, ALPHA)
    (row,) = bd.compare([case]).to_dict("records")
    summary = case.solve().summary()
    for column, name in (told.COUNT_COLUMNS | told.MEASURE_COLUMNS).items():
        assert pd.notna(row[column])
        if "time" not in column:
            assert row[column] == summary[name]


def test_parameters_reach_the_model_and_the_record():
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
def test_label_names_what_differs_from_the_defaults(integrator, label):
    assert bd.Case(swing, {}, integrator).label == label


def test_error_is_the_largest_deviation_relative_to_the_amplitude(fine):
    coarse = bd.Case(swing, {}, bd.GeneralizedAlpha(step=0.02)).solve()
    columns = ["end.x [m]", "end.y [m]", "end.angle [rad]", "pin.angle [rad]"]
    known = fine.observed[columns].to_numpy()
    wrong = np.abs(coarse.observed[columns].to_numpy() - known).max(axis=0)
    expected = np.max(2.0 * wrong / (known.max(axis=0) - known.min(axis=0)))
    (error,) = bd.compare([bd.Case(swing, {}, bd.GeneralizedAlpha(step=0.02))], fine)["error [-]"]
    assert error == pytest.approx(expected, rel=1e-12)
    assert error > 1e-5


def test_columns_that_rest_and_rates_and_forces_are_left_out(fine):
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


def test_named_columns_must_exist_and_move(fine):
    with pytest.raises(bd.BeamdaeError, match=r"'end.z \[m\]'.*did you mean 'end.y \[m\]'"):
        deviations.select_error_columns(fine.observed, ["end.z [m]"])
    still = pd.DataFrame({"end.x [m]": [1.0, 1.0]})
    with pytest.raises(bd.BeamdaeError, match=r"end.x \[m\] must move"):
        deviations.select_error_columns(still)
    with pytest.raises(bd.BeamdaeError, match="must observe something"):
        deviations.select_error_columns(pd.DataFrame(index=[0, 1]))


def test_errors_by_column_are_at_the_end_largest_and_root_mean_square(fine):
    coarse = bd.Case(swing, {}, bd.GeneralizedAlpha(step=0.02))
    known = fine.observed["end.x [m]"].to_numpy()
    error = np.abs(coarse.solve().observed["end.x [m]"].to_numpy() - known) / (0.5 * np.ptp(known))
    (row,) = bd.compare([coarse], fine).to_dict("records")
    assert row["error of end.x [m], end"] == pytest.approx(error[-1])
    assert row["error of end.x [m], max"] == pytest.approx(error.max())
    assert row["error of end.x [m], rms"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert row["reaction error [-]"] > 0.0


def test_reference_with_other_output_times_is_taken_there(fine):
    case = bd.Case(swing, {}, bd.GeneralizedAlpha(step=2.5e-4))
    # The interpolation of the same steps, at times the reference has no row for.
    assert bd.compare([case], fine, output_step=0.013)["error [-]"][0] < 1e-12


def test_errors_fall_with_the_step(fine):
    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=h)) for h in (0.02, 0.01)]
    coarse, better = bd.compare(cases, bd.Case(swing, {}, bd.GeneralizedAlpha(step=2.5e-4)))[
        "error [-]"
    ]
    assert coarse / better == pytest.approx(4.0, rel=0.1)


def test_model_without_start_is_a_row():
    table = bd.compare([bd.Case(doubled, {}, ALPHA), bd.Case(swing, {}, ALPHA)])
    assert table["status"][0] == "failed"
    assert "depend on each other" in table["reason"][0]
    assert np.isnan(table["reached [s]"][0])
    assert table["steps"].isna().tolist() == [True, False]
    assert table["status"][1] == "ok"


def test_failed_run_is_a_row_and_compares_where_it_got_to():
    reference = bd.Case(torn, {"limit": 1.0}, ALPHA)
    (row,) = bd.compare([bd.Case(torn, {}, ALPHA)], reference).to_dict("records")
    assert row["status"] == "failed"
    assert row["reason"].startswith("stopped at t = 0.2 s")
    assert row["reached [s]"] == pytest.approx(0.2)
    assert 0.0 < row["error [-]"] < 1.0
    assert np.isnan(row["error of bob.angle [rad], end"])


def test_reference_that_fails_raises():
    with pytest.raises(bd.BeamdaeError, match=r"torn: the reference failed, .*stopped at t = 0.2"):
        bd.compare([bd.Case(swing, {}, ALPHA)], bd.Case(torn, {}, ALPHA))


def test_study_of_nothing_and_wrong_reference():
    with pytest.raises(bd.BeamdaeError, match="at least one Case"):
        bd.compare([])
    with pytest.raises(bd.BeamdaeError, match="reference must be a Case or a Solution, got 'fine'"):
        bd.compare([bd.Case(swing, {}, ALPHA)], "fine")


def test_reference_must_observe_what_the_cases_do(fine):
    with pytest.raises(bd.BeamdaeError, match=r"end.x \[m\] of the reference is not observed"):
        bd.compare([bd.Case(torn, {}, ALPHA)], fine)


def test_interrupted_comparison_keeps_what_it_has():
    def interrupt(label, t):
        raise KeyboardInterrupt

    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-3))] * 2
    table = bd.compare(cases, progress=interrupt)
    assert list(table["status"]) == ["interrupted"] * 2
    first, second = table["reason"]
    assert first.startswith("interrupted at t = ")
    assert second == "not run, the study was interrupted"


def test_progress_names_the_case():
    seen = []
    case = bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-3))
    bd.compare([case], progress=lambda label, t: seen.append((label, t)))
    assert {label for label, _ in seen} == {case.label}
    assert 0.0 < seen[0][1] <= 0.4


def test_default_integrators_are_of_every_kind():
    kinds = [type(i) for i in default_integrators()]
    assert set(kinds) == {bd.Ida, bd.Radau, bd.GeneralizedAlpha}


@bd.model(t_end=0.4)
def drifting(mass=2.0):
    """Its columns are called as those that tables have themselves."""
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 1), ca.SX.sym("v", 1)
    return bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[mass], force=-q, q0=[1.0], v0=[0.0], names=("drift",),
        observe={"energy.x": q**2, "error": 2.0 * q},
    )  # fmt: skip


def test_regression_columns_called_as_those_of_tables_do_not_vanish():
    mech = swing()
    mech.observe("drift", mech.part("bob").at(2.0, 0.0))
    columns = observed_columns(told.tabulate_trajectory(bd.simulate(mech, ALPHA, 0.1)))
    assert [name for name in columns if name.startswith("drift.")][:2] == [
        "drift.x [m]",
        "drift.y [m]",
    ]
    reference = bd.Case(drifting, {}, bd.GeneralizedAlpha(step=2.5e-4))
    table = bd.compare([bd.Case(drifting, {}, ALPHA)], reference)
    for name in ("drift [-]", "energy.x [-]", "error [-]"):
        assert table[f"error of {name}, max"][0] > 0.0


def test_names_the_ledger_needs_are_refused():
    mech = swing()
    for name in ("energy", "energy.x", "t"):
        with pytest.raises(bd.BeamdaeError, match=f"the observable name '{name}' is taken"):
            mech.observe(name, mech.part("bob").at(2.0, 0.0))


def test_warnings_of_a_run_are_in_its_row():
    with pytest.warns(bd.BeamdaeWarning, match="strip: it bends"):
        table = bd.compare([bd.Case(bent, {}, bd.GeneralizedAlpha(2e-4))])
    assert table["warnings"][0].startswith("strip: it bends")


@pytest.mark.slow(reason="a study; the row of one case is in the test above")
def test_a_case_of_a_study_warns_in_its_row_alone():
    task = Task("bent", bd.Case(bent, {}, bd.Radau(rtol=1e-3)), 0.02, 0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error", bd.BeamdaeWarning)
        outcome = work.run_task(task.serialize({}))
    assert outcome.values["warnings"].startswith("strip: it bends")
