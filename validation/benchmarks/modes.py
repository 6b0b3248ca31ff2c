"""Natural frequencies with published or closed-form references, by both beam formulations."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from benchmarks import mode_closed_forms as closed_forms
from benchmarks.reference_case import ReferenceCase, beam_case

import beamdae as bd

Array = np.ndarray

FORMULATIONS = {"elements": "floating frame", "exact elements": "exact"}


def mode_case(
    name: str,
    source: str,
    elements: int,
    reference: Sequence[float],
    tolerance: float,
    compute: Callable[[int, str], Array],
) -> ReferenceCase:
    """Return the case of the frequencies that `compute` returns by elements and formulation."""

    def by_number(frequencies: Sequence[float] | Array) -> dict[str, float]:
        return {f"frequency {k}": float(x) for k, x in enumerate(frequencies, 1)}

    return beam_case(
        name,
        source,
        elements,
        by_number(reference),
        tolerance,
        lambda elements, settings: by_number(compute(elements, settings["formulation"])),
        {label: {"formulation": x} for label, x in FORMULATIONS.items()},
    )


def ring(
    section: bd.Section, radius: float, elements: int, formulation: str = "floating frame"
) -> bd.Mechanism:
    """Return a free ring of four welded beams."""
    mech = bd.Mechanism()
    circle = bd.Arc(radius=radius, length=2.0 * np.pi * radius)
    settings: dict[str, Any] = {"elements": elements // 4, "formulation": formulation}
    bd.welded_beams(mech, "ring", circle, section, 4, closed=True, **settings)
    return mech


def _ring_case(
    name: str,
    source: str,
    elements: int,
    waves: range,
    closed_form: Callable[[bd.Section, float, int], float],
    section: bd.Section,
    radius: float = 1.0,
) -> ReferenceCase:
    """Return the case of the frequencies of a ring [Hz], of each pair the less accurate one."""

    def compute(elements: int, formulation: str) -> Array:
        modes = bd.modes(ring(section, radius, elements, formulation), n=2 * waves[-1] + 1)
        assert modes.kinds[:3] == ("free motion",) * 3
        return modes.frequencies[[2 * n for n in waves]]

    reference = [closed_form(section, radius, n) / (2.0 * np.pi) for n in waves]
    return mode_case(name, source, elements, reference, 1e-4, compute)


def _round_section() -> bd.Section:
    steel = bd.Material(E=2e11, nu=0.3, rho=8000.0)
    area, second = np.pi * 0.1**2 / 4.0, np.pi * 0.1**4 / 64.0
    shear = 6.0 * 1.3 / (7.0 + 6.0 * 0.3)
    return bd.Section(steel, area=area, second_moment=second, shear_coefficient=shear)


def _thin_section() -> bd.Section:
    steel = bd.Material(E=2e11, nu=0.3, rho=8000.0)
    return bd.Section.rectangle(steel, width=0.01, height=1e-3)


def arch_section() -> bd.Section:
    """Return a section with R sqrt(A / I) = 15 for R = 1 and kG / E = 0.3."""
    rubber = bd.Material(E=1e9, nu=0.3, rho=1000.0)
    shear = 0.3 * 2.0 * 1.3
    return bd.Section(rubber, area=1e-2, second_moment=1e-2 / 225.0, shear_coefficient=shear)


def solve_hinged_arch(elements: int, formulation: str) -> Array:
    """Return w L^2 sqrt(rho A / EI) of a hinged arch of 90 degrees."""
    section, arc = arch_section(), bd.Arc(radius=1.0, length=0.5 * np.pi, angle=-0.25 * np.pi)
    mech = bd.Mechanism()
    settings: dict[str, Any] = {"elements": elements, "formulation": formulation}
    beam = mech.add(bd.Beam("arch", arc, section, **settings))
    for name, s, end in (("left", 0.0, beam.start), ("right", arc.length, beam.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*arc.point(s)), end))
    frequencies = bd.modes(mech, n=10).eigenvalues.imag
    return frequencies * arc.length**2 * np.sqrt(section.rhoA / section.EI)


def square_rubber() -> bd.Section:
    """Return a square section of rubber, 0.4 m thick."""
    nu, side = 0.3, 0.4
    rubber = bd.Material(E=1e9, nu=nu, rho=7850.0)
    shear = 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu)
    return bd.Section(rubber, area=side**2, second_moment=side**4 / 12, shear_coefficient=shear)


def supported_beam(elements: int, formulation: str = "floating frame") -> bd.Mechanism:
    """Return a straight beam of 2 m on a fixed and a sliding hinge."""
    mech = bd.Mechanism()
    settings: dict[str, Any] = {"elements": elements, "formulation": formulation}
    line = bd.Line((0.0, 0.0), (2.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, square_rubber(), **settings))
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), beam.end))
    return mech


def _supported_frequencies(elements: int, formulation: str) -> Array:
    return bd.modes(supported_beam(elements, formulation), n=5).eigenvalues.imag


def rotating_arm(
    slenderness: float, elements: int, formulation: str = "floating frame", offset: float = 0.0
) -> bd.Mechanism:
    """Return a cantilever of unit length, rho A and EI, with L sqrt(A / I) = `slenderness`.

    The clamp is at the distance `offset` from the origin.
    """
    light = bd.Material(E=slenderness**2, nu=0.3, rho=1.0)
    section = bd.Section(light, area=1.0, second_moment=slenderness**-2)
    mech = bd.Mechanism()
    settings: dict[str, Any] = {"elements": elements, "formulation": formulation}
    line = bd.Line((offset, 0.0), (offset + 1.0, 0.0))
    beam = mech.add(bd.Beam("arm", line, section, **settings))
    mech.add(bd.Weld("root", mech.ground.at(offset, 0.0), beam.start))
    return mech


# First three out-of-plane frequencies w L^2 sqrt(rho A / EI) by speed in the same unit.
WRIGHT = {
    0.0: (3.5160, 22.0345, 61.6972),
    1.0: (3.6817, 22.1810, 61.8418),
    2.0: (4.1373, 22.6149, 62.2732),
    3.0: (4.7973, 23.3203, 62.9850),
    4.0: (5.5850, 24.2734, 63.9668),
    5.0: (6.4495, 25.4461, 65.2050),
    6.0: (7.3604, 26.8091, 66.6840),
    8.0: (9.2568, 29.9954, 70.2930),
    10.0: (11.2023, 33.6404, 74.6493),
    12.0: (13.1702, 37.6031, 79.6145),
}


def _rotating_frequencies(speed: float) -> Callable[[int, str], Array]:
    """Return a function for the frequencies; in the plane of a thin arm w^2 is lower by speed^2."""

    def compute(elements: int, formulation: str) -> Array:
        arm = rotating_arm(1e4, elements, formulation)
        modes = bd.modes(arm, about=bd.rotation(speed), n=3)
        return np.sqrt(modes.eigenvalues.imag**2 + speed**2)

    return compute


HUB_RADIUS = 1.0  # distance of the clamp of an arm from the axis over its length


def _campbell_case(
    name: str,
    source: str,
    speeds: tuple[float, ...],
    reference: Callable[[float], Array],
    tolerance: float,
    build: Callable[[int, str], bd.Mechanism],
    center: tuple[float, float] = (0.0, 0.0),
) -> ReferenceCase:
    """Return a case whose values are those of a Campbell diagram nearest to each reference."""

    def compute(elements: int, formulation: str) -> Array:
        # A free ring has three further modes: its rotation, and its translations as a pair.
        number = len(reference(speeds[0])) + 3
        diagram = bd.campbell(build(elements, formulation), speeds, number, center)
        assert not diagram.warnings
        values = []
        for speed, eigenvalues in zip(speeds, diagram.eigenvalues, strict=True):
            distances = np.abs(eigenvalues.imag - reference(speed)[:, None])
            values.append(eigenvalues.imag[np.argmin(distances, axis=1)])
        return np.concatenate(values)

    references = tuple(np.concatenate([reference(speed) for speed in speeds]).tolist())
    return mode_case(name, source, 16, references, tolerance, compute)


# w L^2 sqrt(rho A / EI), to the printed digits.
EISENBERGER = (29.280, 33.305, 67.124, 79.971, 107.851, 143.618, 156.666, 190.477, 225.361, 234.524)
MODE_CASES = (
    _ring_case(
        "free ring, thick",
        "NAFEMS R0015 Test 6, 53.382 and 150.99 Hz by the formula of thin rings; closed form with "
        "stretch, shear and rotary inertia",
        16,
        range(2, 4),
        closed_forms.ring,
        _round_section(),
    ),
    _ring_case(
        "free ring, thick, four waves",
        "NAFEMS R0015 Test 6, 289.51 Hz by the formula of thin rings; closed form as above",
        20,
        range(4, 5),
        closed_forms.ring,
        _round_section(),
    ),
    _ring_case(
        "free ring, SDLL11",
        "AFNOR SDLL11, Code_Aster V2.02.011, 318.36 and 900.46 Hz by the formula of thin rings; "
        "closed form with stretch, shear and rotary inertia",
        16,
        range(2, 4),
        closed_forms.ring,
        bd.Section.rectangle(bd.Material(E=7.2e10, nu=0.3, rho=2700.0), width=0.010, height=0.005),
        0.1,
    ),
    _ring_case(
        "free ring, thin",
        "closed form: Love; Blevins 1979",
        16,
        range(2, 4),
        closed_forms.thin_ring,
        _thin_section(),
    ),
    mode_case(
        "hinged arch",
        "Eisenberger & Efraim, IJNME 52 (2001) 1221: circular, 90 degrees, shear flexible",
        24,
        EISENBERGER,
        1e-4,
        solve_hinged_arch,
    ),
    mode_case(
        "supported beam",
        "closed form of Timoshenko; Nachbagauer et al. 2013, EXUDYN ANCFBeam3DeigTest.py "
        "(95.635645, 280.322475, 332.254249, 635.769143 rad/s of 256 elements)",
        16,
        tuple(closed_forms.supported_beam(square_rubber(), 2.0, 5).tolist()),
        1e-6,
        _supported_frequencies,
    ),
    *(
        mode_case(
            f"rotating arm, speed {speed:g}",
            "Wright, Smith, Thresher & Wang, J. Appl. Mech. 49 (1982) 197: uniform, without offset",
            16,
            reference,
            # Half a unit of the last digit.
            2e-5,
            _rotating_frequencies(speed),
        )
        for speed, reference in WRIGHT.items()
    ),
    _campbell_case(
        "Campbell diagram, arm",
        "Wright, Smith, Thresher & Wang, J. Appl. Mech. 49 (1982) 197, in the plane",
        tuple(WRIGHT),
        lambda speed: np.sqrt(np.square(WRIGHT[speed]) - speed**2),
        # Half a unit of the last digit at the highest speed, in the plane.
        3e-5,
        lambda elements, formulation: rotating_arm(1e4, elements, formulation),
    ),
    _campbell_case(
        "Campbell diagram, arm on a hub",
        "Yoo & Shin, J. Sound Vib. 212 (1998) 807: hub radius 1, in the plane; Rayleigh-Ritz",
        (2.0, 10.0, 50.0),
        lambda speed: closed_forms.rotating_cantilever(speed, HUB_RADIUS, 3),
        1e-4,
        lambda elements, formulation: rotating_arm(1e4, elements, formulation, HUB_RADIUS),
    ),
    _campbell_case(
        "Campbell diagram, spinning ring",
        "Bryan 1890; Carrier, Q. Appl. Math. 3 (1945) 235: inextensible, with tension",
        (1.0, 2.0, 5.0),
        lambda speed: np.concatenate(
            [closed_forms.spinning_thin_ring(_thin_section(), 1.0, n, speed) for n in (2, 3)]
        ),
        1e-4,
        lambda elements, formulation: ring(_thin_section(), 1.0, elements, formulation),
        center=(0.0, 1.0),
    ),
)
