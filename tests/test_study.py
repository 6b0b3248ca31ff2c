"""Studies: what a row says, what errors are measured by, and what a reference has to prove."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import beamdae as bd
from beamdae import study

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
    assert list(table["integrator"]) == ["GeneralizedAlpha(step=0.002)"] * 2
    assert list(table["status"]) == ["ok", "ok"]
    assert list(table["reached [s]"]) == [0.1, 0.1]
    assert list(table["steps"]) == [50, 50]
    assert (table["wall time [s]"] > 0.0).all()
    assert "error [-]" not in table


def test_row_repeats_the_summary_of_the_solution():
    result = study.comparison([bd.Case(swing, {}, ALPHA)])
    (row,) = result.table.to_dict("records")
    (solution,) = result.solutions
    summary = solution.summary()
    for column, name in (study._COUNTS | study._MEASURES).items():
        assert row[column] == summary[name]
        assert pd.notna(row[column])


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
    assert study.compared_columns(fine) == [
        "end.x [m]",
        "end.y [m]",
        "end.angle [rad]",
        "pin.angle [rad]",
    ]
    assert study.compared_columns(fine, ["hinge.Fx [N]"]) == ["hinge.Fx [N]"]


def test_columns_without_positions_are_all_compared(fine):
    frame = pd.DataFrame({"q0 [-]": [0.0, 1.0], "q1 [-]": [0.0, 2.0], "q2 [-]": [0.0, 0.0]})
    bare = replace(fine)
    bare.__dict__["observed"] = frame
    assert study.compared_columns(bare) == ["q0 [-]", "q1 [-]"]


def test_named_columns_must_exist_and_move(fine):
    with pytest.raises(bd.BeamdaeError, match=r"'end.z \[m\]'.*did you mean 'end.y \[m\]'"):
        study.compared_columns(fine, ["end.z [m]"])
    still = replace(fine)
    still.__dict__["observed"] = pd.DataFrame({"end.x [m]": [1.0, 1.0]})
    with pytest.raises(bd.BeamdaeError, match=r"end.x \[m\] must move"):
        study.compared_columns(still)
    still.__dict__["observed"] = pd.DataFrame(index=[0, 1])
    with pytest.raises(bd.BeamdaeError, match="must observe something"):
        study.compared_columns(still)


def test_deviation_of_other_output_times_takes_the_reference_there(fine):
    same = bd.simulate(swing, bd.GeneralizedAlpha(step=2.5e-4), output_step=0.013)
    found = study.deviation(same, fine)
    assert list(found.index) == list(same.t)
    # The interpolation of the same steps, at times the reference has no row for.
    assert found.to_numpy().max() < 1e-12


def test_errors_fall_with_the_step(fine):
    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=h)) for h in (0.02, 0.01)]
    coarse, better = bd.compare(cases, bd.Case(swing, {}, bd.GeneralizedAlpha(step=2.5e-4)))[
        "error [-]"
    ]
    assert coarse / better == pytest.approx(4.0, rel=0.1)


def test_model_without_start_is_a_row():
    table = bd.compare([bd.Case(doubled, {}, ALPHA), bd.Case(swing, {}, ALPHA)])
    assert "depend on each other" in table["status"][0]
    assert np.isnan(table["reached [s]"][0])
    assert table["steps"].isna().tolist() == [True, False]
    assert table["status"][1] == "ok"


def test_failed_run_is_a_row_and_compares_where_it_got_to():
    reference = bd.Case(torn, {"limit": 1.0}, ALPHA)
    result = study.comparison([bd.Case(torn, {}, ALPHA)], reference)
    (row,) = result.table.to_dict("records")
    assert row["status"].startswith("stopped at t = 0.2 s")
    assert row["reached [s]"] == pytest.approx(0.2)
    assert 0.0 < row["error [-]"] < 1.0
    assert result.deviations[0].index[-1] == pytest.approx(0.2)


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


def test_interrupted_study_keeps_what_it_has():
    def interrupt(label, t):
        raise KeyboardInterrupt

    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-3))] * 2
    result = study.comparison(cases, progress=interrupt)
    first, second = result.table["status"]
    assert first.startswith("interrupted at t = ")
    assert second == "not run, the study was interrupted"
    assert len(result.finished) == 1


def test_progress_names_the_case():
    seen = []
    case = bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-3))
    bd.compare([case], progress=lambda label, t: seen.append((label, t)))
    assert {label for label, _ in seen} == {case.label}
    assert 0.0 < seen[0][1] <= 0.4


def test_agreed_reference_knows_its_uncertainty():
    reference = study.agreed_reference(swing)
    assert 0.0 < reference.uncertainty < 1e-5
    cases = [bd.Case(swing, {}, replace(study._REFERENCE, step=h)) for h in (0.02, 2.5e-4)]
    table = bd.compare(cases, reference)
    assert table["below uncertainty"].tolist() == [False, True]


def test_reference_needs_two_methods_that_agree(monkeypatch):
    monkeypatch.setattr(study, "_DISAGREEMENT", 1e-12)
    with pytest.raises(bd.BeamdaeError, match=r"swing: the reference failed, .* differ by"):
        study.agreed_reference(swing)


def test_reference_without_a_number_is_refused(monkeypatch):
    nothing = pd.DataFrame({"end.x [m]": [np.nan]})
    monkeypatch.setattr(study, "deviation", lambda *_: nothing)
    with pytest.raises(bd.BeamdaeError, match="differ by nan"):
        study.agreed_reference(swing)


def test_files_of_a_comparison(tmp_path, fine):
    cases = [bd.Case(swing, {}, ALPHA), bd.Case(doubled, {}, ALPHA)]
    result = study.comparison(cases, fine)
    table, reference, trajectory = result.to_csv(tmp_path / "new", "swings")
    assert list(pd.read_csv(table)["status"]) == list(result.table["status"])
    assert list(pd.read_csv(reference)["t [s]"]) == pytest.approx(list(fine.t))
    assert trajectory.name == "swings_1_GeneralizedAlpha_step_0.002.csv"
    assert trajectory.with_suffix(".json").exists()
    (tmp_path / "file").touch()
    with pytest.raises(bd.BeamdaeError, match="cannot be written"):
        result.to_csv(tmp_path / "file", "swings")


def test_default_integrators_are_two_of_each():
    kinds = [type(i) for i in study.default_integrators()]
    assert kinds == [bd.Ida, bd.Ida, bd.GeneralizedAlpha, bd.GeneralizedAlpha]
