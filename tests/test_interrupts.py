"""Interrupts of calls: none is lost, and partial results are attached."""

import ctypes
import importlib
import signal
import sys
import textwrap
import threading
import time
from dataclasses import dataclass

import pytest
from mechanisms import free_ball

import beamdae as bd
from beamdae.interrupts import DeferredInterrupts, Interrupted, interruptible


def pendulum(frequency=0.3, length=1.0):
    mech, bob = free_ball((length, 0.0), name="bob", gravity=9.81)
    mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), bob.point))
    mech.add(bd.Spring("air", mech.ground.at(0.0, -9.0), bob.point, 0.1, 0.5))
    mech.add(bd.Force("load", bob.point, (bd.sine(1.0, frequency=frequency), 0.0)))
    return mech


def send_interrupt():
    signal.raise_signal(signal.SIGINT)


@ctypes.CFUNCTYPE(ctypes.c_int)
def discard_interrupt():
    """Receive an interrupt where its exception is discarded."""
    try:
        send_interrupt()
    except KeyboardInterrupt:
        return 0
    return 1


class InterruptAt:
    """Progress function that receives an interrupt in its call number `n`."""

    def __init__(self, n, receive=send_interrupt):
        self.calls, self.n, self.receive = 0, n, receive

    def __call__(self, *_):
        self.calls += 1
        if self.calls == self.n:
            self.receive()


@pytest.mark.parametrize("value", ["both", True, None, 1])
def test_other_treatments_of_partial_results_are_rejected(value):
    with pytest.raises(bd.BeamdaeError, match=r"^simulate: partial must be .*raise"):
        bd.simulate(pendulum(), t_end=1.0, partial=value)


@dataclass(frozen=True)
class Truncating(bd.Integrator):
    """Integrator of a user that returns interrupted runs."""

    step: float = 1e-3
    order = 2

    def integrate(self, equations, times, progress=None):
        try:
            method = bd.GeneralizedAlpha(self.step)
            return method.integrate(equations, times, InterruptAt(2))
        except Interrupted as interrupt:
            return interrupt.solution


@pytest.mark.slow(reason="a fifth of a second")
def test_interrupts_of_other_integrators_are_raised():
    with pytest.raises(Interrupted) as caught:
        bd.simulate(pendulum(), Truncating(), 50.0)
    assert caught.value.solution.status.kind == "interrupted"
    with pytest.raises(Interrupted) as caught:
        bd.periodic(pendulum(), 1.0 / 0.3, Truncating())
    assert caught.value.partial is None


def test_an_interrupted_comparison_is_raised_with_its_table():
    model = bd.model(t_end=20.0)(pendulum)
    cases = [bd.Case(model, {"length": x}, bd.Radau()) for x in (1.0, 2.0)]
    with pytest.raises(Interrupted, match="compare") as caught:
        bd.compare(cases, progress=InterruptAt(8))
    table = caught.value.partial
    assert list(table["status"]) == ["interrupted"] * 2
    assert table["reason"].iloc[0].startswith("interrupted at t = ")
    assert table["reason"].iloc[1] == "not run because the study was interrupted"


@pytest.mark.parametrize("partial", ["raise", "return"])
def test_an_interrupted_sweep_has_its_results(partial, tmp_path):
    def run():
        over = {"length": [1.0, 2.0, 3.0]}
        return bd.sweep(
            pendulum, over, t_end=0.1, folder=tmp_path, progress=InterruptAt(3), partial=partial
        )

    if partial == "return":
        results = run()
    else:
        with pytest.raises(Interrupted) as caught:
            run()
        results = caught.value.partial
    assert results.interrupted
    assert list(results.table["status"]) == ["ok", "ok", "interrupted"]
    assert (tmp_path / "sweep.csv").exists()


@bd.model(t_end=1.0)
def discarding(frequency=0.3):
    """Return a pendulum, after the exception of an interrupt has been discarded."""
    assert discard_interrupt() == 0
    return pendulum(frequency)


# Sweeps reject the model because its callback cannot be reproduced in other processes.
ANALYSES = {
    "simulate": bd.simulate,
    "equilibrium": bd.equilibrium,
    "modes": bd.modes,
    "linearize": bd.linearize,
    "periodic": lambda model: bd.periodic(model, 1.0 / 0.3, settle=0),
    "check": bd.check,
    "accuracy": lambda model: bd.simulate(model, accuracy=0.01),
    "compare": lambda model: bd.compare([bd.Case(model)]),
}


@pytest.mark.parametrize("analysis", ANALYSES.values(), ids=ANALYSES)
def test_discarded_interrupts_end_every_analysis(analysis):
    """Interrupts in callbacks of C code were printed and lost."""
    with pytest.raises(Interrupted):
        analysis(discarding)


def test_a_discarded_interrupt_ends_a_run_at_its_next_check():
    with pytest.raises(Interrupted) as caught:
        bd.simulate(pendulum(), bd.Radau(), 50.0, progress=InterruptAt(8, discard_interrupt))
    assert 0.0 < caught.value.solution.trajectory.end < 50.0


def test_a_second_interrupt_is_raised_at_once_after_a_discarded_one():
    @interruptible
    def compute():
        discard_interrupt()
        send_interrupt()
        return 3

    with pytest.raises(Interrupted) as caught:
        compute()
    assert caught.value.partial is None


def test_a_discarded_interrupt_is_raised_again():
    """Searches without a check ran to their end."""

    @interruptible
    def compute():
        discard_interrupt()
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            pass
        return 3

    with pytest.raises(Interrupted) as caught:
        compute()
    assert caught.value.partial is None


def test_an_interrupt_discarded_at_the_end_is_raised():
    @interruptible
    def compute():
        discard_interrupt()
        return 3

    with pytest.raises(Interrupted, match="after the last step") as caught:
        compute()
    assert caught.value.partial == 3


def test_an_interrupt_discarded_before_a_study_is_received_by_it():
    """Searches ran to their end, because a study that waits for processes has no repetitions."""

    @interruptible
    def compute():
        discard_interrupt()
        with DeferredInterrupts() as interrupts:
            return interrupts.received

    assert compute()


def test_an_interrupt_that_becomes_another_exception_is_raised():
    @interruptible
    def compute():
        try:
            send_interrupt()
        except KeyboardInterrupt:
            raise RuntimeError("a library failed") from None

    with pytest.raises(Interrupted) as caught:
        compute()
    assert isinstance(caught.value.__cause__, RuntimeError)


def test_partial_results_of_inner_calls_are_removed():
    @interruptible
    def compute():
        return bd.simulate(pendulum(), t_end=9.0, progress=InterruptAt(8))

    with pytest.raises(Interrupted, match=r"^compute: interrupted at t = ") as caught:
        compute()
    assert caught.value.partial is None


def test_handlers_of_the_user_are_called_and_restored():
    received = []
    before = signal.signal(signal.SIGINT, lambda number, _: received.append(number))
    handler = signal.getsignal(signal.SIGINT)
    try:

        @interruptible
        def compute():
            send_interrupt()
            return 3

        assert compute() == 3
        assert received == [signal.SIGINT]
        assert signal.getsignal(signal.SIGINT) is handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_calls_in_other_threads_are_not_changed():
    results = []
    thread = threading.Thread(target=lambda: results.append(bd.simulate(pendulum(), t_end=0.1)))
    thread.start()
    thread.join()
    assert results[0].status.success


def test_imports_are_completed(tmp_path, monkeypatch):
    """NumPy cannot be imported again after an interrupted import."""
    source = """
        import signal
        signal.raise_signal(signal.SIGINT)
        value = 3
    """
    (tmp_path / "interrupted_module.py").write_text(textwrap.dedent(source))
    monkeypatch.syspath_prepend(tmp_path)

    @interruptible
    def compute():
        return importlib.import_module("interrupted_module").value

    with pytest.raises(Interrupted):
        compute()
    assert sys.modules.pop("interrupted_module").value == 3


# The first call comes from the pilot run.
@pytest.mark.parametrize("begin", [0.0, 0.5])
@pytest.mark.parametrize("call", ["simulate", "compare"])
def test_exceptions_of_progress_have_the_result_so_far(call, begin):
    def fail(*arguments):
        if arguments[-1] >= begin:
            raise bd.BeamdaeError("the user stops")

    model = bd.model(t_end=20.0)(pendulum)
    calls = {
        "simulate": lambda: bd.simulate(model, bd.Radau(), progress=fail),
        "compare": lambda: bd.compare([bd.Case(model, {}, bd.Radau())], progress=fail),
    }
    with pytest.raises(bd.BeamdaeError, match=r"^the user stops$") as caught:
        calls[call]()
    solution = caught.value.solution
    assert solution.status.sentence.endswith("progress failed: BeamdaeError: the user stops")
    assert solution.trajectory.end > begin
    assert solution.model["t_end"] == 20.0
