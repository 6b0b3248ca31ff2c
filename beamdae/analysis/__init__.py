"""Questions beside time stepping: equilibria, natural modes, stresses, periodic motion."""
