"""Comparison of cases: rows of the table, error columns, labels and failures."""

import mechanisms
import numpy as np
import pytest
from mechanisms import symbols
from study_models import singular_torque

import beamdae as bd

ALPHA = bd.GeneralizedAlpha(step=2e-3)
swing = bd.model(t_end=0.4)(mechanisms.swing)


@bd.model(t_end=0.4)
def redundant():
    mech = swing()
    mech.add(bd.Revolute("second hinge", mech.ground.at(0.0, 0.0), mech.part("bob").at(0.0, 0.0)))
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


def test_each_case_has_a_row_with_its_parameters():
    cases = [bd.Case(swing, p, ALPHA) for p in bd.grid(mass=[1.0, 3.0], torque=[0.5])]
    table = bd.compare(cases, t_end=0.1, output_step=0.01)
    assert list(table["model"]) == ["swing", "swing"]
    assert list(table["mass"]) == [1.0, 3.0]
    assert list(table["torque"]) == [0.5, 0.5]
    assert list(table["label"]) == ["GeneralizedAlpha(step=0.002)"] * 2
    assert list(table["integrator"]) == ["GeneralizedAlpha"] * 2
    assert list(table["status"]) == ["ok", "ok"]
    assert list(table["reached [s]"]) == [0.1, 0.1]
    assert list(table["steps"]) == [50, 50]
    assert (table["wall time [s]"] > 0.0).all()
    assert "error [-]" not in table


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
    # Rates and forces are left out.
    columns = ["end.x [m]", "end.y [m]", "end.angle [rad]"]
    exact = fine.observed[columns].to_numpy()
    difference = np.abs(coarse.observed[columns].to_numpy() - exact).max(axis=0)
    expected = np.max(2.0 * difference / (exact.max(axis=0) - exact.min(axis=0)))
    (error,) = bd.compare([bd.Case(swing, {}, bd.GeneralizedAlpha(step=0.02))], fine)["error [-]"]
    assert error == pytest.approx(expected, rel=1e-12)
    assert error > 1e-5


def test_errors_by_column_are_at_the_end_the_maximum_and_the_root_mean_square(fine):
    coarse = bd.Case(swing, {}, bd.GeneralizedAlpha(step=0.02))
    exact = fine.observed["end.x [m]"].to_numpy()
    error = np.abs(coarse.solve().observed["end.x [m]"].to_numpy() - exact)
    (row,) = bd.compare([coarse], fine).to_dict("records")
    assert row["error of end.x, end [m]"] == pytest.approx(error[-1])
    assert row["error of end.x, max [m]"] == pytest.approx(error.max())
    assert row["error of end.x, rms [m]"] == pytest.approx(np.sqrt(np.mean(error**2)))


def test_references_are_interpolated_at_the_output_times_of_a_case(fine):
    case = bd.Case(swing, {}, bd.GeneralizedAlpha(step=2.5e-4))
    # The same steps, interpolated at times without a row of the reference.
    assert bd.compare([case], fine, output_step=0.013)["error [-]"][0] < 1e-12


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


@pytest.mark.parametrize(
    ("case", "reference", "message"),
    [
        (swing, "fine", "reference must be a Case or a Solution, got 'fine'"),
        (swing, bd.Case(singular_torque, {}, ALPHA), "the reference run with .*stopped at t = 0.2"),
        (singular_torque, bd.Case(swing, {}, ALPHA), r"a case does not observe the column end.x"),
    ],
)
def test_references_that_no_case_can_be_compared_with_are_refused(case, reference, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.compare([bd.Case(case, {}, ALPHA)], reference)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (["end.z [m]"], r"'end.z \[m\]'.*did you mean 'end.y \[m\]'"),
        (["end.x", "bob.x"], r"the reference is constant in bob\.x"),
    ],
)
def test_compared_columns_must_exist_and_move(columns, message):
    @bd.model(t_end=0.1)
    def at_rest():
        mech = swing()
        mech.observe("bob", mech.ground.at(1.0, 0.0))
        return mech

    with pytest.raises(bd.BeamdaeError, match=message):
        bd.compare([bd.Case(at_rest, {}, ALPHA)], bd.Case(at_rest, {}, ALPHA), columns=columns)


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


@bd.model(t_end=0.4)
def drifting(mass=2.0):
    """Its columns have the names of columns of the case table."""
    t, q, v = symbols(1)
    return bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[mass], force=-q, q0=[1.0], v0=[0.0], names=("drift",),
        observe={"energy.x": q**2, "error": 2.0 * q},
    )  # fmt: skip


def test_regression_columns_with_names_of_table_columns_are_compared():
    reference = bd.Case(drifting, {}, bd.GeneralizedAlpha(step=2.5e-4))
    table = bd.compare([bd.Case(drifting, {}, ALPHA)], reference)
    for name in ("drift", "energy.x", "error"):
        assert table[f"error of {name}, max [-]"][0] > 0.0


def test_observables_with_names_of_the_ledger_are_refused():
    mech = swing()
    for name in ("energy", "energy.x", "t"):
        with pytest.raises(bd.BeamdaeError, match=f"the observable name '{name}' is reserved for"):
            mech.observe(name, mech.part("bob").at(2.0, 0.0))
