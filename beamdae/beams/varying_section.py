"""Sections that vary along a beam: functions of arc length, and tapers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

from beamdae.beams.materials import Material, require_material
from beamdae.beams.sections import Section
from beamdae.errors import BeamdaeError, format_exception, require_finite, require_pair, short_repr

SectionLaw = Callable[[float], Section]

_CONSTANT = {field.name for field in fields(Section)} | {"EA", "GA", "EI", "rhoA", "rhoI"}


@dataclass(frozen=True, eq=False)
class VaryingSection:
    """The section of a beam along which it varies, as its kinematics asks for it.

    Attributes
    ----------
    part
        Name of the beam.
    law
        Arc length s [m] -> Section.
    """

    part: str
    law: SectionLaw

    def at(self, s: float) -> Section:
        """The section at arc length s [m]."""
        wanted = f"{self.part}: section must be a Section, or a function of s that gives one"
        try:
            found = self.law(float(s))
        except BeamdaeError as problem:
            raise BeamdaeError(f"{self.part}: at s = {s:g} m of it, {problem}") from None
        except Exception as problem:
            raise BeamdaeError(
                f"{wanted}, at s = {s:g} it failed, {format_exception(problem)}."
            ) from problem
        if not isinstance(found, Section):
            raise BeamdaeError(f"{wanted}, at s = {s:g} it gave {short_repr(found)}.")
        return found

    def __getattr__(self, name: str) -> Any:
        if name in _CONSTANT:
            raise BeamdaeError(
                f"{self.part}: its section varies along the beam, {name} is asked of section.at(s)."
            )
        raise AttributeError(name)

    def beginning(self, start: float) -> SectionLaw:
        """The section of what is left of the beam from arc length `start` [m] on."""
        return lambda s: self.at(start + s)


@dataclass(frozen=True)
class Taper:
    """A shape whose dimensions run linearly from one end of a beam to the other: see `taper`."""

    shape: Callable[..., Section]
    material: Material
    dimensions: tuple[tuple[str, tuple[float, float]], ...]

    def over(self, length: float) -> SectionLaw:
        """Of a beam of that length [m], by arc length."""

        def section(s: float) -> Section:
            share = s / length
            sizes = {name: (1.0 - share) * a + share * b for name, (a, b) in self.dimensions}
            return self.shape(self.material, **sizes)

        return section


def taper(shape: Callable[..., Section], material: Material, **dimensions: Any) -> Taper:
    """A section whose dimensions run linearly from the start of a beam to its end.

    Parameters
    ----------
    shape
        Such as ``bd.Section.rectangle``: a function of the material and the dimensions.
    material
        The material.
    dimensions
        Arguments of the shape, each a number or a pair (at the start, at the end).

    Examples
    --------
    >>> import beamdae as bd
    >>> steel = bd.Material.of("steel")
    >>> blade = bd.taper(bd.Section.rectangle, steel, width=0.03, height=(0.004, 0.002))
    >>> beam = bd.Beam("blade", bd.Line((0.0, 0.0), (1.0, 0.0)), blade)
    >>> round(beam.section.at(0.5).height, 6)
    0.003
    """
    if not callable(shape):
        raise BeamdaeError(
            f"taper: shape must be a function such as Section.rectangle, got {short_repr(shape)}."
        )
    require_material("taper", material)
    both = tuple((name, _ends(name, value)) for name, value in dimensions.items())
    found = Taper(shape, material, both)
    ends = VaryingSection("taper", found.over(1.0))
    for end in (0.0, 1.0):
        ends.at(end)
    return found


def _ends(name: str, value: Any) -> tuple[float, float]:
    if hasattr(value, "__len__") and not isinstance(value, str):
        a, b = require_pair("taper", name, value, "a number or a pair (at the start, at the end)")
        return require_finite("taper", f"{name} at the start", a), require_finite(
            "taper", f"{name} at the end", b
        )
    size = require_finite("taper", name, value)
    return size, size


def require_section(part: str, value: Any, length: float) -> Section | VaryingSection:
    """Return `value` as the section of a beam of that length [m]."""
    if isinstance(value, Section):
        return value
    if isinstance(value, Taper):
        return VaryingSection(part, value.over(length))
    if not callable(value) or isinstance(value, type):
        raise BeamdaeError(
            f"{part}: section must be a Section, or a function of s that gives one, "
            f"got {short_repr(value)}."
        )
    return VaryingSection(part, value)
