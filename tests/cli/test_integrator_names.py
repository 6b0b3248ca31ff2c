"""`--integrator`: built-in names, and integrators that the model file defines or imports."""

import json
from pathlib import Path

import pandas as pd
import pytest
from command_line import invoke, succeed
from numpy.testing import assert_allclose

import beamdae as bd

MODEL = '''
from dataclasses import dataclass

import numpy as np

import beamdae as bd
from beamdae import GeneralizedAlpha as Alpha
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.integrators.drive import drive
from beamdae.integrators.integrator import Accuracy
from beamdae.integrators.integrator import StepError, clip_step
from beamdae.linear.factorizations import create_factorization
from beamdae.results.outcome import Statistics


@dataclass(frozen=True)
class ImplicitEuler(bd.Integrator):
    """y' = (y - y_n) / h; calls `drive` itself."""

    step: float = 1e-3
    iterations: int = 20

    @property
    def accuracy(self):
        return Accuracy("step", self.step)

    @property
    def order(self):
        return 1

    def integrate(self, equations, times, progress=None):
        return drive(self, equations, times, progress)

    def method_on(self, plan):
        return EulerSteps(self, plan)


class EulerSteps:
    steps_per_check = 64
    resolved_options = {}
    counts = Statistics()

    def __init__(self, settings, plan):
        self.settings = settings
        self.form = formulate_first_order(plan.equations, "stabilized-index1")
        self.linear = create_factorization(self.form.pattern)

    def begin(self, start, end, branch, state):
        self.t, self.end, self.branch = start, end, branch
        self.y, self.yp = self.form.pack(state)

    def step(self):
        remaining = self.end - self.t
        h = clip_step(self.settings.step, remaining)
        self.t = self.end if h == remaining else self.t + h
        time, last = np.array([self.t, self.branch]), self.y
        self.y = self.y + h * self.yp
        for _ in range(self.settings.iterations):
            self.yp = (self.y - last) / h
            residual = self.form.residual(time, self.y, self.yp)
            self.linear.factorize(self.form.jacobian(time, self.y, self.yp, 1.0 / h))
            change = self.linear.solve(residual)
            self.y = self.y - change
            if np.max(np.abs(change)) <= 1e-10 * (1.0 + np.max(np.abs(self.y))):
                self.yp = (self.y - last) / h
                return self.t, self.form.unpack(self.y, self.yp)
        raise StepError("Newton's iteration did not converge; use a smaller step")


@dataclass(frozen=True)
class ShortSteps(ImplicitEuler):
    def __post_init__(self):
        if self.step > 0.01:
            raise ValueError("steps longer than 0.01 s are not supported")


euler = ImplicitEuler(step=5e-3)
radau = ImplicitEuler(step=1.0)


@bd.model(t_end=0.02)
def swing(mass=2.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("tip", bob.at(1.0, 0.0))
    return mech
'''


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Return a function that runs MODEL without an error estimate, a picture and a page."""
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(MODEL, encoding="utf-8")
    fixed = ["run", "model.py", "--no-estimate", "--no-page", "--no-picture"]
    return lambda *arguments: invoke(*fixed, *arguments)


def read_settings():
    return json.loads(Path("results/swing.json").read_text())["integrator"]


@pytest.mark.parametrize(
    ("arguments", "method", "step", "iterations"),
    [
        (["--integrator", "ImplicitEuler"], "ImplicitEuler", 1e-3, 20),
        (["--integrator", "ImplicitEuler", "--step", "0.004"], "ImplicitEuler", 4e-3, 20),
        (["--integrator", "euler"], "ImplicitEuler", 5e-3, 20),
        (["--integrator", "euler", "--step", "0.01"], "ImplicitEuler", 0.01, 20),
    ],
)
def test_class_or_instance_of_the_model_file_integrates(run, arguments, method, step, iterations):
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    settings = read_settings()
    assert settings["integrator"] == method
    assert (settings["step"], settings["iterations"]) == (step, iterations)
    assert json.loads(Path("results/swing.json").read_text())["result"]["steps"] == round(
        0.02 / step
    )


def test_result_is_that_of_simulate(run):
    assert run("--integrator", "ImplicitEuler", "--output-step", "0.01").exit_code == 0
    names = {}
    exec(MODEL, names)
    solution = bd.simulate(names["swing"], names["ImplicitEuler"](), output_step=0.01)
    column = pd.read_csv("results/swing.csv")["tip.y [m]"]
    assert_allclose(column, solution.columns["tip.y [m]"], rtol=1e-15, atol=0.0)


def test_imported_class_can_be_used_by_its_name_in_the_file(run):
    settings = ("--step", "0.002", "--option", "rho_inf=0.5", "--output-step", "0.01")
    assert run("--integrator", "Alpha", *settings).exit_code == 0
    found = [read_settings()[name] for name in ("integrator", "step", "rho_inf")]
    assert found == ["GeneralizedAlpha", 2e-3, 0.5]
    assert list(pd.read_csv("results/swing.csv")["t [s]"]) == [0.0, 0.01, 0.02]


def test_built_in_names_come_before_variables_of_the_file(run):
    assert run("--integrator", "radau").exit_code == 0
    assert read_settings()["integrator"] == "Radau"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--integrator", "ImplictEuler"],
            "run: --integrator must be one of 'auto', 'ida', 'radau', 'generalized-alpha', "
            "'Alpha', 'ImplicitEuler', 'ShortSteps', 'euler', got 'ImplictEuler' (did you mean "
            "'ImplicitEuler'?).",
        ),
        (
            ["--integrator", "ImplicitEuler", "--rtol", "1e-3"],
            "run: --rtol is not a setting of ImplicitEuler (only of auto, ida, radau, "
            "generalized-alpha, Alpha).",
        ),
        (
            ["--integrator", "generalized-alpha", "--option", "max_order=2"],
            "run: max_order= is not a setting of generalized-alpha (only of ida).",
        ),
        (
            ["--integrator", "ShortSteps", "--step", "1"],
            "run: --integrator ShortSteps: the constructor failed: ValueError at line 71: "
            "steps longer than 0.01 s are not supported.",
        ),
    ],
)
def test_unknown_name_and_unsupported_option_are_refused(run, arguments, message):
    result = run(*arguments)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"error: {message}")
    assert not Path("results").exists()


def test_the_model_file_is_executed_once(run):
    Path("model.py").write_text(MODEL + "print('executed')\n", encoding="utf-8")
    assert run("--integrator", "euler").stdout.count("executed") == 1


@pytest.mark.slow(reason="a sweep in worker processes, which get the class of the file")
def test_sweep_in_processes_with_an_integrator_of_the_model_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(MODEL, encoding="utf-8")
    arguments = ["sweep", "model.py", "--over", "mass=1,2", "--integrator", "euler", "--jobs", "2"]
    succeed(*arguments)
    again = succeed(*arguments)
    assert "2 stored before" in again.output


@pytest.mark.slow(reason="runs a model twice")
def test_error_is_estimated_with_an_integrator_of_the_model_file(run):
    result = succeed("run", "model.py", "--integrator", "euler", "--verify", "-v")
    assert "ImplicitEuler step=0.005" in result.output
    assert "error by observed end [-] min max" in " ".join(result.output.split())
