"""Screens of commands at all widths, and commands without pictures."""

import re
from pathlib import Path

import pytest
import typer
from command_line import app, invoke, succeed
from model_texts import COLUMN
from terminals import in_terminal, process

import beamdae as bd

WIDTHS = (60, 80, 120)
MODEL = '''
import beamdae as bd


@bd.model(t_end=1.0)
def arm(mass=2.0, note="[/b] :smile:"):
    """A bob [/b] swings."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge :smile:", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("tip :smile:", bob.at(1.0, 0.0))
    return mech
'''


STUDY = """

@bd.study(references=(bd.Ida(1e-8), bd.GeneralizedAlpha(2e-3)))
def both():
    integrators = [bd.Ida(1e-4), bd.GeneralizedAlpha(5e-3)]
    return [bd.Case(arm, {"note": "[/b] :smile:"}, integrator) for integrator in integrators]
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Working folder with a model and a study."""
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(MODEL + STUDY, encoding="utf-8")
    Path("data.csv").write_text("t [s],tip :smile:.y [m]\n0.1,-0.04\n0.2,-0.18\n", encoding="utf-8")
    return tmp_path


@pytest.mark.slow(reason="starts processes in terminals")
@pytest.mark.parametrize("width", WIDTHS)
def test_run_in_a_terminal(here, width):
    code, lines, _ = in_terminal(width, "run", "model.py", "--verify")
    assert code == 0, lines
    bars = [line for line in lines if re.search(r"\d/1 s ", line)]
    assert any(re.search(r" \d:\d\d left ", line) for line in bars)
    assert any("verification" in line for line in bars)
    table = [line for line in lines if line.strip().startswith("tip :smile:")]
    assert len(table) == 6
    for line in table:
        assert 0.0 <= float(line.partition("]")[2].split()[1]) < 1e-3
    assert all(len(line) <= width for line in lines if not line.startswith("written"))
    assert not any("…" in line for line in table)


@pytest.mark.slow(reason="runs studies in terminals")
@pytest.mark.parametrize("width", WIDTHS)
def test_study_in_a_terminal(here, width):
    code, lines, _ = in_terminal(width, "compare", "model.py")
    assert code == 0, lines
    bars = [line for line in lines if re.search(r"\b[0-5]/5\b", line)]
    assert any(re.search(r" \d:\d\d left", line) for line in bars)
    assert all(len(line) <= width for line in bars)
    for label in ("Ida(rtol=0.0001)", "GeneralizedAlpha(step=0.005)"):
        (row,) = [line for line in lines if line.startswith(f" {label}") and " ok " in line]
        assert "…" not in row
    assert "a wider terminal or cases.csv shows them" in " ".join(" ".join(lines).split())


# Arguments of the other commands, and text that is complete at every width.
COMMANDS = {
    "list": (["."], ["arm", "both"]),
    "check": (["model.py"], ["tip :smile:", "ready to run"]),
    "draw": (["model.py"], ["arm"]),
    "static": (["model.py"], ["reached the end", "tip :smile:.x [m]"]),
    "modes": (["model.py", "-n", "1"], ["frequency", "kind", "moves"]),
    "fit": (["model.py", "data.csv", "--by", "mass", "--sigma", "0.01"], ["mass", "converged"]),
    "sweep": (["model.py", "--over", "mass=1,2", "--of", "tip :smile:.y"], ["2 cases, 2 reached"]),
    "examples": ([], ["leaf_spring_vehicle"]),
    "new": (["mine.py"], ["beamdae run mine.py."]),
}


@pytest.mark.slow(reason="starts processes in terminals")
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_fits_the_terminal(here, command):
    arguments, words = COMMANDS[command]
    for width in WIDTHS:
        Path("mine.py").unlink(missing_ok=True)
        code, lines, _ = in_terminal(width, command, *arguments)
        assert code == 0, lines
        lines = [line for line in lines if not line.startswith("written: ")]
        assert max(map(len, lines)) <= width
        text = " ".join(" ".join(lines).split())
        for word in words:
            assert word in text


def test_errors_wrap_at_the_width_of_the_terminal(here):
    arguments = "run", "model.py", "--integrator", "unknown"
    lines = invoke(*arguments, env={"COLUMNS": "60"}).stderr.splitlines()
    assert len(lines) > 1
    assert max(map(len, lines)) <= 60
    assert invoke(*arguments).stderr == " ".join(lines) + "\n"


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize(
    "width",
    [
        "20",
        *(pytest.param(width, marks=pytest.mark.slow(reason="as 20")) for width in ("40", "200")),
    ],
)
def test_lists_and_facts_at_extreme_widths(here, width):
    for command in (["list", "."], ["check", "model.py", "--no-predict"], ["examples"]):
        result = succeed(*command, env={"COLUMNS": width})
        assert max(map(len, result.stdout.splitlines())) <= int(width)
        assert ("not shown:" in result.stdout) == (command[0] == "list" and width != "200")


@pytest.mark.slow(reason="starts a process in a terminal")
def test_the_progress_bar_restores_the_cursor_and_disappears(here):
    _, _, text = in_terminal(60, "run", "model.py")
    assert text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l")
    last = text[text.rindex("\x1b[?25h") :]
    assert "/1 s" not in last


@pytest.mark.slow(reason="starts processes")
def test_no_bar_in_a_dumb_terminal_without_a_terminal_or_if_quiet(here):
    for environment, more in (({"TERM": "dumb"}, []), ({}, ["--quiet"]), ({}, ["--json", "-q"])):
        _, lines, text = in_terminal(60, "run", "model.py", *more, environment=environment)
        assert "\x1b[?25l" not in text
        assert not any("/1 s" in line for line in lines)
    _, errors = process("run", "model.py").communicate(timeout=60)
    assert errors == ""


@pytest.mark.slow(reason="starts processes in terminals")
def test_no_color_is_respected(here):
    _, _, colored = in_terminal(80, "run", "model.py", "--t-end", "0.01")
    _, _, plain = in_terminal(
        80, "run", "model.py", "--t-end", "0.01", environment={"NO_COLOR": "1"}
    )
    color = r"\x1b\[[0-9;]*3[0-9]"
    assert re.search(color, colored)
    assert not re.search(color, plain)


@pytest.mark.slow(reason="starts processes")
def test_lines_in_a_pipe_are_not_wrapped_unless_columns_is_set(here):
    rows = {}
    for columns in ("", "50"):
        environment = {"COLUMNS": columns} if columns else {}
        output, _ = process("run", "model.py", environment=environment).communicate(timeout=60)
        rows[columns] = output.splitlines()
        assert ("not shown" in output) == bool(columns)
    assert max(map(len, rows[""])) > 50
    assert max(map(len, rows["50"])) <= 50


# Progress of studies.


# Lists.
RUN = "import pathlib\npathlib.Path('ran').touch()\n"


# Files without models.
UNLISTED_FILES = {
    "script.py": RUN + "import beamdae as bd\nbd.simulate\n",
    "foreign.py": RUN + "import torch as bd\n@bd.model\ndef f(): pass\n",
    "broken.py": "1 / 0\n",
    "odd.py": "def (:\n",
}


def test_list_executes_no_files(here):
    for name, source in UNLISTED_FILES.items():
        Path(name).write_text(source)
    Path("bad.py").write_text(
        RUN + "from beamdae import model as m\n1 / 0\n"
        "@m(t_end=T)\ndef lone(length=2 * 3, kind='thin'):\n    pass\n"
    )
    Path("syntax.py").write_text("import beamdae as bd\n@bd.model(\n")
    result = invoke("list", ".", env={"COLUMNS": ""})
    assert result.exit_code == 1
    assert not Path("ran").exists()
    tables = {}
    for line in result.stdout.splitlines():
        if re.match(r" (model|study|file) ", line):
            rows = tables[line.split()[0]] = []
        elif line.strip() and "──" not in line and "t_end" not in line:
            rows.append(line.split())
    assert [" ".join(row) for row in tables["model"]] == [
        "lone bad.py T length=2 * 3, kind=thin",
        "arm model.py 1 mass=2, note=[/b] :smile: A bob [/b] swings.",
    ]
    assert tables["study"] == [["both", "model.py"]]
    assert [row[0] for row in tables["file"]] == ["syntax.py"]
    assert "syntax.py: line 2: " in result.stdout


def test_list_of_a_study_omits_models_of_other_files(here):
    Path("study.py").write_text(
        "import beamdae as bd\narm = bd.load_model('model.py')\n"
        "@bd.study()\ndef third():\n    return [bd.Case(arm)]\n"
    )
    result = succeed("list", "study.py")
    assert "third" in result.stdout
    assert "swings" not in result.stdout


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("columns", ["60", "400"])
def test_regression_help_texts_keep_brackets(monkeypatch, columns):
    """`beamdae run --help` printed 'tip.y ' instead of 'tip.y [mm]'."""
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setenv("TERMINAL_WIDTH", columns)
    found = []
    for name, command in typer.main.get_command(app).commands.items():
        texts = [command.help, *(getattr(x, "help", None) for x in command.params)]
        brackets = re.findall(r"\[[^\]]*\]", " ".join(filter(None, texts)))
        for _ in range(2 if name == "run" else 1):  # Texts are the same after a help page.
            shown = invoke(name, "--help").stdout
            assert [x for x in brackets if x not in shown] == [], name
        found += brackets
    assert "[mm]" in found


@pytest.mark.slow(reason="a fifth of a second")
def test_help_of_flags_does_not_mention_booleans():
    for command in ([], ["run"], ["compare"]):
        result = succeed(*command, "--help")
        assert "bool" not in result.stdout.lower()
    assert "--time-limit" in result.stdout


PICTURES = {
    "run": ["--no-estimate"],
    "sweep": ["--over", "force=1,2", "--jobs", "1"],
    "static": [],
    "modes": [],
    "buckling": [],
    "bode": ["--output", "tip.y"],
}


def call(tmp_path, command, *options):
    path = tmp_path / "column.py"
    path.write_text(COLUMN)
    arguments = [command, str(path), *PICTURES[command], *options, "--out", str(tmp_path / "out")]
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
def test_skipped_pictures_and_pages_of_earlier_results_stay_and_are_named(
    tmp_path, command, options, names
):
    old = [tmp_path / "out" / name for name in names]
    mine = old[0].with_name("mine.png")
    mine.parent.mkdir(parents=True)
    for path in (*old, mine):
        path.touch()
    result, _ = call(tmp_path, command, *options)
    assert result.exit_code == 0, result.output
    assert all(path.exists() for path in (*old, mine))
    lines = [x for x in result.output.splitlines() if x.startswith("not renewed: ")]
    assert [Path(x[13:].partition(",")[0]).name for x in lines] == [path.name for path in old]


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
    path.write_text(COLUMN)
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
