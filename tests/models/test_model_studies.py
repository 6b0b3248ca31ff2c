"""Study files in models/studies: their cases, and results of runs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from study_runs import LocalPool, ModelFile, run_study

import beamdae as bd

FOLDER = Path(__file__).parents[2] / "models" / "studies"
FILES = sorted(FOLDER.glob("*_integrators.py"))


def studies(path):
    return ModelFile(path).studies


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_a_study_has_at_least_sixty_cases_of_all_integrators(path):
    (study,) = studies(path).values()
    assert study.name == path.stem
    assert len(study.cases) >= 60
    assert {case.integrator.method for case in study.cases} == {"Ida", "Radau", "GeneralizedAlpha"}
    assert {case.parameters["elements"] for case in study.cases} == {4, 8}
    assert {case.parameters["damping"] > 0.0 for case in study.cases} == {True, False}


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_first_group_of_a_study_shows_the_expected_orders(path, tmp_path):
    (study,) = studies(path).values()
    first = [case for case in study.cases if case.group == study.cases[0].group]
    results = run_study(replace(study, cases=tuple(first)), tmp_path, LocalPool())
    assert set(results.table["status"]) == {"ok"}
    (reference,) = results.references.values()
    # References of two methods, one of order five, one extrapolated: far below all reported errors.
    assert reference.uncertainty < 1e-6
    errors = results.table["error [-]"].dropna()
    assert errors.min() >= reference.resolution
    summary = results.summary
    is_order = (summary["what"] == "order in step") & (summary["answer"] == "GeneralizedAlpha")
    orders = summary[is_order]
    assert_allclose(orders["value"].to_numpy(float), 2.0, atol=0.1)
    ida = results.table[results.table["series"] == "Ida"]["error [-]"].to_numpy()
    # On average proportional to rtol, over two or three decades.
    assert np.all(np.diff(ida) < 0.0)
    tolerances = np.array([case.tolerance for case in first if case.series == "Ida"])
    assert np.all(ida < 100.0 * tolerances)


@pytest.mark.slow
def test_study_of_both_formulations(tmp_path):
    (study,) = studies(FOLDER / "hub_beam_formulations.py").values()
    results = run_study(study, tmp_path, LocalPool())
    assert set(results.table["status"]) == {"ok"}
    assert {case.parameters.get("formulation") for case in study.cases} == {None, "exact"}


def test_a_study_file_may_name_a_model_in_another_folder(tmp_path):
    model = FOLDER.parent / "pendulum.py"
    (tmp_path / "mine.py").write_text(
        f"import beamdae as bd\npendulum = bd.load_model({str(model)!r})\n"
        "@bd.study()\ndef mine():\n    return [bd.Case(pendulum)]\n"
    )
    (study,) = studies(tmp_path / "mine.py").values()
    assert study.cases[0].model.name == "pendulum"
    assert isinstance(study, bd.results.Study)


@pytest.mark.slow
def test_crank_speed_sweep_gives_the_stored_torques_and_deflections(tmp_path):
    (sweep,) = studies(FOLDER / "crank_speeds.py").values()
    assert isinstance(sweep, bd.results.Sweep)
    assert len(sweep.cases) == 21
    speeds, excluded_rise = (2.0, 5.0, 8.0), 0.06
    indices = [
        k
        for k, setting in enumerate(sweep.settings)
        if setting["speed"] in speeds and setting["rise"] != excluded_rise
    ]
    few = replace(
        sweep,
        cases=tuple(sweep.cases[k] for k in indices),
        settings=tuple(sweep.settings[k] for k in indices),
    )
    table = few(tmp_path).table
    # Stored results of Radau(1e-7), equal to those of geometrically exact beams.
    torque = [4.44426, 4.40228, 5.01142, 4.80495, 6.03793, 6.04691]
    deflection = [1.08907e-3, 6.39882e-3, 1.23665e-3, 6.18689e-3, 1.83378e-3, 9.09667e-3]
    assert_allclose(table["peak torque [N m]"], torque, rtol=1e-3)
    assert_allclose(table["peak deflection [m]"], deflection, rtol=1e-3)
    assert np.all(np.diff(table["peak torque [N m]"].to_numpy()[1::2]) > 0.0)
