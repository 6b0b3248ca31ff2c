"""Convergence of the beam formulations."""
