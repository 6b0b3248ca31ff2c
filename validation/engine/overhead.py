"""Measure the overhead of the study engine.

    python validation/engine/overhead.py [--cases 1000]

Runs the pendulum with several tip masses and many steps, and prints the time spent on integration,
setup, measuring and the engine, relative to the wall time multiplied by the number of processes.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import beamdae as bd
from beamdae.studies.execution import study_run
from beamdae.studies.execution.executors import LocalPool

pendulum = bd.load_model(Path(__file__).parents[2] / "models" / "pendulum.py")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000, help="number of cases (default: 1000)")
    case_count = parser.parse_args().cases
    # Few models and many integrator settings, as in a typical study.
    cases = tuple(
        bd.Case(pendulum, {"tip_mass": mass}, bd.GeneralizedAlpha(step=step))
        for mass in np.linspace(0.01, 0.1, max(case_count // 100, 1)).round(4).tolist()
        for step in np.geomspace(1e-3, 5e-4, min(case_count, 100)).tolist()
    )
    references = (bd.Ida(rtol=1e-5), bd.GeneralizedAlpha(step=5e-4))
    study = bd.results.Study("overhead", cases, references=references, t_end=2.0)
    pool = LocalPool()
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        results = study_run.run_study(study, Path(folder), pool)
        total = (time.perf_counter() - start) * pool.workers
    outcomes = results.outcomes.values()
    integration = sum(o.values["wall time [s]"] for o in outcomes)
    setup = sum(o.values["setup time [s]"] for o in outcomes)
    print(f"{len(outcomes)} runs on {pool.workers} processes, {total:.0f} s of processor time")
    print(f"integration          {integration / total:6.1%}")
    print(f"building, compiling  {setup / total:6.1%}")
    measuring = sum(o.values["measuring time [s]"] for o in outcomes)
    print(f"measuring            {measuring / total:6.1%}  residuals, drift, energies of all steps")
    print(f"the engine           {1.0 - (integration + setup + measuring) / total:6.1%}")


if __name__ == "__main__":
    main()
