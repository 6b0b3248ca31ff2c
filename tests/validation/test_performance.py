"""Programs of validation/performance with short runs: they end and return tables."""

import sys
from pathlib import Path

import pandas as pd
import pytest

FOLDER = Path(__file__).parents[2] / "validation" / "performance"
sys.path.insert(0, str(FOLDER))

pytestmark = pytest.mark.slow(reason="compiles loops, and repeats runs in turns")


def test_times_of_runs_and_of_their_operations():
    import benchmark

    table = benchmark.time_runs(1, benchmark.SYSTEMS[:1])
    assert len(table) == len(benchmark.INTEGRATORS)
    assert (table["calls [s]"] > 0.0).all()
    assert (table["run [s]"] > 0.0).all()
    # The load of the machine may affect one of the two times, so only the order is certain.
    assert table["price of Python"].between(0.1, 100.0).all()


def test_checkout_takes_the_same_time_as_itself():
    import benchmark

    table = benchmark.compare_with_checkout(FOLDER.parents[1], 3, benchmark.SYSTEMS[:1])
    assert table["of medians"].between(0.2, 5.0).all()


def test_cost_of_small_sizes(tmp_path):
    import scaling

    table = pd.DataFrame([scaling.measure_costs(scaling.beam, size, 1) for size in (2, 4, 8)])
    assert (table[list(scaling.TIME_COLUMNS[:-1])] > 0.0).all(axis=None)
    scaling.draw_scaling([(table, "beam", "elements")], tmp_path / "scaling.png")
    assert scaling.measure_costs(scaling.ring, 4, 1)["unknowns"] > 0
    assert scaling.measure_costs(scaling.exact, 4, 1)["unknowns"] > 0
    assert set(scaling.time_motions(1, 2)["model"]) == {"exact", "beam"}


def test_errors_against_the_stored_reference(tmp_path):
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
    wp.draw_work_precision(table, tmp_path / "picture.png")


def test_cost_of_gradients():
    import gradients

    row = gradients.measure("hub_beam, 1", "GeneralizedAlpha", 0.02, 1)
    assert row["parameters"] == 1
    assert row["sweep [ms]"] > 0.0
    assert row["model function [ms]"] > 0.0
    assert row["gradient [ms]"] > row["sweep [ms]"]


def test_peak_memory_of_a_short_run():
    import peak_memory

    assert 0.01 < peak_memory.measure_peak(8, 20) < 10.0
