// Curves of the selected cases over time.

const DECADES = 9;
const MARKS_ON_LINE = 6;
const PANELS = [
  { key: "observed", title: "Observed" },
  { key: "error", title: "Error over time" },
  { key: "energy", title: "Energy [J]", unit: "J" },
  { key: "drift", title: "Drift of the joints" },
];
const DIFFERENCE = "difference to the reference";

function drawPanels() {
  const panels = PANELS.map((panel) => ({ ...panel, choices: choices(panel) })).filter(
    (panel) => panel.choices.length,
  );
  const hint =
    "Select cases in the plot or in the table: their trajectories, errors, energies and drifts appear here.";
  const none = casesHere().some((one) => one.curves) ? hint : "No case of this model has curves.";
  const drawn = panels.length && selected().length;
  for (const { key } of PANELS) state.charts.delete(key);
  byId("panels").replaceChildren(...(drawn ? panels.map(panelElement) : [empty(none)]));
  if (drawn) panels.forEach(drawPanel);
}

// What a panel can show: each of its curves, and all of a unit together.
function choices({ key, unit }) {
  const curves = casesHere().map((one) => one.curves?.[key] ?? {});
  const names = distinct(curves.flatMap((found) => Object.keys(found)));
  const logarithmic = (name) => curves.some((found) => own(found, name)?.log);
  const unitOf = (name) => (logarithmic(name) ? null : (unit ?? /\[([^\]]*)\]$/.exec(name)?.[1] ?? null));
  const together = distinct(known(names.map(unitOf))).map((one) => ({
    label: `all in ${one}`,
    names: names.filter((name) => unitOf(name) === one),
    title: `[${one}]`,
  }));
  const each = names.map((name) => ({ label: name, names: [name], title: axisTitle(name, logarithmic(name)) }));
  return [...each, ...together.filter((choice) => choice.names.length > 1)];
}

function axisTitle(name, logarithmic) {
  return logarithmic && name === "imbalance" ? "size of the imbalance" : name;
}

function panelElement(panel) {
  const { key, title } = panel;
  panel.choice = panel.choices.find(({ label }) => label === state.names[key]) ?? firstChoice(panel);
  const change = (event) => {
    panel.choice = panel.choices[event.target.selectedIndex];
    state.names[key] = panel.choice.label;
    state.views[key].y = null;
    drawPanel(panel);
  };
  const options = panel.choices.map((one) => html("option", { selected: one === panel.choice && "" }, one.label));
  const which =
    options.length > 1 ? [html("select", { "aria-label": `${title}: which`, change }, ...options)] : [];
  panel.holder = html("div");
  const heading = html("div", { class: "heading" }, html("h3", {}, title), ...which, ...differenceChoice(panel));
  return html("div", { class: "panel", "data-panel": key }, heading, panel.holder);
}

// Energies of a single run belong together.
function firstChoice({ key, choices }) {
  return page.cases.length === 1 && key === "energy" ? choices.at(-1) : choices[0];
}

function differenceChoice(panel) {
  const { key, title } = panel;
  if (!casesHere().some((one) => Object.keys(one.curves?.difference?.[key] ?? {}).length)) return [];
  const change = (event) => {
    state.differences[key] = event.target.checked;
    state.views[key].y = null;
    drawPanel(panel);
  };
  const checked = state.differences[key] && "";
  const box = html("input", {
    type: "checkbox",
    "aria-label": `${title}: ${DIFFERENCE}`,
    checked: checked ?? false,
    change,
  });
  return [html("label", {}, box, ` ${DIFFERENCE}`)];
}

function drawPanel(panel) {
  const { key, holder } = panel;
  const lines = linesOf(panel);
  if (!lines.length) {
    state.charts.delete(key);
    const sentence = state.differences[key]
      ? "None of the selected cases has a difference to the reference for this."
      : "None of the selected cases has this curve.";
    holder.replaceChildren(empty(sentence));
    return;
  }
  const made = chart(curveSpec(panel, lines));
  readable(made);
  state.charts.set(key, made);
  holder.replaceChildren(...nameLegend(panel, lines), made.element);
  drawChart(made);
}

// A line for each selected case and each name; several names of one run have colors of their own.
function linesOf({ key, choice }) {
  const cases = selected();
  const source = state.differences[key] ? (one) => one.curves?.difference?.[key] : (one) => one.curves?.[key];
  return cases
    .flatMap(({ one, number, color }) =>
      choice.names.map((name, k) => ({
        one,
        name,
        label: lineLabel(one, name, choice),
        style: lineStyle(cases.length > 1 ? color : nameColor(color, choice, k), choice.names.length > 1 ? k : number - 1),
        t: one.curves?.t,
        values: own(source(one), name),
      })),
    )
    .map((line) => ({ ...line, values: valuesOf(line.values), t: valuesOf(line.t) }))
    .filter(({ values }) => values && known(values).length);
}

function nameColor(color, { names }, k) {
  return names.length > 1 ? `color-${k % COLORS}` : color;
}

function lineLabel(one, name, { names }) {
  if (names.length === 1) return one.label;
  const cases = selected().length > 1;
  return cases ? `${name}, ${one.label}` : name;
}

// Names of a panel that shows several are hidden and shown by it.
function nameLegend(panel, lines) {
  const { key, choice } = panel;
  if (choice.names.length < 2) return [];
  const entries = choice.names
    .filter((name) => lines.some((line) => line.name === name))
    .map((name) => {
      const away = state.hidden.names[key];
      const click = () => {
        flip(away, name);
        drawPanel(panel);
      };
      const { style } = lines.find((line) => line.name === name);
      return switchOf(`${key} ${name}`, !away.has(name), click, lineSign(style), name);
    });
  return [html("div", { class: "legend" }, ...entries)];
}

function curveSpec({ key, title, choice }, all) {
  const { cases, names } = state.hidden;
  const seen = all.filter(({ one, name }) => !cases.has(one.id) && !(choice.names.length > 1 && names[key].has(name)));
  const lines = seen.length ? seen : all;
  const log = Boolean(lines[0].values.log);
  const [begin, end] = extent(all.map(({ t }) => t));
  const difference = state.differences[key];
  const quantity = difference ? `difference of ${choice.title}` : choice.title;
  return {
    id: key,
    name: quantity,
    label: `${title}, ${choice.label}: use the arrow keys to read values`,
    x: { title: "t [s]", range: [begin, end > begin ? end : begin + 1], log: false },
    y: { title: quantity, range: padded(curveExtent(lines, log), log), log },
    view: state.views[key],
    lines: seen,
    height: (width) => Math.min(Math.max(0.5 * width, 230), 320),
    under: () => [],
    inside: (box, x, y) => seen.map((line, k) => curve(line, x, y, marksAt(box, k, seen.length))),
    over: (box, _, y) => (key === "error" ? resolutionLine(box, y) : []),
    changed: () => followTime(key),
    legend: () => seen.map(({ style, label }) => ({ sign: lineSign(style), text: label })),
    rows: () => curveRows(seen),
  };
}

function curveExtent(lines, logarithmic) {
  const [low, high] = extent(lines.map(({ values }) => values));
  return logarithmic ? [Math.max(low, high / 10 ** DECADES), high] : [low, high];
}

function curveRows(lines) {
  const rows = lines.flatMap(({ one, name, t, values }) => t.map((time, k) => [one.label, name, time, values[k]]));
  return [["case", "quantity", "t [s]", "value"], ...rows.filter((row) => row[3] !== null)];
}

// All panels show the same time.
function followTime(key) {
  const { x } = state.views[key];
  for (const other of PANELS.map((panel) => panel.key).filter((one) => one !== key)) {
    state.views[other].x = x;
    if (state.charts.has(other)) drawChart(state.charts.get(other));
  }
}

// Where lines have their marks, each between those of the others; a line alone needs none.
function marksAt(box, k, count) {
  const apart = (box.right - box.left) / MARKS_ON_LINE;
  const places = Array.from({ length: MARKS_ON_LINE }, (_, i) => box.left + (i + (k + 0.5) / count) * apart);
  return count > 1 ? places : [];
}

function curve({ one, style, t, values }, x, y, marked) {
  let path = "";
  let last = null;
  values.forEach((value, k) => {
    if (value === null) return;
    const begins = k === 0 || values[k - 1] === null;
    last = [x.at(t[k]), y.at(value)];
    path += `${begins ? "M" : "L"}${last[0].toFixed(1)} ${last[1].toFixed(1)}`;
  });
  const cross = failed(one)
    ? [svg("path", { class: `curve ${style.color}`, transform: `translate(${last})`, d: "M-4-4L4 4M-4 4L4-4" })]
    : [];
  const marks = marked
    .filter((place) => x.back(place) <= t.at(-1))
    .map((place) => nearest(t, x.back(place)))
    .filter((k) => values[k] !== null)
    .map((k) => lineMark(style, [x.at(t[k]), y.at(values[k])]));
  return svg("g", {}, svg("path", { class: `curve ${style.color} ${style.dash}`, d: path }), ...cross, ...marks);
}

function nearest(t, time) {
  const k = t.findIndex((one) => one >= time);
  if (k < 0) return t.length - 1;
  return k > 0 && time - t[k - 1] < t[k] - time ? k - 1 : k;
}
