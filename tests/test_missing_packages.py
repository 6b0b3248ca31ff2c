"""Analyses and commands without scikit-sundae, llvmlite, the core, processes or threads."""

import json
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from mechanisms import free_ball

import beamdae as bd

HIDING = Path(__file__).with_name("hidden_packages")
NO_IDA = ("llvmlite", "sksundae", "scikit-sundae")
# A browser (Pyodide) has no compiler, and starts neither processes nor threads.
BROWSER = (*NO_IDA, "_multiprocessing", "fcntl", "resource", "_ssl", "_lzma", "threads")

MODEL = """import beamdae as bd


@bd.model(t_end=0.3)
def swing(mass=1.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, 0.1, (1.0, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("bob", bob.at(1.0, 0.0))
    return mech


@bd.model(t_end=0.01)
def clamped():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    strip = bd.Section.rectangle(bd.Material(E=7e10, nu=0.3, rho=2700.0), 0.02, 0.005)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech


@bd.model(t_end=1.0)
def shaken(frequency=1.0):
    mech = bd.Mechanism()
    bob = mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
    for k in range(2):
        anchor = mech.ground.at(k, k)
        mech.add(bd.Spring(f"spring {k}", anchor, bob.point, stiffness=100.0, damping=5.0))
    mech.add(bd.Force("push", bob.point, (bd.sine(1.0, frequency), 0.0)))
    mech.observe("bob", bob.point)
    return mech
"""
ANALYSES = """
import json
import warnings

import beamdae as bd
from model import clamped, shaken, swing

CALLS = {
    "simulate": lambda: bd.simulate(swing).integrator,
    "a beam": lambda: bd.simulate(clamped).integrator,
    "Ida": lambda: bd.simulate(swing, bd.Ida()).integrator,
    "GeneralizedAlpha": lambda: bd.simulate(swing, bd.GeneralizedAlpha()).integrator,
    "errors": lambda: len(bd.simulate(swing).errors.table()),
    "verify": lambda: len(bd.verify(bd.simulate(swing)).table()),
    "accuracy": lambda: bd.simulate(swing, accuracy=0.05).errors.status.kind,
    "modes": lambda: len(bd.modes(clamped).frequencies),
    "equilibrium": lambda: bd.equilibrium(clamped).status.kind,
    "linearize": lambda: bd.linearize(clamped) is None,
    "periodic": lambda: bd.periodic(shaken, 1.0).status.kind,
    "check": lambda: bd.check(swing) is None,
    "sweep": lambda: list(bd.sweep(swing, {"mass": [1.0, 2.0]}).table["status"]),
    "compare": lambda: list(bd.compare([bd.Case(swing, {}, bd.Radau())])["status"]),
}
answers = {}
for name, call in CALLS.items():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            answer = call()
        except bd.BeamdaeError as problem:
            answer = f"BeamdaeError: {problem}"
    answers[name] = answer, [str(x.message) for x in caught]
print(json.dumps(answers, default=str))
"""


def run_python(folder, hidden, *arguments):
    """Run Python without the hidden packages in a folder that contains the model."""
    (folder / "model.py").write_text(MODEL)
    paths = (HIDING, folder, Path(bd.__file__).parents[1])
    env = {"PYTHONPATH": os.pathsep.join(map(str, paths)), "HIDDEN": ",".join(hidden)}
    env |= {"CC": "false"} if hidden is BROWSER else {}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, **env, "XDG_CACHE_HOME": str(folder / "cache")},
        capture_output=True,
        text=True,
        timeout=300.0,
    )


def test_auto_uses_radau_if_ida_cannot_be_imported(monkeypatch):
    def fail():
        raise sys.modules["beamdae.sundials"].UnavailableError(
            "the functions of SUNDIALS cannot be loaded"
        )

    monkeypatch.setattr("beamdae.integrators.ida.compiled_solver.load_library", fail)
    monkeypatch.setitem(sys.modules, "beamdae.integrators.ida.python_solver", None)
    monkeypatch.setattr("beamdae.errors._issued_messages", set())
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        runs = [bd.simulate(mech, t_end=1.0) for _ in range(2)]
    (warning,) = issued
    assert warning.category.__name__ == "KernelWarning"
    assert re.match(r"Auto: scikit-sundae cannot .*; Radau is used", str(warning.message))
    for run in runs:
        assert run.integrator["method"] == "Radau"
    with pytest.raises(bd.BeamdaeError, match=r"^Ida: scikit-sundae .*; install scikit-sundae, or"):
        bd.simulate(mech, bd.Ida(), t_end=1.0)


@pytest.mark.slow(reason="new processes without machine code")
@pytest.mark.parametrize("hidden", [("llvmlite",), NO_IDA], ids=" ".join)
def test_all_analyses_work_without_packages(tmp_path, hidden):
    (tmp_path / "analyses.py").write_text(ANALYSES)
    result = run_python(tmp_path, hidden, "analyses.py")
    assert (result.returncode, result.stderr) == (0, "")
    answers = json.loads(result.stdout)
    has_ida = "sksundae" not in hidden
    solution, sentences = answers["simulate"]
    assert solution["method"] == ("Ida" if has_ida else "Radau")
    assert sum("Radau is used instead of Ida" in x for x in sentences) == (not has_ida)
    assert sum("agree within the tolerance" in x for x in sentences) == 1
    explicit = answers.pop("Ida")[0]
    if not has_ida:
        assert explicit.startswith("BeamdaeError: Ida: scikit-sundae cannot be imported")
    assert not [x for x, _ in answers.values() if "BeamdaeError" in str(x)]
    assert answers["periodic"][0] == answers["equilibrium"][0] == "ok"
    assert answers["sweep"][0] == ["ok", "ok"]
    assert answers["compare"][0] == ["ok"]


@pytest.mark.slow(reason="a new process without machine code")
def test_browser_has_plain_methods_and_names_what_others_require(tmp_path):
    (tmp_path / "analyses.py").write_text(ANALYSES)
    result = run_python(tmp_path, BROWSER, "analyses.py")
    assert (result.returncode, result.stderr) == (0, "")
    answers = {name: str(x) for name, (x, _) in json.loads(result.stdout).items()}
    works = {name for name, x in answers.items() if not re.search("BeamdaeError|failed", x)}
    assert works == {"GeneralizedAlpha", "modes", "linearize"}
    for name in ("equilibrium", "periodic"):
        assert answers[name].startswith("BeamdaeError: core: this method or analysis requires")
    assert answers["simulate"].startswith("BeamdaeError: Ida: scikit-sundae cannot be imported")


@pytest.mark.slow(reason="commands without machine code")
@pytest.mark.parametrize(
    "command",
    [
        ("run", "model.py", "--model", "swing"),
        ("sweep", "model.py", "--model", "swing", "--over", "mass=1,2", "--jobs", "2"),
        ("modes", "model.py", "--model", "clamped"),
        ("static", "model.py", "--model", "clamped"),
        ("check", "model.py", "--model", "swing"),
    ],
    ids=lambda command: command[0],
)
def test_commands_work_without_packages(tmp_path, command):
    result = run_python(tmp_path, NO_IDA, "-m", "beamdae", *command)
    assert result.returncode == 0, result.stderr
    assert "Traceback" not in result.stderr
