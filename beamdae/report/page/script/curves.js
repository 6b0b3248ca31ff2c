// Curves of the selected cases over time, in four panels. The columns that the user measured or asked for are listed
// first, and those that do not move last.

const MAX_LOG_DECADES = 9; // decades below the largest value on logarithmic axes
const MARKERS_PER_LINE = 6;
const MAX_DATA_POINTS = 150; // of a column; more are smaller, so that they do not hide each other
// Columns whose range is smaller than this part of the largest value with the same unit are constant, and so are
// those with a smaller magnitude: guided coordinates and unloaded directions leave rounding noise.
const CONSTANT_RANGE = 1e-9;
const NOISE_MAGNITUDE = 1e-14; // [SI units]
// No chart opens on a column whose range is smaller than this part of the largest one with its unit, such as the
// shortening of a beam that bends.
const MINOR_RANGE = 0.2;
const MISSED_SHARE = 0.01; // of the range of a curve
const PANELS = [
  { key: "observed", title: "Observed", section: "panels" },
  { key: "energy", title: "Energy [J]", section: "panels", unit: "J" },
  { key: "magnitude", title: "Magnitude", section: "panels" },
  { key: "phase", title: "Phase", section: "panels" },
  { key: "error", title: "Error over time", section: "error-panels" },
  { key: "drift", title: "Drift of the joints", section: "solver-panels" },
];
const PHASE_STEP = 45; // ticks of phases are multiples of this angle [deg]
const DIFFERENCE = "difference to the reference";

function drawPanels() {
  const panels = PANELS.map((panel) => ({ ...panel, choices: listChoices(panel) })).filter(
    (panel) => panel.choices.length,
  );
  for (const { key } of PANELS) state.charts.delete(key);
  for (const { section } of PANELS) byId(section).replaceChildren();
  if (!panels.length || !selectedCases().length) {
    const hint = groupCases().some(mayHaveCurves)
      ? "Select cases in the plot or in the table to see their trajectories, errors, energies and drifts."
      : "No case of this model has curves.";
    if (!page.leads || page.cases.some(mayHaveCurves)) byId("panels").replaceChildren(createPlaceholder(hint));
  } else {
    for (const panel of panels) byId(panel.section).append(createPanel(panel));
    panels.forEach(drawPanel);
  }
  hideEmptySections();
}

// Largest range and magnitude of each column in any of the cases, and the largest ones of all columns with its unit.
function measureRanges(names, curves, unitOf) {
  const extents = new Map();
  const units = new Map();
  for (const name of names) {
    const limits = removeMissing(curves.map((byName) => getOwn(byName, name))).map(storedLimits);
    const range = Math.max(...limits.map(([low, high]) => high - low));
    const magnitude = Math.max(...limits.flat().map(Math.abs));
    const unit = units.get(unitOf(name)) ?? { range: 0, magnitude: 0 };
    units.set(unitOf(name), { range: Math.max(unit.range, range), magnitude: Math.max(unit.magnitude, magnitude) });
    extents.set(name, { range, magnitude });
  }
  return new Map(names.map((name) => [name, { ...extents.get(name), unit: units.get(unitOf(name)) }]));
}

function isConstantColumn(name, { range, magnitude, unit }) {
  // Derivatives, for example with respect to an elastic modulus in Pa, may be small without being noise.
  const noise = name.startsWith("d(") ? 0 : NOISE_MAGNITUDE;
  return magnitude <= noise || range <= CONSTANT_RANGE * unit.magnitude;
}

// Choices of a panel: each single curve, and all curves with the same unit together.
function listChoices({ key, unit }) {
  const curves = groupCases().map((run) => run.curves?.[key] ?? {});
  const all = removeDuplicates(curves.flatMap((curvesByName) => Object.keys(curvesByName)));
  const isLog = (name) => curves.some((curvesByName) => getOwn(curvesByName, name)?.log);
  const isZero = (name) => curves.every((byName) => !removeMissing(getValues(getOwn(byName, name)) ?? []).length);
  // Logarithms of zeros are missing.
  const names = all.filter((name) => !isLog(name) || !isZero(name));
  const unitOf = (name) => (isLog(name) ? null : (unit ?? /\[([^\]]*)\]$/.exec(name)?.[1] ?? null));
  const canRest = key === "observed" || key === "energy";
  const ranges = measureRanges(canRest ? names : [], curves, unitOf);
  const constant = canRest ? names.filter((name) => isConstantColumn(name, ranges.get(name))) : [];
  const isMinor = (name) => ranges.get(name)?.range < MINOR_RANGE * ranges.get(name)?.unit.range;
  const rankOf = (name) => (page.featured.includes(name) ? page.featured.indexOf(name) : page.featured.length);
  const moving = names.filter((name) => !constant.includes(name)).sort((a, b) => rankOf(a) - rankOf(b));
  const createChoice = (name) => ({
    label: name,
    names: [name],
    isMinor: isMinor(name) && !page.featured.includes(name),
    title: isLog(name) && name === "imbalance" ? "magnitude of the imbalance" : name,
  });
  const combined = removeDuplicates(removeMissing(moving.map(unitOf))).map((commonUnit) => ({
    label: `all in ${commonUnit}`,
    names: moving.filter((name) => unitOf(name) === commonUnit),
    title: `[${commonUnit}]`,
  }));
  return [
    ...moving.map(createChoice),
    ...combined.filter((choice) => choice.names.length > 1),
    ...constant.map((name) => ({ ...createChoice(name), isConstant: true })),
  ];
}

function createPanel(panel) {
  const { key, title, choices } = panel;
  // All energies of a single run share a chart.
  const together = choices.find(({ names }) => names.length > 1);
  const single = choices.find((choice) => !choice.isMinor) ?? choices[0];
  const runs = page.cases.filter((run) => !run.points);
  const initial = (runs.length === 1 && key === "energy" && together) || single;
  panel.choice = choices.find(({ label }) => label === state.choices[key]) ?? initial;
  panel.holder = html("div");
  const controls = [html("h3", {}, title)];
  if (choices.length > 1) {
    const change = (event) => {
      panel.choice = choices[event.target.selectedIndex];
      state.choices[key] = panel.choice.label;
      state.views[key].y = null;
      drawPanel(panel);
    };
    const createOption = (choice) =>
      html("option", { selected: choice === panel.choice && "" }, choice.label);
    const moving = choices.filter(({ isConstant }) => !isConstant);
    const constant = choices.filter(({ isConstant }) => isConstant);
    const options = moving.map(createOption);
    if (constant.length) {
      options.push(html("optgroup", { label: "constant" }, ...constant.map(createOption)));
    }
    controls.push(html("select", { "aria-label": `${title}: quantity`, change }, ...options));
  }
  if (groupCases().some((run) => Object.keys(run.curves?.difference?.[key] ?? {}).length)) {
    const change = (event) => {
      state.differences[key] = event.target.checked;
      state.views[key].y = null;
      drawPanel(panel);
    };
    const attributes = { type: "checkbox", "aria-label": `${title}: ${DIFFERENCE}`, change };
    const checked = state.differences[key] ? "" : false;
    controls.push(html("label", {}, html("input", { ...attributes, checked }), ` ${DIFFERENCE}`));
  }
  return html(
    "div",
    { class: "panel", "data-panel": key },
    html("div", { class: "heading" }, ...controls),
    panel.holder,
  );
}

function drawPanel(panel) {
  const { key, holder } = panel;
  const lines = collectLines(panel);
  if (!lines.length) {
    state.charts.delete(key);
    const quantity = state.differences[key] ? `a ${DIFFERENCE} for this quantity` : "this curve";
    holder.replaceChildren(createPlaceholder(`None of the selected cases has ${quantity}.`));
    return;
  }
  const chart = createChart(describeCurveChart(panel, lines));
  addCursor(chart);
  state.charts.set(key, chart);
  holder.replaceChildren(...createNameLegend(panel, lines), chart.element, ...describeMissedPeaks(panel, lines));
  drawChart(chart);
}

// One line per selected case and name. Color distinguishes cases and dashes distinguish names. With a single
// case besides measured data, both distinguish names; with a single name, both distinguish cases.
function collectLines({ key, choice: { names } }) {
  const cases = selectedCases();
  const [hasCases, hasNames] = [cases.filter(({ run }) => !run.points).length > 1, names.length > 1];
  const curvesOf = state.differences[key] ? (run) => run.curves?.difference?.[key] : (run) => run.curves?.[key];
  return cases
    .flatMap(({ run, number, color }) =>
      names.map((name, k) => ({
        run,
        name,
        label: !hasNames || run.points ? run.label : hasCases ? `${name}, ${run.label}` : name,
        style: {
          ...lineStyle(hasCases || !hasNames ? color : `color-${k % COLOR_COUNT}`, hasNames ? k : number - 1),
          isData: run.points,
        },
        t: getValues(run.curves?.t),
        values: getValues(getOwn(curvesOf(run), name)),
      })),
    )
    .filter(({ values }) => values && removeMissing(values).length);
}

// A hint if the drawn rows miss a peak between them by more than 1 % of the range.
function describeMissedPeaks({ key, choice: { names, isConstant } }, lines) {
  if (key !== "observed" || state.differences[key] || names.length > 1 || isConstant) return [];
  const misses = lines.flatMap(({ run, name, values }) => {
    const [low, high] = findExtent([values]);
    const [least, most] = getOwn(run.extremes, name) ?? [low, high];
    const range = Math.max(high, most) - Math.min(low, least);
    return [[(most - high) / range, run.label, most], [(low - least) / range, run.label, least]];
  });
  return misses
    .filter(([share]) => share > MISSED_SHARE)
    .sort(([x], [y]) => y - x)
    .slice(0, 1)
    .map(([, label, peak]) =>
      html("p", { class: "missed" }, `The curves miss peaks between rows: ${label} reaches ${formatValue(peak)}.`),
    );
}

// Legend of a panel with several names; clicking an entry hides or shows its lines.
function createNameLegend(panel, lines) {
  const { key, choice } = panel;
  if (choice.names.length < 2) return [];
  const hidden = state.hidden.names[key];
  const entries = choice.names
    .filter((name) => lines.some((line) => line.name === name))
    .map((name) => {
      const change = () => {
        toggleMember(hidden, name);
        drawPanel(panel);
      };
      const { style } = lines.find((line) => line.name === name);
      return createLegendSwitch(`${key} ${name}`, !hidden.has(name), change, createLineIcon(style), name);
    });
  return [html("div", { class: "legend" }, ...entries)];
}

function describeCurveChart({ key, title, choice }, allLines) {
  const { cases, names } = state.hidden;
  const isHidden = ({ run, name }) => cases.has(run.id) || (choice.names.length > 1 && names[key].has(name));
  const lines = allLines.filter((line) => !isHidden(line));
  const scaledLines = lines.length ? lines : allLines;
  const log = Boolean(scaledLines[0].values.log);
  const [low, high] = findExtent(scaledLines.map(({ values }) => values));
  const yExtent = log ? [Math.max(low, high / 10 ** MAX_LOG_DECADES), high] : [low, high];
  const [begin, end] = findExtent(allLines.map(({ t }) => t));
  const quantity = state.differences[key] ? `difference of ${choice.title}` : choice.title;
  return {
    id: key,
    name: quantity,
    label: `${title}, ${choice.label}: press the arrow keys to read values`,
    x: { title: timeTitle(), range: [begin, end > begin ? end : begin + 1], log: Boolean(timeAxis.log) },
    y: { title: quantity, range: padRange(yExtent, log), log, stepBase: key === "phase" ? PHASE_STEP : undefined },
    view: state.views[key],
    lines,
    height: (width) => clamp(0.36 * width, 215, 320),
    drawBackground: () => [],
    drawClipped: (box, x, y) => {
      // Measured data are points already, and a single curve among them needs no markers.
      const marked = lines.filter(({ run }) => !run.points);
      const ordered = [...marked, ...lines.filter(({ run }) => run.points)];
      return ordered.map((line) => createCurve(line, x, y, spaceMarkers(box, marked.indexOf(line), marked.length)));
    },
    drawForeground: (box, _, y) => (key === "error" ? createResolutionLine(box, y) : []),
    afterViewChange: () => shareTimeRange(key),
    showTime: createTimeLine,
    legend: () => lines.map(({ style, label }) => ({ icon: createLineIcon(style), text: label })),
    rows: () => listCurveRows(lines),
  };
}

function listCurveRows(lines) {
  const rows = lines.flatMap(({ run, name, t, values }) =>
    t.map((time, k) => [run.label, name, time, values[k]]),
  );
  return [["case", "quantity", timeTitle(), "value"], ...rows.filter((row) => row[3] !== null)];
}

function timeTitle() {
  return timeAxis.unit ? `${timeAxis.name} [${timeAxis.unit}]` : timeAxis.name;
}

// All panels show the same time range.
function shareTimeRange(key) {
  const { x } = state.views[key];
  for (const other of PANELS.map((panel) => panel.key).filter((name) => name !== key)) {
    state.views[other].x = x;
    if (state.charts.has(other)) drawChart(state.charts.get(other));
  }
}

// Positions of the markers of line k, staggered with the markers of other lines. A single line has no markers.
function spaceMarkers(box, k, lineCount) {
  if (lineCount < 2) return [];
  const spacing = (box.right - box.left) / MARKERS_PER_LINE;
  return Array.from({ length: MARKERS_PER_LINE }, (_, i) => box.left + (i + (k + 0.5) / lineCount) * spacing);
}

function createCurve(line, x, y, markerPositions) {
  const { run, style, t, values } = line;
  if (run.points) return createDataPoints(line, x, y);
  let path = "";
  let last = null;
  values.forEach((value, k) => {
    if (value === null) return;
    const startsLine = k === 0 || values[k - 1] === null;
    last = [x.toPosition(t[k]), y.toPosition(value)];
    path += `${startsLine ? "M" : "L"}${last[0].toFixed(1)} ${last[1].toFixed(1)}`;
  });
  // A cross marks the end of a failed run.
  const cross = hasFailed(run)
    ? [svg("path", { class: `curve ${style.color}`, transform: `translate(${last})`, d: "M-4-4L4 4M-4 4L4-4" })]
    : [];
  const markers = markerPositions
    .map((position) => x.toValue(position))
    .filter((time) => time <= t.at(-1))
    .map((time) => nearestIndex(t, time))
    .filter((k) => values[k] !== null)
    .map((k) => createLineMarker(style, [x.toPosition(t[k]), y.toPosition(values[k])]));
  return svg("g", {}, svg("path", { class: `curve ${style.color} ${style.dash}`, d: path }), ...cross, ...markers);
}

// Lines of zero length with round caps: one element for all points.
function createDataPoints({ style, t, values }, x, y) {
  const density = values.length > MAX_DATA_POINTS ? "dense" : "";
  const points = values
    .map((value, k) => (value === null ? "" : `M${x.toPosition(t[k]).toFixed(1)} ${y.toPosition(value).toFixed(1)}h0`))
    .join("");
  return svg("path", { class: `curve data ${density} ${style.color}`, d: points });
}

function nearestIndex(t, time) {
  const k = t.findIndex((value) => value >= time);
  if (k < 0) return t.length - 1;
  return k > 0 && time - t[k - 1] < t[k] - time ? k - 1 : k;
}
