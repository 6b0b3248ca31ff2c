"""What a check found, in words by topic."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beamdae.analysis.linear_dynamics.symmetric_eigenproblem import FrequencyRange
from beamdae.equations.starts.redundant_constraints import describe_dependent_sets

# Lightly damped modes are those of less than this.
_LIGHTLY = 0.62
# Motions of a sentence.
_MOST_TOLD = 8


def describe_check(check: Any) -> Mapping[str, str]:
    """Topics of a `Check`, and what there is to tell of each."""
    facts = {"size": f"{check.coordinates} coordinates, {check.constraints} constraints"}
    if check.mobility is not None:
        rigid = check.rigid_mobility
        facts["mobility"] = (
            f"{check.mobility} = {check.coordinates} coordinates - {check.rank} independent "
            f"constraints; {rigid} if beams are rigid and drivers hold"
        )
        facts["dependent constraints"] = describe_dependent_sets(check.dependent) or "none"
        free = check.free_motions
        more = [f"and {len(free) - _MOST_TOLD} more"] if len(free) > _MOST_TOLD else []
        facts["free motions"] = "; ".join([*free[:_MOST_TOLD], *more]) or "none"
    else:
        facts["mobility"] = "not looked for, the constraints are too many"
    loose = "; ".join(", ".join(group) for group in check.loose)
    facts["unconnected parts"] = f"no joint ties to the ground: {loose}" if loose else "none"
    facts["start"] = _start(check)
    if check.residuals:
        worst = {
            level: max(check.residuals, key=lambda r: getattr(r, level) or 0.0)
            for level in ("position", "velocity", "acceleration")
        }
        facts["largest residuals"] = ", ".join(
            f"{sign} {getattr(at, level) or 0.0:.2g} ({at.part})"
            for sign, (level, at) in zip(("g", "g_dot", "g_ddot"), worst.items(), strict=True)
        )
    if check.spectrum is not None:
        facts |= _spectrum(check.spectrum)
    elif check.start is not None:
        facts["frequencies"] = "not looked for, the coordinates are too many"
    for mesh in check.meshes:
        facts[f"mesh of {mesh.beam}"] = (
            f"{mesh.verdict}; arc length off by {mesh.length_error:.2g}, curvature times length by "
            f"{mesh.curvature_error:.2g}"
        )
    if check.prediction is not None:
        p = check.prediction
        how = "a run to the end" if p.reached >= 1.0 else f"a trial of {p.reached:.1%} of it"
        facts["a run takes"] = (
            f"about {p.steps:.1g} steps, {p.seconds:.1g} s ({p.method}), as {how} says"
        )
    facts["verdict"] = check.problem or "it can be run"
    return facts


def _start(check: Any) -> str:
    if check.start is None:
        return "none found"
    most = check.start.largest
    moved = "nothing has coordinates" if most is None else "the joints change nothing"
    if most is not None and most.displacement > 0.0:
        moved = f"the joints move {most.part} by {most.displacement:.3g} m ({most.coordinate})"
    return f"{check.start.asked}; {moved}"


def _spectrum(found: FrequencyRange) -> dict[str, str]:
    if found.massless:
        return {"mass": f"singular, {found.massless} moves without inertia"}
    facts = {"mass": "positive in every motion the joints allow"}
    if found.highest is not None and found.lowest is not None:
        light = found.damping_ratio < _LIGHTLY
        orders = (
            "BDF stays at order 2 where it passes over them" if light else "any order is stable"
        )
        facts["frequencies"] = (
            f"{found.lowest:.4g} to {found.highest:.4g} Hz; a step of {0.05 / found.lowest:.2g} s "
            f"resolves the lowest, one of {0.05 / found.highest:.2g} s the highest; damping ratio "
            f"of the fastest {found.damping_ratio:.2g}, {orders}"
        )
    if found.falling > 0.0:
        facts["unstable"] = f"a motion leaves the start at the rate {found.falling:.3g} 1/s"
    return facts
