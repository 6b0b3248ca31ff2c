"""Runs that exceed the available memory."""

import functools
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from mechanisms import hinged_body
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.integrators import step_history
from beamdae.results.solution import Solution

GIGABYTE = 1e9


@functools.cache
def pendulum():
    mech, bar = hinged_body(2.0, 0.3, (0.5, 0.0), name="bar", gravity=9.81)
    mech.observe("center", bar.at(0.5, 0.0))
    return bd.equations_of_motion(mech)


INTEGRATORS = [
    bd.Ida(1e-5, max_step=5e-4),
    pytest.param(bd.Radau(1e-5, max_step=5e-4), marks=pytest.mark.slow(reason="several runs")),
    bd.GeneralizedAlpha(step=5e-4),
]


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda i: i.method)
def test_full_memory_ends_a_run_and_keeps_its_steps(integrator, monkeypatch):
    whole = bd.simulate(pendulum(), integrator, 1.0)
    assert whole.statistics.steps > 1900
    monkeypatch.setattr(step_history, "available_memory", lambda: 1e5)
    monkeypatch.setattr(step_history, "_UNCHECKED_BYTES", 0.0)
    monkeypatch.setattr(step_history, "_MAX_BLOCK_ROWS", 1024)
    solution = bd.simulate(pendulum(), integrator, 1.0)
    assert solution.status.kind == "limited"
    assert "stored states take 9.8e-05 GB" in solution.status.sentence
    assert "use longer steps, fewer elements" in solution.status.sentence
    assert 300 < solution.statistics.steps < 1100
    # Equal to the run with enough memory, except for the shorter pilot run.
    # The last row is the state at which it stopped.
    row_count = len(solution.t) - 1
    assert row_count > 100
    assert_allclose(solution.q[:row_count], whole.q[:row_count], atol=1e-6)


@pytest.mark.parametrize("problem", [MemoryError(), RuntimeError("std::bad_alloc")])
def test_memory_error_after_a_run_keeps_it(problem, monkeypatch):
    def short(self):
        raise problem

    monkeypatch.setattr(Solution, "warnings", property(short))
    with pytest.warns(bd.BeamdaeWarning, match="simulate: the run could not be checked"):
        solution = bd.simulate(pendulum(), bd.Ida(), 1.0)
    assert solution.status.success


def test_output_rows_that_exceed_memory_are_rejected(monkeypatch):
    monkeypatch.setattr("beamdae.memory._free_physical_memory", lambda: 1e6)
    with pytest.raises(
        bd.BeamdaeError,
        match=r"^simulate: output of 100001 rows needs about 0\.0088 GB of memory, but only 0\.001",
    ):
        bd.simulate(pendulum(), bd.Ida(), 1.0, output_step=1e-5)


@pytest.mark.slow(reason="a process with a memory limit for each integrator")
@pytest.mark.parametrize("remaining", [0.05, 0.3, 0.6])
@pytest.mark.parametrize("integrator", ["Ida()", "Radau()", "GeneralizedAlpha()"])
def test_process_with_little_memory_ends_with_a_message(integrator, remaining):
    if not Path("/proc/self/statm").exists():
        pytest.skip("the system does not tell how much memory a process has")
    program = f"""
        import resource, warnings
        import beamdae as bd
        warnings.simplefilter("ignore")
        import beamdae.simulation
        pages = int(open("/proc/self/statm").read().split()[0])
        most = pages * resource.getpagesize() + {int(remaining * GIGABYTE)}
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        try:
            mech = bd.Mechanism(gravity=(0.0, -9.81))
            alloy = bd.Material(E=7e10, nu=0.3, rho=2700.0)
            strip = bd.Section.rectangle(alloy, width=0.03, height=0.003)
            line = bd.Line((0.0, 0.0), (1.0, 0.0))
            beam = mech.add(bd.Beam("beam", line, strip, elements=1000))
            mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
            stop = lambda t: "enough" if t > 0.0 else None
            print("kind:", bd.simulate(mech, bd.{integrator}, 1.0, progress=stop).status.kind)
        except bd.BeamdaeError as problem:
            print("error:", problem)
    """
    command = [sys.executable, "-c", textwrap.dedent(program)]
    process = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert process.returncode == 0, process.stderr[-2000:]
    assert process.stdout.strip().splitlines()[-1].startswith(("kind: limited", "error: "))
