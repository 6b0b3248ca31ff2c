"""Words that people search for, by the page that answers them.

Sphinx lists them in its index, so that its search finds the page first, and in `words.md`.
"""

WORDS = {
    "start": ("install", "installation", "pip"),
    "coming_from": ("MATLAB", "Simscape", "Exudyn", "Adams", "CAD", "three-dimensional"),
    "tutorials/blade": ("fatigue", "rainflow", "shaker", "base excitation", "run-up"),
    "tutorials/drop_test": ("drop test", "impact test", "shock"),
    "tutorials/stage": ("flexure", "compliant mechanism", "feedforward"),
    "howto/export_an_fmu": ("export", "FMU", "FMI", "Simulink", "co-simulation"),
    "howto/speed_up_a_run": ("slow", "speed", "performance", "run time"),
    "howto/choose_an_integrator": ("solver", "time step", "step size"),
    "howto/draw_and_animate": ("video", "GIF", "picture", "animation"),
    "howto/explore_with_sliders": ("slider", "interactive", "live view"),
    "howto/run_on_a_cluster": ("cluster", "Dask"),
    "howto/calibrate": ("calibration", "identification", "measurement", "parameter fit"),
    "howto/use_gradients": ("PyTorch", "JAX", "adjoint"),
    "howto/write_a_force": ("custom force", "aerodynamic force", "nonlinear spring"),
    "guide/models": ("unit", "units", "parameter", "material", "cross-section"),
    "guide/joints": ("motor", "hinge", "bearing", "gear", "prescribed motion", "slider joint"),
    "guide/forces": ("gravity", "torque", "moment", "friction", "contact", "spring", "damper"),
    "guide/controllers": ("PID", "controller", "control", "sensor", "actuator", "feedback"),
    "guide/starts": ("initial velocity", "initial condition", "degrees of freedom"),
    "guide/results": ("CSV", "plot", "pandas", "save"),
    "guide/modes": (
        "natural frequency",
        "eigenfrequency",
        "eigenvalue",
        "resonance",
        "Campbell diagram",
    ),
    "guide/equilibria": ("static", "buckling", "snap-through", "limit load"),
    "guide/section_forces": (
        "stress",
        "bending moment",
        "internal force",
        "safety factor",
        "frequency response",
    ),
    "guide/sweeps": ("parallel", "sweep", "parameter study", "multiprocessing"),
    "guide/events": ("resume", "restart", "checkpoint", "impact", "collision", "stop condition"),
    "guide/sensitivities": ("sensitivity", "derivative", "gradient"),
    "guide/optimization": ("optimization", "design", "stress limit"),
    "guide/accuracy": ("error", "tolerance", "convergence", "accuracy"),
    "guide/commands": ("command line", "terminal", "CLI"),
}
