"""Assembly of equations of motion from the statements of parts or from CasADi expressions.

May import: parts, symbolic, memory, model_functions, read_only, errors, and the rest of equations
except modules that import assembly, such as `watched_terms`.
To extend: add checks of statements to `statement_checks`, and a module like `constrained_system`
for another source of equations.
"""
