"""Self-contained HTML pages of runs and studies, and the animation player of notebooks.

May import: errors, equations.measures, report.text, results.
Next: a panel is a section of `page.html` with functions in `script/` and styles in `style/`, both
listed in `page_file.py`.
"""
