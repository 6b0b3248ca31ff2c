"""Programs of validation/performance with short runs: they end and return tables."""

import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "validation" / "performance"
sys.path.insert(0, str(FOLDER))

pytestmark = pytest.mark.slow


def test_checkout_takes_the_same_time_as_itself():
    import benchmark

    table = benchmark.compare_with_checkout(FOLDER.parents[1], 3, benchmark.SYSTEMS[:1])
    assert table["of medians"].between(0.2, 5.0).all()


def test_errors_against_the_stored_reference():
    import work_precision as wp

    case = wp.CASES[0]
    settings = [
        setting
        for setting in wp.list_settings(case, None, quick=False)
        if setting.mesh == "1 x 6" and setting.integrator in ("GeneralizedAlpha(step=0.001)",)
    ]
    table = wp.run_settings(case, settings, wp.load_reference(case.name))
    table = wp.time_finalists(table, settings, 1)
    # Mesh and floating frame have an error of 0.02 mm; the steps of 1 ms add to it.
    assert table["error [mm]"].between(0.005, 0.1).all()
    assert wp.select_fastest(table)["beamdae"].notna().any()
