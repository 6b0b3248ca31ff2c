"""Content of HTML pages as plain data and arrays, which `page_file.write_page` writes.

A page with one case and without columns is the page of a run: it has no case table. The order of
every page is motion, curves, results, error budget, solver. All entries but `id`, `group` of a case
and those of columns are optional. A page contains

- `title`, `subtitle`, `notes`, and `made`, versions by package name.
- `noun`: name of the cases, such as "modes".
- `groups` of cases that are compared with each other: `id`, `label`, `frames` (an animation, see
  `scene.frame_export.export_frames`) and `reference` (None, or `accepted`, `sentence` and
  `uncertainty`, the smallest error that it resolves).
- `columns` of the case table: `key`, `label`, `unit` and `kind` ("text", "number", "status", or
  "error" and "cost" for these entries of the cases). Those of the `section` "solver" are hidden at
  first.
- `cases`, the runs, designs, modes or points: `id`, `group`, `label`, `family` (determines color,
  marker and legend), `series` (cases of the same series are connected by a line, in the order of
  their `rank`), `status` ("ok" or a sentence), `values` by key of the column, `error`, `cost` [s],
  `below` (the error is below the resolution of the reference), `limited`, `dashed` (lines to the
  case are dashed), `at` (index of its value for each slider), `frames`, `curves` (see
  `page_data.select_curves`: arrays `t` and, by panel and name, `observed`, `energy`, `error`,
  `drift`, or `magnitude` and `phase` over frequencies), `points` (measured data, drawn as points)
  and `file` (with its rows).
- `axes`: keys of the columns `x` and `y` of the scatter plot; None for no scatter plot. `overlays`
  have `lines` and `marks` for a pair of axes, each with `label`, `x` and `y`. `views` are the
  ranges that charts show first, by key of the chart and axis; the button "Reset" shows all. If
  `leads` is true, the scatter plot is the main result, shown first beside the motion.
- `families` that have the first colors, also if some do not occur; `sequential` if families follow
  a parameter, so that their colors form a sequence.
- `sliders` of swept parameters: `label`, `unit` and `values`. They select the motion of the nearest
  case with `frames`.
- `time`: `name` and `unit` of the quantity in the place of the time, `log` for a logarithmic axis.
- `portrait`: columns `x` and `y` of a chart of one over the other, and `marks`: `t` and `label`.
- `featured`: observed columns that are listed first; by default those that characterize the motion.
- `tables` of facts: `title`, `head`, `rows` and `section` ("results", "motion", "errors" or
  "solver").
"""

from typing import Any

Content = dict[str, Any]
