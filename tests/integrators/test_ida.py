"""How IDA is driven: its vectors, its memory, its voice."""

import io
import sys
import threading

import numpy as np
import pytest
from hub_beam import hub_beam
from published_cases import PENDULUM
from sksundae.ida import IDA

import beamdae as bd
from beamdae.integrators import ida
from beamdae.integrators.preconditioned import PreconditionedResidual
from beamdae.integrators.silence import silent


class Copying(ida.IDA):
    """A wrapper of IDA that hands out copies of its vectors, and takes them back after the call."""

    def __init__(self, residual, **options):
        def copied(t, y, yp, out):
            mine = np.array(out)
            residual(t, np.array(y), np.array(yp), mine)
            out[:] = mine

        super().__init__(copied, **options)


def test_regression_a_wrapper_that_hands_out_copies_is_refused(monkeypatch):
    """Runs ended 600 rtol off, and said that they had reached the end."""
    monkeypatch.setattr(ida, "IDA", Copying)
    with pytest.raises(bd.BeamdaeError, match=r"^Ida: scikit-sundae .* hands out copies of IDA's"):
        bd.simulate(PENDULUM.equations, bd.Ida(rtol=1e-6), 1.0)


@pytest.fixture
def made(monkeypatch):
    """What IDA is driven by, of each run in turn."""
    made = []

    class Watched(PreconditionedResidual):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            made.append(self)

    monkeypatch.setattr(ida, "PreconditionedResidual", Watched)
    return made


@pytest.mark.parametrize("formulation", ida.FIRST_ORDER)
def test_the_vectors_of_the_wrapper_there_is_are_shared(formulation, made):
    settings = bd.Ida(rtol=1e-6, formulation=formulation, error_control="positions")
    assert bd.simulate(PENDULUM.equations, settings, 0.5).status.success
    assert made[0]._shared


def test_regression_what_is_kept_of_a_run_does_not_grow_with_it(made):
    """The time of every residual was kept, gigabytes in a long run."""
    for t_end in (0.1, 2.0):
        solution = bd.simulate(PENDULUM.equations, bd.Ida(rtol=1e-6), t_end)
    assert solution.statistics.residual_calls > 200
    # The first is the scout of the short run, the last the long run itself.
    short, long = ({k: np.size(v) for k, v in vars(made[k]).items()} for k in (0, -1))
    assert short == long


def test_regression_runs_that_overlap_leave_stdout_as_it_was():
    before = sys.stdout
    inside, turns = threading.Barrier(3), [threading.Event() for _ in range(4)]
    turns[0].set()

    def run(number):
        met = []

        def meet(t):
            # All are under way before any of them ends, and they end in the order they began in.
            if not met:
                met.append(inside.wait(10.0))
                turns[number].wait(10.0)

        bd.simulate(PENDULUM.build().equations, bd.Ida(rtol=1e-7), 1.0, progress=meet)
        turns[number + 1].set()

    threads = [threading.Thread(target=run, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not inside.broken
    assert sys.stdout is before


def test_silence_is_of_the_thread_that_asks_for_it(monkeypatch):
    heard = io.StringIO()
    monkeypatch.setattr(sys, "stdout", heard)
    entered, spoken = threading.Event(), threading.Event()

    def quiet():
        with silent:
            entered.set()
            spoken.wait(5.0)
            sys.stdout.write("unheard")

    thread = threading.Thread(target=quiet)
    thread.start()
    entered.wait(5.0)
    sys.stdout.write("heard")
    spoken.set()
    thread.join()
    assert sys.stdout is heard
    assert heard.getvalue() == "heard"


def test_sundials_says_nothing_where_a_status_says_it(capfd):
    mech = bd.Mechanism()
    body = mech.add(bd.PointMass("body", 1.0, at=(0.0, 0.0)))
    mech.add(bd.Force("push", body.point, (lambda t: np.sqrt(0.5 - t), 0.0)))
    solution = bd.simulate(mech, bd.Ida(rtol=1e-6), 1.0)
    assert solution.status.kind == "failed"
    assert capfd.readouterr() == ("", "")


def test_regression_memory_of_large_systems_does_not_grow_with_their_square(monkeypatch):
    """A full matrix for the identity took 6 GB and most of the time at 1024 elements."""
    kept = {}

    def watched(residual, **options):
        def jacobian(t, y, yp, res, c, out):
            kept[y.size] = out.size
            options["jacfn"](t, y, yp, res, c, out)

        return IDA(residual, **{**options, "jacfn": jacobian})

    monkeypatch.setattr(ida, "IDA", watched)
    for bodies in (2, 30):
        mech = bd.Mechanism(gravity=(0.0, -9.81))
        before = mech.ground.at(0.0, 0.0)
        for k in range(bodies):
            rod = mech.add(bd.RigidBody(f"rod {k}", mass=1.0, inertia=0.1, center=(k + 0.5, 0.0)))
            mech.add(bd.Revolute(f"pin {k}", before, rod.at(float(k), 0.0)))
            before = rod.at(k + 1.0, 0.0)
        solution = bd.simulate(mech, bd.Ida(rtol=1e-3), 0.01)
        assert solution.status.success
    (small, few), (large, many) = sorted(kept.items())
    assert few == small**2
    assert many == large


def test_an_unstable_order_that_is_set_does_not_enlarge_the_amplitudes():
    # BDF of order 5 makes undamped modes grow: a scout of that order saw seven times the motion.
    seen = [
        bd.simulate(hub_beam(elements=4), bd.Ida(1e-4, max_order=k, max_steps=5), t_end=2.0)
        for k in ("auto", 5)
    ]
    assert seen[0].integrator["amplitudes"] == seen[1].integrator["amplitudes"]
    assert seen[1].integrator["max_order"] == 5
