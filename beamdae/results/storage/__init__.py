"""Files of results: CSV tables with JSON metadata, and saved runs.

May import: results, but results.solution only in `saved_run` and inside functions; equations
and the layers below.
To extend: add a module for a new file format, state its content as a dataclass, and read and write
it with `documents.Format` and `files.atomic_write`.
"""
