"""The command line in scripts: --json and --quiet."""

import json
import re
from pathlib import Path

import pytest
from command_line import invoke, succeed
from study_runs import run_serially
from terminals import process, shell

MODEL = '''
import sys

import beamdae as bd

print("printed by the model")


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
# The value of the law is not real after t = 0.0105 s.
FAILING = "mech.add(bd.Moment('m', on=bob.at(0.0, 0.0), law=lambda t: t * (0.0105 - t) ** 0.5))"
COMMON = {"command", "exit_code", "files", "warnings", "errors"}
# Arguments with which each command exits with 0, and keys of its document.
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


def parse(text):
    """Parse a JSON document as a strict reader does."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


@pytest.mark.parametrize("command", KEYS)
def test_json_document_of_each_command(here, command):
    arguments, keys = KEYS[command]
    result = succeed(command, *arguments, "--json")
    document = parse(result.stdout)
    assert set(document) >= COMMON | keys
    assert (document["command"], document["exit_code"], document["errors"]) == (command, 0, [])
    assert all(Path(file).is_file() for file in document["files"])
    # Output of the model goes to standard error.
    assert "printed by the model" not in result.stdout
    if "model" in keys:
        assert document["model"]["name"] == "arm"
        assert document["model"]["parameters"] == {"mass": 2.0}
        assert "printed by the model" in result.stderr


@pytest.mark.slow(reason="half a second")
def test_the_guide_lists_the_keys_of_documents(here):
    guide = Path(__file__).parents[2] / ".docs" / "guide" / "commands.md"
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", guide.read_text(encoding="utf-8"), re.MULTILINE)
    guide_keys = {command: set(re.findall(r"`([^`]+)`", keys)) for command, keys in rows}
    others = {
        "bode",
        "buckling",
        "compare",
        "export",
        "fit",
        "optimize",
        "periodic",
        "response",
        "sweep",
    } | {"view"}
    assert set(guide_keys) == (KEYS.keys() | others) - {"new"}
    for command in ("check", "static", "draw"):
        document = parse(invoke(command, *KEYS[command][0], "--json").stdout)
        assert guide_keys[command] <= set(document)
    for command, (_, keys) in KEYS.items():
        assert keys - {"model"} <= guide_keys.get(command, set())


@pytest.mark.parametrize("command", KEYS)
def test_a_quiet_command_prints_nothing(here, command):
    Path("model.py").write_text(MODEL.replace("print", "len"), encoding="utf-8")
    result = invoke(command, *KEYS[command][0], "--quiet")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")


@pytest.mark.slow(reason="runs a model")
def test_json_document_of_a_run(here):
    document = parse(invoke("run", "model.py", "--json", "--set", "mass=3").stdout)
    assert document["model"]["parameters"] == {"mass": 3.0}
    assert document["result"]["last_time"] == 0.02
    fall = document["observed"]["tip.y [m]"]
    assert fall["min"] == fall["end"] < fall["max"] == 0.0
    assert 0.0 < fall["total"] < 1e-3
    assert [Path(file).suffix for file in document["files"]][:2] == [".csv", ".json"]


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("option", ["--json", "--quiet"])
def test_failures_and_usage_errors_keep_their_code_and_message(here, option):
    Path("failing.py").write_text(MODEL.replace("# more", FAILING), encoding="utf-8")
    for code, words, arguments in (
        (1, "failed: ", ["run", "failing.py", "--integrator", "generalized-alpha"]),
        (2, "error: gone.py: there is no such file.", ["check", "gone.py"]),
        (2, "no parameter 'mas'", ["run", "model.py", "--set", "mas=3"]),
        (2, "error: beamdae run: no such option: --bogus", ["run", "model.py", "--bogus"]),
        (2, "no such option: --n (Possible options: --number)", ["modes", "model.py", "--n", "3"]),
        (2, "error: beamdae run: invalid value for '--rtol'", ["run", "model.py", "--rtol=x"]),
        (2, "error: beamdae run: missing argument 'MODEL.py'", ["run"]),
        (2, "error: beamdae: no such command 'rum', did you mean 'run'?", ["rum"]),
    ):
        result = invoke(*arguments, option)
        assert result.exit_code == code, result.output
        (line,) = [x for x in result.stderr.splitlines() if x != "printed by the model"]
        assert words in line
        if option == "--json":
            document = parse(result.stdout)
            assert (document["exit_code"], document["errors"]) == (code, [line])
            assert "observed" in document or code == 2
        else:
            assert result.stdout.replace("printed by the model\n", "") == ""


def test_a_file_that_cannot_be_parsed_is_a_row_of_the_list(here):
    Path("bad.py").write_text("from beamdae import study\n1 /\n", encoding="utf-8")
    result = invoke("list", ".", "--json")
    document = parse(result.stdout)
    assert (result.exit_code, document["exit_code"]) == (1, 1)
    assert [row["name"] for row in document["models"]] == ["arm"]
    assert [row["file"] for row in document["problems"]] == ["bad.py"]


@pytest.mark.slow(reason="runs a study twice")
def test_json_document_of_a_study(here, monkeypatch):
    run_serially(monkeypatch)
    result = invoke("compare", "model.py", "--json")
    document = parse(result.stdout)
    assert result.exit_code == 0, result.output
    assert set(document) >= COMMON | {"study", "folder", "references", "cases", "summary"}
    assert [case["status"] for case in document["cases"]] == ["ok"] * 5
    assert ": 8/8, 0:00 left" in result.stderr
    result = invoke("compare", "model.py", "--quiet")
    assert (result.exit_code, result.stderr) == (0, "")


@pytest.mark.slow(reason="starts processes")
def test_standard_output_of_a_process_is_only_the_document(here):
    """Output of other processes and of code below Python goes to standard error."""
    noise = "import os\nos.system('echo below')\n"
    Path("model.py").write_text(noise + MODEL, encoding="utf-8")
    code, output, errors = shell("{beamdae} compare model.py --json")
    assert (code, parse(output)["exit_code"]) == (0, 0)
    assert "below" in errors
    assert shell("{beamdae} run model.py --json | true")[0] == 0
    code, _, errors = shell("{beamdae} run model.py --json --quiet >/dev/full")
    assert (code, "standard output cannot be written" in errors) == (2, True)


@pytest.mark.slow(reason="starts a process")
def test_an_interrupted_run_prints_its_document(here):
    strike = "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n"
    Path("model.py").write_text(strike + MODEL, encoding="utf-8")
    command = process("run", "model.py", "--json")
    output, errors = command.communicate(timeout=60)
    assert command.returncode == parse(output)["exit_code"] == 130
    assert parse(output)["errors"] == errors.splitlines()


@pytest.mark.slow(reason="prints help at several widths")
def test_help_lists_exit_codes_and_is_wrapped_at_every_width():
    assert "Exit codes: 0 success" in invoke("--help").stdout
    assert invoke("modes", "-h").stdout == invoke("modes", "--help").stdout
    for width in (20, 40, 60, 100):
        text = invoke("run", "--help", env={"COLUMNS": str(width)}).stdout
        # Boxes would cut words on narrow screens.
        assert ("╭" in text) == (width >= 80)
        if 40 < width < 80:
            assert max(map(len, text.splitlines())) <= width
        if width < 80:
            assert "…" not in text
        paragraph = " ".join(text.split())
        assert "--quiet" in paragraph
        assert width < 40 or "If a run ends early, it is written to NAME.run" in paragraph
