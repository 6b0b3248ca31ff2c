"""Option --no-picture of all commands that draw, and the order of their output."""

from pathlib import Path

import pytest
from command_line import invoke, succeed
from model_texts import COLUMN as MODEL

import beamdae as bd

COMMANDS = {
    "run": ["--no-estimate"],
    "sweep": ["--over", "force=1,2", "--jobs", "1"],
    "static": [],
    "modes": [],
    "buckling": [],
    "bode": ["--output", "tip.y"],
}


def call(tmp_path, command, *options):
    path = tmp_path / "column.py"
    path.write_text(MODEL)
    arguments = [command, str(path), *COMMANDS[command], *options, "--out", str(tmp_path / "out")]
    result = invoke(*arguments)
    return result, {x.suffix for x in tmp_path.glob("out/**/*") if x.is_file()}


@pytest.mark.parametrize(
    "command",
    [
        *("run", "static", "modes", "buckling", "bode"),
        pytest.param("sweep", marks=pytest.mark.slow(reason="starts a process")),
    ],
)
def test_no_picture_skips_the_pictures_and_keeps_the_tables(tmp_path, command):
    result, kinds = call(tmp_path, command, "--no-picture")
    assert result.exit_code == 0, result.output
    assert ".csv" in kinds
    assert not kinds & {".png", ".svg"}
    assert ".html" in kinds


@pytest.mark.parametrize(
    ("command", "options", "names"),
    [
        ("static", ["--no-picture", "--no-page"], ["column_static.html", "column_static.png"]),
        ("modes", ["--no-picture", "--no-page"], ["column_modes.html", "column_modes.png"]),
        (
            "buckling",
            ["--no-picture", "--no-page"],
            ["column_buckling.html", "column_buckling.png"],
        ),
        ("run", ["--no-picture", "--no-page"], ["column.html", "column.png"]),
        pytest.param(
            "sweep",
            ["--no-picture", "--no-page"],
            ["column_sweep_force/report.html", "column_sweep_force/response.png"],
            marks=pytest.mark.slow(reason="starts a process"),
        ),
    ],
)
def test_regression_skipped_pictures_of_earlier_results_are_removed(
    tmp_path, command, options, names
):
    """Old pictures and pages stayed beside new tables."""
    old = [tmp_path / "out" / name for name in names]
    mine = old[0].with_name("mine.png")
    mine.parent.mkdir(parents=True)
    for path in (*old, mine):
        path.touch()
    result, _ = call(tmp_path, command, *options)
    assert result.exit_code == 0, result.output
    assert mine.exists()
    assert not any(path.exists() for path in old)
    removed = [x for x in result.output.splitlines() if x.startswith("removed: ")]
    assert [Path(x[9:].partition(",")[0]).name for x in removed] == [path.name for path in old]


@pytest.mark.slow(reason="starts a process")
def test_a_study_prints_its_results_before_it_writes_page_and_pictures(tmp_path, monkeypatch):
    def fail(*arguments):
        raise bd.BeamdaeError("this file fails")

    monkeypatch.setattr("beamdae.studies.sweeps.sweep_results.write_page", fail)
    monkeypatch.setattr("beamdae.report.pictures.figures.save_figure", fail)
    result, kinds = call(tmp_path, "sweep")
    assert result.exit_code == 1
    results, *failures = result.output.split("failed: this file fails")
    assert "2 cases, 2 reached the end time" in results
    assert len(failures) == 2
    assert not kinds & {".html", ".png", ".svg"}
    result, kinds = call(tmp_path, "sweep", "--no-picture", "--no-page")
    assert result.exit_code == 0
    assert not kinds & {".html", ".png", ".svg"}


@pytest.mark.slow(reason="half a second and more")
def test_run_draws_the_selected_columns_over_another_one_and_measured_data(tmp_path):
    path, data = tmp_path / "column.py", tmp_path / "measured.csv"
    path.write_text(MODEL)
    data.write_text("t [ms],tip.x [mm],tip.y [mm]\n0,0,1000\n2,0,999\n")
    options = ["--no-estimate", "--no-page", "--out", str(tmp_path / "out")]
    plot = ["--plot", "tip.y", "--plot", "strut", "--x", "tip.x", "--data", str(data)]
    succeed("run", str(path), *plot, *options)
    assert (tmp_path / "out/column.png").stat().st_size > 5000
    options = ["--no-estimate", "--no-picture", "--out", str(tmp_path / "out")]
    succeed("run", str(path), "--data", str(data), *options)
    assert "data of tip.x [m]" in (tmp_path / "out/column.html").read_text()


@pytest.mark.slow(reason="a fifth of a second")
def test_static_draws_columns_over_another_one(tmp_path):
    result, kinds = call(tmp_path, "static", "--plot", "tip.y", "--x", "tip.x", "--no-page")
    assert result.exit_code == 0, result.output
    assert ".png" in kinds
