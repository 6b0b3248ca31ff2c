"""Published and closed-form cases, met by every integrator."""
