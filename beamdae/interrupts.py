"""Interrupts of calls: no Ctrl-C is lost, and partial results are kept where possible.

Python raises KeyboardInterrupt between any two instructions of the main thread. If these belong to
a function that C code calls (a callback of ctypes, a conversion of SWIG, a finalizer), the
exception is discarded. Public functions that may take long are therefore decorated by
`interruptible`: an interrupt is pending until code that keeps partial results calls `acknowledge`.
A pending interrupt is raised by the next `raise_pending` of a run, again after a second, and when
the function returns. Interrupts during imports wait for these, or for five seconds, because modules
such as NumPy cannot be used in the same process after an incomplete import. A second interrupt is
raised at once.
"""

from __future__ import annotations

import _thread
import functools
import signal
import sys
import threading
import time as clock
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from dataclasses import dataclass, replace
from types import FrameType
from typing import Any, Literal, ParamSpec, Self, TypeVar, cast

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

# Treatment of the partial result of an interrupted call: raise `Interrupted` with it, or return it.
PartialResult = Literal["raise", "return"]
PARTIAL_RESULTS = ("raise", "return")

# Time after which an interrupt that was discarded is raised again [s]; cleaning up takes less. An
# import delays an interrupt by at most the second time, because modules may be endless scripts.
_REPEAT_INTERVAL = 1.0
_MAX_IMPORT_TIME = 5.0
_AFTER_LAST_STEP = "interrupted after the last step"
_IMPORT_FILES = ("<frozen importlib._bootstrap>", "<frozen importlib._bootstrap_external>")
# All but Ctrl-C only if a handler raises KeyboardInterrupt, as on the command line. Windows has no
# SIGHUP, which a closed terminal sends.
END_SIGNALS = (signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))
SIGNALS = (signal.SIGINT, *END_SIGNALS)
# Names of the public functions that are running, the outermost first.
_running: ContextVar[tuple[str, ...]] = ContextVar("running", default=())


class Interrupted(KeyboardInterrupt):
    """Raised if Ctrl-C ends a call; contains the result computed so far.

    Parameters
    ----------
    reason
        Description of the interrupt, for example "interrupted at t = 0.3 s".
    partial
        The result computed so far, or None.
    call
        Name of the public function that was interrupted, or "".

    Attributes
    ----------
    partial
        Result computed so far: an object of the type that the call returns, or None if there is
        none or the call has no partial results.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    >>> try:
    ...     solution = bd.simulate(mech, t_end=1.0)
    ... except KeyboardInterrupt as interrupt:
    ...     solution = interrupt.solution
    """

    # Unlike a plain KeyboardInterrupt, a subclass may pass through `exec`, as in a dataclass;
    # otherwise, Python ends the process with a different exit code, even if it is caught.

    def __init__(self, reason: str = "interrupted", partial: Any = None, call: str = "") -> None:
        super().__init__(reason)
        self.reason, self.partial, self.call = reason, partial, call
        # True once it has been raised by the public function `call`, which another may have called.
        self.has_ended_call = False

    @property
    def solution(self) -> Any:
        """Solution computed so far: `partial.solution` if it exists, otherwise `partial`."""
        return getattr(self.partial, "solution", self.partial)

    def __str__(self) -> str:
        call = f"{self.call}: " if self.call else ""
        hint = "" if self.partial is None else "; the result so far is the attribute `partial`"
        return f"{call}{self.reason}{hint}"


# True if an interrupt has not ended its call yet; only the main thread changes it.
_is_pending = False


def acknowledge() -> bool:
    """End the pending interrupt, because the caller ends the call itself.

    Call this function first where KeyboardInterrupt is caught to keep results. Return True if an
    interrupt was pending, even if C code discarded its exception. Outside the main thread, do
    nothing and return False.
    """
    global _is_pending
    if threading.current_thread() is not threading.main_thread():
        return False
    was_pending, _is_pending = _is_pending, False
    return was_pending


def raise_pending() -> None:
    """Raise an interrupt that C code has discarded, or that waits for the end of an import."""
    if _is_pending and threading.current_thread() is threading.main_thread():
        raise Interrupted


def attach_partial(problem: BaseException, partial: Any) -> None:
    """Add the attributes `partial` and `solution`, as of `Interrupted`, to an exception."""
    # Exceptions with `__slots__` may have no further attributes.
    with suppress(AttributeError, TypeError):
        vars(problem).update(partial=partial, solution=getattr(partial, "solution", partial))


@contextmanager
def keep_result(result: Any, call: str, reason: str) -> Iterator[None]:
    """Attach a finished result to interrupts of a `with` block in the public function `call`."""
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(reason, result, call) from None


def outermost_call(names: Collection[str]) -> str:
    """Return the outermost running public function of `names`, or "" if none of them runs.

    Only functions decorated by `interruptible` are known.
    """
    return next((name for name in _running.get() if name in names), "")


def interruptible(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Decorate a public function so that no interrupt of a call is lost.

    An interrupted call raises `Interrupted`. The function may raise `Interrupted` itself, with a
    partial result and its own name as `call`; partial results of other functions that it calls are
    removed. If the function returns while an interrupt is pending, its result becomes the partial
    result or, with partial="return", is returned with the status "interrupted". An OverflowError is
    raised as a BeamdaeError.
    """
    name = function.__name__

    @functools.wraps(function)
    def call(*arguments: Parameters.args, **options: Parameters.kwargs) -> Result:
        handlers, running = _replace_handlers(), _running.get()
        try:
            _running.set((*running, name))
            # Tiny numbers become zero, also after `np.seterr(all="raise")`. The help of the command
            # line is printed without NumPy.
            numpy = sys.modules.get("numpy")
            with nullcontext() if numpy is None else numpy.errstate(under="ignore"):
                result = function(*arguments, **options)
        except KeyboardInterrupt as problem:
            acknowledge()
            if (
                isinstance(problem, Interrupted)
                and problem.call == name
                and not problem.has_ended_call
            ):
                problem.has_ended_call = True
                raise
            reason = problem.reason if isinstance(problem, Interrupted) else str(problem)
            # The last step of a call inside this one is not its own.
            reason = reason.replace(_AFTER_LAST_STEP, "")
            raise _end_call(name, reason) from problem
        except Exception as problem:
            if not acknowledge():
                if isinstance(problem, OverflowError):
                    # The help of the command line is printed without NumPy.
                    from beamdae.errors import BeamdaeError

                    raise BeamdaeError(
                        f"{name}: a number exceeds the range of floating-point numbers; check "
                        "laws, masses, stiffnesses and start values."
                    ) from problem
                raise
            # Other code converted the interrupt to a different exception.
            raise _end_call(name) from problem
        else:
            if not acknowledge():
                return result
            if options.get("partial") == "return" and hasattr(result, "status"):
                interrupted: Any = result
                status = replace(interrupted.status, kind="interrupted", sentence=_AFTER_LAST_STEP)
                return cast("Result", replace(interrupted, status=status))
            raise _end_call(name, _AFTER_LAST_STEP, result)
        finally:
            _running.set(running)
            _restore_handlers(handlers)

    return call


def _end_call(name: str, reason: str = "", partial: Any = None) -> Interrupted:
    interrupt = Interrupted(reason or "interrupted", partial, name)
    interrupt.has_ended_call = True
    return interrupt


def _replace_handlers() -> dict[int, Any]:
    """Install the handler of this module, and return the handlers that it replaces."""
    replaced: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        if not _running.get():
            # An earlier call was interrupted while it returned.
            acknowledge()
        for number in SIGNALS:
            previous = signal.getsignal(number)
            # Signals that are ignored, or that end the process by default, are left unchanged.
            if callable(previous) and not isinstance(previous, _SignalHandler):
                replaced[number] = previous
                signal.signal(number, _SignalHandler(previous))
    return replaced


def _restore_handlers(handlers: dict[int, Any]) -> None:
    for number, handler in handlers.items():
        # The call may have installed another handler.
        if isinstance(signal.getsignal(number), _SignalHandler):
            signal.signal(number, handler)


@dataclass(frozen=True)
class _SignalHandler:
    """Handler that calls the previous one, and records the KeyboardInterrupt that it raises."""

    previous: Callable[[int, FrameType | None], Any]

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        global _is_pending
        try:
            self.previous(number, frame)
        except KeyboardInterrupt:
            is_delayed, _is_pending = not _is_pending and _is_importing(frame), True
            delay = _MAX_IMPORT_TIME if is_delayed else _REPEAT_INTERVAL
            # Not with `threading`, whose locks the interrupted code may hold.
            _thread.start_new_thread(_repeat, (number, delay))
            if not is_delayed:
                raise


def _repeat(number: int, delay: float) -> None:
    """Send the signal again after a delay [s] if its interrupt has not ended its call by then."""
    clock.sleep(delay)
    if _is_pending and isinstance(signal.getsignal(number), _SignalHandler):
        _thread.interrupt_main(signal.Signals(number))


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None and frame.f_code.co_filename not in _IMPORT_FILES:
        frame = frame.f_back
    return frame is not None


class DeferredInterrupts:
    """Record interrupts inside a `with` block of the main thread instead of raising them.

    Attributes
    ----------
    received
        True once an interrupt has arrived.
    immediate
        If True, the next interrupt is raised immediately and resets this flag. Set the flag
        while no results can be lost.
    """

    def __init__(self) -> None:
        self.received = self.immediate = False
        self._previous_handlers: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            # An interrupt that was discarded, or that waits for the end of an import.
            self.received = acknowledge()
            for number in SIGNALS:
                # Signals that are ignored, or that end the process by default, are left unchanged.
                if callable(signal.getsignal(number)):
                    self._previous_handlers[number] = signal.signal(number, self._receive)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous_handlers.items():
            signal.signal(number, handler)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self.received = True
        try:
            self._previous_handlers[number](number, frame)
        except KeyboardInterrupt:
            if self.immediate:
                self.immediate = False
                raise
            acknowledge()
