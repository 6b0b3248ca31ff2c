"""What is seen of a mechanism: lines and symbols on points of its bodies, told once.

Drawings, moving pictures, modes and the page of a study show the same `Scene`: `symbols` and
`loads` say what a part looks like, `poses` where its points are.
"""
