"""Export all models as FMUs, compare them with simulate, and time their steps.

    python validation/fmus/models.py               equality, size and step time of each model
    python validation/fmus/models.py --radau       the same with adaptive steps
    python validation/fmus/models.py --real-time   largest pendulum that keeps 1 kHz

FMPy simulates the FMUs in a process that cannot import beamdae. Differences are the largest of all
outputs, without outputs that are zero up to rounding and without the rows at breakpoints, where
simulate stores the state after its restart. They are relative to the range of the output; for the
components of a vector, such as x_dot and y_dot of a point, to the largest range. "other" is the
largest difference between two runs of simulate, with the same and with another tolerance: of
Newton's iteration for fixed steps, with the default of GeneralizedAlpha, and of the error test
(divided by 100) for adaptive steps.
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
NEWTON_TOLERANCE = 1e-9
RADAU_RTOL = 1e-6
METHODS = {
    "alpha": (
        bd.GeneralizedAlpha(STEP, newton_tolerance=NEWTON_TOLERANCE),
        bd.GeneralizedAlpha(STEP),
    ),
    "radau": (bd.Radau(RADAU_RTOL), bd.Radau(RADAU_RTOL / 100.0)),
}
# Outputs with a smaller range, in SI units, are zero.
MIN_RANGE = 1e-9
_TIME_HEADINGS = f"{'median':>10s} {'99.9 %':>10s} {'worst':>10s}"
_SIMULATION = """
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("beamdae", "casadi"):
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


def compare(
    model: bd.results.Model, fmu: bd.results.ExportedFmu, folder: Path
) -> tuple[float, str, float]:
    """Return the difference between an FMU and a run, its output, and that of another run."""
    result = folder / "rows.npy"
    command = [sys.executable, "-c", _SIMULATION, fmu.path, STEP, model.t_end, result]
    subprocess.run(list(map(str, command)), check=True, capture_output=True)
    rows = np.load(result)
    methods = METHODS[fmu.integrator]
    run, other = (bd.simulate(model, method, output_step=STEP) for method in methods)
    table, other_table = run.table(), other.table()
    times = table.iloc[:, 0].to_numpy()
    smooth = np.ones(len(times), bool)
    for breakpoint_time in run.equations.breakpoints:
        smooth &= np.abs(times - breakpoint_time) > 0.5 * STEP
    headers = {column.rpartition(" [")[0]: column for column in table.columns}
    ranges: dict[tuple[str, str], float] = {}
    for name in fmu.outputs:
        vector = find_vector(headers[name])
        size = float(np.ptp(table[headers[name]].to_numpy()))
        ranges[vector] = max(size, ranges.get(vector, 0.0))
    worst, largest = (0.0, ""), 0.0
    for name in fmu.outputs:
        expected, different = (x[headers[name]].to_numpy() for x in (table, other_table))
        size = ranges[find_vector(headers[name])]
        if size > MIN_RANGE:
            worst = max(worst, (float(np.max(np.abs(rows[name] - expected)[smooth])) / size, name))
            largest = max(largest, float(np.max(np.abs(different - expected)[smooth])) / size)
    return *worst, largest


def find_vector(column: str) -> tuple[str, str]:
    """Return the name of an observable and the unit, which the components of a vector share."""
    name, _, unit = column.rpartition(" [")
    return name.rpartition(".")[0] or name, unit


def format_times(times: StepTimes) -> str:
    """Return median, percentile and maximum in microseconds."""
    return " ".join(f"{MICROSECONDS * x:10.1f}" for x in times[:3])


def print_models(integrator: str) -> None:
    print(f"{'model':22s} {'kB':>6s} {'difference':>10s} {'other':>10s} {_TIME_HEADINGS}")
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
            difference, output, other = compare(model, fmu, Path(name))
            print(
                f"{model.name:22s} {fmu.size / 1e3:6.0f} {difference:10.1e} {other:10.1e} "
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
