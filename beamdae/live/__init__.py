"""Live view: a page served on this computer, with sliders for the parameters of a model.

May import: report, simulation and everything below. To extend: add a kind of control to
`session.create_controls` and to the page script `report/page/script/live.js`.
"""
