"""Assembly: from the statements of parts, or CasADi expressions, to equations of motion.

May import: the rest of equations; nothing in equations imports assembly.
Next: a new check of statements goes to statement_checks, a new source of equations beside
constrained_system.
"""
