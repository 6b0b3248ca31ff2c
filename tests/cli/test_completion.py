"""Shell completion, which does not execute models."""

from pathlib import Path

import pytest
from terminals import process

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
    "parameters of one model": (
        ["beamdae", "run", "model.py", "--model", "leg", "--set", ""],
        "mass=2.0",
    ),
    "parameter with a default that a shell would split": (
        ["beamdae", "run", "model.py", "--set", "sp"],
        "speed=",
    ),
    "models and studies": (
        ["beamdae", "run", "model.py", "--model", ""],
        "arm leg all_of_them",
    ),
    "missing file": (["beamdae", "run", "gone.py", "--set", ""], ""),
    "file": (["beamdae", "check", "mo"], "model.py"),
    "files and folders": (["beamdae", "check", ""], "model.py empty/ sub/"),
    "file in a folder": (["beamdae", "check", "sub/"], "sub/other.py"),
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
