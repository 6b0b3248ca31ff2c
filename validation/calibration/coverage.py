"""Coverage of the 95 % intervals of fits: `python validation/calibration/coverage.py`.

Each replicate fits eight parameters to the record of the twin experiment with other noise. The
intervals are right if they contain the true values in 95 % of the replicates; with 200 replicates,
the standard deviation of this share is 1.5 % for each parameter.
"""

import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import twin

from beamdae.errors import BeamdaeWarning

REPLICATES = 200
RESULTS = Path(__file__).parent / "results"


def main(replicates=REPLICATES):
    warnings.simplefilter("ignore", BeamdaeWarning)
    record = twin.exact_record()
    truth = np.array([*twin.TRUE.values(), twin.SHIFT, twin.SCALE, twin.OFFSET])
    rows, names, times = [], [], []
    for seed in range(replicates):
        begin = time.process_time()
        fit = twin.fit(twin.noisy_record(record, seed))
        times.append(time.process_time() - begin)
        names = list(fit.names)
        errors = (fit.values - truth) / fit.standard_deviations
        rows.append([*errors, fit.chi_square, fit.evaluations, fit.status.success])
    table = pd.DataFrame(rows, columns=[*names, "chi-square", "evaluations", "converged"])
    errors = table[names].to_numpy()
    inside = np.abs(errors) <= fit.quantile
    summary = pd.DataFrame(
        {
            "true value": truth,
            "coverage [%]": 100.0 * inside.mean(axis=0),
            "mean error [sd]": errors.mean(axis=0),
            "sd of errors [sd]": errors.std(axis=0, ddof=1),
        },
        index=pd.Index(names, name="parameter"),
    )
    RESULTS.mkdir(exist_ok=True)
    summary.to_csv(RESULTS / "coverage.csv", float_format="%.6g")
    print(summary.to_string(float_format="%.4g"))
    print(f"all parameters: {100.0 * inside.mean():.2f} % of {inside.size} intervals")
    freedom = fit.degrees_of_freedom
    print(f"chi-square {table['chi-square'].mean():.1f} at {freedom} degrees of freedom")
    median, count = table["evaluations"].median(), int(table["converged"].sum())
    print(f"evaluations {median:.0f} (median), converged {count}")
    print(f"processor time of a fit: {np.median(times):.2f} s")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
