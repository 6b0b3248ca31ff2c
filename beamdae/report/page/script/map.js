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
  const change = (event) => {
    state.mapped = responses[event.target.selectedIndex].key;
    drawMap();
  };
  const options = responses.map((each) => html("option", { selected: each === response && "" }, each.title));
  byId("map-title").replaceChildren(
    html("h2", {}, "Map"),
    html("label", {}, "of ", html("select", { "aria-label": "response of the map", change }, ...options)),
  );
  const cases = mappedCases();
  const [low, high] = findExtent([cases.map(response.value).filter(Number.isFinite)]);
  byId("map-scale").replaceChildren(createColorBar({ limits: [low, high], scale: SEQUENCE, title: response.title }));
  const chart = createChart(describeMap(cases, response, [low, high]));
  state.charts.set("map", chart);
  byId("map-plot").replaceChildren(chart.element);
  drawChart(chart);
}

// Cases of the plane through the position of the sliders.
function mappedCases() {
  const others = page.sliders.map((_, axis) => axis).filter((axis) => !page.map.includes(axis));
  const near = nearestCase({ at: state.position }, groupCases());
  return groupCases().filter((run) => others.every((axis) => run.at[axis] === near.at[axis]));
}

function describeMap(cases, response, [low, high]) {
  const [x, y] = mapAxes();
  const [i, j] = page.map;
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
    return svg("rect", {
      class: `cell ${hasValue ? "" : "missing"}`,
      x: left,
      y: top,
      width: right - left,
      height: bottom - top,
      style: hasValue ? `fill: ${interpolateColor(SEQUENCE, share)}` : "",
      "data-case": run.id,
      role: "button",
      tabindex: "-1",
      "aria-label": `${run.label}, ${response.title} ${text}`,
      click: () => toggleCase(run.id),
      pointerenter: (event) =>
        showTooltip(event.clientX, event.clientY, html("strong", {}, run.label), ` ${response.title}: ${text}`),
      pointerleave: hideTooltip,
    });
  };
  return {
    id: "map",
    name: `map of ${response.title}`,
    label: `${response.title} over ${x.label} and ${y.label}, one cell per case`,
    x: axisOf(x),
    y: axisOf(y),
    view: state.views.map,
    height: (width) => clamp(0.625 * width, 240, 460),
    drawBackground: () => [],
    drawClipped: (_, xScale, yScale) => cases.map((run) => createCell(run, xScale, yScale)),
    drawForeground: () => [],
    afterDraw: ({ plot }) => markSelection(plot),
    legend: () => [],
    rows: () => [
      [titleOf(x), titleOf(y), response.title],
      ...cases.map((run) => [x.values[run.at[i]], y.values[run.at[j]], response.value(run)]),
    ],
  };
}
