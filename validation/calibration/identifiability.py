"""What the gauges do not determine: `python validation/calibration/identifiability.py`.

Fits of more parameters than the records determine: E with the thickness of the strip, from both
gauges, and from gauge 1 alone. Both print relative standard deviations and undetermined
combinations.
"""

import warnings

import pandas as pd
import twin

import beamdae as bd
from beamdae.errors import BeamdaeWarning

MANY = [*twin.TRUE, "thickness"]
# The searches begin at the true values, because they only follow a flat valley.
MOST_EVALUATIONS = 10


def fit(data, sensors):
    """Return a fit of all parameters and the thickness."""
    return bd.fit(
        twin.pendulum,
        data,
        MANY,
        twin.METHOD,
        sigma=twin.NOISE,
        parameters=twin.TRUE,
        log=twin.LOG,
        max_evaluations=MOST_EVALUATIONS,
        **sensors,
    )


def main():
    warnings.simplefilter("ignore", BeamdaeWarning)
    data = twin.noisy_record(twin.exact_record(), seed=0)
    alone = {name: data[name] for name in ("t [s]", "gauge 1")}
    one = twin.SENSORS | {"shift": {"gauge 1": twin.SENSORS["shift"]["*"]}}
    for label, result in (
        ("both gauges", fit(data, twin.SENSORS)),
        ("gauge 1 alone", fit(alone, one)),
    ):
        deviations = 100.0 * result.standard_deviations / abs(result.values)
        print(f"{label}, relative standard deviations [%]:")
        print(pd.Series(deviations, index=result.names).round(2).to_string())
        print("E and thickness, correlation", result.correlations().loc["E", "thickness"].round(4))
        print("\n".join(result.undetermined), flush=True)


if __name__ == "__main__":
    main()
