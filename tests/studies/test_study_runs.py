"""Runs of studies, and fits from several starts."""

from dataclasses import replace
from itertools import count

import mechanisms
import numpy as np
import pandas as pd
import pytest
from mechanisms import free_ball, symbols
from study_models import singular_torque, swing
from study_runs import SerialPool, create_study_page, run_study

import beamdae as bd

ALPHA = bd.GeneralizedAlpha(step=5e-3)


def sweep(*values, **settings):
    cases = tuple(bd.Case(swing, x, ALPHA) for x in values)
    return bd.results.Study("sweep", cases, references=(), **settings)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    study = sweep(*bd.grid(mass=[1.0, -1.0, *range(2, 6)]))
    return run_study(study, tmp_path_factory.mktemp("sweep"), SerialPool())


# Plan of references -------------------------------------------------------------------------------
FINE = (bd.Radau(rtol=1e-5), bd.GeneralizedAlpha(step=1e-3))
MIXED = [bd.Case(swing, {"mass": m}, x) for m, x in ((1.0, ALPHA), (2.0, ALPHA), (2.0, FINE[0]))]


@pytest.fixture
def run(tmp_path):
    """Return a function that runs a study of these cases in a new folder."""
    folders = map(str, count())

    def run(cases, **settings):
        study = bd.results.Study("mixed", tuple(cases), **settings)
        return run_study(study, tmp_path / next(folders), SerialPool())

    return run


@pytest.mark.slow(reason="many small runs")
def test_groups_that_compare_integrators_have_references_unless_settings_say_otherwise(run):
    one, two = "swing(mass=1.0)", "swing(mass=2.0)"

    def referenced_groups(cases, **settings):
        return list(run(cases, **settings).references)

    assert referenced_groups(MIXED) == [two]
    assert referenced_groups(MIXED[:2]) == []
    assert referenced_groups(MIXED[:2] * 2) == [], "the same case twice compares nothing"
    assert referenced_groups(MIXED, references=FINE) == [one, two]
    assert referenced_groups(MIXED, columns=("end.x [m]",)) == [one, two]
    assert referenced_groups(MIXED[:2], over="mass") == [f"swing, {ALPHA.label}"]
    for settings in ({}, {"over": "mass"}, {"columns": ("end.x [m]",)}):
        assert referenced_groups(MIXED, references=(), **settings) == []


def test_cases_with_equal_parameters_share_a_reference(run):
    parameters = [{}, {"mass": 2}, {"mass": 2.0, "note": None}, {"note": None, "mass": 2.0}]
    cases = [
        bd.Case(swing, x, bd.GeneralizedAlpha(step=h))
        for x, h in zip(parameters, (1e-3, 2e-3, 4e-3, 8e-3), strict=True)
    ]
    results = run(cases)
    assert set(results.table["group"]) == {"swing"}
    # The references are three runs: two methods, one of them with two steps.
    assert len(results.outcomes) == 4 + 3


@pytest.mark.slow(reason="many small runs")
def test_regression_different_parameters_with_equal_labels_are_different_groups(run):
    """Labels of strings and numbers, and of arrays with equal leading digits, are equal."""
    values = (3, "3", np.array([0.1]), np.array([0.1 + 1e-12]), "a", "A")
    cases = [bd.Case(swing, {"note": x}, y) for x in values for y in (ALPHA, FINE[0])]
    results = run(cases)
    names = ["swing(note=3)", "swing(note=3) (2)", "swing(note=[0.1])", "swing(note=[0.1]) (2)"]
    names += ["swing(note=a)", "swing(note=A)"]
    assert list(results.references) == names
    assert list(results.table["group"])[::2] == names


@pytest.mark.slow(reason="half a second")
def test_study_with_errors_of_some_cases(tmp_path):
    cases = [*MIXED, bd.Case(swing, {"mass": -1.0}, ALPHA)]
    results = run_study(bd.results.Study("mixed", tuple(cases)), tmp_path, SerialPool())
    assert list(results.table["error bound [-]"].notna()) == [False, True, True, False]
    assert not results.table["below resolution"][[0, 3]].any()
    assert set(results.summary["group"]) <= {"swing(mass=2.0)"}
    assert not results.failed
    page = create_study_page(results)
    assert [(x["label"], x["reference"]["accepted"]) for x in page["groups"]] == [
        ("swing(mass=2.0)", True),
        ("mixed", True),
    ]
    assert [case["label"] for case in page["cases"][:2]] == [
        f"swing(mass=1.0), {ALPHA.label}",
        ALPHA.label,
    ]
    assert "bob" in [symbol["name"] for symbol in page["groups"][0]["frames"]["glyphs"]]
    kinds = {column["label"]: column["kind"] for column in page["columns"]}
    assert [kinds[x] for x in ("error", "wall time", "steps")] == ["error", "cost", "number"]
    # Only cases with a reference have errors over time.
    errors = [case["curves"]["error"] for case in page["cases"][:2]]
    assert errors[0] == {}
    assert list(errors[1]) == ["error"]


# Studies without references -----------------------------------------------------------------------
@pytest.mark.parametrize(
    ("masses", "settings"),
    [
        ((1.0, 1.0), {}),
        ((1.0, 2.0), {}),
        ((1.0, -1.0), {"references": ()}),
        ((1.0, 2.0), {"over": "mass", "references": ()}),
    ],
)
def test_study_without_references_has_no_errors_and_no_summary(masses, settings, tmp_path):
    """Groups of a single run need no reference."""
    cases = tuple(bd.Case(swing, {"mass": mass}, ALPHA) for mass in masses)
    results = run_study(bd.results.Study("pair", cases, **settings), tmp_path, SerialPool())
    assert len(results.outcomes) == len(set(masses))
    assert list(results.table["status"]) == ["ok" if mass > 0.0 else "failed" for mass in masses]
    assert "error [-]" not in results.table
    assert results.references == {}
    assert results.summary.empty
    assert not (tmp_path / "summary.csv").exists()
    assert not results.failed


def test_finished_study_runs_no_task_again(swept, tmp_path):
    def require_no_tasks(tasks):
        assert list(tasks) == []
        yield from ()

    pool = SerialPool()
    pool.run_tasks = require_no_tasks
    repeated = run_study(swept.study, swept.folder, pool)
    pd.testing.assert_frame_equal(repeated.table, swept.table)
    for key, outcome in swept.outcomes.items():
        if outcome.table is not None:
            pd.testing.assert_frame_equal(repeated.outcomes[key].table, outcome.table)


def test_page_without_references_has_one_group_and_the_curves_of_the_first_cases(
    swept, monkeypatch
):
    monkeypatch.setattr("beamdae.studies.study_page.MAX_CURVES", 4)
    page = create_study_page(swept)
    assert [group["id"] for group in page["groups"]] == ["sweep"]
    assert page["cases"][0]["label"] == f"swing(mass=1.0), {ALPHA.label}"
    has_curves = [case["curves"] is not None for case in page["cases"]]
    assert has_curves == [True, False, True, True, False, False]
    assert page["groups"][0]["reference"] is None


def test_regression_warnings_that_several_cases_share_are_described_once(swept):
    """Texts of several warnings differed in their combination: one paragraph per case."""
    bent = "arm: the beam bends {} rad. Use strain='exact' (see arm.x); or more elements."
    missed = "tip.x_dot: the output rows miss {} m/s at t = 1 s, also in tip.y (2 m){}."
    other = "arm.x: the output rows miss its {} value, {} N at t = 1 s."
    texts = [
        f"Further: no.\n{other.format('largest', 3)}",
        f"{bent.format(0.1)}\n{missed.format(2, '')}",
        missed.format(3.5, ", tip.z (1 m)"),
        f"{bent.format(0.2)}\n{missed.format(1e-5, '')}\nFurther: no.\n"
        f"{other.replace('arm', 'tip').format('smallest', 1)}",
        *("", ""),
    ]
    table = pd.DataFrame({"warnings": texts, "group": "sweep"})
    first = f"for example {ALPHA.label}"
    assert replace(swept, table=table).describe_warnings() == [
        f"sweep: warnings in 2 of 6 cases, {first}: Further: no.",
        f"sweep: warnings in 1 of 6 cases, {first}: {other.format('largest', 3)}",
        f"sweep: warnings in 2 of 6 cases, {first}: {bent.format(0.1)}",
        f"sweep: warnings in 2 of 6 cases, {first}: {missed.format(2, '')}",
        f"sweep: warnings in 1 of 6 cases, {first}: {missed.format(3.5, ', tip.z (1 m)')}",
        "sweep: 1 more kinds of warnings; see cases.csv.",
    ]


METHOD = bd.GeneralizedAlpha(step=0.02)
TIMES = np.linspace(0.1, 2.0, 20)

BOUNDS = {"stiffness": (10.0, 300.0)}


@bd.model(t_end=1.0)
def oscillator(stiffness=200.0):
    if stiffness > 400.0:
        raise bd.BeamdaeError("oscillator: the spring is too stiff.")
    mech, _body = free_ball((1.0, 0.0), velocity=(0.2, 0.0), name="mass", spring=(stiffness,))
    return mech


def fit(starts, integrator=METHOD, **options):
    data = {"t [s]": TIMES, "mass.x": 1.0 + 0.2 / 40.0**0.5 * np.sin(40.0**0.5 * TIMES)}
    options = {"bounds": BOUNDS, "log": "stiffness", "seed": 3, "max_evaluations": 8, **options}
    return bd.fit(oscillator, data, "stiffness", integrator, sigma=1e-3, starts=starts, **options)


@pytest.mark.slow(reason="seven searches")
def test_the_best_of_several_starts_is_returned_and_resumed(tmp_path):
    # From 200 N/m, the search ends in a local minimum.
    assert abs(fit(1).parameters["stiffness"] - 40.0) > 5.0
    steps = []
    best = fit(3, folder=tmp_path / "store", progress=steps.append)
    # The period of the discrete oscillator is longer by 0.1 %.
    assert best.parameters["stiffness"] == pytest.approx(40.0, rel=1e-2)
    assert [x.done for x in steps] == [0, 1, 2, 3]
    table = best.starts
    assert best.evaluations in table["evaluations"].to_list()
    # The others end at minima near the limit of evaluations.
    assert table["status"].iloc[-1] == "ok"
    assert table["first stiffness"].iloc[0] == 200.0
    assert best.chi_square == pytest.approx(table["chi-square"].min(), rel=1e-6)
    steps.clear()
    again = fit(3, folder=tmp_path / "store", progress=steps.append)
    assert [x.stored for x in steps] == [3]
    assert again.parameters == best.parameters
    # Other variables are other searches.
    fit(2, folder=tmp_path / "store", log=(), max_evaluations=1, progress=steps.append)
    assert steps[-1].stored == 0


@pytest.mark.slow(reason="three searches")
def test_failed_starts_are_reported_and_skipped():
    bounds = {"stiffness": (1.0, 10000.0)}
    best = fit(3, bounds=bounds, log=())
    assert list(best.starts["status"]).count("failed") == 2
    assert "too stiff" in " ".join(best.starts["reason"])
    with pytest.raises(bd.BeamdaeError, match=r"all 2 searches failed.*GeneralizedAlpha"):
        fit(2, integrator=bd.Ida())


@pytest.mark.slow(reason="half a second and more")
def test_exceptions_of_progress_end_the_fit(tmp_path):
    def fail(status):
        if status.done == 1:
            raise RuntimeError("no display")

    with pytest.raises(RuntimeError, match=r"^no display$") as caught:
        fit(2, folder=tmp_path, progress=fail, max_evaluations=1)
    assert caught.value.partial is None
    steps = []
    fit(2, folder=tmp_path, progress=steps.append, max_evaluations=1)
    assert steps[0].stored == 1


@pytest.mark.slow(reason="six searches")
def test_equal_seeds_give_equal_starts():
    first, again, other = (
        fit(3, seed=seed, max_evaluations=1).starts["first stiffness"] for seed in (1, 1, 2)
    )
    assert list(first) == list(again)
    assert list(first[1:]) != list(other[1:])
    # One start in each half of the logarithms.
    shares = np.sort(np.log(first[1:] / 10.0) / np.log(30.0))
    assert shares[0] < 0.5 < shares[1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"folder": 3}, "folder must be the path"),
        ({"jobs": 0}, "jobs must be a whole number"),
        ({"progress": 3}, "progress must be a function"),
        ({"progress": lambda: None}, "progress must be a function that accepts 1 argument"),
        ({"seed": -1}, "seed must be a whole number"),
    ],
)
def test_refusals(changes, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        fit(2, **changes)


# Comparison of cases: rows of the table, error columns, labels and failures.

FINE_ALPHA = bd.GeneralizedAlpha(step=2e-3)
swing_model = bd.model(t_end=0.4)(mechanisms.swing)


@bd.model(t_end=0.4)
def redundant():
    mech = swing_model()
    mech.add(bd.Revolute("second hinge", mech.ground.at(0.0, 0.0), mech.part("bob").at(0.0, 0.0)))
    return mech


@pytest.fixture(scope="module")
def fine():
    return bd.simulate(swing_model, bd.GeneralizedAlpha(step=2.5e-4))


def test_grid_returns_all_combinations_in_order():
    assert bd.grid(a=[1, 2], b=["x", "y"]) == [
        {"a": 1, "b": "x"},
        {"a": 1, "b": "y"},
        {"a": 2, "b": "x"},
        {"a": 2, "b": "y"},
    ]
    assert bd.grid() == [{}]


def test_each_case_has_a_row_with_its_parameters():
    cases = [bd.Case(swing_model, p, FINE_ALPHA) for p in bd.grid(mass=[1.0, 3.0], torque=[0.5])]
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
    solution = bd.Case(swing_model, {"mass": 7}, FINE_ALPHA).solve(t_end=0.01)
    assert solution.model["parameters"]["mass"] == 7.0
    assert swing_model.parameters["mass"] == 2.0
    with pytest.raises(bd.BeamdaeError, match="no parameter 'mas'"):
        bd.Case(swing_model, {"mas": 7}, FINE_ALPHA).solve()


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
    assert bd.Case(swing_model, {}, integrator).label == label


def test_error_is_the_largest_deviation_relative_to_the_amplitude(fine):
    coarse = bd.Case(swing_model, {}, bd.GeneralizedAlpha(step=0.02)).solve()
    # Rates and forces are left out.
    columns = ["end.x [m]", "end.y [m]", "end.angle [rad]"]
    exact = fine.observed[columns].to_numpy()
    difference = np.abs(coarse.observed[columns].to_numpy() - exact).max(axis=0)
    expected = np.max(2.0 * difference / (exact.max(axis=0) - exact.min(axis=0)))
    (error,) = bd.compare([bd.Case(swing_model, {}, bd.GeneralizedAlpha(step=0.02))], fine)[
        "error [-]"
    ]
    assert error == pytest.approx(expected, rel=1e-12)
    assert error > 1e-5


def test_errors_by_column_are_at_the_end_the_maximum_and_the_root_mean_square(fine):
    coarse = bd.Case(swing_model, {}, bd.GeneralizedAlpha(step=0.02))
    exact = fine.observed["end.x [m]"].to_numpy()
    error = np.abs(coarse.solve().observed["end.x [m]"].to_numpy() - exact)
    (row,) = bd.compare([coarse], fine).to_dict("records")
    assert row["error of end.x, end [m]"] == pytest.approx(error[-1])
    assert row["error of end.x, max [m]"] == pytest.approx(error.max())
    assert row["error of end.x, rms [m]"] == pytest.approx(np.sqrt(np.mean(error**2)))


def test_references_are_interpolated_at_the_output_times_of_a_case(fine):
    case = bd.Case(swing_model, {}, bd.GeneralizedAlpha(step=2.5e-4))
    # The same steps, interpolated at times without a row of the reference.
    assert bd.compare([case], fine, output_step=0.013)["error [-]"][0] < 1e-12


def test_a_model_without_a_consistent_start_is_a_row():
    table = bd.compare([bd.Case(redundant, {}, FINE_ALPHA), bd.Case(swing_model, {}, FINE_ALPHA)])
    assert table["status"][0] == "failed"
    assert "depend on each other" in table["reason"][0]
    assert np.isnan(table["reached [s]"][0])
    assert table["steps"].isna().tolist() == [True, False]
    assert table["status"][1] == "ok"


def test_failed_runs_are_compared_up_to_the_time_they_reached():
    reference = bd.Case(singular_torque, {"limit": 1.0}, FINE_ALPHA)
    (row,) = bd.compare([bd.Case(singular_torque, {}, FINE_ALPHA)], reference).to_dict("records")
    assert row["status"] == "failed"
    assert row["reason"].startswith("stopped at t = 0.2 s")
    assert row["reached [s]"] == pytest.approx(0.2)
    assert 0.0 < row["error [-]"] < 1.0
    assert np.isnan(row["error of bob.angle, end [rad]"])


@pytest.mark.parametrize(
    ("case", "reference", "message"),
    [
        (swing_model, "fine", "reference must be a Case or a Solution, got 'fine'"),
        (
            swing_model,
            bd.Case(singular_torque, {}, FINE_ALPHA),
            "the reference run with .*stopped at t = 0.2",
        ),
        (
            singular_torque,
            bd.Case(swing_model, {}, FINE_ALPHA),
            r"a case does not observe the column end.x",
        ),
    ],
)
def test_references_that_no_case_can_be_compared_with_are_refused(case, reference, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.compare([bd.Case(case, {}, FINE_ALPHA)], reference)


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
        mech = swing_model()
        mech.observe("bob", mech.ground.at(1.0, 0.0))
        return mech

    with pytest.raises(bd.BeamdaeError, match=message):
        bd.compare(
            [bd.Case(at_rest, {}, FINE_ALPHA)], bd.Case(at_rest, {}, FINE_ALPHA), columns=columns
        )


def test_progress_receives_the_label_of_the_case():
    calls = []
    case = bd.Case(swing_model, {}, bd.GeneralizedAlpha(step=1e-3))
    bd.compare([case], progress=lambda label, t: calls.append((label, t)))
    assert {label for label, _ in calls} == {case.label}
    assert 0.0 < calls[0][1] <= 0.4


@pytest.mark.parametrize("failing", ["GeneralizedAlpha", "reference"])
def test_exceptions_of_progress_end_the_comparison(failing):
    """In the reference run, they were reported as a failure of the model."""

    def fail(label, t):
        if label.startswith(failing):
            raise ValueError("no display")

    case = bd.Case(swing_model, {}, bd.GeneralizedAlpha(step=1e-3))
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
    table = bd.compare([bd.Case(drifting, {}, FINE_ALPHA)], reference)
    for name in ("drift", "energy.x", "error"):
        assert table[f"error of {name}, max [-]"][0] > 0.0


def test_observables_with_names_of_the_ledger_are_refused():
    mech = swing_model()
    for name in ("energy", "energy.x", "t"):
        with pytest.raises(bd.BeamdaeError, match=f"the observable name '{name}' is reserved for"):
            mech.observe(name, mech.part("bob").at(2.0, 0.0))
