"""Robertson's problem, run by the class of scikit-sundae and by the C interface of SUNDIALS."""

import ctypes

import numpy as np
from sksundae.ida import IDA

from beamdae.sundials.library import load_library
from beamdae.sundials.prototypes import JACOBIAN, RESIDUAL
from beamdae.sundials.solver import IdaSolver


def array(address, size):
    return np.ctypeslib.as_array((ctypes.c_double * size).from_address(address))


class DirectIda:
    """`IdaSolver` with the part of scikit-sundae's interface that beamdae uses."""

    def __init__(self, residual, *, jacfn, first_step, atol, **options):
        for band in ("linsolver", "lband", "uband"):
            options.pop(band, None)
        call, size = load_library().call, len(atol)

        def vector(at):
            return array(call.N_VGetArrayPointer(at), size)

        @RESIDUAL
        def residual_callback(t, y, yp, out, data):
            residual(t, vector(y), vector(yp), vector(out))
            return 0

        @JACOBIAN
        def jacobian_callback(t, c, y, yp, res, matrix, data, *work):
            diagonal = array(call.SUNBandMatrix_Data(matrix), size)
            jacfn(t, vector(y), vector(yp), vector(res), c, diagonal)
            return 0

        self._callbacks, self._first = (residual_callback, jacobian_callback), first_step
        at = (ctypes.cast(function, ctypes.c_void_p).value for function in self._callbacks)
        self.solver = IdaSolver(*at, atol=atol, **options)

    def init_step(self, t, y, yp):
        self.solver.start(t, y, yp, self._first)

    def step(self, end, method, stop):
        status = self.solver.step(stop)
        return Result(status, self.solver.t, self.solver.y.copy(), self.solver.yp.copy())


class Result:
    def __init__(self, status, t, y, yp):
        self.status, self.success, self.message = status, status >= 0, ""
        self.t, self.y, self.yp = t, y, yp


def create_sksundae_ida(residual, **options):
    return IDA(residual, linsolver="band", lband=0, uband=0, **options)


def take_steps(solver, t, y, yp, end, max_steps=10_000):
    """Return (status, t, y, y') of every step until `end` or a failure."""
    solver.init_step(t, y, yp)
    steps = []
    for _ in range(max_steps):
        result = solver.step(end, "onestep", end)
        steps.append((result.status, result.t, result.y, result.yp))
        if result.status:
            return steps
    raise AssertionError("the run does not end")


def steps_are_equal(one, other):
    """Return True if two runs have the same steps bit by bit, with NaN and signs of zeros."""
    return len(one) == len(other) and all(
        a[0] == b[0]
        and all(
            np.asarray(x).tobytes() == np.asarray(y).tobytes() for x, y in zip(a, b, strict=True)
        )
        for a, b in zip(one, other, strict=True)
    )


class Robertson:
    """Stiff kinetics of three species; IDA gets J^-1 r and the identity."""

    y0, yp0 = np.array([1.0, 0.0, 0.0]), np.array([-0.04, 0.04, 0.0])
    atol = np.array([1e-8, 1e-12, 1e-8])

    def __init__(self):
        self.inverse, self.out, self.calls = np.eye(3), None, 0

    def _raw(self, y, yp):
        rate = -0.04 * y[0] + 1e4 * y[1] * y[2]
        second = -rate - 3e7 * y[1] ** 2
        return np.array([yp[0] - rate, yp[1] - second, y.sum() - 1.0])

    def residual(self, t, y, yp, out):
        self.calls += 1
        self.out = out
        out[:] = self.inverse @ self._raw(y, yp)

    def jacobian(self, t, y, yp, res, c, out):
        first = [c + 0.04, -1e4 * y[2], -1e4 * y[1]]
        second = [-0.04, c + 1e4 * y[2] + 6e7 * y[1], 1e4 * y[1]]
        self.inverse = np.linalg.inv(np.array([first, second, np.ones(3)]))
        self.out[:] = self.inverse @ self._raw(y, yp)
        if out.ndim == 2:
            np.fill_diagonal(out, 1.0)
        else:
            out[:] = 1.0

    def create(self, kind, **options):
        defaults = {
            "first_step": 1e-6,
            "max_step": 4e9,
            "max_order": 5,
            "rtol": 1e-6,
            "atol": self.atol,
        }
        return kind(self.residual, jacfn=self.jacobian, **(defaults | options))

    def run(self, kind, end=4e6, **options):
        return take_steps(self.create(kind, **options), 0.0, self.y0, self.yp0, end)
