// Scatter plot of the cases: error over wall time, or any two quantities.

const DOWN_ARROW_PATH = "M0 8V22M-4 17L0 22L4 17";
const MAX_FAMILY_SWITCHES = 8; // more families of a sequence have a color scale instead of switches
const POINT_RADIUS = 11; // radius of the area that reacts to the pointer [px]
const RESOLUTION_SPAN = 100; // draw the resolution if it exceeds the smallest error divided by this

// The page of a single run has neither scatter plot nor case table.
function isStudyPage() {
  return page.cases.length > 1 || page.columns.length > 0;
}

function drawScatter() {
  byId("precision").hidden = !isStudyPage() || page.axes === null;
  const [x, y] = axisQuantities();
  const focused = findFocusedSelect(byId("scatter-title"));
  const cases = x && y ? groupCases().filter((run) => isPlottable(run, x) && isPlottable(run, y)) : [];
  byId("scatter-title").replaceChildren(...createScatterTitle(x, y));
  focusSelect(byId("scatter-title"), focused);
  byId("families").replaceChildren(...(cases.length ? createFamilyLegend(cases, y) : []));
  if (!cases.length) {
    const both = x && y ? `${y.label} and ${x.label}` : "an error and a wall time";
    byId("precision-plot").replaceChildren(createPlaceholder(`No case of this model has both ${both}.`));
    return;
  }
  const chart = createChart(describeScatter(cases, x, y));
  chart.plot.addEventListener("keydown", handlePointKey);
  state.charts.set("scatter", chart);
  byId("precision-plot").replaceChildren(chart.element);
  drawChart(chart);
}

function createScatterTitle(x, y) {
  const capitalize = (text) => text.slice(0, 1).toUpperCase() + text.slice(1);
  // Column names keep their capitalization.
  const name = (quantity) => (quantity.kind === "number" ? quantity.label : capitalize(quantity.label));
  const title = html("h2", {}, x && y ? `${name(y)} over ${x.label}` : "Cases");
  if (quantities.length < 3) return [title];
  return [title, createAxisSelect("y", y), createAxisSelect("x", x)];
}

function createAxisSelect(axis, selected) {
  const options = quantities.map((quantity) =>
    html("option", { selected: quantity === selected && "" }, quantity.title),
  );
  const change = (event) => {
    state.axes[axis] = quantities[event.target.selectedIndex].key;
    state.views.scatter = { x: null, y: null };
    drawScatter();
    listUnplottedCases();
  };
  return html("label", {}, `${axis} `, html("select", { "aria-label": `${axis} axis`, change }, ...options));
}

// Legend that hides and shows families.
function createFamilyLegend(cases, y) {
  const present = families.filter((family) => cases.some((run) => run.family === family));
  if (families.length < 2) return [];
  if (page.sequential && present.length > MAX_FAMILY_SWITCHES) {
    return [createSequentialLegend(present)];
  }
  const hidden = state.hidden.families;
  const entries = present.map((family) => {
    const change = () => {
      toggleMember(hidden, family);
      drawScatter();
    };
    const key = `family ${family}`;
    return createLegendSwitch(key, !hidden.has(family), change, createFamilyIcon(family), family || "runs");
  });
  const unresolved = y.kind === "error" && cases.find((run) => run.below);
  if (unresolved) {
    const text = "upper bound: below the resolution of the reference";
    entries.push(html("span", {}, createFamilyIcon(unresolved.family, "hollow"), text));
  }
  return entries;
}

function describeScatter(cases, x, y) {
  const visible = cases.filter((run) => !state.hidden.families.has(run.family));
  const showsErrors = y.kind === "error";
  // Lines of an overlay are straight and may start from zero, which a logarithmic axis cannot show.
  const { lines: guides, marks } = findOverlay(x, y);
  const isLinear = guides.length > 0;
  const log = { x: !isLinear && needsLogAxis(x, cases), y: !isLinear && needsLogAxis(y, cases) };
  const [low, high] = showsErrors ? findErrorExtent(cases) : findExtent([cases.map(y.value)]);
  // Interpolated peaks can exceed all points.
  const yExtent = [Math.min(low, ...guides.flatMap((line) => line.y)), Math.max(high, ...marks.map((mark) => mark.y))];
  const position = (run, xScale, yScale) => [xScale.toPosition(x.value(run)), yScale.toPosition(y.value(run))];
  const createPoints = (box, xScale, yScale) =>
    visible
      .map((run) => ({ run, at: position(run, xScale, yScale) }))
      .filter(({ at }) => isWithin(at[0], [box.left, box.right]) && isWithin(at[1], [box.top, box.bottom]))
      .sort((a, b) => a.at[0] - b.at[0]) // the arrow keys follow this order
      .map(({ run, at }) => createPoint(run, at, showsErrors));
  const isCount = (quantity) => !quantity.unit && cases.every((run) => Number.isInteger(quantity.value(run)));
  return {
    id: "scatter",
    name: `${y.label} over ${x.label}`,
    label: `${y.label} over ${x.label}, one point per case`,
    x: { title: x.title, range: padRange(findExtent([cases.map(x.value)]), log.x), log: log.x, isCount: isCount(x) },
    y: { title: y.title, range: padRange(yExtent, log.y), log: log.y, isCount: isCount(y) },
    view: state.views.scatter,
    height: (width) => clamp(0.625 * width, 260, 460),
    drawBackground: (box, _, yScale) => (showsErrors ? createUnresolvedBand(box, yScale) : []),
    drawClipped: (_, xScale, yScale) => [
      ...createOverlayLines(x, y, xScale, yScale),
      ...createSeriesLines(visible, (run) => position(run, xScale, yScale), showsErrors),
    ],
    drawForeground: (box, xScale, yScale) => [
      ...createOverlayMarks(x, y, box, xScale, yScale, visible),
      ...(showsErrors ? createResolutionLine(box, yScale) : []),
      ...createPoints(box, xScale, yScale),
    ],
    afterDraw: ({ plot }) => {
      plot.querySelector(".run")?.setAttribute("tabindex", "0");
      markSelection(plot);
    },
    legend: () =>
      families
        .filter((family) => visible.some((run) => run.family === family))
        .map((family) => ({ icon: createFamilyIcon(family), text: family })),
    rows: () => [
      ["case", x.title, y.title, ...(showsErrors ? ["below what the reference resolves"] : [])],
      ...visible.map((run) => [
        run.label,
        x.value(run),
        y.value(run),
        ...(showsErrors ? [run.below ? "yes" : "no"] : []),
      ]),
    ],
  };
}

// Range of the errors, extended to the resolution of the reference if that is close.
function findErrorExtent(cases) {
  const [low, high] = findExtent([cases.map((run) => run.error)]);
  const resolution = referenceResolution();
  const isClose = resolution && resolution > low / RESOLUTION_SPAN;
  return isClose ? [Math.min(low, resolution), Math.max(high, resolution)] : [low, high];
}

// Position of the reference resolution, or null if it is outside the plot.
function resolutionPosition(box, y) {
  const position = referenceResolution() ? y.toPosition(referenceResolution()) : null;
  return position !== null && isWithin(position, [box.top, box.bottom]) ? position : null;
}

function createUnresolvedBand(box, y) {
  const top = resolutionPosition(box, y);
  return top === null ? [] : [createPlotArea({ ...box, top }, { class: "unresolved" })];
}

function createResolutionLine(box, y) {
  const position = resolutionPosition(box, y);
  if (position === null) return [];
  const labelY = position < box.top + 20 ? position + 15 : position - 6;
  return [
    svg("line", { class: "resolution", x1: box.left, x2: box.right, y1: position, y2: position }),
    svg(
      "text",
      { class: "halo", x: box.left + 6, y: labelY },
      `resolution of the reference: ${formatValue(referenceResolution(), 3)}`,
    ),
  ];
}

// Lines that connect the cases of each series in the order of their ranks.
function createSeriesLines(cases, position, showsErrors) {
  return groupSeries(cases).flatMap((members) =>
    members.slice(1).map((run, k) => {
      const previous = members[k];
      const [[x1, y1], [x2, y2]] = [position(previous), position(run)];
      const isBound = showsErrors && (previous.below || run.below);
      const isDashed = isBound || previous.dashed || run.dashed;
      const classes = `series ${familyColor(run.family)} ${isDashed ? "dashed" : ""}`;
      return svg("line", { class: classes, x1, y1, x2, y2 });
    }),
  );
}

function groupSeries(cases) {
  return removeDuplicates(removeMissing(cases.map((run) => run.series))).map((series) =>
    cases.filter((run) => run.series === series).sort((a, b) => a.rank - b.rank),
  );
}

// Lines and marks that belong to these axes.
function findOverlay(x, y) {
  const overlay = page.overlays.find((each) => each.x === x.key && each.y === y.key);
  return overlay ?? { lines: [], marks: [] };
}

function createOverlayLines(x, y, xScale, yScale) {
  return findOverlay(x, y).lines.map((line) => {
    const points = line.x.map((u, k) => [xScale.toPosition(u), yScale.toPosition(line.y[k])]);
    const finite = points.map((point) => (point.every(Number.isFinite) ? point : null));
    const format = (point) => point.map((position) => position.toFixed(1)).join(" ");
    return svg("path", { class: "guide", d: formatPath(finite, format) });
  });
}

// Circles at the marks, labels of the marks, and labels on the lines.
function createOverlayMarks(x, y, box, xScale, yScale, cases) {
  const { lines, marks } = findOverlay(x, y);
  if (!lines.length && !marks.length) return [];
  const isInside = ([u, v]) => isWithin(u, [box.left - 1, box.right + 1]) && isWithin(v, [box.top - 1, box.bottom + 1]);
  const place = (u, v) => [xScale.toPosition(u), yScale.toPosition(v)];
  const placedMarks = marks.map(({ label, x: u, y: v }) => ({ label, at: place(u, v) })).filter(({ at }) => isInside(at));
  const placedLines = lines.map(({ label, x: xs, y: ys }) => ({ label, path: xs.map((u, k) => place(u, ys[k])) }));
  const circles = placedMarks.map(({ at: [cx, cy] }) => svg("circle", { class: "mark", cx, cy, r: 7 }));
  const series = groupSeries(cases).map((members) => members.map((run) => place(x.value(run), y.value(run))));
  const labels = placeLabels(box, placedLines, placedMarks, series);
  return [...circles, ...labels.map(({ text, at }) => createLabel(text, at))];
}

function createLabel(text, [x, y]) {
  return svg("text", { class: "halo label", x, y: y + LABEL_HEIGHT / 2 - 3, "text-anchor": "middle" }, text);
}

function createPoint(run, [x, y], showsErrors) {
  const isBound = showsErrors && run.below;
  const label = [run.label, ...listCaseFacts(run).map((row) => row.join(" "))].join(", ");
  const attributes = {
    class: `run ${familyColor(run.family)} ${isBound ? "hollow" : ""}`,
    transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})`,
    "data-case": run.id,
    tabindex: "-1",
    role: "button",
    "aria-label": label,
    "data-label": label,
    click: () => toggleCase(run.id),
    pointerenter: (event) => showTooltip(event.clientX, event.clientY, ...createCaseTooltip(run)),
    pointerleave: hideTooltip,
    focus: (event) => showTooltipBeside(event.currentTarget, createCaseTooltip(run)),
    blur: hideTooltip,
  };
  const arrow = isBound ? [svg("path", { class: "arrow", d: DOWN_ARROW_PATH })] : [];
  return svg(
    "g",
    attributes,
    svg("circle", { class: "ring", r: POINT_RADIUS }),
    ...arrow,
    createMarker(run.family),
    svg("text", { class: "number halo", x: 10, y: -8, "aria-hidden": "true" }),
  );
}

function createCaseTooltip(run) {
  const rows = listCaseFacts(run).map((row) => html("tr", {}, ...row.map((text) => html("td", {}, text))));
  return [html("strong", {}, run.label), html("table", {}, ...rows)];
}

// Arrow keys move the focus from point to point, or to the adjacent cell of the map; Enter and Space select.
function handlePointKey(event) {
  const points = [...event.currentTarget.querySelectorAll(".run, .cell")];
  const current = points.indexOf(document.activeElement);
  const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
  const isMap = points[0]?.matches(".cell");
  if (current < 0 && step) moveFocus(points, points.find((point) => point.tabIndex === 0) ?? points[0]);
  else if (event.key === "Enter" || event.key === " ") points[current] && toggleCase(points[current].dataset.case);
  else if (step && isMap) moveFocus(points, adjacentCell(points, points[current], event.key));
  else if (step) moveFocus(points, points[(current + step + points.length) % points.length]);
  else return;
  event.preventDefault();
}

// The focused point is the only one that the Tab key reaches.
function moveFocus(points, target) {
  if (!target) return;
  points.forEach((point) => point.setAttribute("tabindex", point === target ? "0" : "-1"));
  target.focus();
}

// List below the plot: failed cases, and the number of cases without values.
function listUnplottedCases() {
  const axes = axisQuantities();
  const isDrawn = (run) => axes.every((axis) => axis && isPlottable(run, axis));
  const cases = isStudyPage() ? groupCases() : [];
  const failures = cases.filter(hasFailed);
  const withoutValues = cases.filter((run) => !hasFailed(run) && !isDrawn(run)).length;
  const elements = [];
  if (failures.length) {
    elements.push(
      html("strong", {}, `Failed, not drawn: ${failures.length}`),
      html("ul", { tabindex: "0", "aria-label": "failed cases" }, ...failures.map(createFailureEntry)),
    );
  }
  if (withoutValues) {
    const [x, y] = axes;
    const missing = x && y ? `${y.label} or ${x.label}` : "an error or a wall time";
    elements.push(html("p", { class: "muted" }, `Without ${missing}, not drawn: ${withoutValues}`));
  }
  byId("unplotted").replaceChildren(...elements);
}

function createFailureEntry(run) {
  const button = html(
    "button",
    { type: "button", click: () => toggleCase(run.id) },
    createFamilyIcon(run.family),
    " ",
    run.label,
  );
  const tag = run.limited ? [html("span", { class: "tag" }, "limited"), " "] : [];
  return html("li", {}, button, " ", ...tag, run.status);
}
