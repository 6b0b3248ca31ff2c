"""Errors about unknown keyword arguments of public classes."""

import inspect

import pytest

import beamdae as bd
from beamdae.catalog import GROUPS

CLASSES = [
    x
    for group in GROUPS
    for public in group.names
    for x in [getattr(bd, public.name)]
    if inspect.isclass(x) and "__init__" in vars(x) and not issubclass(x, (Exception, tuple))
]


@pytest.mark.parametrize("cls", CLASSES, ids=lambda x: x.__name__)
def test_unknown_arguments_of_all_classes_are_named(cls):
    if any(x.kind is x.VAR_KEYWORD for x in inspect.signature(cls).parameters.values()):
        pytest.skip("takes any keyword")
    with pytest.raises(bd.BeamdaeError, match=rf"^{cls.__name__}: there is no argument 'color'"):
        cls(color="red")


def test_regression_arguments_of_similar_parts_are_listed():
    """The error was a TypeError without the names of the arguments."""
    allowed = "the arguments are name, mass, inertia, center, velocity, angular_velocity and shape"
    with pytest.raises(TypeError, match=rf"RigidBody: there is no argument 'at'; {allowed}\.$"):
        bd.RigidBody("stage", mass=1.0, inertia=1.0, at=(0.0, 0.0))
    with pytest.raises(bd.BeamdaeError, match=r"Section\.rectangle: .* 'heigth' \(did you mean 'h"):
        bd.Section.rectangle(bd.Material.of("steel"), width=0.1, heigth=0.1)


def test_other_type_errors_are_unchanged():
    with pytest.raises(TypeError, match=r"missing 1 required positional argument: 'inertia'"):
        bd.RigidBody("stage", mass=1.0)
