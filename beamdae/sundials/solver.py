"""IDA of SUNDIALS, one step at a time, with a diagonal Jacobian."""

from __future__ import annotations

import contextlib
import ctypes
import weakref
from typing import Any, NamedTuple

import numpy as np

from beamdae.sundials.library import load_library

Array = np.ndarray

# Limits that scikit-sundae sets. The number of steps per call is also the default of IDA.
_MAX_NEWTON_ITERATIONS = 4
_MAX_CONVERGENCE_FAILURES = 10
_MIN_STEP = 0.0
_MAX_STEPS_PER_CALL = 500

# Codes above this value have different meanings in IDASolve and in linear solvers.
_FIRST_COMMON_STATUS = -20
_STATUS_DESCRIPTIONS = {
    -1: "too many steps in one call",
    -2: "rtol and atol are too small for double precision",
    -3: "the error test failed too often, or at the smallest step",
    -4: "Newton's iteration failed too often, or at the smallest step",
    -5: "the linear solver could not be initialized",
    -6: "the setup of the linear solver failed",
    -7: "the linear solver failed",
    -8: "the residual cannot be evaluated",
    -9: "the residual failed repeatedly",
    -12: "the residual failed at the start",
    -14: "IDA could not recover after the residual had failed",
    -15: "Newton's iteration could not be initialized",
    -16: "the setup of Newton's iteration failed",
    -17: "Newton's iteration failed",
    -20: "IDA has no memory block",
    -21: "there is not enough memory",
    -22: "an argument is out of range",
    -23: "IDA was not initialized",
    -24: "an error weight is zero",
    -28: "a vector operation failed",
    -29: "the context is missing",
}


class IdaError(Exception):
    """Raised if a function of SUNDIALS fails; the message names the function and the reason."""


class SolverPointers(NamedTuple):
    """Addresses for compiled code that calls IDA: its memory, and vectors for y, y' and errors."""

    memory: int
    y: int
    yp: int
    errors: int


def describe_status(status: int) -> str:
    """Return a description of a negative status of IDA."""
    return _STATUS_DESCRIPTIONS.get(status, f"error {status} of SUNDIALS")


# C memory of solvers. The memory of a deleted solver is freed when the next solver is created,
# because an interrupt during a finalizer would be printed and lost.
_live_solvers: list[tuple[weakref.ref[IdaSolver], contextlib.ExitStack]] = []


def _free_dead_solvers() -> None:
    """Free the C memory of deleted solvers, each once, from any thread."""
    for entry in [entry for entry in list(_live_solvers) if entry[0]() is None]:
        with contextlib.suppress(ValueError):
            _live_solvers.remove(entry)
            entry[1].close()


class IdaSolver:
    """IDA for r(t, y, y') = 0 with a diagonal Jacobian.

    It is set up as `IDA(linsolver="band", lband=0, uband=0)` of scikit-sundae 1.2, so that the
    steps of both agree to the last bit. Each solver has a separate context, so that several solvers
    may run simultaneously, each in one thread at a time.

    Parameters
    ----------
    residual, jacobian
        Addresses of C functions, which must outlive the solver: residual(t, y, y', r, user_data)
        and jacobian(t, c, y, y', r, J, user_data, three vectors) with J = dr/dy + c dr/dy'. IDA
        passes a Jacobian of zeros; its `SUNBandMatrix_Data` is the diagonal. A positive result
        makes IDA shorten the step, a negative result ends the run.
    user_data
        Address that IDA passes to these functions.
    rtol, atol
        Relative tolerance, and absolute tolerances, one per unknown; error weights are
        1 / (rtol |y| + atol).
    max_order, max_step
        Highest order, 1 to 5, and longest step [s].
    untested
        Mask of the unknowns that are excluded from the error test; the convergence test of Newton's
        iteration includes all unknowns. Defaults to no exclusion.

    Attributes
    ----------
    y, yp
        State, set by `start` and by each step: IDA writes into these arrays.
    errors
        Array into which compiled code lets IDA write the local errors of a step.
    pointers
        Addresses for compiled code that calls IDA directly.

    Raises
    ------
    UnavailableError
        If the C interface of SUNDIALS cannot be used.
    IdaError
        If IDA rejects an option.
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
        with contextlib.ExitStack() as stack:
            self.pointers, matrix, linear = self._create(stack)
            self._call_ida("IDASetUserData", user_data)
            self._call_ida("IDAInit", residual, 0.0, self.pointers.y, self.pointers.yp)
            # IDA copies the tolerances.
            self._call_ida("IDASVtolerances", rtol, self.pointers.errors)
            if untested is not None:
                self.errors[:] = ~untested
                self._call_ida("IDASetId", self.pointers.errors)
                self._call_ida("IDASetSuppressAlg", 1)
            self._call_ida("IDASetLinearSolver", linear, matrix)
            self._call_ida("IDASetJacFn", jacobian)
            self._call_ida("IDASetMaxNonlinIters", _MAX_NEWTON_ITERATIONS)
            self._call_ida("IDASetMaxConvFails", _MAX_CONVERGENCE_FAILURES)
            self._call_ida("IDASetMinStep", _MIN_STEP)
            self._call_ida("IDASetMaxStep", max_step)
            self._call_ida("IDASetMaxOrd", max_order)
            self._call_ida("IDASetMaxNumSteps", _MAX_STEPS_PER_CALL)
            _free_dead_solvers()
            _live_solvers.append((weakref.ref(self), stack.pop_all()))

    def _create(self, stack: contextlib.ExitStack) -> tuple[SolverPointers, int, int]:
        """Create IDA and its vectors; return their pointers, the matrix and the linear solver.

        The stack frees all of these in reverse order.
        """
        call, context, memory = self._call, ctypes.c_void_p(), ctypes.c_void_p()
        _check_status("SUNContext_Create", call.SUNContext_Create(0, ctypes.byref(context)))
        stack.callback(call.SUNContext_Free, ctypes.byref(context))
        # The default handler prints errors; the returned codes are sufficient.
        _check_status("SUNContext_ClearErrHandlers", call.SUNContext_ClearErrHandlers(context))

        def register(name: str, address: int | None, free: Any) -> int:
            if address is None:
                raise MemoryError(f"{name} of SUNDIALS: out of memory")
            stack.callback(free, address)
            return address

        size = len(self.y)
        vectors = [
            register("N_VMake_Serial", call.N_VMake_Serial(size, at, context), call.N_VDestroy)
            for at in (array.ctypes.data for array in (self.y, self.yp, self.errors))
        ]
        matrix = call.SUNBandMatrix(size, 0, 0, context)
        register("SUNBandMatrix", matrix, call.SUNMatDestroy)
        linear = call.SUNLinSol_Band(vectors[0], matrix, context)
        register("SUNLinSol_Band", linear, call.SUNLinSolFree)
        memory.value = call.IDACreate(context)
        register("IDACreate", memory.value, lambda _: call.IDAFree(ctypes.byref(memory)))
        return SolverPointers(memory.value or 0, *vectors), matrix, linear

    def start(self, t: float, y: Array, yp: Array, first_step: float) -> None:
        """Start at (y, y') at time `t` [s], with a first step of at most `first_step` [s]."""
        self.y[:], self.yp[:] = y, yp
        self._call_ida("IDASetInitStep", first_step)
        self._call_ida("IDAReInit", t, self.pointers.y, self.pointers.yp)

    def stop_at(self, end: float) -> None:
        """Forbid steps beyond the time `end` [s] until `end` is reached."""
        self._call_ida("IDASetStopTime", end)

    @property
    def failures(self) -> tuple[int, int, int]:
        """Failed error tests, steps without solution, and iterations since the last start.

        A Newton iteration that fails with an old Jacobian is repeated with a new one. If the
        repetition also fails, there is no solution, and IDA shortens the step.
        """
        names = "IDAGetNumErrTestFails", "IDAGetNumStepSolveFails", "IDAGetNumNonlinSolvConvFails"
        error_tests, solves, newton = map(self._read, names)
        return error_tests, solves, newton

    def _read(self, name: str) -> int:
        # C's long may have 32 bits; 64 bits hold both.
        value = ctypes.c_int64()
        self._call_ida(name, ctypes.byref(value))
        return value.value

    def _call_ida(self, name: str, *arguments: Any) -> None:
        """Call a function whose first argument is IDA's memory, and check its status."""
        _check_status(name, getattr(self._call, name)(self.pointers.memory, *arguments))


def _check_status(name: str, code: int) -> None:
    if code < 0:
        is_common = code <= _FIRST_COMMON_STATUS
        reason = describe_status(code) if is_common else f"error {code} of SUNDIALS"
        raise IdaError(f"{name}: {reason}")
