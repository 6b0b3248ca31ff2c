"""Export all models as FMUs, compare them with simulate, and time their steps.

    python validation/fmus/models.py               equality, size and step time of each model
    python validation/fmus/models.py --radau       the same with adaptive steps
    python validation/fmus/models.py --real-time   largest pendulum that keeps 1 kHz

FMPy simulates the FMUs in a process that cannot import beamdae. Differences are the largest of all
outputs, relative to the range of the output, without outputs that are zero up to rounding and
without the rows at breakpoints, where simulate stores the state after its restart. "error" is the
largest difference between two runs of simulate, with the same and with a tight tolerance: of
Newton's iteration for fixed steps, and of the error test (divided by 100) for adaptive steps.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

MODELS_FOLDER = Path(__file__).parents[2] / "models"
sys.path.insert(0, str(MODELS_FOLDER))

import numpy as np

import beamdae as bd
from beamdae.cli.model_files.model_file import ModelFile
from beamdae.export.fmu import StepTimes

STEP = 1e-3
TIMED_STEPS = 100_000
ELEMENTS = (8, 16, 32, 64, 128, 256)
REAL_TIME_ITERATIONS = 2
MICROSECONDS = 1e6
TIGHT = 1e-10
RADAU_RTOL = 1e-6
METHODS = {
    "alpha": (bd.GeneralizedAlpha(STEP), bd.GeneralizedAlpha(STEP, newton_tolerance=TIGHT)),
    "radau": (bd.Radau(RADAU_RTOL), bd.Radau(RADAU_RTOL / 100.0)),
}
# Outputs with a smaller range, in SI units, are zero.
MIN_RANGE = 1e-9
_TIME_HEADINGS = f"{'median':>10s} {'99.9 %':>10s} {'worst':>10s}"
_SIMULATION = """
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("beamdae", "casadi", "numba"):
            raise ImportError(name)
sys.meta_path.insert(0, Blocker())
import numpy as np
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu
path, step, end = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
problems = validate_fmu(path)
assert not problems, problems
rows = simulate_fmu(path, stop_time=end, step_size=step, output_interval=step)
np.save(sys.argv[4], rows)
"""


def compare(model: bd.Model, fmu: bd.ExportedFmu, folder: Path) -> tuple[float, str, float]:
    """Return the difference between an FMU and a run, its output, and the error of the run."""
    result = folder / "rows.npy"
    command = [sys.executable, "-c", _SIMULATION, fmu.path, STEP, model.t_end, result]
    subprocess.run(list(map(str, command)), check=True, capture_output=True)
    rows = np.load(result)
    methods = METHODS[fmu.integrator]
    run, tight = (bd.simulate(model, method, output_step=STEP) for method in methods)
    table, tight_table = run.table(), tight.table()
    times = table.iloc[:, 0].to_numpy()
    smooth = np.ones(len(times), bool)
    for breakpoint_time in run.equations.breakpoints:
        smooth &= np.abs(times - breakpoint_time) > 0.5 * STEP
    headers = {column.rpartition(" [")[0]: column for column in table.columns}
    worst, newton = (0.0, ""), 0.0
    for name in fmu.outputs:
        expected, accurate = (x[headers[name]].to_numpy() for x in (table, tight_table))
        size = float(np.ptp(accurate))
        if size > MIN_RANGE:
            worst = max(worst, (float(np.max(np.abs(rows[name] - expected)[smooth])) / size, name))
            newton = max(newton, float(np.max(np.abs(accurate - expected)[smooth])) / size)
    return *worst, newton


def format_times(times: StepTimes) -> str:
    """Return median, percentile and maximum in microseconds."""
    return " ".join(f"{MICROSECONDS * x:10.1f}" for x in times[:3])


def print_models(integrator: str) -> None:
    print(f"{'model':22s} {'kB':>6s} {'difference':>10s} {'error':>10s} {_TIME_HEADINGS}")
    for path in sorted(MODELS_FOLDER.glob("*.py")):
        model = ModelFile(path).model(None)
        with tempfile.TemporaryDirectory() as name:
            file = Path(name) / "model.fmu"
            try:
                fmu = bd.export_fmu(
                    model,
                    file,
                    step=STEP,
                    integrator=integrator,
                    rtol=RADAU_RTOL,
                    timed_steps=TIMED_STEPS,
                )
            except bd.BeamdaeError as problem:
                print(f"{model.name:22s} {problem}")
                continue
            assert fmu.step_times is not None
            error, output, newton = compare(model, fmu, Path(name))
            print(
                f"{model.name:22s} {fmu.size / 1e3:6.0f} {error:10.1e} {newton:10.1e} "
                f"{format_times(fmu.step_times)} {output}",
                flush=True,
            )


def print_real_time() -> None:
    from pendulum import pendulum

    print(
        f"{'elements':>8s} {'iterations':>10s} {'median':>10s} {'99.9 %':>10s} {'worst':>10s} error"
    )
    for elements in ELEMENTS:
        for iterations in (None, REAL_TIME_ITERATIONS):
            with tempfile.TemporaryDirectory() as name:
                fmu = bd.export_fmu(
                    pendulum(elements=elements),
                    Path(name) / "pendulum.fmu",
                    step=STEP,
                    t_end=pendulum.t_end,
                    real_time=iterations,
                    timed_steps=TIMED_STEPS,
                )
            times = fmu.step_times
            assert times is not None
            label = "tolerance" if iterations is None else str(iterations)
            print(f"{elements:8d} {label:>10s} {format_times(times)} {times.error:.1e}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="FMUs of all models.")
    parser.add_argument("--real-time", action="store_true", help="sizes that keep 1 kHz")
    parser.add_argument("--radau", action="store_true", help="adaptive steps")
    arguments = parser.parse_args()
    if arguments.real_time:
        print_real_time()
    else:
        print_models("radau" if arguments.radau else "alpha")


if __name__ == "__main__":
    main()
