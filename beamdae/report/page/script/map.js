// Map of a response over two parameters: one cell per case, colored by the value.

function mapAxes() {
  const [x, y] = page.map ?? [];
  return [x, y].map((axis) => page.sliders[axis]);
}

function drawMap() {
  const responses = quantities.filter(({ kind }) => kind === "number");
  byId("map").hidden = !page.map || !responses.length;
  if (byId("map").hidden) return;
  const response = responses.find(({ key }) => key === state.mapped) ?? axisQuantities()[1];
  state.plane = findPlane();
  drawMapTitle(responses, response);
  const cases = groupCases().filter((run) => outerAxes().every((axis, k) => run.at[axis] === state.plane[k]));
  const [low, high] = findExtent([cases.map(response.value).filter(Number.isFinite)]);
  const bar = { limits: [low, high], scale: SEQUENCE, title: response.title };
  byId("map-scale").replaceChildren(...(low <= high ? [createColorBar(bar)] : []));
  const chart = createChart(describeMap(cases, response, [low, high]));
  chart.plot.addEventListener("keydown", handlePointKey);
  state.charts.set("map", chart);
  byId("map-plot").replaceChildren(chart.element);
  drawChart(chart);
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
  return [formatValue(values[k]), ...(unit && unit !== "-" ? [unit] : [])].join(" ");
}

// Title with the response and the values of the parameters outside the map. The redrawn select keeps the focus.
function drawMapTitle(responses, response) {
  const title = byId("map-title");
  const focused = findFocusedSelect(title);
  const change = (event) => {
    state.mapped = responses[event.target.selectedIndex].key;
    drawMap();
  };
  const options = responses.map((each) => html("option", { selected: each === response && "" }, each.title));
  title.replaceChildren(
    html("h2", {}, "Map"),
    html("label", {}, "of ", html("select", { "aria-label": "response of the map", change }, ...options)),
    ...outerAxes().map((axis, k) => createPlaneSelect(axis, state.plane[k])),
  );
  focusSelect(title, focused);
}

function createPlaneSelect(axis, selected) {
  const slider = page.sliders[axis];
  const nodes = removeDuplicates(groupCases().map((run) => run.at[axis])).sort((a, b) => a - b);
  const change = (event) => {
    state.position[axis] = nodes[event.target.selectedIndex];
    showPosition();
    drawMap();
  };
  const options = nodes.map((k) =>
    html("option", { selected: k === selected && "" }, formatParameter(slider, k)),
  );
  const attributes = { "aria-label": `${slider.label} of the map`, change };
  return html("label", {}, `at ${slider.label} = `, html("select", attributes, ...options));
}

function describeMap(cases, response, [low, high]) {
  const [x, y] = mapAxes();
  const [i, j] = page.map;
  const plane = outerAxes().map((axis, k) => {
    const slider = page.sliders[axis];
    return ` at ${slider.label} = ${formatParameter(slider, state.plane[k])}`;
  });
  const titleOf = ({ label, unit }) => (unit && unit !== "-" ? `${label} [${unit}]` : label);
  const axisOf = (slider) => ({
    title: titleOf(slider),
    range: [-0.5, slider.values.length - 0.5],
    log: false,
    ticks: slider.values.map((value, k) => ({ value: k, text: formatValue(value) })),
  });
  const createCell = (run, xScale, yScale) => {
    const [left, right] = [-0.5, 0.5].map((side) => xScale.toPosition(run.at[i] + side));
    const [bottom, top] = [-0.5, 0.5].map((side) => yScale.toPosition(run.at[j] + side));
    const value = response.value(run);
    const hasValue = !hasFailed(run) && Number.isFinite(value);
    const share = high > low ? (value - low) / (high - low) : 0.5;
    const text = hasValue ? formatValue(value) : hasFailed(run) ? run.status : "no value";
    const facts = [html("strong", {}, run.label), ` ${response.title}: ${text}`];
    return svg("rect", {
      class: `cell ${hasValue ? "" : "missing"}`,
      x: left,
      y: top,
      width: right - left,
      height: bottom - top,
      style: hasValue ? `fill: ${interpolateColor(SEQUENCE, share)}` : "",
      "data-case": run.id,
      "data-column": run.at[i],
      "data-row": run.at[j],
      role: "button",
      tabindex: "-1",
      "aria-label": `${run.label}, ${response.title} ${text}`,
      click: () => toggleCase(run.id),
      pointerenter: (event) => showTooltip(event.clientX, event.clientY, ...facts),
      pointerleave: hideTooltip,
      focus: (event) => showTooltipBeside(event.currentTarget, facts),
      blur: hideTooltip,
    });
  };
  // The keyboard reaches visible cells only.
  const overlaps = (k, { start, end, toValue }) => k + 0.5 > toValue(start) && k - 0.5 < toValue(end);
  const isVisible = (run, xScale, yScale) => overlaps(run.at[i], xScale) && overlaps(run.at[j], yScale);
  return {
    id: "map",
    name: ["map of ", response.title, ...plane].join(""),
    label: [`${response.title} over ${x.label} and ${y.label}`, ...plane, ", one cell per case"].join(""),
    x: axisOf(x),
    y: axisOf(y),
    view: state.views.map,
    height: (width) => clamp(0.625 * width, 240, 460),
    drawBackground: () => [],
    drawClipped: (_, xScale, yScale) =>
      cases.filter((run) => isVisible(run, xScale, yScale)).map((run) => createCell(run, xScale, yScale)),
    drawForeground: () => [],
    afterDraw: ({ plot }) => {
      plot.querySelector(".cell")?.setAttribute("tabindex", "0");
      markSelection(plot);
    },
    legend: () => [],
    rows: () => [
      [titleOf(x), titleOf(y), response.title],
      ...cases.map((run) => [x.values[run.at[i]], y.values[run.at[j]], response.value(run)]),
    ],
  };
}

// Nearest cell in the direction of an arrow key, in the same row or column; undefined at the border.
function adjacentCell(cells, current, key) {
  const [along, across] = key === "ArrowLeft" || key === "ArrowRight" ? ["column", "row"] : ["row", "column"];
  const sign = key === "ArrowRight" || key === "ArrowUp" ? 1 : -1;
  const distanceTo = (cell) => sign * (cell.dataset[along] - current.dataset[along]);
  return cells
    .filter((cell) => cell.dataset[across] === current.dataset[across] && distanceTo(cell) > 0)
    .sort((a, b) => distanceTo(a) - distanceTo(b))[0];
}
