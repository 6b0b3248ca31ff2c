"""Modules that a run imports, which determine its start time."""

import subprocess
import sys
from pathlib import Path

import pytest

MODEL = Path(__file__).parents[2] / "models" / "hub_beam.py"


@pytest.mark.slow(reason="starts a process for each command")
@pytest.mark.parametrize(
    ("command", "never"),
    [
        (["list", str(MODEL)], ("casadi", "scipy", "pandas")),
        (["examples"], ("casadi", "scipy", "pandas")),
        (["--help"], ("casadi", "numpy", "scipy", "pandas", "matplotlib", "sksundae")),
        (
            ["run", str(MODEL), "--t-end", "0.01", "--no-picture", "--no-page"],
            ("pandas", "matplotlib", "scipy.optimize", "distributed", "beamdae.studies"),
        ),
        (["check", str(MODEL)], ("pandas", "matplotlib")),
        (["static", str(MODEL.with_name("pendulum.py"))], ("pandas", "scipy.optimize")),
        (["modes", str(MODEL.with_name("pendulum.py"))], ("scipy.optimize",)),
        (
            ["draw", str(MODEL)],
            (
                *("pandas", "scipy.optimize", "llvmlite", "threadpoolctl"),
                *("beamdae.analysis", "beamdae.integrators", "beamdae.simulation"),
                *("beamdae.equations.equations_of_motion", "beamdae.results.solution"),
                *("beamdae.parts.joints.rolling", "beamdae.parts.forces.springs"),
            ),
        ),
    ],
)
def test_commands_import_only_what_they_need(command, never, tmp_path):
    """Pictures and pages imported pandas and all analyses; tables of models imported CasADi."""
    code = f"""
import runpy, sys
sys.argv = ["beamdae", *{command!r}]
try:
    runpy.run_module("beamdae", run_name="__main__")
except SystemExit as end:
    assert not end.code, end.code
print("imported:", *sys.modules)
"""
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    imported = result.stdout.splitlines()[-1].split()
    assert "beamdae.cli.app" in imported
    assert not [name for name in imported if name.startswith(never)]


@pytest.mark.slow(reason="starts a process")
def test_regression_the_plot_of_a_run_does_not_import_pandas(tmp_path):
    code = """
import sys
import beamdae as bd
mech = bd.Mechanism(gravity=(0.0, -9.81))
ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
mech.observe("ball", ball.point)
bd.simulate(mech, t_end=0.1).plot("ball.y").save("ball.png")
assert "matplotlib" in sys.modules
assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)


@pytest.mark.slow(reason="starts a process")
def test_runs_of_scripts_import_no_displays():
    code = """
import sys
import beamdae as bd
mech = bd.Mechanism(gravity=(0.0, -9.81))
mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
bd.simulate(mech, t_end=0.1)
assert not {"rich", "typer", "html", "pandas", "matplotlib"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
