"""The programs of validation/performance with little to do: they come to their ends, and tables."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

FOLDER = Path(__file__).parents[2] / "validation" / "performance"
sys.path.insert(0, str(FOLDER))

pytestmark = pytest.mark.slow(reason="loops that are compiled, runs in turns")


def test_times_of_runs_and_of_what_they_consist_of():
    import benchmark

    lines = benchmark.runs(1, benchmark.SYSTEMS[:1])
    assert len(lines) == len(benchmark.INTEGRATORS)
    assert (lines["calls [s]"] > 0.0).all()
    assert (lines["run [s]"] > 0.0).all()
    # Another machine's load is in one of them alone: no more than an order is sure.
    assert lines["price of Python"].between(0.1, 100.0).all()


def test_a_checkout_beside_itself_takes_the_same_time():
    import benchmark

    lines = benchmark.beside_before(FOLDER.parents[1], 3, benchmark.SYSTEMS[:1])
    assert lines["of medians"].between(0.2, 5.0).all()


def test_cost_of_small_sizes(tmp_path):
    import scaling

    lines = pd.DataFrame([scaling.measured(scaling.beam, size, 1) for size in (2, 4, 8)])
    assert (lines[list(scaling.TIMES[:-1])] > 0.0).all(axis=None)
    assert list(scaling.slopes(lines, "beam", 2)["sizes"]) == ["2 to 4", "4 to 8", "from 2 on"]
    scaling.draw([(lines, "beam", "elements")], tmp_path / "scaling.png")
    assert scaling.measured(scaling.ring, 4, 1)["unknowns"] > 0
    assert scaling.measured(scaling.exact, 4, 1)["unknowns"] > 0
    assert set(scaling.motions(1, 2)["model"]) == {"exact", "beam"}


def test_time_of_mechanisms_over_what_their_size_predicts(monkeypatch):
    import mechanisms

    monkeypatch.setattr(mechanisms, "STEPS", 200)
    lines = mechanisms.compared(1)
    assert list(lines["four-bar"]) == list(mechanisms.CASES)
    assert (lines[["step [us]", "predicted [us]", "ratio by residual"]] > 0.0).all(axis=None)


def test_errors_against_the_stored_reference(tmp_path):
    import work_precision as wp

    case = wp.CASES[0]
    settings = [
        setting
        for setting in wp.settings_of(case, None, quick=False)
        if setting.mesh == "1 x 6" and setting.integrator in ("GeneralizedAlpha(step=0.001)",)
    ]
    lines = wp.timed(wp.tried(case, settings, wp.reference(case)), settings, 1)
    # Steps of 1 ms; the mesh and the floating frame are worth 0.02 mm.
    assert lines["error [mm]"].between(0.005, 0.1).all()
    assert wp.best(lines)["beamdae"].notna().any()
    wp.draw(lines, tmp_path / "picture.png")


def test_without_exudyn_a_sentence_says_so():
    code = "import sys, workers; print(workers.exudyn(sys.argv[1]))"
    missing = [sys.executable, "-c", code, str(FOLDER / "no interpreter")]
    found = subprocess.run(missing, cwd=FOLDER, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "None"
    assert "are skipped." in found.stderr
