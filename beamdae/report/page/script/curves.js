// Curves of the selected cases over time, in panels, and over each other.

const MAX_LOG_DECADES = 9; // decades below the largest value on logarithmic axes
const MAX_DATA_POINTS = 150; // of a column; more are smaller, so that they do not hide each other
const POINT_REACH = 14; // size of the area around a point of a curve that reacts to the pointer [px]
const CROSS = "M-4-5L0-1L4-5L5-4L1 0L5 4L4 5L0 1L-4 5L-5 4L-1 0L-5-4Z";
const PHASE_STEP = 45; // [deg]
const LINE_WIDTH = 1.6; // [px]
const PANELS = [
  { key: "observed", title: "Observed", section: "panels" },
  { key: "energy", title: "Energy [J]", section: "panels", unit: "J", log: ["imbalance"] },
  { key: "magnitude", title: "Magnitude", section: "panels", log: true },
  { key: "phase", title: "Phase", section: "panels", step: PHASE_STEP },
  { key: "error", title: "Error over time", section: "error-panels", log: true },
  { key: "drift", title: "Drift of the joints", section: "solver-panels", log: true },
];

function drawPanels() {
  const panels = PANELS.map((panel) => ({ ...panel, choices: listChoices(panel) }));
  const isEmpty = !panels.some(({ choices }) => choices.length) || !selectedCases().length;
  for (const { section } of PANELS) byId(section).replaceChildren();
  for (const panel of panels) {
    if (isEmpty || !panel.choices.length) removeChart(panel.key);
    else drawPanel(panel);
  }
  if (isEmpty && (!page.leads || page.cases.some((run) => run.curves))) {
    const hint = groupCases().some((run) => run.curves)
      ? "Select cases in the plot or in the table to see their trajectories, errors, energies and drifts."
      : "No case of this model has curves.";
    byId("panels").replaceChildren(createPlaceholder(hint));
  }
  hideEmptySections();
}

function unitOf(title) {
  return /\[([^\]]*)\]$/.exec(title)?.[1] ?? null;
}

// Choices of a panel: each column, those that characterize the motion first, and all columns with the same unit together.
function listChoices({ key, unit, log = [] }) {
  const rank = (name) => (page.featured.includes(name) ? page.featured.indexOf(name) : Infinity);
  const names = removeDuplicates(groupCases().flatMap((run) => Object.keys(run.curves?.[key] ?? {})));
  names.sort((a, b) => (rank(a) === rank(b) ? 0 : rank(a) - rank(b)));
  const single = names.map((name) => ({ label: name, names: [name], title: name, log: log === true || log.includes(name) }));
  const together = single.filter((choice) => !choice.log).map(({ label }) => [label, unit ?? unitOf(label)]);
  const units = removeDuplicates(removeMissing(together.map(([, of]) => of)));
  const combined = units.map((of) => ({ label: `all in ${of}`, names: together.filter((pair) => pair[1] === of).map(([name]) => name), title: `[${of}]`, log: false }));
  return [...single, ...combined.filter((choice) => choice.names.length > 1)];
}

function drawPanel({ key, title, section, choices, step }) {
  // All energies of a single run share a chart.
  const runs = page.cases.filter((run) => !run.points);
  const together = runs.length === 1 && key === "energy" && choices.find(({ names }) => names.length > 1);
  const choice = choices.find(({ label }) => label === state.choices[key]) ?? (together || choices[0]);
  const choose = ({ label }) => {
    state.choices[key] = label;
    drawPanels();
    resetView(state.charts.get(key), 1);
  };
  const select = choices.length > 1 ? [createSelect(`${title}: quantity`, choices, choice, choose)] : [];
  const holder = html("div");
  const heading = html("div", { class: "heading" }, html("h3", {}, title), ...select);
  byId(section).append(html("div", { class: "panel", "data-panel": key }, heading, holder));
  if (collectLines(key, choice).length) return createChart(key, () => describeCurves(key, title, choice, step), holder);
  removeChart(key);
  holder.append(createPlaceholder("None of the selected cases has this curve."));
}

// One line per selected case and name. Color distinguishes cases and dashes distinguish names. With a single
// case besides measured data, both distinguish names; with a single name, both distinguish cases.
function collectLines(key, { names, log }) {
  const cases = selectedCases();
  const [hasCases, hasNames] = [cases.filter(({ run }) => !run.points).length > 1, names.length > 1];
  const usable = (value) => (log && !(value > 0) ? null : value);
  return cases
    .flatMap(({ run, number, color }) =>
      names.map((name, k) => ({
        run,
        name,
        label: !hasNames || run.points ? run.label : hasCases ? `${name}, ${run.label}` : name,
        color: themeColor(hasCases || !hasNames ? color : `color-${k % COLOR_COUNT}`),
        dash: DASHES[(hasNames ? k : number - 1) % DASHES.length],
        t: run.curves?.t,
        values: getOwn(run.curves?.[key], name)?.map(usable),
      })),
    )
    .filter(({ values }) => values && removeMissing(values).length);
}

function describeCurves(key, title, choice, step) {
  const lines = collectLines(key, choice);
  const { log } = choice;
  const lowest = log ? findExtent(lines.map(({ values }) => values))[1] / 10 ** MAX_LOG_DECADES : -Infinity;
  const y = { title: choice.title, log, step };
  const series = lines.map((line) => {
    const data = line.t.map((time, k) => [time, line.values[k] === null ? null : Math.max(line.values[k], lowest)]);
    return line.run.points ? describePoints(line, data) : { ...describeLine(line, data), symbol: (_, { dataIndex }) => (hasFailed(line.run) && dataIndex === data.length - 1 ? PATH + CROSS : "none") };
  });
  return {
    name: choice.title,
    label: `${title}, ${choice.label}: press the arrow keys to read values`,
    x: { title: timeTitle(), log: Boolean(timeAxis.log), isTime: true },
    y,
    hasCursor: true,
    series: key === "error" ? [...series, createResolutionLine(y)] : series,
    legend: choice.names.length > 1 && lines.map(({ label }) => label),
    height: (width) => clamp(0.36 * width, 225, 330),
    read: (entries) => readLines(entries, y),
    marks: (time) => [[time, null]],
    rows: () => [
      ["case", "quantity", timeTitle(), "value"],
      ...lines.flatMap(({ run, name, t, values }) => t.map((time, k) => [run.label, name, time, values[k]]).filter((row) => row[3] !== null)),
    ],
  };
}

function describeLine({ label, color, dash }, data) {
  return { type: "line", name: label, data, color, z: 2, lineStyle: { width: LINE_WIDTH, type: dash }, showAllSymbol: true, symbolSize: 8, silent: true };
}

// Measured data are above the lines of the model.
function describePoints({ label, color }, data) {
  const isDense = data.length > MAX_DATA_POINTS;
  return { type: "scatter", name: label, data, color, z: 3, symbolSize: isDense ? 3 : 5, itemStyle: { opacity: isDense ? 0.6 : 1 }, silent: true };
}

// Values of all lines at the cursor, in the unit of the axis.
function readLines(entries, y) {
  const unit = scaleUnit(unitOf(y.title) ?? "", y.order);
  const rows = entries.map(({ color, seriesName, value }) => [
    html("span", { class: "swatch", style: `background: ${color}` }),
    seriesName,
    value[1] === null ? "–" : `${formatValue(y.log ? 10 ** value[1] : value[1] / 10 ** y.order)} ${unit}`,
  ]);
  return [html("strong", {}, formatTime(toValue({ log: timeAxis.log }, entries[0].axisValue))), createReadings(rows)];
}

function createReadings(rows) {
  return html("table", {}, ...rows.map((row) => html("tr", {}, ...row.map((cell) => html("td", {}, cell)))));
}

function timeTitle() {
  return timeAxis.unit ? `${timeAxis.name} [${timeAxis.unit}]` : timeAxis.name;
}

// Chart of one column over another, such as the load factor over a displacement. A dot follows the motion.
function drawPortrait() {
  const choices = listChoices(PANELS[0]).filter(({ names }) => names.length === 1);
  const holder = byId("portrait");
  holder.hidden = !page.portrait || choices.length < 2 || !selectedCases().some(({ run }) => run.curves);
  if (holder.hidden) return removeChart("portrait");
  const selects = ["y", "x"].map((axis) => {
    const choose = ({ label }) => {
      page.portrait[axis] = label;
      drawPortrait();
      resetView(state.charts.get("portrait"), 0, 1);
    };
    const selected = choices.find(({ label }) => label === page.portrait[axis]);
    return html("label", {}, `${axis} `, createSelect(`${axis} axis of the curve`, choices, selected, choose));
  });
  createChart("portrait", describePortrait, holder, html("div", { class: "heading" }, html("h3", {}, "Curve"), ...selects));
}

function describePortrait() {
  const { x: xName, y: yName, marks } = page.portrait;
  const lines = selectedCases().filter(({ run }) => run.curves).map(({ run, color, number }) => {
    const [x, y] = [xName, yName].map((name) => getOwn(run.curves.observed, name) ?? []);
    const data = run.curves.t.map((time, k) => [x[k], y[k], run.id, time]);
    return { run, data, label: run.label, color: themeColor(color), dash: DASHES[(number - 1) % DASHES.length] };
  });
  const pointAt = ({ data }, time) => data.findLast((point) => point[3] <= time) ?? data[0];
  const isKnown = ([x, y]) => Number.isFinite(x) && Number.isFinite(y);
  const special = marks.map(({ t, label }) => [...pointAt(lines[0], t).slice(0, 2), undefined, label]).filter(isKnown);
  return {
    name: `${yName} over ${xName}`,
    label: `${yName} over ${xName}`,
    x: { title: xName },
    y: { title: yName },
    series: [
      ...lines.map((line) => ({ ...describeLine(line, line.data), silent: false, symbolSize: POINT_REACH, itemStyle: { opacity: 0 } })),
      createMarks(special),
    ],
    height: (width) => clamp(0.4 * width, 230, 340),
    read: ({ value: [x, y, , time] }) => [html("strong", {}, formatTime(time)), createReadings([[yName, formatValue(y)], [xName, formatValue(x)]])],
    marks: (time) => lines.map((line) => pointAt(line, time)).filter(isKnown),
    rows: () => [["case", timeTitle(), xName, yName], ...lines.flatMap(({ label, data }) => data.map(([x, y, , time]) => [label, time, x, y]))],
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
