"""Stored results of finished runs, and the hashes that determine whether they are valid.

May import: studies.tasks, studies.run_values, results and everything below.
To extend: to hash a new type of value, edit `fingerprints`; to add a field to the records, edit
`store`.
"""
