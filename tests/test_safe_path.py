"""No process that beamdae starts imports a module from the working folder."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import beamdae as bd
from beamdae.core import compilers

# Modules of Python and packages that beamdae or multiprocessing import.
NAMES = (
    *("argparse", "ast", "calendar", "contextlib", "copy", "csv", "ctypes", "dataclasses"),
    *("datetime", "decimal", "enum", "fractions", "functools", "hashlib", "heapq", "inspect"),
    *("json", "logging", "multiprocessing", "numbers", "pickle", "platform", "queue", "random"),
    *("secrets", "selectors", "shutil", "signal", "socket", "string", "struct", "subprocess"),
    *("tempfile", "textwrap", "threading", "tokenize", "types", "typing", "uuid", "warnings"),
    *("weakref", "zipfile", "casadi", "cloudpickle", "numpy", "pandas", "scipy", "typer"),
)
# Python itself imports these from the working folder before `python -m` starts a program.
OF_PYTHON = subprocess.run(
    [sys.executable, "-c", "import runpy, pkgutil, sys; print(*sys.modules)"],
    capture_output=True,
    text=True,
    check=True,
).stdout.split()
MODULE = """
import sys
with open({log!r}, "a") as file:
    file.write(f"{{__name__}} {{sys.argv}}\\n")
raise ImportError(__name__)
"""
MODEL = """
import beamdae as bd

@bd.model(t_end=0.05)
def ball(mass=1.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", mass, at=(0.0, 1.0)))
    mech.observe("ball", ball.point)
    return mech

if __name__ == "__main__":
    raise SystemExit(bd.sweep(ball, over={"mass": [1.0, 2.0]}, jobs=2).table.empty)
"""
COMMANDS = {
    "sweep": "sweep {model} --over mass=1,2 --jobs 2",
    "compare": "compare {model} --jobs 2",
    "list": "list {folder}",
    "run": "run {model} --no-estimate",
    "export": "export {model} --fmu ball.fmu",
}


@pytest.fixture
def folder(tmp_path):
    """Working folder with files that have the names of modules, and a model in another folder."""
    work = tmp_path / "work"
    work.mkdir()
    for name in NAMES:
        (work / f"{name}.py").write_text(MODULE.format(log=str(tmp_path / "EXECUTED")))
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "ball.py").write_text(MODEL)
    return tmp_path


def run(folder, *arguments):
    root = str(Path(bd.__file__).parents[1])
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder / "work",
        env=os.environ | {"PYTHONPATH": root},
        capture_output=True,
        text=True,
        check=False,
    )


def require_success(folder, result):
    executed = folder / "EXECUTED"
    assert not executed.exists(), executed.read_text()
    assert result.returncode == 0, result.stderr


@pytest.mark.slow(reason="several processes")
@pytest.mark.parametrize("command", COMMANDS)
def test_commands_run_no_file_of_the_working_folder(command, folder):
    # As the installed program does, whose own folder is first on the import path.
    program = folder / "beamdae"
    program.write_text("from beamdae.__main__ import main\nmain()\n")
    models = folder / "models"
    arguments = COMMANDS[command].format(model=models / "ball.py", folder=models).split()
    require_success(folder, run(folder, str(program), *arguments))


@pytest.mark.slow(reason="several processes")
def test_the_module_runs_no_file_of_the_working_folder(folder):
    for name in OF_PYTHON:
        (folder / "work" / f"{name}.py").unlink(missing_ok=True)
    require_success(folder, run(folder, "-m", "beamdae", "list", str(folder / "models")))


@pytest.mark.slow(reason="several processes")
@pytest.mark.parametrize("flags", [[], ["-E"], ["-s"]], ids=str)
def test_sweeps_of_scripts_run_no_file_of_the_working_folder(flags, folder):
    script = folder / "models" / "ball.py"
    if "-E" in flags:  # without PYTHONPATH
        root = str(Path(bd.__file__).parents[1])
        script.write_text(f"import sys\nsys.path.insert(0, {root!r})\n{script.read_text()}")
    require_success(folder, run(folder, *flags, str(script)))


@pytest.mark.slow(reason="two processes")
def test_the_packaged_compiler_runs_no_file_of_the_working_folder(folder, monkeypatch):
    monkeypatch.setattr(compilers.importlib.util, "find_spec", lambda name: name)
    command = compilers.find_compiler("export_fmu", compilers.PLATFORMS["aarch64-darwin"])
    run(folder, *command[1:])
    assert not (folder / "EXECUTED").exists()
