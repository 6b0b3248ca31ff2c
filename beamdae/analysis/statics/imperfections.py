"""Geometric imperfections: beams whose stress-free shape deviates from the drawing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from beamdae import deferred
from beamdae.analysis.statics.linear_buckling import Buckling
from beamdae.analysis.statics.static_equilibrium import trace_critical_points
from beamdae.beams.beam import CUSTOM_FORMULATION, Beam, beams_of
from beamdae.beams.remeshing import replace_beams
from beamdae.curves.intrinsic_curve import IntrinsicCurve
from beamdae.curves.plane_curves import require_curve
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.errors import (
    BeamdaeError,
    kind_of_message,
    record_warnings,
    require_finite,
    require_mapping,
    require_sequence,
    short_repr,
    suggest,
    warn_of_incomplete_result,
    warn_of_result,
)
from beamdae.interrupts import interruptible
from beamdae.parts.mechanism import AS_DRAWN, Mechanism
from beamdae.results.displays import HasPage, HasTable, Plot
from beamdae.results.section_forces.section_motions import (
    evaluate_sections,
    position_and_angle,
)
from beamdae.simulation import as_mechanism

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_NAME = "imperfect"
# Points at which lengths and distances between curves are evaluated.
_SAMPLES = 401
# Degree of the splines through the displacements and rotations of the nodes.
_SPLINE_DEGREE = 5
# Change of a coordinate, in m or rad, over which motions are differenced.
_DIFFERENCE = 1e-5
# A beam whose rotations vary by less than this fraction of the largest rotation keeps its shape.
_MIN_BENDING = 1e-9


# Derivatives of the displacement (x, y) and of the section rotation [rad] of a reference curve by
# its arc length s, as a function of s [m] that returns (..., 3).
_Slope = Callable[[Array], Array]


def _differentiate_motion(s: Array, motion: Array) -> _Slope:
    """Return the slope of displacements and rotations (3, k) at the arc lengths s (k,)."""
    degree = min(_SPLINE_DEGREE, len(s) - 1)
    slope: _Slope = scipy.interpolate.make_interp_spline(s, motion.T, degree).derivative()
    return slope


def _deviate(beam: Beam, slope: _Slope, amplitude: float) -> Beam:
    """Return the beam whose stress-free shape deviates by a multiple of a motion."""
    s = np.linspace(0.0, beam.length, _SAMPLES)
    angle = beam.curve.tangent_angle(s)
    axis = np.stack([np.cos(angle), np.sin(angle)]) + amplitude * slope(s).T[:2]
    stretch = np.linalg.norm(axis, axis=0)
    before = beam.free_curve
    length = before.length + float(np.trapezoid(stretch - 1.0, s))
    ratio, ratio_before = length / beam.length, before.length / beam.length

    def curvature(s: float) -> float:
        at = s / ratio
        change = amplitude * float(slope(np.array(at))[2])
        return (ratio_before * float(before.curvature(ratio_before * at)) + change) / ratio

    angle_before = float(before.tangent_angle(0.0))
    return beam._with_free_curve(IntrinsicCurve(curvature, length, angle=angle_before))


def imperfect(model: Any, shape: Any, amplitude: float | None = None) -> Mechanism:
    """Return a copy of a mechanism whose beams have a geometric imperfection.

    The stress-free shape of each beam (`Beam(free_curve=)`) is its reference curve plus the
    deviation. The drawing and the joints do not change: without load, the mechanism takes the
    imperfect shape without stress, up to terms of second order in the amplitude, if the deviation
    is compatible with the joints, as buckling modes are. A measured shape that does not fit causes
    the stresses of an assembly by force. Only beams have imperfections: rigid bodies, springs and
    joints keep their positions.

    Parameters
    ----------
    model
        A model function (with its defaults) or a mechanism.
    shape
        Shape of the deviation:

        - coordinates (n,) of a mode, for example `buckling(mech).shapes[0]`, or a `Buckling`, of
          which the first mode is used,
        - measured curves, by the name of the beam, such as {"column": bd.Curve(points=points)}.
    amplitude
        Largest distance of a beam axis from its reference curve [m]; a negative value reverses the
        deviation. Required for a mode; by default, measured curves are not scaled.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the shape bends no beam, a beam with custom kinematics would
        deviate, or the imperfection changes the length of a beam by more than 1 %.

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.002)
    >>> mech = bd.Mechanism()
    >>> column = mech.add(bd.Beam("column", bd.Line((0.0, 0.0), (0.0, 1.0)), strip))
    >>> clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), column.start))
    >>> press = mech.add(bd.Force("press", column.end, (0.0, -strip.EI)))
    >>> mech.observe("tip", column.end)
    >>> bent = bd.imperfect(mech, bd.buckling(mech, n=1), amplitude=1e-3)
    >>> path = bd.equilibrium(bent, to=1.0)
    >>> bool(abs(abs(path.columns["tip.x [m]"][-1]) - 1e-3 / (1 - 4 / 3.14159**2)) < 1e-5)
    True
    """
    model = as_mechanism(_NAME, model)
    change = _prepare_changes(_NAME, model, shape)
    if amplitude is not None:
        amplitude = require_finite(_NAME, "amplitude", amplitude)
    elif not isinstance(shape, Mapping):
        raise BeamdaeError(f"{_NAME}: a mode has no size; pass amplitude= [m].")
    return change(f"{_NAME}: amplitude", amplitude)


def _prepare_changes(
    call: str, mechanism: Mechanism, shape: Any
) -> Callable[[str, float | None], Mechanism]:
    """Return the function from an amplitude [m] to the mechanism with this imperfection.

    Its first argument names the amplitude in messages; without an amplitude, the shape is not
    scaled. All beams of a mode share its amplitude, that of its largest displacement.
    """
    beams = {beam.name: beam for beam in beams_of(mechanism)}
    if isinstance(shape, Mapping):
        curves = require_mapping(call, "shape", shape, "measured curves by name of a beam")
        motions = {name: _measure_motion(call, beams, name, x) for name, x in curves.items()}
        least = -1.0
    else:
        motions = _modal_motions(call, mechanism, beams, shape)
        least = _MIN_BENDING * max((np.ptp(x[2]) for _, x in motions.values()), default=0.0)
    size = max((np.max(np.hypot(*x[:2])) for _, x in motions.values()), default=0.0)
    slopes = {
        name: _differentiate_motion(s, x)
        for name, (s, x) in motions.items()
        if np.ptp(x[2]) > least
    }
    if not (slopes and size > 0.0):
        raise BeamdaeError(
            f"{call}: the shape bends no beam; choose another mode or other curves, because only "
            "beams have imperfections."
        )

    def change(argument: str, amplitude: float | None) -> Mechanism:
        scale, changed = 1.0 if amplitude is None else amplitude / float(size), {}
        for name, slope in slopes.items():
            try:
                changed[name] = _deviate(beams[name], slope, scale)
            except BeamdaeError as problem:
                raise BeamdaeError(
                    f"{argument} {scale * size:.3g} m is too large for {name} ({problem}); "
                    "reduce it."
                ) from problem
        return replace_beams(mechanism, changed, _NAME)

    return change


@dataclass(frozen=True, repr=False)
class KnockDown(HasTable, HasPage):
    """Critical load factors of a structure with imperfections of various amplitudes.

    Attributes
    ----------
    amplitudes
        Amplitudes of the imperfection (k,) [m].
    factors
        Load factor of the first critical point of each path (k,) [-]; nan if there is none.
    kinds
        Kind of each critical point, see `CriticalPoint`; "" if there is none.
    perfect
        Load factor of the first critical point without imperfection [-]; nan if there is none.
    warnings
        Warnings that the call issued.
    """

    amplitudes: Array
    factors: Array
    kinds: tuple[str, ...]
    perfect: float
    warnings: tuple[str, ...] = field(default=(), repr=False)

    def __repr__(self) -> str:
        pairs = zip(self.amplitudes.tolist(), self.factors.tolist(), strict=True)
        values = ", ".join(f"{factor:.5g} at {amplitude:g} m" for amplitude, factor in pairs)
        return f"<KnockDown: {self.perfect:.5g} without imperfection; {values}>"

    def plot(self) -> Plot:
        """Plot the critical load factor over the amplitude of the imperfection."""
        return deferred.module("report.result_displays").draw_result(self)

    def table(self) -> pd.DataFrame:
        """Return a table with amplitude, load factor, its ratio to the perfect structure, kind."""
        import pandas as pd

        return pd.DataFrame(
            {
                "amplitude [m]": self.amplitudes,
                "load factor [-]": self.factors,
                "knock-down factor [-]": self.factors / self.perfect,
                "point": list(self.kinds),
            }
        )


@interruptible
@record_warnings
def knock_down(model: Any, shape: Any, amplitudes: Any, **settings: Any) -> KnockDown:
    """Compute the critical load factor as a function of the amplitude of an imperfection.

    Parameters
    ----------
    model, shape
        See `imperfect`.
    amplitudes
        Amplitudes [m] of the imperfection.
    settings
        Arguments of `equilibrium`. Choose `to` such that each path passes its first critical point,
        for example a displacement.

    Returns
    -------
    KnockDown
        Critical load factors; `table` contains their ratios to that of the perfect structure.

    Raises
    ------
    BeamdaeError
        If an argument is invalid.

    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        If the path of an amplitude has no critical point, and as in `equilibrium` for the model,
        each kind of warning once.
    """
    model = as_mechanism("knock_down", model)
    change = _prepare_changes("knock_down", model, shape)
    values = require_sequence("knock_down", "amplitudes", amplitudes, "numbers")
    sizes = [require_finite("knock_down", "amplitudes", value) for value in values]
    paths, messages = [], dict[str, str]()
    for size in [*sizes, None]:
        bent = model if size is None else change("knock_down: an entry of amplitudes,", size)
        path, sentences = trace_critical_points(bent, settings)
        paths.append(path)
        for sentence in sentences:
            messages.setdefault(kind_of_message(sentence), sentence)
        if not (path.critical or size is None):
            what = f"knock_down: the path of the amplitude {size:g} m has no critical point"
            is_short = path.status.success
            end = "; choose a farther target to=" if is_short else f": {path.status.sentence}"
            warn_of_incomplete_result(f"{what}{end}.")
    warn_of_result(messages.values())
    first = [path.critical[0] if path.critical else None for path in paths]
    factors = [np.nan if one is None else float(one.factor) for one in first]
    kinds = tuple("" if one is None else one.kind for one in first[:-1])
    return KnockDown(np.array(sizes), np.array(factors[:-1]), kinds, factors[-1])


def _measure_motion(
    call: str, beams: Mapping[str, Beam], name: Any, measured: Any
) -> tuple[Array, Array]:
    """Return arc lengths (k,), and displacements and rotations (3, k) to a measured curve."""
    if name not in beams:
        raise BeamdaeError(
            f"{call}: shape names {short_repr(name)}, but no beam has this name"
            f"{suggest(str(name), beams)}; use the name of a beam."
        )
    beam, curve = beams[name], require_curve(f"{call}: {name}", measured)
    s = np.linspace(0.0, beam.length, _SAMPLES)
    at = curve.length / beam.length * s
    rotation = curve.tangent_angle(at) - beam.curve.tangent_angle(s)
    return s, np.vstack([(curve.point(at) - beam.curve.point(s)).T, rotation])


def _modal_motions(
    call: str, mechanism: Mechanism, beams: Mapping[str, Beam], shape: Any
) -> dict[str, tuple[Array, Array]]:
    """Return arc lengths, and displacements and rotations (3, nodes), of all beams in a mode."""
    equations = equations_of_motion(mechanism, AS_DRAWN)
    expected = (
        f"the {equations.n} real coordinates of a mode of this mechanism, a Buckling with a mode, "
        "or a dict of curves"
    )
    vector = shape.shapes[0] if isinstance(shape, Buckling) and len(shape) else shape
    entries = require_sequence(call, "shape", vector, expected)
    if len(entries) != equations.n:
        raise BeamdaeError(f"{call}: shape must be {expected}, got {short_repr(shape)}.")
    mode = np.array([require_finite(call, "shape", entry) for entry in entries])
    rows = {name: k for k, name in enumerate(equations.q_names)}
    motions = {}
    for name, beam in beams.items():
        change = mode[[rows[f"{name}.{one.name}"] for one in beam.coordinates]]
        if beam.formulation == CUSTOM_FORMULATION and np.any(change):
            raise BeamdaeError(
                f"{call}: {name} has custom kinematics, which have no free_curve; use a built-in "
                "formulation."
            )
        nodes = beam.mesh.node_arc_lengths
        points = [beam.kinematics.material_point(s) for s in nodes.tolist()]
        at = [(point.operator, point.motion) for point in points]
        # Scaled to a rotation small enough for a linear result.
        step = _DIFFERENCE / (np.max(np.abs(change), initial=0.0) or 1.0)
        q = beam.initial_position + step * np.stack([change, -change])
        at_rest = np.zeros_like(q)
        ends = evaluate_sections(position_and_angle, at, q, at_rest, at_rest)
        motions[name] = nodes, (ends[0] - ends[1]).T / (2.0 * step)
    return motions
