"""Equations of motion: assembled from statements, formulated for integrators, made consistent.

May import: parts and symbolic; beams only through the parts they are.
Next: a form of the equations in `formulations`; what is built from equations is decorated `@once`.
"""
