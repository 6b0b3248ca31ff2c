// Curves of the selected cases over time, in panels, and over each other. The columns that the user measured or asked
// for are listed first, and those that do not move last.

const MAX_LOG_DECADES = 9; // decades below the largest value on logarithmic axes
const MARKERS_PER_LINE = 6;
const MAX_DATA_POINTS = 150; // of a column; more are smaller, so that they do not hide each other
const PORTRAIT_REACH = 14; // size of the area around a point that reacts to the pointer [px]
// Columns whose range is smaller than this part of the largest value with the same unit are constant, and so are
// those with a smaller magnitude: guided coordinates and unloaded directions leave rounding noise.
const CONSTANT_RANGE = 1e-9;
const NOISE_MAGNITUDE = 1e-14; // [SI units]
// No chart opens on a column whose range is smaller than this part of the largest one with its unit, such as the
// shortening of a beam that bends.
const MINOR_RANGE = 0.2;
const PANELS = [
  { key: "observed", title: "Observed", section: "panels" },
  { key: "energy", title: "Energy [J]", section: "panels", unit: "J" },
  { key: "magnitude", title: "Magnitude", section: "panels" },
  { key: "phase", title: "Phase", section: "panels" },
  { key: "error", title: "Error over time", section: "error-panels" },
  { key: "drift", title: "Drift of the joints", section: "solver-panels" },
];
const PHASE_STEP = 45; // [deg]
const DIFFERENCE = "difference to the reference";

function drawPanels() {
  for (const { key, section } of PANELS) {
    removeChart(key);
    byId(section).replaceChildren();
  }
  const panels = PANELS.map((panel) => ({ ...panel, choices: listChoices(panel) })).filter(
    (panel) => panel.choices.length,
  );
  if (panels.length && selectedCases().length) panels.forEach(createPanel);
  else if (!page.leads || page.cases.some(mayHaveCurves)) {
    const hint = groupCases().some(mayHaveCurves)
      ? "Select cases in the plot or in the table to see their trajectories, errors, energies and drifts."
      : "No case of this model has curves.";
    byId("panels").replaceChildren(createPlaceholder(hint));
  }
  hideEmptySections();
}

// Largest range and magnitude of a column in any of the cases.
function measureColumn(name, curves) {
  const limits = removeMissing(curves.map((byName) => getOwn(byName, name))).map(storedLimits);
  return {
    range: Math.max(...limits.map(([low, high]) => high - low)),
    magnitude: Math.max(...limits.flat().map(Math.abs)),
  };
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
  const sizes = new Map(names.map((name) => [name, measureColumn(name, curves)]));
  const largest = (name, size) =>
    Math.max(...names.filter((other) => unitOf(other) === unitOf(name)).map((other) => sizes.get(other)[size]));
  const isConstant = (name) => {
    if (key !== "observed" && key !== "energy") return false;
    const { range, magnitude } = sizes.get(name);
    // Derivatives, for example with respect to an elastic modulus in Pa, may be small without being noise.
    const noise = name.startsWith("d(") ? 0 : NOISE_MAGNITUDE;
    return magnitude <= noise || range <= CONSTANT_RANGE * largest(name, "magnitude");
  };
  const rankOf = (name) => (page.featured.includes(name) ? page.featured.indexOf(name) : page.featured.length);
  const moving = names.filter((name) => !isConstant(name)).sort((a, b) => rankOf(a) - rankOf(b));
  const combined = removeDuplicates(removeMissing(moving.map(unitOf))).map((commonUnit) => ({
    label: `all in ${commonUnit}`,
    names: moving.filter((name) => unitOf(name) === commonUnit),
    title: `[${commonUnit}]`,
  }));
  const createChoice = (name) => ({
    label: name,
    names: [name],
    isMinor: !page.featured.includes(name) && sizes.get(name).range < MINOR_RANGE * largest(name, "range"),
    title: isLog(name) && name === "imbalance" ? "magnitude of the imbalance" : name,
  });
  return [
    ...moving.map(createChoice),
    ...combined.filter((choice) => choice.names.length > 1),
    ...names.filter(isConstant).map((name) => ({ ...createChoice(name), isConstant: true })),
  ];
}

function createPanel(panel) {
  const { key, title, section, choices } = panel;
  // All energies of a single run share a chart.
  const together = choices.find(({ names }) => names.length > 1);
  const single = choices.find((choice) => !choice.isMinor) ?? choices[0];
  const runs = page.cases.filter((run) => !run.points);
  const initial = (runs.length === 1 && key === "energy" && together) || single;
  const choice = choices.find(({ label }) => label === state.choices[key]) ?? initial;
  const redraw = (change) => {
    change();
    state.views[key] = { x: state.views[key]?.x };
    drawPanels();
  };
  const choose = (next) => redraw(() => (state.choices[key] = next.label));
  const controls = [html("h3", {}, title)];
  if (choices.length > 1) controls.push(createSelect(`${title}: quantity`, choices, choice, choose));
  if (groupCases().some((run) => Object.keys(run.curves?.difference?.[key] ?? {}).length)) {
    const change = (event) => redraw(() => (state.differences[key] = event.target.checked));
    const checked = state.differences[key] ? "" : false;
    const box = html("input", { type: "checkbox", "aria-label": `${title}: ${DIFFERENCE}`, change, checked });
    controls.push(html("label", {}, box, ` ${DIFFERENCE}`));
  }
  const holder = html("div");
  const heading = html("div", { class: "heading" }, ...controls);
  byId(section).append(html("div", { class: "panel", "data-panel": key }, heading, holder));
  const lines = collectLines(key, choice);
  const quantity = state.differences[key] ? `a ${DIFFERENCE} for this quantity` : "this curve";
  if (lines.length) createChart(describeCurves({ key, title, choice }, lines), holder);
  else holder.append(createPlaceholder(`None of the selected cases has ${quantity}.`));
}

// One line per selected case and name. Color distinguishes cases and dashes distinguish names. With a single
// case besides measured data, both distinguish names; with a single name, both distinguish cases.
function collectLines(key, { names }) {
  const cases = selectedCases();
  const [hasCases, hasNames] = [cases.filter(({ run }) => !run.points).length > 1, names.length > 1];
  const curvesOf = state.differences[key] ? (run) => run.curves?.difference?.[key] : (run) => run.curves?.[key];
  return cases
    .flatMap(({ run, number, color }) =>
      names.map((name, k) => ({
        run,
        name,
        label: !hasNames || run.points ? run.label : hasCases ? `${name}, ${run.label}` : name,
        style: lineStyle(themeColor(hasCases || !hasNames ? color : `color-${k % COLOR_COUNT}`), hasNames ? k : number - 1),
        t: getValues(run.curves?.t),
        values: getValues(getOwn(curvesOf(run), name)),
      })),
    )
    .filter(({ values }) => values && removeMissing(values).length);
}

function describeCurves({ key, title, choice }, lines) {
  const log = Boolean(lines[0].values.log);
  const lowest = log ? findExtent(lines.map(({ values }) => values))[1] / 10 ** MAX_LOG_DECADES : -Infinity;
  const quantity = state.differences[key] ? `difference of ${choice.title}` : choice.title;
  const models = lines.filter(({ run }) => !run.points);
  const series = lines.map((line) => {
    const data = line.t.map((time, k) => [time, line.values[k] === null ? null : Math.max(line.values[k], lowest)]);
    return line.run.points ? describePoints(line, data) : describeLine(line, data, models.indexOf(line), models.length);
  });
  const y = { title: quantity, log, step: key === "phase" ? PHASE_STEP : undefined };
  return {
    id: key,
    name: quantity,
    label: `${title}, ${choice.label}: press the arrow keys to read values`,
    x: { title: timeTitle(), log: Boolean(timeAxis.log), isTime: true },
    y,
    hasCursor: true,
    series: key === "error" ? [...series, createResolutionLine(y)] : series,
    legend: choice.names.length > 1 && lines.map(({ label }) => label),
    height: (width) => clamp(0.36 * width, 225, 330),
    read: (time) => readLines(lines, time, quantity),
    marks: (time) => [[time, null]],
    rows: () => [
      ["case", "quantity", timeTitle(), "value"],
      ...lines.flatMap(({ run, name, t, values }) =>
        t.map((time, k) => [run.label, name, time, values[k]]).filter((row) => row[3] !== null),
      ),
    ],
  };
}

// Markers of several lines are staggered. A cross marks the end of a failed run.
function describeLine({ run, label, style: { color, dash, marker } }, data, number, count) {
  const spacing = Math.max(Math.floor(data.length / MARKERS_PER_LINE), 1);
  const first = Math.floor(((number + 0.5) * spacing) / count);
  const isEnd = (k) => hasFailed(run) && k === data.length - 1;
  const hasMarker = (k) => isEnd(k) || (count > 1 && k % spacing === first);
  return {
    type: "line",
    name: label,
    data,
    color,
    z: 2,
    lineStyle: { width: 1.6, type: dash },
    symbol: (_, { dataIndex: k }) => (isEnd(k) ? "path://M-4-5L0-1L4-5L5-4L1 0L5 4L4 5L0 1L-4 5L-5 4L-1 0L-5-4Z" : hasMarker(k) ? `path://${marker}` : "none"),
    showAllSymbol: true,
    symbolSize: 8,
    silent: true,
  };
}

// Measured data are above the lines of the model.
function describePoints({ label, style: { color } }, data) {
  const isDense = data.length > MAX_DATA_POINTS;
  const itemStyle = { opacity: isDense ? 0.6 : 1 };
  return { type: "scatter", name: label, data, color, z: 3, symbolSize: isDense ? 3 : 5, itemStyle, silent: true };
}

function readLines(lines, time, title) {
  const unit = /\[([^\]]*)\]$/.exec(title)?.[1] ?? "";
  const rows = lines.map(({ label, style, t, values, run }) => {
    const value = values[nearestIndex(t, time)] ?? null;
    const order = values.log ? 0 : engineeringOrder(findExtent([values]));
    const text = value === null ? formatValue(value) : `${formatValue(value / 10 ** order)} ${scaleUnit(unit, order)}`;
    return [createLineIcon({ ...style, isData: run.points }), label, text];
  });
  return [html("strong", {}, formatTime(time)), createReadings(rows)];
}

function createReadings(rows) {
  return html("table", {}, ...rows.map((row) => html("tr", {}, ...row.map((cell) => html("td", {}, cell)))));
}

function timeTitle() {
  return timeAxis.unit ? `${timeAxis.name} [${timeAxis.unit}]` : timeAxis.name;
}

function nearestIndex(t, time) {
  const k = t.findIndex((value) => value >= time);
  if (k < 0) return t.length - 1;
  return k > 0 && time - t[k - 1] < t[k] - time ? k - 1 : k;
}

// Chart of one column over another, such as the load factor over a displacement. A dot follows the motion.
function drawPortrait() {
  const lines = page.portrait ? selectedCases().filter(({ run }) => run.curves) : [];
  const choices = listChoices(PANELS[0]).filter(({ names }) => names.length === 1);
  const holder = byId("portrait");
  holder.hidden = !lines.length || choices.length < 2;
  if (holder.hidden) {
    removeChart("portrait");
    return;
  }
  const selects = ["y", "x"].map((axis) => {
    const choose = ({ label }) => {
      page.portrait[axis] = label;
      delete state.views.portrait;
      drawPortrait();
    };
    const selected = choices.find(({ label }) => label === page.portrait[axis]);
    return html("label", {}, `${axis} `, createSelect(`${axis} axis of the curve`, choices, selected, choose));
  });
  createChart(describePortrait(lines), holder, html("div", { class: "heading" }, html("h3", {}, "Curve"), ...selects));
}

function describePortrait(selected) {
  const { x: xName, y: yName, marks } = page.portrait;
  const lines = selected.map(({ run, color, number }) => ({
    run,
    style: lineStyle(themeColor(color), number - 1),
    t: getValues(run.curves.t),
    x: getValues(getOwn(run.curves.observed, xName)) ?? [],
    y: getValues(getOwn(run.curves.observed, yName)) ?? [],
  }));
  const pointAt = ({ t, x, y }, time) => {
    const k = nearestIndex(t, time);
    return [x[k], y[k]];
  };
  const [first] = lines;
  const special = marks.map(({ t, label }) => ({ value: pointAt(first, t), label })).filter(({ value }) => value.every(Number.isFinite));
  return {
    id: "portrait",
    name: `${yName} over ${xName}`,
    label: `${yName} over ${xName}`,
    x: { title: xName },
    y: { title: yName },
    series: [
      ...lines.map(({ run, style, t, x, y }) => ({
        type: "line",
        name: run.label,
        color: style.color,
        data: t.map((time, k) => [x[k], y[k], run.id, time]),
        symbolSize: PORTRAIT_REACH,
        showAllSymbol: true,
        itemStyle: { opacity: 0 },
        lineStyle: { width: 1.6, type: style.dash },
      })),
      createMarks(special.map(({ value, label }) => [...value, undefined, label])),
    ],
    height: (width) => clamp(0.4 * width, 230, 340),
    read: ([x, y, , time]) => [
      html("strong", {}, formatTime(time)),
      createReadings([[yName, formatValue(y)], [xName, formatValue(x)]]),
    ],
    marks: (time) => lines.map((line) => pointAt(line, time)).filter((point) => point.every(Number.isFinite)),
    rows: () => [
      ["case", timeTitle(), xName, yName],
      ...lines.flatMap(({ run, t, x, y }) => t.map((time, k) => [run.label, time, x[k], y[k]])),
    ],
  };
}

// Circles with labels that avoid each other.
function createMarks(data) {
  return {
    type: "scatter",
    name: "marks",
    data,
    symbol: "circle",
    symbolSize: 11,
    silent: true,
    z: 4,
    itemStyle: { color: "transparent", borderColor: themeColor("ink"), borderWidth: 1.5 },
    label: { show: true, position: "top", formatter: ({ value }) => value[3], color: themeColor("ink") },
    labelLayout: { hideOverlap: true },
  };
}

// Chart of a list of numbers in each selected case, such as the thicknesses along a beam, over their index.
function drawProfile() {
  const holder = byId("profile");
  const profile = page.profiles.find(({ label }) => label === state.choices.profile) ?? page.profiles[0];
  holder.hidden = !profile || !selectedCases().length;
  if (holder.hidden) {
    removeChart("profile");
    return;
  }
  const choose = ({ label }) => {
    state.choices.profile = label;
    delete state.views.profile;
    drawProfile();
  };
  const several = page.profiles.length > 1;
  const selects = several ? [createSelect("Parameter over its index", page.profiles, profile, choose)] : [];
  const { label, keys } = profile;
  const lines = selectedCases().map(({ run, color, number }) => ({
    run,
    label: run.label,
    style: lineStyle(themeColor(color), number - 1),
    t: keys.map((_, k) => k),
    values: keys.map((key) => getOwn(run.values, key) ?? null),
  }));
  const spec = {
    id: "profile",
    name: `${label} over index`,
    label: `${label} over index, one line per case`,
    x: { title: "index", isCount: true },
    y: { title: label },
    hasCursor: true,
    series: lines.map(({ style, values, label: name }) => ({
      type: "line",
      name,
      color: style.color,
      data: values.map((value, k) => [k, value]),
      symbol: `path://${style.marker}`,
      symbolSize: 8,
      lineStyle: { width: 1.6, type: style.dash },
    })),
    height: (width) => clamp(0.36 * width, 215, 320),
    read: (index) => readLines(lines, index, label).with(0, html("strong", {}, `${label} ${Math.round(index)}`)),
    rows: () => [
      ["case", "index", label],
      ...lines.flatMap(({ run, values }) => values.map((value, k) => [run.label, k, value])),
    ],
  };
  createChart(spec, holder, html("div", { class: "heading" }, html("h3", {}, "Parameter"), ...selects));
}
