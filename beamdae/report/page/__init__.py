"""One self-contained HTML page of a study: template, style, script, and the data they show.

May import: errors. Takes plain values, see `page.write_page`.
Next: a panel is a section of `page.html` with a file of its functions in `script/` and of its looks
in `style/`, named in `page.py`.
"""
