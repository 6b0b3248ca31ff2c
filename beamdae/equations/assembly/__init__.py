"""Assembly of equations of motion from the statements of parts or from CasADi expressions.

May import: the rest of equations; nothing in equations imports assembly.
To extend: add checks of statements to `statement_checks`, and a module like `constrained_system`
for another source of equations.
"""
