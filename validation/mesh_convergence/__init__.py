"""Mesh convergence of the hub beam."""
