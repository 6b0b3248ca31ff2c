"""C prototypes of SUNDIALS 7 for double precision and 32-bit indices, without MPI."""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

_address, _real, _index = ctypes.c_void_p, ctypes.c_double, ctypes.c_int32
_code, _int, _long = ctypes.c_int, ctypes.c_int, ctypes.c_long


class FunctionAddresses(NamedTuple):
    """Addresses of the functions by their names in C, for callables and compiled loops."""

    SUNDIALSGetVersionNumber: int
    SUNContext_Create: int
    SUNContext_ClearErrHandlers: int
    SUNContext_Free: int
    N_VNew_Serial: int
    N_VMake_Serial: int
    N_VBufSize_Serial: int
    N_VGetArrayPointer: int
    N_VDestroy: int
    SUNBandMatrix: int
    SUNBandMatrix_Data: int
    SUNMatDestroy: int
    SUNLinSol_Band: int
    SUNLinSolFree: int
    IDACreate: int
    IDAInit: int
    IDAReInit: int
    IDASVtolerances: int
    IDASetUserData: int
    IDASetLinearSolver: int
    IDASetJacFn: int
    IDASetMaxNonlinIters: int
    IDASetMaxConvFails: int
    IDASetInitStep: int
    IDASetMinStep: int
    IDASetMaxStep: int
    IDASetMaxOrd: int
    IDASetMaxNumSteps: int
    IDASetStopTime: int
    IDASetId: int
    IDASetSuppressAlg: int
    IDASolve: int
    IDAFree: int
    IDAGetNumSteps: int
    IDAGetLastOrder: int
    IDAGetLastStep: int
    IDAGetCurrentStep: int
    IDAGetNumErrTestFails: int
    IDAGetNumNonlinSolvConvFails: int
    IDAGetNumNonlinSolvIters: int
    IDAGetNumStepSolveFails: int
    IDAGetNumLinSolvSetups: int
    IDAGetNumResEvals: int
    IDAGetNumJacEvals: int
    IDAGetEstLocalErrors: int


# (result, *arguments) -> functions.
_SIGNATURES: dict[tuple[Any, ...], tuple[str, ...]] = {
    (_code, *[_address] * 4, _int): ("SUNDIALSGetVersionNumber",),
    (_code, _int, _address): ("SUNContext_Create",),
    (_code, _address): ("SUNContext_ClearErrHandlers", "SUNContext_Free", "SUNLinSolFree"),
    # Called before the index width is known: a 64-bit integer also passes a 32-bit index.
    (_address, ctypes.c_int64, _address): ("N_VNew_Serial",),
    (_address, _index, _address, _address): ("N_VMake_Serial",),
    (_address, _address): ("N_VGetArrayPointer", "SUNBandMatrix_Data", "IDACreate"),
    (None, _address): ("N_VDestroy", "SUNMatDestroy", "IDAFree"),
    (_address, *[_index] * 3, _address): ("SUNBandMatrix",),
    (_address, *[_address] * 3): ("SUNLinSol_Band",),
    (_code, _address, _address, _real, _address, _address): ("IDAInit",),
    (_code, _address, _real, _address, _address): ("IDAReInit",),
    (_code, _address, _real, _address): ("IDASVtolerances",),
    (_code, _address, _address, _address): ("IDASetLinearSolver",),
    (_code, _address, _int): (
        *("IDASetMaxNonlinIters", "IDASetMaxConvFails", "IDASetMaxOrd", "IDASetSuppressAlg"),
    ),
    (_code, _address, _long): ("IDASetMaxNumSteps",),
    (_code, _address, _real): (
        *("IDASetInitStep", "IDASetMinStep", "IDASetMaxStep", "IDASetStopTime"),
    ),
    (_code, _address, _real, *[_address] * 3, _int): ("IDASolve",),
    (_code, _address, _address): (
        *("N_VBufSize_Serial", "IDASetUserData", "IDASetJacFn", "IDASetId"),
        *("IDAGetNumSteps", "IDAGetLastOrder", "IDAGetLastStep"),
        *("IDAGetCurrentStep", "IDAGetNumErrTestFails", "IDAGetNumNonlinSolvConvFails"),
        *("IDAGetNumNonlinSolvIters", "IDAGetNumStepSolveFails", "IDAGetNumLinSolvSetups"),
        *("IDAGetNumResEvals", "IDAGetNumJacEvals", "IDAGetEstLocalErrors"),
    ),
}
# Calls through these prototypes release the interpreter lock.
PROTOTYPES = {
    name: ctypes.CFUNCTYPE(*signature) for signature, names in _SIGNATURES.items() for name in names
}
