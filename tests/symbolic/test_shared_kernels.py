"""Concurrent threads share kernels, by whose identity structures are compared."""

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

from mechanisms import hinged_beam, rectangle

import beamdae as bd
import beamdae.symbolic.formula
import beamdae.symbolic.kernel_groups
from beamdae.beams import damping, elements
from beamdae.parts.bodies import rigid_body


def test_structures_of_concurrent_threads_are_equal():
    """Sensitivities in threads were refused because kernels had been built twice."""
    for build in (
        beamdae.symbolic.formula._build_shared_kernel,
        beamdae.symbolic.kernel_groups._rebuild_kernel,
        damping._rayleigh_kernel,
        elements.element_kernel,
        rigid_body._rigid_body_kernel,
    ):
        build.cache_clear()
    barrier = Barrier(4)

    def assemble(_):
        section = rectangle(0.1, 0.1, material=bd.Material(E=1e7, nu=0.3, rho=2e3))
        mechanism, _ = hinged_beam(section, 3)
        barrier.wait(10.0)
        return bd.equations_of_motion(mechanism).structure

    with ThreadPoolExecutor(4) as pool:
        one, *others = pool.map(assemble, range(4))
    assert all(other == one for other in others)
