"""Stops between steps: limits and peaks that steps pass over, and events with their actions.

May import: equations, parts, results, errors, and `method`, `run_plan` and `step_history` of
integrators.
To extend: add a `Watch` to `stop_search`, or the module of a new event action next to `switching`,
and apply it in `switching`.
"""
