// Curves of the selected cases over time, in panels, and over each other.

const MAX_LOG_DECADES = 9; // decades below the largest value on logarithmic axes
const MAX_DATA_POINTS = 150; // of a column; more are smaller, so that they do not hide each other
// Points of a curve over another column, in an area [px] that reacts to the pointer.
const POINTS_OF_CURVE = { silent: false, symbolSize: 14, itemStyle: { opacity: 0 } };
const CROSS = "M-4-5L0-1L4-5L5-4L1 0L5 4L4 5L0 1L-4 5L-5 4L-1 0L-5-4Z";
const PHASE_STEP = 45; // [deg]
const LINE_WIDTH = 1.6; // [px]
// A panel shows the curves called `key`, or those called `source`, over time or, with `isOver`, over another column.
const PANELS = [
  { key: "portrait", source: "observed", title: "Curve", section: "portrait", isOver: true },
  { key: "observed", title: "Observed", section: "panels" },
  { key: "energy", title: "Energy [J]", section: "panels", unit: "J", log: ["imbalance"] },
  { key: "magnitude", title: "Magnitude", section: "panels", log: true },
  { key: "phase", title: "Phase", section: "panels", step: PHASE_STEP },
  { key: "error", title: "Error over time", section: "error-panels", log: true },
  { key: "drift", title: "Drift of the joints", section: "solver-panels", log: true },
];

function drawPanels() {
  const panels = PANELS.map((panel) => ({ ...panel, choices: listChoices(panel) }));
  byId("portrait").hidden = !page.portrait;
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
function listChoices({ key, source = key, unit, log = [], isOver }) {
  if (isOver && !page.portrait) return [];
  const rank = (name) => (page.featured.includes(name) ? page.featured.indexOf(name) : Infinity);
  const names = removeDuplicates(groupCases().flatMap((run) => Object.keys(run.curves?.[source] ?? {})));
  names.sort((a, b) => (rank(a) === rank(b) ? 0 : rank(a) - rank(b)));
  const single = names.map((name) => ({ label: name, names: [name], title: name, log: log === true || log.includes(name) }));
  const together = single.filter((choice) => !choice.log).map(({ label }) => [label, unit ?? unitOf(label)]);
  const units = removeDuplicates(removeMissing(together.map(([, of]) => of)));
  const combined = units.map((of) => ({ label: `all in ${of}`, names: together.filter((pair) => pair[1] === of).map(([name]) => name), title: `[${of}]`, log: false }));
  if (isOver) return single;
  return [...single, ...combined.filter((choice) => choice.names.length > 1)];
}

function drawPanel(panel) {
  const { key, title, section, choices } = panel;
  // All energies of a single run share a chart.
  const runs = page.cases.filter((run) => !run.points);
  const together = runs.length === 1 && key === "energy" && choices.find(({ names }) => names.length > 1);
  const find = (name) => choices.find(({ label }) => label === name);
  const choice = find(state.choices[key]) ?? (together || choices[0]);
  const over = panel.isOver ? (find(state.choices.over) ?? choices[0]) : null;
  const createChoice = (entry, name, selected) => {
    const choose = ({ label }) => {
      state.choices[entry] = label;
      drawPanels();
      resetView(state.charts.get(key), ...(panel.isOver ? [0, 1] : [1]));
    };
    return createSelect(`${title}: ${name}`, choices, selected, choose);
  };
  const selects = choices.length > 1 ? [createChoice(key, "quantity", choice)] : [];
  if (over) selects.push(" over ", createChoice("over", "horizontal axis", over));
  const holder = html("div");
  const heading = html("div", { class: "heading" }, html("h3", {}, title), ...selects);
  byId(section).append(html("div", { class: "panel", "data-panel": key }, heading, holder));
  if (collectLines(panel, choice, over).length) return createChart(key, () => describeCurves(panel, choice, over), holder);
  removeChart(key);
  holder.append(createPlaceholder("None of the selected cases has this curve."));
}

// One line per selected case and name. Color distinguishes cases and dashes distinguish names. With a single
// case besides measured data, both distinguish names; with a single name, both distinguish cases.
function collectLines({ key, source = key }, { names, log }, over) {
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
        x: over ? getOwn(run.curves?.[source], over.label) : run.curves?.t,
        values: getOwn(run.curves?.[source], name)?.map(usable),
      })),
    )
    .filter(({ x, values }) => x && values && removeMissing(values).length);
}

function describeCurves(panel, choice, over) {
  const { key, title, step } = panel;
  const lines = collectLines(panel, choice, over);
  const { log } = choice;
  const lowest = log ? findExtent(lines.map(({ values }) => values))[1] / 10 ** MAX_LOG_DECADES : -Infinity;
  const y = { title: choice.title, log, step };
  for (const line of lines) {
    line.data = line.t.map((time, k) => [line.x[k], line.values[k] === null ? null : Math.max(line.values[k], lowest), line.run.id, time]);
  }
  const series = lines.map((line) => {
    const { run, data } = line;
    if (run.points) return describePoints(line, data);
    const end = { symbol: (_, { dataIndex }) => (hasFailed(run) && dataIndex === data.length - 1 ? PATH + CROSS : "none") };
    return { ...describeLine(line, data), ...(over ? POINTS_OF_CURVE : end) };
  });
  if (over) series.push(createMarks(page.portrait.marks.map(({ t, label }) => [...pointAt(lines[0], t).slice(0, 2), undefined, label]).filter(isKnown)));
  if (key === "error") series.push(createResolutionLine(y));
  return {
    label: `${title}, ${choice.label}: press the arrow keys to read values`,
    x: over ? { title: over.title } : { title: timeTitle(), log: Boolean(timeAxis.log), isTime: true },
    y,
    hasCursor: !over,
    series,
    legend: choice.names.length > 1 && lines.map(({ label }) => label),
    height: (width) => clamp(0.36 * width, 225, 330),
    read: (entries) => (over ? readPoint(entries.value, choice.title, over.title) : readLines(entries, y)),
    marks: (time) => (over ? lines.map((line) => pointAt(line, time)).filter(isKnown) : [[time, null]]),
  };
}

function pointAt({ data }, time) {
  return data.findLast((point) => point[3] <= time) ?? data[0];
}

function isKnown([x, y]) {
  return Number.isFinite(x) && Number.isFinite(y);
}

function readPoint([x, y, , time], yTitle, xTitle) {
  return [html("strong", {}, formatTime(time)), createReadings([[yTitle, formatValue(y)], [xTitle, formatValue(x)]])];
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
