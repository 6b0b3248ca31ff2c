"""Records of finished runs on disk, and the hashes that tell whether they are still valid.

May import: studies.tasks, results, model_functions and everything below.
Next: a value whose hash is missing in `fingerprints`, a field of a record in `store`.
"""
