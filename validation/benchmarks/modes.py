"""Natural frequencies with published or closed-form answers, none of them by this project."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import beamdae as bd

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class KnownModes:
    """A structure, and what is known of its modes.

    Attributes
    ----------
    ours
        Modes of the structure of so many elements -> the numbers of `known`.
    known
        The published numbers, in order.
    within
        Relative error that is to be met with these `elements`.
    """

    name: str
    source: str
    elements: int
    known: tuple[float, ...]
    within: float
    ours: Callable[[int], Array]

    def rows(self) -> Iterator[dict[str, Any]]:
        """A row for each of the numbers."""
        found = self.ours(self.elements)
        for k, (own, known) in enumerate(zip(found, self.known, strict=True)):
            yield {
                "case": self.name,
                "setting": f"modes, {self.elements} elements",
                "quantity": "frequency",
                "entry": k,
                "published": f"{known:.12g}",
                "ours": f"{own:.12g}",
                "error": f"{abs(own - known):.2e}",
                "relative": f"{abs(own - known) / known:.2e}",
                "ended": "",
            }


def ring(section: bd.Section, radius: float, elements: int) -> bd.Mechanism:
    """Free ring of four welded beams."""
    mech = bd.Mechanism()
    circle = bd.Arc(radius=radius, length=2.0 * np.pi * radius)
    bd.welded_beams(mech, "ring", circle, section, 4, closed=True, elements=elements // 4)
    return mech


def _ring_pairs(section: bd.Section, radius: float, count: int, elements: int) -> Array:
    """Both frequencies [Hz] of each of the first wave numbers, the one that is farther off."""
    found = bd.modes(ring(section, radius, elements), n=3 + 2 * count)
    assert found.kinds[:3] == ("free motion",) * 3
    return found.frequencies[4::2]


def thin_ring(section: bd.Section, radius: float, n: Array) -> Array:
    """w_n^2 = n^2 (n^2 - 1)^2 / (n^2 + 1) EI / (rho A R^4) in Hz (Love; Blevins 1979)."""
    squares = n**2 * (n**2 - 1) ** 2 / (n**2 + 1) * section.EI / (section.rhoA * radius**4)
    return np.sqrt(squares) / (2.0 * np.pi)


def _round_steel() -> bd.Section:
    steel = bd.Material(E=2e11, nu=0.3, rho=8000.0)
    area, second = np.pi * 0.1**2 / 4.0, np.pi * 0.1**4 / 64.0
    shear = 6.0 * 1.3 / (7.0 + 6.0 * 0.3)
    return bd.Section(steel, area=area, second_moment=second, shear_coefficient=shear)


def _sdll11() -> bd.Section:
    alloy = bd.Material(E=7.2e10, nu=0.3, rho=2700.0)
    return bd.Section.rectangle(alloy, width=0.010, height=0.005)


def _thin() -> bd.Section:
    steel = bd.Material(E=2e11, nu=0.3, rho=8000.0)
    return bd.Section.rectangle(steel, width=0.01, height=1e-3)


def _hinged_arch(elements: int) -> Array:
    """Of 90 degrees, R sqrt(A / I) = 15, kG / E = 0.3: w L^2 sqrt(rho A / EI)."""
    rubber = bd.Material(E=1e9, nu=0.3, rho=1000.0)
    shear = 0.3 * 2.0 * 1.3
    section = bd.Section(rubber, area=1e-2, second_moment=1e-2 / 225.0, shear_coefficient=shear)
    arc, mech = bd.Arc(radius=1.0, length=0.5 * np.pi, angle=-0.25 * np.pi), bd.Mechanism()
    beam = mech.add(bd.Beam("arch", arc, section, elements=elements))
    for name, s, end in (("left", 0.0, beam.start), ("right", arc.length, beam.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*arc.point(s)), end))
    found = bd.modes(mech, n=10).eigenvalues.imag
    return found * arc.length**2 * np.sqrt(section.rhoA / section.EI)


def supported_beam(elements: int) -> bd.Mechanism:
    """Thick straight beam on two hinges, of which one slides."""
    nu, side = 0.3, 0.4
    rubber = bd.Material(E=1e9, nu=nu, rho=7850.0)
    shear = 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu)
    section = bd.Section(rubber, area=side**2, second_moment=side**4 / 12, shear_coefficient=shear)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (2.0, 0.0)), section, elements=elements))
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), beam.end))
    return mech


def _supported(elements: int) -> Array:
    return bd.modes(supported_beam(elements), n=5).eigenvalues.imag


def rotating_arm(slenderness: float, elements: int) -> bd.Mechanism:
    """Cantilever of unit length, rho A and EI, with L sqrt(A / I) = `slenderness`."""
    light = bd.Material(E=slenderness**2, nu=0.3, rho=1.0)
    section = bd.Section(light, area=1.0, second_moment=slenderness**-2)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements=elements))
    mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    return mech


# First three out of the plane of rotation, by w L^2 sqrt(rho A / EI), at speeds in the same unit.
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


def _rotating(speed: float) -> Callable[[int], Array]:
    """Those in the plane: a thin arm there is softer by the square of the speed, w^2 - W^2."""

    def ours(elements: int) -> Array:
        found = bd.modes(rotating_arm(1e4, elements), about=bd.rotation(speed), n=3)
        return np.sqrt(found.eigenvalues.imag**2 + speed**2)

    return ours


_EISENBERGER = (
    *(29.279900, 33.304919, 67.123516, 79.970812, 107.851105),
    *(143.617539, 156.6656, 190.4771, 225.3612, 234.5235),
)
KNOWN_MODES = (
    KnownModes(
        "free ring, thick",
        "NAFEMS R0015 Test 6 (53.382, 150.99, 289.51 Hz by the formula of thin rings); with shear "
        "and rotary inertia",
        20,
        (53.115955, 149.320108, 283.940167),
        1e-4,
        lambda elements: _ring_pairs(_round_steel(), 1.0, 3, elements),
    ),
    KnownModes(
        "free ring, SDLL11",
        "AFNOR SDLL11, Code_Aster V2.02.011 (318.36, 900.46 Hz by the formula of thin rings); with "
        "shear and rotary inertia",
        16,
        (317.753143, 896.803020),
        1e-4,
        lambda elements: _ring_pairs(_sdll11(), 0.1, 2, elements),
    ),
    KnownModes(
        "free ring, thin",
        "closed form: Love; Blevins 1979",
        16,
        tuple(thin_ring(_thin(), 1.0, np.array([2.0, 3.0])).tolist()),
        1e-4,
        lambda elements: _ring_pairs(_thin(), 1.0, 2, elements),
    ),
    KnownModes(
        "hinged arch",
        "Eisenberger & Efraim, IJNME 52 (2001) 1221: circular, 90 degrees, shear flexible",
        24,
        _EISENBERGER,
        1e-4,
        _hinged_arch,
    ),
    KnownModes(
        "supported beam",
        "closed form of Timoshenko; Nachbagauer et al. 2013, EXUDYN ANCFBeam3DeigTest.py "
        "(95.635645, 280.322475, 332.254249, 635.769143 rad/s of 256 elements)",
        16,
        (95.633980881, 280.320625133, 332.234513637, 635.696288366, 840.961875398),
        1e-6,
        _supported,
    ),
    *(
        KnownModes(
            f"rotating arm, speed {speed:g}",
            "Wright, Smith, Thresher & Wang, J. Appl. Mech. 49 (1982) 197: uniform, without offset",
            16,
            known,
            # Half of the last digit.
            2e-5,
            _rotating(speed),
        )
        for speed, known in WRIGHT.items()
    ),
)
