"""IDA of SUNDIALS, a step at a time, with the identity as its linear system."""

from __future__ import annotations

import contextlib
import ctypes
import weakref
from typing import Any, NamedTuple

import numpy as np

from beamdae.sundials.library import load_library

Array = np.ndarray

ONE_STEP = 2

# What scikit-sundae sets; the last is IDA's own as well.
_NEWTON_ITERATIONS, _CONVERGENCE_FAILURES, _SHORTEST, _STEPS = 4, 10, 0.0, 500

# Codes above this one stand for something else in linear solvers than in IDASolve.
_FIRST_COMMON_STATUS = -20
_STATUS_DESCRIPTIONS = {
    -1: "too many steps in one call",
    -2: "rtol and atol ask for more than the precision of numbers allows",
    -3: "the error test failed too often, or at the smallest step",
    -4: "Newton's iteration failed too often, or at the smallest step",
    -5: "the linear solver could not be initialized",
    -6: "the setup of the linear solver failed",
    -7: "the linear solver failed",
    -8: "the residual cannot be evaluated",
    -9: "the residual failed again and again",
    -12: "the residual failed at the start",
    -14: "there was no way on after the residual had failed",
    -15: "Newton's iteration could not be initialized",
    -16: "the setup of Newton's iteration failed",
    -17: "Newton's iteration failed",
    -20: "IDA has no memory block",
    -21: "there is not enough memory",
    -22: "an argument is out of its range",
    -23: "IDA was not initialized",
    -24: "an error weight is zero",
    -28: "a vector operation failed",
    -29: "the context is missing",
}


class IdaError(Exception):
    """A function of SUNDIALS that failed, and why."""


class IdaStatistics(NamedTuple):
    """What IDA counts, since the last start.

    A Newton iteration that fails with an old Jacobian counts as a failure, and is repeated with a
    new one (another setup); where that fails as well, it counts as a failed solve and the step is
    shortened.
    """

    steps: int
    error_test_failures: int
    newton_failures: int
    newton_iterations: int
    failed_solves: int
    setups: int
    residuals: int
    jacobians: int
    last_order: int
    next_order: int
    last_step: float
    next_step: float


# In the order of the fields. Counters are read into 64 bits whatever C's long is.
_GETTERS: tuple[tuple[str, Any], ...] = (
    ("IDAGetNumSteps", ctypes.c_int64),
    ("IDAGetNumErrTestFails", ctypes.c_int64),
    ("IDAGetNumNonlinSolvConvFails", ctypes.c_int64),
    ("IDAGetNumNonlinSolvIters", ctypes.c_int64),
    ("IDAGetNumStepSolveFails", ctypes.c_int64),
    ("IDAGetNumLinSolvSetups", ctypes.c_int64),
    ("IDAGetNumResEvals", ctypes.c_int64),
    ("IDAGetNumJacEvals", ctypes.c_int64),
    ("IDAGetLastOrder", ctypes.c_int),
    ("IDAGetCurrentOrder", ctypes.c_int),
    ("IDAGetLastStep", ctypes.c_double),
    ("IDAGetCurrentStep", ctypes.c_double),
)


class SolverPointers(NamedTuple):
    """What compiled code hands to the functions: IDA's memory, and vectors for y, y' and errors."""

    memory: int
    y: int
    yp: int
    errors: int


def describe_status(status: int) -> str:
    """What a negative status says."""
    return _STATUS_DESCRIPTIONS.get(status, f"error {status} of SUNDIALS")


# What solvers hold of C. That of a dead one is freed when the next one is made: an interrupt in
# what Python calls when an object dies would be lost, with a traceback.
_live_solvers: list[tuple[weakref.ref[IdaSolver], contextlib.ExitStack]] = []


def _free_dead_solvers() -> None:
    """Free what no solver holds any more; every entry once, whatever thread is here."""
    for entry in [entry for entry in list(_live_solvers) if entry[0]() is None]:
        with contextlib.suppress(ValueError):
            _live_solvers.remove(entry)
            entry[1].close()


class IdaSolver:
    """IDA for r(t, y, y') = 0 whose Jacobian is the identity, of which the diagonal is kept.

    Set up as `IDA(linsolver="band", lband=0, uband=0)` of scikit-sundae 1.2 is, so that steps are
    the same to the last bit. A solver has a context of its own: several may run at once, each in
    one thread at a time.

    Parameters
    ----------
    residual, jacobian
        Addresses of C functions (`prototypes.RESIDUAL` and `JACOBIAN`), which have to outlive the
        solver. The Jacobian is all zeros when it is asked for; `SUNBandMatrix_Data` of it is the
        diagonal.
    user_data
        The address these functions are handed.
    atol
        Absolute tolerances, one for each unknown.
    max_order, max_step, rtol
        As in `Ida`.
    untested
        Which unknowns the error test leaves out, while Newton's iteration is tested in all of them;
        None: it leaves out none.

    Attributes
    ----------
    t, y, yp
        Time and state after the last step; the arrays are those IDA returns its results in.
    errors
        What `local_errors` and `error_weights` are returned in.
    pointers
        For compiled code that calls IDA itself.
    """

    def __init__(
        self,
        residual: int,
        jacobian: int,
        *,
        rtol: float,
        atol: Array,
        max_order: int,
        max_step: float,
        user_data: int | None = None,
        untested: Array | None = None,
    ) -> None:
        self._call = load_library().call
        self.y, self.yp, self.errors = (np.zeros(len(atol)) for _ in range(3))
        self.errors[:] = atol
        self._t = ctypes.c_double()
        with contextlib.ExitStack() as stack:
            self.pointers, matrix, linear = self._made(stack)
            self._do("IDASetUserData", user_data)
            self._do("IDAInit", residual, 0.0, self.pointers.y, self.pointers.yp)
            # IDA copies them.
            self._do("IDASVtolerances", rtol, self.pointers.errors)
            if untested is not None:
                self.errors[:] = ~untested
                self._do("IDASetId", self.pointers.errors)
                self._do("IDASetSuppressAlg", 1)
            self._do("IDASetLinearSolver", linear, matrix)
            self._do("IDASetJacFn", jacobian)
            self._do("IDASetMaxNonlinIters", _NEWTON_ITERATIONS)
            self._do("IDASetMaxConvFails", _CONVERGENCE_FAILURES)
            self._do("IDASetMinStep", _SHORTEST)
            self._do("IDASetMaxStep", max_step)
            self._do("IDASetMaxOrd", max_order)
            self._do("IDASetMaxNumSteps", _STEPS)
            _free_dead_solvers()
            _live_solvers.append((weakref.ref(self), stack.pop_all()))

    def _made(self, stack: contextlib.ExitStack) -> tuple[SolverPointers, int, int]:
        """What IDA needs and IDA, which the stack frees in the reverse order; matrix and solver."""
        call, context, memory = self._call, ctypes.c_void_p(), ctypes.c_void_p()
        _check_status("SUNContext_Create", call.SUNContext_Create(0, ctypes.byref(context)))
        stack.callback(call.SUNContext_Free, ctypes.byref(context))
        # They print; what happened is in the codes that are returned.
        _check_status("SUNContext_ClearErrHandlers", call.SUNContext_ClearErrHandlers(context))

        def freed(name: str, made: int | None, free: Any) -> int:
            if made is None:
                raise MemoryError(f"{name} of SUNDIALS found no memory")
            stack.callback(free, made)
            return made

        size = len(self.y)
        vectors = [
            freed("N_VMake_Serial", call.N_VMake_Serial(size, at, context), call.N_VDestroy)
            for at in (a.ctypes.data for a in (self.y, self.yp, self.errors))
        ]
        matrix = call.SUNBandMatrix(size, 0, 0, context)
        freed("SUNBandMatrix", matrix, call.SUNMatDestroy)
        linear = call.SUNLinSol_Band(vectors[0], matrix, context)
        freed("SUNLinSol_Band", linear, call.SUNLinSolFree)
        memory.value = call.IDACreate(context)
        freed("IDACreate", memory.value, lambda _: call.IDAFree(ctypes.byref(memory)))
        return SolverPointers(memory.value or 0, *vectors), matrix, linear

    @property
    def t(self) -> float:
        """Time after the last step."""
        return self._t.value

    def start(self, t: float, y: Array, yp: Array, first_step: float) -> None:
        """Begin anew at a state, with a first step of this length or less."""
        self._t.value = t
        self.y[:], self.yp[:] = y, yp
        self._do("IDASetInitStep", first_step)
        self._do("IDAReInit", t, self.pointers.y, self.pointers.yp)

    def stop_at(self, end: float) -> None:
        """Let steps end at `end`, until one of them does."""
        self._do("IDASetStopTime", end)

    def step(self, end: float) -> int:
        """One step, which does not go beyond `end`.

        Returns
        -------
        int
            IDA's status: 0, or 1 at `end`; negative where it failed, see `describe_status`.
        """
        self.stop_at(end)
        at = self.pointers
        status: int = self._call.IDASolve(
            at.memory, end, ctypes.byref(self._t), at.y, at.yp, ONE_STEP
        )
        return status

    @property
    def statistics(self) -> IdaStatistics:
        """What IDA counted since the last start."""
        values = []
        for name, kind in _GETTERS:
            value = kind()
            self._do(name, ctypes.byref(value))
            values.append(value.value)
        return IdaStatistics(*values)

    def local_errors(self) -> Array:
        """Estimated local errors of the last step, one for each unknown."""
        self._do("IDAGetEstLocalErrors", self.pointers.errors)
        return self.errors.copy()

    def error_weights(self) -> Array:
        """What errors are multiplied by: 1 / (rtol |y| + atol)."""
        self._do("IDAGetErrWeights", self.pointers.errors)
        return self.errors.copy()

    def _do(self, name: str, *arguments: Any) -> None:
        """Call a function that takes IDA's memory first, and tells whether it succeeded."""
        _check_status(name, getattr(self._call, name)(self.pointers.memory, *arguments))


def _check_status(name: str, code: int) -> None:
    if code < 0:
        said = (
            describe_status(code) if code <= _FIRST_COMMON_STATUS else f"error {code} of SUNDIALS"
        )
        raise IdaError(f"{name}: {said}")
