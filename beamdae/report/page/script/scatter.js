// Scatter plot of the cases.

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
  if (byId("precision").hidden) return;
  const [x, y] = axisQuantities();
  const capitalize = ({ kind, label }) => (kind === "number" ? label : label.slice(0, 1).toUpperCase() + label.slice(1));
  const title = html("h2", {}, x && y ? `${capitalize(y)} over ${x.label}` : "Cases");
  const createAxisSelect = ([axis, selected]) => {
    const choose = ({ key }) => {
      state.axes[axis] = key;
      drawScatter();
      resetView(state.charts.get("scatter"), 0, 1);
      listUnplottedCases();
    };
    return html("label", {}, `${axis} `, createSelect(`${axis} axis`, quantities, selected, choose, (quantity) => quantity.title));
  };
  const selects = quantities.length < 3 ? [] : Object.entries({ y, x }).map(createAxisSelect);
  byId("scatter-title").replaceChildren(title, ...selects);
  if (plottableCases().length) return createChart("scatter", describeScatter, byId("precision-plot"));
  removeChart("scatter");
  const both = x && y ? `${y.label} and ${x.label}` : "an error and a wall time";
  byId("precision-plot").replaceChildren(createPlaceholder(`No case of this model has both ${both}.`));
}

function describeScatter() {
  const [x, y] = axisQuantities();
  const cases = plottableCases();
  const showsErrors = y.kind === "error";
  // Lines of an overlay are straight and may start from zero, which a logarithmic axis cannot show.
  const overlay = page.overlays.find((each) => each.x === x.key && each.y === y.key) ?? { lines: [], marks: [] };
  const describeAxis = (quantity) => ({
    title: quantity.title,
    log: !overlay.lines.length && needsLogAxis(quantity, cases),
    isCount: !quantity.unit && cases.every((run) => Number.isInteger(quantity.value(run))),
  });
  const axes = { x: describeAxis(x), y: describeAxis(y) };
  const present = families.filter((family) => cases.some((run) => run.family === family));
  const isLong = page.sequential && present.length > MAX_FAMILIES_IN_LEGEND;
  const numbers = new Map(selectedCases().map(({ run, number }) => [run.id, number]));
  const isHollow = (run) => showsErrors && run.below;
  const place = (run) => [x.value(run), y.value(run)];
  const createPoints = (family, members, itemStyle = {}) => ({
    type: "scatter",
    name: family || "runs",
    color: familyColor(family),
    symbol: PATH + familyMarker(family),
    symbolSize: ([, , id]) => (numbers.has(id) ? SELECTED_SIZE : POINT_SIZE),
    itemStyle: { opacity: 1, ...itemStyle },
    label: { show: true, position: "right", fontWeight: "bold", color: themeColor("ink"), formatter: ({ value }) => String(numbers.get(value[2]) ?? "") },
    z: 3,
    data: members.filter((run) => run.family === family).map((run) => [...place(run), run.id]),
  });
  const hollow = (family) => ({ color: themeColor("background"), borderColor: familyColor(family), borderWidth: 1.5 });
  const guides = overlay.lines.map(({ label, x: xs, y: ys }) => ({
    type: "line",
    name: label,
    color: themeColor("muted"),
    lineStyle: { width: 1, type: [6, 4] },
    symbol: "none",
    silent: true,
    data: xs.map((value, k) => [value, ys[k]]),
  }));
  return {
    label: `${y.label} over ${x.label}, one point per case: press the arrow keys to visit and Enter to select points`,
    ...axes,
    series: [
      ...present.map((family) => createPoints(family, cases)),
      ...present.map((family) => createPoints(family, cases.filter(isHollow), hollow(family))).filter(({ data }) => data.length),
      ...createSeriesLines(cases, place, isHollow),
      ...guides,
      createGuideLabels(overlay.lines),
      createMarks(overlay.marks.map(({ label, x: u, y: v }) => [u, v, undefined, label])),
      ...(showsErrors ? [createResolutionLine(axes.y)] : []),
    ],
    legend: present.length > 1 && (isLong ? [present[0], present.at(-1)] : present),
    height: (width) => clamp(0.625 * width, 260, 460),
    read: ({ value: [, , id] }) => describeCase(page.cases.find((run) => run.id === id)),
    select: toggleCase,
  };
}

// Labels on lines, which may have a common point, at places that are staggered from their right ends.
function createGuideLabels(lines) {
  const place = ({ x, y, label }, number) => {
    const k = Math.max(Math.round((1 - LABEL_SPACING * (number + 0.5)) * x.length) - 1, 0);
    return [x[k], y[k], undefined, label];
  };
  const { label, ...marks } = createMarks(lines.map(place));
  return { ...marks, name: "labels", symbolSize: 0.1, label: { ...label, position: "inside", backgroundColor: themeColor("background") } };
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
  const isDashed = (run) => Boolean(run.dashed || isHollow(run));
  return removeDuplicates(removeMissing(cases.map((run) => run.series))).flatMap((series) => {
    const members = cases.filter((run) => run.series === series).sort((a, b) => a.rank - b.rank);
    const joins = members.slice(1).map((run, k) => [members[k], run]);
    const createLine = (dashed) => ({
      type: "line",
      name: members[0].family || "runs",
      color: familyColor(members[0].family),
      lineStyle: { width: 1.3, opacity: 0.75, type: dashed ? [3, 4] : "solid" },
      symbol: "none",
      silent: true,
      data: joins.filter((ends) => ends.some(isDashed) === dashed).flatMap((ends) => [...ends.map(place), [null, null]]),
    });
    return [false, true].map(createLine).filter(({ data }) => data.length);
  });
}

function describeCase(run) {
  return [html("strong", {}, run.label), createReadings(listCaseFacts(run))];
}

// List below the plot: failed cases, and the number of cases without values.
function listUnplottedCases() {
  const [x, y] = axisQuantities();
  const cases = isStudyPage() ? groupCases() : [];
  const failures = cases.filter(hasFailed);
  const withoutValues = cases.length - failures.length - plottableCases().length;
  const elements = [];
  if (failures.length) {
    const entries = failures.map((run) => {
      const button = html("button", { type: "button", click: () => toggleCase(run.id) }, createFamilyIcon(run.family), " ", run.label);
      return html("li", {}, button, " ", ...(run.limited ? [html("span", { class: "tag" }, "limited"), " "] : []), run.status);
    });
    elements.push(html("strong", {}, `Failed, not drawn: ${failures.length}`));
    elements.push(html("ul", { tabindex: "0", "aria-label": "failed cases" }, ...entries));
  }
  if (isStudyPage() && withoutValues) {
    const missing = x && y ? `${y.label} or ${x.label}` : "an error or a wall time";
    elements.push(html("p", { class: "muted" }, `Without ${missing}, not drawn: ${withoutValues}`));
  }
  byId("unplotted").replaceChildren(...elements);
}
