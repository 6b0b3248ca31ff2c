"""The command line for scripts: one JSON document, or nothing but what went wrong."""

import json
import re
from pathlib import Path

import pytest
from terminals import process, shell
from typer.testing import CliRunner

from beamdae.cli.app import app
from beamdae.studies.execution.executors import SerialPool

MODEL = '''
import sys

import beamdae as bd

print("the model says")


@bd.model(t_end=0.02)
def arm(mass=2.0):
    """A bob swings."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("tip", bob.at(1.0, 0.0))
    # more
    return mech
'''
# The law leaves the real numbers on the way.
DEAD = "mech.add(bd.Moment('m', on=bob.at(0.0, 0.0), law=lambda t: t * (0.0105 - t) ** 0.5))"
COMMON = {"command", "exit_code", "files", "warnings", "errors"}
# Of each command that ends with 0: its arguments, and keys of its document.
KEYS = {
    "run": (["model.py"], {"model", "status", "reason", "result", "observed", "integrator"}),
    "check": (["model.py"], {"model", "ok", "mobility", "parts", "free_motions", "problem"}),
    "draw": (["model.py"], {"model", "parts"}),
    "static": (["model.py"], {"model", "status", "load factor", "observed", "points"}),
    "modes": (["model.py", "-n", "1"], {"model", "about", "modes"}),
    "list": (["."], {"models", "studies", "problems"}),
    "examples": ([], {"examples"}),
    "new": (["mine.py"], set()),
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(MODEL, encoding="utf-8")
    return tmp_path


def called(*arguments):
    return CliRunner().invoke(app, list(arguments))


def strict(text):
    """The one document of a standard output, as strict readers take it."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


@pytest.mark.parametrize("command", KEYS)
def test_the_document_of_each_command(here, command):
    arguments, keys = KEYS[command]
    result = called(command, *arguments, "--json")
    assert result.exit_code == 0, result.output
    told = strict(result.stdout)
    assert set(told) >= COMMON | keys
    assert (told["command"], told["exit_code"], told["errors"]) == (command, 0, [])
    assert all(Path(file).is_file() for file in told["files"])
    # What a model prints is not part of it.
    assert "the model says" not in result.stdout
    if "model" in keys:
        assert told["model"]["name"] == "arm"
        assert told["model"]["parameters"] == {"mass": 2.0}
        assert "the model says" in result.stderr


def test_the_guide_tells_the_keys_of_documents(here):
    guide = Path(__file__).parents[2] / ".docs" / "guide" / "commands.md"
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", guide.read_text(encoding="utf-8"), re.MULTILINE)
    told = {command: set(re.findall(r"`([^`]+)`", keys)) for command, keys in rows}
    assert set(told) == {*KEYS, "compare", "sweep"} - {"new"}
    for command in ("check", "static", "draw"):
        document = strict(called(command, *KEYS[command][0], "--json").stdout)
        assert told[command] <= set(document)
    for command, (_, keys) in KEYS.items():
        assert keys - {"model"} <= told.get(command, set())


@pytest.mark.parametrize("command", KEYS)
def test_a_quiet_command_says_nothing(here, command):
    Path("model.py").write_text(MODEL.replace("print", "len"), encoding="utf-8")
    result = called(command, *KEYS[command][0], "--quiet")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")


@pytest.mark.slow(reason="a run of the command")
def test_numbers_of_a_run(here):
    told = strict(called("run", "model.py", "--json", "--set", "mass=3").stdout)
    assert told["model"]["parameters"] == {"mass": 3.0}
    assert told["result"]["last_time"] == 0.02
    fall = told["observed"]["tip.y [m]"]
    assert fall["min"] == fall["end"] < fall["max"] == 0.0
    assert 0.0 < fall["error over half the range"] < 1e-3
    assert [Path(file).suffix for file in told["files"]][:2] == [".csv", ".json"]


@pytest.mark.parametrize("how", ["--json", "--quiet"])
def test_failures_and_mistakes_keep_their_code_and_sentence(here, how):
    Path("dead.py").write_text(MODEL.replace("# more", DEAD), encoding="utf-8")
    for code, words, arguments in (
        (1, "failed: ", ["run", "dead.py", "--integrator", "generalized-alpha"]),
        (2, "error: gone.py: there is no such file.", ["check", "gone.py"]),
        (2, "no parameter 'mas'", ["run", "model.py", "--set", "mas=3"]),
        (2, "error: beamdae run: no such option: --bogus", ["run", "model.py", "--bogus"]),
        (2, "error: beamdae run: invalid value for '--rtol'", ["run", "model.py", "--rtol=x"]),
        (2, "error: beamdae run: missing argument 'MODEL.py'", ["run"]),
        (2, "error: beamdae: no such command 'rum', did you mean 'run'?", ["rum"]),
    ):
        result = called(*arguments, how)
        assert result.exit_code == code, result.output
        (line,) = [x for x in result.stderr.splitlines() if x != "the model says"]
        assert words in line
        if how == "--json":
            told = strict(result.stdout)
            assert (told["exit_code"], told["errors"]) == (code, [line])
            assert "observed" in told or code == 2
        else:
            assert result.stdout.replace("the model says\n", "") == ""


def test_a_wrong_value_is_told_with_the_option(here):
    result = called("run", "model.py", "--rtol", "abc")
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert "'--rtol'" in line
    assert "'abc'" in line
    assert "beamdae run --help" in line


def test_a_broken_file_of_a_folder_is_a_row_of_the_list(here):
    Path("bad.py").write_text("from beamdae import study\n1 / 0\n", encoding="utf-8")
    result = called("list", ".", "--json")
    told = strict(result.stdout)
    assert (result.exit_code, told["exit_code"]) == (1, 1)
    assert [one["name"] for one in told["models"]] == ["arm"]
    assert [one["file"] for one in told["problems"]] == ["bad.py"]


@pytest.mark.slow(reason="a study, twice")
def test_the_document_of_a_study(here, monkeypatch):
    monkeypatch.setattr(
        "beamdae.studies.execution.executors.LocalPool", lambda workers: SerialPool()
    )
    result = called("compare", "model.py", "--json")
    told = strict(result.stdout)
    assert result.exit_code == 0, result.output
    assert set(told) >= COMMON | {"study", "folder", "references", "cases", "summary"}
    assert [case["status"] for case in told["cases"]] == ["ok"] * 5
    assert "8 of 8 runs" in result.stderr
    result = called("compare", "model.py", "--quiet")
    assert (result.exit_code, result.stderr) == (0, "")


@pytest.mark.slow(reason="processes of the command")
def test_nothing_but_the_document_comes_out_of_a_process(here):
    """Also what other processes and code below Python print goes elsewhere."""
    noise = "import os\nos.system('echo below')\n"
    Path("model.py").write_text(noise + MODEL, encoding="utf-8")
    code, output, errors = shell("{beamdae} compare model.py --json")
    assert (code, strict(output)["exit_code"]) == (0, 0)
    assert "below" in errors
    assert shell("{beamdae} run model.py --json | true")[0] == 0
    code, _, errors = shell("{beamdae} run model.py --json --quiet >/dev/full")
    assert (code, "standard output cannot be written" in errors) == (2, True)


@pytest.mark.slow(reason="a process of the command")
def test_an_interrupted_run_has_its_document(here):
    strike = "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n"
    Path("model.py").write_text(strike + MODEL, encoding="utf-8")
    command = process("run", "model.py", "--json")
    output, errors = command.communicate(timeout=60)
    assert command.returncode == strict(output)["exit_code"] == 130
    assert strict(output)["errors"] == errors.splitlines()


@pytest.mark.slow(reason="help of every width")
def test_help_tells_exit_codes_and_flows_at_every_width():
    for width in ("40", "100"):
        told = CliRunner().invoke(app, ["run", "--help"], env={"COLUMNS": width}).stdout
        assert "--json" in told
        assert "--quiet" in told
        assert "Exit codes: 0 done" in CliRunner().invoke(app, ["--help"]).stdout
        paragraph = " ".join(told.split()).split("Arguments")[0]
        assert "and so on; NAME.csv is that of all parts" in paragraph


def test_narrow_help_has_no_boxes_that_cut_words():
    for width in (20, 40, 60):
        told = CliRunner().invoke(app, ["run", "--help"], env={"COLUMNS": str(width)}).stdout
        assert "…" not in told
        assert "╭" not in told
        if width > 40:
            assert max(map(len, told.splitlines())) <= width
    assert "╭" in CliRunner().invoke(app, ["run", "--help"], env={"COLUMNS": "80"}).stdout
