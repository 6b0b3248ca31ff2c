// Scatter plot of the cases, and map of a response over two parameters.

const MAX_FAMILIES_IN_LEGEND = 8; // of families that follow a parameter, only the first and the last one are named
const LABEL_SPACING = 0.1; // between labels on neighboring lines, relative to the lengths of the lines
const POINT_SIZE = 11; // [px]
const SELECTED_SIZE = 15; // [px]

// The page of a single run has neither scatter plot nor case table.
function isStudyPage() {
  return page.cases.length > 1 || page.columns.length > 0;
}

function drawScatter() {
  byId("precision").hidden = !isStudyPage() || page.axes === null;
  const [x, y] = axisQuantities();
  const cases = x && y ? groupCases().filter((run) => isPlottable(run, x) && isPlottable(run, y)) : [];
  if (byId("precision").hidden) return;
  byId("scatter-title").replaceChildren(...createScatterTitle(x, y));
  if (cases.length) createChart(describeScatter(cases, x, y), byId("precision-plot"));
  else {
    removeChart("scatter");
    const both = x && y ? `${y.label} and ${x.label}` : "an error and a wall time";
    byId("precision-plot").replaceChildren(createPlaceholder(`No case of this model has both ${both}.`));
  }
}

function createScatterTitle(x, y) {
  const capitalize = (text) => text.slice(0, 1).toUpperCase() + text.slice(1);
  // Column names keep their capitalization.
  const name = (quantity) => (quantity.kind === "number" ? quantity.label : capitalize(quantity.label));
  const title = html("h2", {}, x && y ? `${name(y)} over ${x.label}` : "Cases");
  if (quantities.length < 3) return [title];
  const createAxisSelect = ([axis, selected]) => {
    const choose = ({ key }) => {
      state.axes[axis] = key;
      delete state.views.scatter;
      drawScatter();
      listUnplottedCases();
    };
    return html("label", {}, `${axis} `, createSelect(`${axis} axis`, quantities, selected, choose, ({ title }) => title));
  };
  return [title, ...Object.entries({ y, x }).map(createAxisSelect)];
}

function describeScatter(cases, x, y) {
  const showsErrors = y.kind === "error";
  // Lines of an overlay are straight and may start from zero, which a logarithmic axis cannot show.
  const overlay = page.overlays.find((each) => each.x === x.key && each.y === y.key) ?? { lines: [], marks: [] };
  const isLinear = overlay.lines.length > 0;
  const describeAxis = (quantity) => ({
    title: quantity.title,
    log: !isLinear && needsLogAxis(quantity, cases),
    isCount: !quantity.unit && cases.every((run) => Number.isInteger(quantity.value(run))),
  });
  const axes = { x: describeAxis(x), y: describeAxis(y) };
  const present = families.filter((family) => cases.some((run) => run.family === family));
  const isLong = page.sequential && present.length > MAX_FAMILIES_IN_LEGEND;
  const numbers = new Map(selectedCases().map(({ run, number }) => [run.id, number]));
  const isHollow = (run) => showsErrors && run.below;
  const place = (run) => [x.value(run), y.value(run)];
  const createPoints = (family) => ({
    type: "scatter",
    name: family || "runs",
    color: familyColor(family),
    symbol: familyMarker(family),
    symbolSize: ([, , id]) => (numbers.has(id) ? SELECTED_SIZE : POINT_SIZE),
    itemStyle: { opacity: 1 },
    label: { show: true, position: "right", fontWeight: "bold", color: themeColor("ink"), formatter: ({ value }) => String(numbers.get(value[2]) ?? "") },
    z: 3,
    data: cases.filter((run) => run.family === family).map((run) => [...place(run), run.id]),
  });
  const createHollow = (family) => ({
    ...createPoints(family),
    itemStyle: { opacity: 1, color: themeColor("background"), borderColor: familyColor(family), borderWidth: 1.5 },
    data: cases.filter((run) => run.family === family && isHollow(run)).map((run) => [...place(run), run.id]),
    z: 4,
  });
  const guides = overlay.lines.map(({ label, x: xs, y: ys }) => ({
    type: "line",
    name: label,
    color: themeColor("muted"),
    lineStyle: { width: 1, type: [6, 4] },
    symbol: "none",
    silent: true,
    data: xs.map((value, k) => [value, ys[k]]),
  }));
  const unresolved = present.filter((family) => cases.some((run) => run.family === family && isHollow(run)));
  return {
    id: "scatter",
    name: `${y.label} over ${x.label}`,
    label: `${y.label} over ${x.label}, one point per case: press the arrow keys to visit and Enter to select points`,
    ...axes,
    series: [
      ...present.map(createPoints),
      ...unresolved.map(createHollow),
      ...createSeriesLines(cases, place, isHollow),
      ...guides,
      createGuideLabels(overlay.lines),
      createMarks(overlay.marks.map(({ label, x: u, y: v }) => [u, v, undefined, label])),
      ...(showsErrors ? [createResolutionLine(axes.y)] : []),
    ],
    legend: present.length > 1 && (isLong ? [present[0], present.at(-1)] : present),
    height: (width) => clamp(0.625 * width, 260, 460),
    read: ([, , id]) => describeCase(page.cases.find((run) => run.id === id)),
    select: toggleCase,
    rows: () => [
      ["case", x.title, y.title, ...(showsErrors ? ["below what the reference resolves"] : [])],
      ...cases.map((run) => [run.label, ...place(run), ...(showsErrors ? [run.below ? "yes" : "no"] : [])]),
    ],
  };
}

// Labels on lines, which may have a common point, at places that are staggered from their right ends.
function createGuideLabels(lines) {
  const place = (line, number) => {
    const k = Math.max(line.x.length - 1 - Math.round(LABEL_SPACING * (number + 0.5) * line.x.length), 0);
    return [line.x[k], line.y[k], undefined, line.label];
  };
  return {
    ...createMarks(lines.map(place)),
    name: "labels",
    symbolSize: 0.1,
    label: {
      show: true,
      position: "inside",
      formatter: ({ value }) => value[3],
      color: themeColor("ink"),
      backgroundColor: themeColor("background"),
    },
  };
}

// Line at the smallest error that the reference resolves.
function createResolutionLine(axis) {
  const resolution = referenceResolution();
  const label = { formatter: `resolution of the reference: ${formatValue(resolution, 3)}`, position: "insideStartTop", color: themeColor("ink") };
  const lines = resolution ? [{ yAxis: fromValue(axis, resolution) }] : [];
  const lineStyle = { color: themeColor("muted"), type: [2, 3] };
  return { type: "line", name: "resolution", silent: true, data: [], markLine: { symbol: "none", label, lineStyle, data: lines, animation: false } };
}

// Lines that connect the cases of each series in the order of their ranks; lines to unstable or unresolved cases are
// dashed.
function createSeriesLines(cases, place, isHollow) {
  return removeDuplicates(removeMissing(cases.map((run) => run.series))).flatMap((series) => {
    const members = cases.filter((run) => run.series === series).sort((a, b) => a.rank - b.rank);
    const isDashed = (run) => Boolean(run.dashed || isHollow(run));
    const createLine = (dashed) => {
      const joins = members.slice(1).map((run, k) => (isDashed(run) || isDashed(members[k])) === dashed);
      const data = members.slice(1).flatMap((run, k) => (joins[k] ? [place(members[k]), place(run), [null, null]] : []));
      const lineStyle = { width: 1.3, opacity: 0.75, type: dashed ? [3, 4] : "solid" };
      return { type: "line", name: members[0].family || "runs", color: familyColor(members[0].family), lineStyle, symbol: "none", silent: true, data };
    };
    return [false, true].map(createLine).filter(({ data }) => data.length);
  });
}

function describeCase(run) {
  return [html("strong", {}, run.label), createReadings(listCaseFacts(run))];
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
  const click = () => toggleCase(run.id);
  const button = html("button", { type: "button", click }, createFamilyIcon(run.family), " ", run.label);
  const tag = run.limited ? [html("span", { class: "tag" }, "limited"), " "] : [];
  return html("li", {}, button, " ", ...tag, run.status);
}

// Map of a response over two parameters: one cell per case, colored by the value.
function drawMap() {
  const responses = quantities.filter(({ kind }) => kind === "number");
  byId("map").hidden = !page.map || !responses.length;
  if (byId("map").hidden) return;
  const response = responses.find(({ key }) => key === state.mapped) ?? axisQuantities()[1];
  state.plane = findPlane();
  const choose = ({ key }) => {
    state.mapped = key;
    drawMap();
  };
  byId("map-title").replaceChildren(
    html("h2", {}, "Map"),
    html("label", {}, "of ", createSelect("response of the map", responses, response, choose, ({ title }) => title)),
    ...outerAxes().map((axis, k) => createPlaneSelect(axis, state.plane[k])),
  );
  const cases = groupCases().filter((run) => outerAxes().every((axis, k) => run.at[axis] === state.plane[k]));
  createChart(describeMap(cases, response), byId("map-plot"));
}

// Redraw the map if the position has moved to another plane.
function updateMap() {
  if (!byId("map").hidden && findPlane().join() !== state.plane.join()) drawMap();
}

// Parameters that are not axes of the map.
function outerAxes() {
  return page.sliders.map((_, axis) => axis).filter((axis) => !page.map.includes(axis));
}

// Values of the parameters outside the map next to the position, as indices. Sweeps may lack some combinations.
function findPlane() {
  const near = nearestCase({ at: state.position }, groupCases(), outerAxes());
  return outerAxes().map((axis) => near.at[axis]);
}

function formatParameter({ unit, values }, k) {
  return [formatValue(values[k]), unit === "-" ? "" : unit].join(" ").trim();
}

function createPlaneSelect(axis, selected) {
  const { label } = page.sliders[axis];
  const nodes = removeDuplicates(groupCases().map((run) => run.at[axis])).sort((a, b) => a - b);
  const options = nodes.map((node) => ({ node, label: formatParameter(page.sliders[axis], node) }));
  const choose = ({ node }) => {
    state.position[axis] = node;
    showPosition();
    drawMap();
  };
  const current = options.find(({ node }) => node === selected);
  return html("label", {}, `at ${label} = `, createSelect(`${label} of the map`, options, current, choose));
}

function describeMap(cases, response) {
  const [i, j] = page.map;
  const titleOf = ({ label, unit }) => (unit && unit !== "-" ? `${label} [${unit}]` : label);
  const axisOf = (axis) => ({
    title: titleOf(page.sliders[axis]),
    names: page.sliders[axis].values.map((value) => formatValue(value)),
  });
  const valueOf = (run) => (hasFailed(run) ? null : response.value(run));
  const [low, high] = findExtent([cases.map(valueOf).filter(Number.isFinite)]);
  const numbers = new Map(selectedCases().map(({ run, number }) => [run.id, number]));
  const createCells = (isKnown) => ({
    type: "heatmap",
    encode: { x: 0, y: 1, value: 4 },
    name: isKnown ? response.title : "missing",
    label: { show: true, formatter: ({ value }) => String(numbers.get(value[2]) ?? ""), fontWeight: "bold", color: "#fff", textBorderColor: "#000", textBorderWidth: 2 },
    itemStyle: { borderColor: themeColor("background"), borderWidth: 1 },
    data: cases.filter((run) => Number.isFinite(valueOf(run)) === isKnown).map((run) => [run.at[i], run.at[j], run.id, undefined, valueOf(run) ?? 0]),
  });
  const plane = outerAxes().map((axis, k) => {
    const slider = page.sliders[axis];
    return ` at ${slider.label} = ${formatParameter(slider, state.plane[k])}`;
  });
  return {
    id: "map",
    name: ["map of ", response.title, ...plane].join(""),
    label: [`${response.title} over ${page.sliders[i].label} and ${page.sliders[j].label}`, ...plane, ", one cell per case"].join(""),
    x: axisOf(i),
    y: axisOf(j),
    series: [createCells(true), createCells(false)],
    visualMap: [
      { seriesIndex: 0, min: Math.min(low, high), max: Math.max(low, high), dimension: 4, orient: "horizontal", left: 90, top: 0, itemHeight: 150, text: [formatValue(high), formatValue(low)], inRange: { color: SEQUENCE.map(themeColor) } },
      { seriesIndex: 1, show: false, dimension: 4, min: 0, max: 1, inRange: { color: [themeColor("surface"), themeColor("surface")] } },
    ],
    height: (width) => clamp(0.625 * width, 240, 460),
    read: ([, , id, , value]) => {
      const run = page.cases.find((other) => other.id === id);
      const text = hasFailed(run) ? run.status : valueOf(run) === null ? "no value" : formatValue(value);
      return [html("strong", {}, run.label), ` ${response.title}: ${text}`];
    },
    select: toggleCase,
    rows: () => [
      [titleOf(page.sliders[i]), titleOf(page.sliders[j]), response.title],
      ...cases.map((run) => [page.sliders[i].values[run.at[i]], page.sliders[j].values[run.at[j]], valueOf(run)]),
    ],
  };
}
