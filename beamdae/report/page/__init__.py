"""HTML pages of runs and studies, and the notebook animation player.

May import: errors, equations.measures, report.text, results.
To extend: add a panel to `page.html`, with functions in `script/` and styles in `style/`, list
new files in `page_file.py`, and add its entries to `content.py`.
"""
