"""Shell completion, which does not execute models."""

from pathlib import Path

import pytest
from terminals import process

from beamdae.cli import completion
from beamdae.cli.model_files.example_files import example_names
from beamdae.cli.model_files.outline import read_outline

SOURCE = '''
import pathlib

pathlib.Path("ran").touch()

import beamdae as bd
from beamdae import model as m


@bd.model(t_end=1.0)
def arm(length=1.0, kind="exact", *, speed=2 * 3.14, needed):
    """One."""


@m(t_end=2.0)
def leg(mass=2.0):
    """Another of `mass` [kg]."""


@bd.study()
def all_of_them():
    return []


@bd.measure
def no_model(depth=1):
    return {}
'''


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(SOURCE, encoding="utf-8")
    Path("notes.txt").touch()
    Path("sub").mkdir()
    Path("sub/other.py").touch()
    Path("empty").mkdir()
    return tmp_path


def test_an_outline_is_read_without_executing_the_file(here):
    outline = read_outline(Path("model.py"))
    assert outline.defines
    assert outline.models == {
        "arm": {"length": "1.0", "kind": "'exact'", "speed": "2 * 3.14", "needed": ""},
        "leg": {"mass": "2.0"},
    }
    assert outline.studies == ("all_of_them",)
    assert not read_outline(Path("sub/other.py")).defines
    assert not read_outline(Path("gone.py")).defines
    assert not Path("ran").exists()


def test_an_outline_reads_defaults_with_units(tmp_path):
    source = """import beamdae as bd
@bd.model(t_end=1.0)
def arm(a=bd.param(0.85, "m", "radius"), b=bd.param(2, description="count"), c=bd.param(3)):
    \"\"\"`a` [mm].\"\"\"
"""
    (tmp_path / "arm.py").write_text(source, encoding="utf-8")
    outline = read_outline(tmp_path / "arm.py")
    assert outline.models == {"arm": {"a": "0.85", "b": "2", "c": "3"}}
    assert outline.hints == {
        "arm": {"a": "default 0.85 m: radius", "b": "default 2: count", "c": "default 3"}
    }


@pytest.mark.parametrize(
    ("source", "defines"),
    [
        ("bd.sweep(bd.load_model('model.py'), {'mass': [1.0]})\n", False),
        ("from beamdae import sweep, load_model\nsweep(load_model('model.py'), {})\n", False),
        ("@bd.sweep(None, {})\ndef masses(run):\n    return {}\n", True),
        ("from beamdae import sweep\n@sweep(None, {})\ndef masses(run):\n    return {}\n", True),
        ("all_of_them = bd.study(None)\n", True),
    ],
)
def test_regression_a_script_that_only_uses_models_defines_none(tmp_path, source, defines):
    (tmp_path / "script.py").write_text("import beamdae as bd\n" + source, encoding="utf-8")
    assert read_outline(tmp_path / "script.py").defines is defines


def test_model_files_folders_and_examples(here):
    assert completion.complete_model_files("") == ["model.py", "empty/", "sub/"]
    assert completion.complete_model_files("sub/") == ["sub/other.py"]
    assert completion.complete_model_files("./mo") == ["./model.py"]
    # Without a model file the shell completes by itself.
    for typed in ("empty/", "no", "gone/", "sub"):
        assert completion.complete_model_files(typed) == []
    assert completion.complete_model_files("exam") == [
        f"example:{name}" for name in example_names()
    ]


def test_parameters_and_models_of_the_file_on_the_line(here, monkeypatch):
    monkeypatch.delenv("COMP_WORDS", raising=False)
    line = "_TYPER_COMPLETE_ARGS"
    monkeypatch.setenv(line, "beamdae run model.py --set ")
    words = [word for word, _ in completion.complete_parameters()]
    # Defaults that a shell would split are omitted.
    assert words == ["length=1.0", "kind=exact", "speed=", "needed=", "mass=2.0"]
    monkeypatch.setenv(line, "beamdae run model.py --model leg --set ")
    assert completion.complete_parameters() == [
        ("mass=2.0", "default 2.0 kg: Another of `mass` [kg].")
    ]
    assert completion.complete_models() == ["arm", "leg", "all_of_them"]
    for other in ("", "run gone.py", "run example:gone", "run 'open model.py"):
        monkeypatch.setenv(line, other)
        assert completion.complete_parameters() == [] or "open" in other
    assert not Path("ran").exists()


# Words as bash splits them, the last of which is completed, and its completion.
BASH = {
    "command": (["beamdae", "mod"], "modes"),
    "example": (["beamdae", "run", "example", ":", "gov"], "governor"),
    "parameter": (["beamdae", "run", "model.py", "--set", "le"], "length=1.0"),
    "value": (["beamdae", "run", "model.py", "--set", "mass", "="], "2.0"),
    "parameter of an example": (
        ["beamdae", "run", "example", ":", "governor", "--set", "to"],
        "torque=0.6",
    ),
    "option": (["beamdae", "run", "model.py", "--integrator", "=", "ra"], "radau"),
    "file": (["beamdae", "check", "mo"], "model.py"),
    "file of the shell": (["beamdae", "run", "model.py", "--out", "e"], ""),
}


@pytest.mark.slow(reason="starts processes")
@pytest.mark.parametrize(("words", "expected"), BASH.values(), ids=BASH)
def test_bash_completes_words_it_splits(here, words, expected):
    variables = {"COMP_WORDS": "\n".join(words), "COMP_CWORD": str(len(words) - 1)}
    command = process(environment={"_BEAMDAE_COMPLETE": "complete_bash", **variables})
    output, errors = command.communicate(timeout=60)
    assert (command.returncode, errors) == (0, "")
    assert output.split() == expected.split()
    assert not Path("ran").exists()


@pytest.mark.slow(reason="starts a process")
def test_completion_is_installed_for_the_named_shell(here):
    command = process(
        "--install-completion",
        "bash",
        environment={"HOME": str(here), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
    )
    _, errors = command.communicate(timeout=60)
    assert command.returncode == 0, errors
    assert "_BEAMDAE_COMPLETE" in Path(".bash_completions/beamdae.sh").read_text()
