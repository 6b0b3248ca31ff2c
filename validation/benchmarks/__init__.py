"""Published and closed-form cases for integrators and analyses."""
