"""Parts of a mechanism: bodies, joints, forces, time laws, observables and events.

May import: symbolic, model_functions, read_only, deferred, errors. Parts state their equations in
local coordinates only.
To extend: add a joint to `joints`, a force to `forces` or a body to `bodies`, each as one class.
"""
