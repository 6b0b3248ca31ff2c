"""Fits from several starts: the best result, stored searches, failures and interrupts."""

import numpy as np
import pytest
from mechanisms import free_ball

import beamdae as bd

METHOD = bd.GeneralizedAlpha(step=0.02)
TIMES = np.linspace(0.1, 2.0, 20)
BOUNDS = {"stiffness": (10.0, 300.0)}


@bd.model(t_end=1.0)
def oscillator(stiffness=200.0):
    if stiffness > 400.0:
        raise bd.BeamdaeError("oscillator: the spring is too stiff.")
    mech, _body = free_ball((1.0, 0.0), velocity=(0.2, 0.0), name="mass", spring=(stiffness,))
    return mech


def fit(starts, integrator=METHOD, **options):
    data = {"t [s]": TIMES, "mass.x": 1.0 + 0.2 / 40.0**0.5 * np.sin(40.0**0.5 * TIMES)}
    options = {"bounds": BOUNDS, "log": "stiffness", "seed": 3, "max_evaluations": 8, **options}
    return bd.fit(oscillator, data, "stiffness", integrator, sigma=1e-3, starts=starts, **options)


@pytest.mark.slow(reason="seven searches")
def test_the_best_of_several_starts_is_returned_and_resumed(tmp_path):
    # From 200 N/m, the search ends in a local minimum.
    assert abs(fit(1).parameters["stiffness"] - 40.0) > 5.0
    steps = []
    best = fit(3, folder=tmp_path / "store", progress=steps.append)
    # The period of the discrete oscillator is longer by 0.1 %.
    assert best.parameters["stiffness"] == pytest.approx(40.0, rel=1e-2)
    assert [x.done for x in steps] == [0, 1, 2, 3]
    table = best.starts
    assert best.evaluations in table["evaluations"].to_list()
    # The others end at minima near the limit of evaluations.
    assert table["status"].iloc[-1] == "ok"
    assert table["first stiffness"].iloc[0] == 200.0
    assert best.chi_square == pytest.approx(table["chi-square"].min(), rel=1e-6)
    steps.clear()
    again = fit(3, folder=tmp_path / "store", progress=steps.append)
    assert [x.stored for x in steps] == [3]
    assert again.parameters == best.parameters
    # Other variables are other searches.
    fit(2, folder=tmp_path / "store", log=(), max_evaluations=1, progress=steps.append)
    assert steps[-1].stored == 0


@pytest.mark.slow(reason="three searches")
def test_failed_starts_are_reported_and_skipped():
    bounds = {"stiffness": (1.0, 10000.0)}
    best = fit(3, bounds=bounds, log=())
    assert list(best.starts["status"]).count("failed") == 2
    assert "too stiff" in " ".join(best.starts["reason"])
    with pytest.raises(bd.BeamdaeError, match=r"all 2 searches failed.*GeneralizedAlpha"):
        fit(2, integrator=bd.Ida())


@pytest.mark.slow(reason="half a second and more")
def test_exceptions_of_progress_end_the_fit(tmp_path):
    def fail(status):
        if status.done == 1:
            raise RuntimeError("no display")

    with pytest.raises(RuntimeError, match=r"^no display$") as caught:
        fit(2, folder=tmp_path, progress=fail, max_evaluations=1)
    assert caught.value.partial is None
    steps = []
    fit(2, folder=tmp_path, progress=steps.append, max_evaluations=1)
    assert steps[0].stored == 1


@pytest.mark.slow(reason="six searches")
def test_equal_seeds_give_equal_starts():
    first, again, other = (
        fit(3, seed=seed, max_evaluations=1).starts["first stiffness"] for seed in (1, 1, 2)
    )
    assert list(first) == list(again)
    assert list(first[1:]) != list(other[1:])
    # One start in each half of the logarithms.
    shares = np.sort(np.log(first[1:] / 10.0) / np.log(30.0))
    assert shares[0] < 0.5 < shares[1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"folder": 3}, "folder must be the path"),
        ({"jobs": 0}, "jobs must be a whole number"),
        ({"progress": 3}, "progress must be a function"),
        ({"progress": lambda: None}, "progress must be a function that accepts 1 argument"),
        ({"seed": -1}, "seed must be a whole number"),
    ],
)
def test_refusals(changes, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        fit(2, **changes)
