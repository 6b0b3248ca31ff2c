"use strict";

const MISSING = 65535;
const COLORS = 7;
const DASHES = ["", "dash-1", "dash-2", "dash-3"];
const DECADES = 9;
const SPEEDS = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10];
const MARKS = [
  "M-5 0A5 5 0 1 0 5 0A5 5 0 1 0-5 0Z",
  "M-4.5-4.5H4.5V4.5H-4.5Z",
  "M0-6L5.6 4H-5.6Z",
  "M0-6.2L6.2 0L0 6.2L-6.2 0Z",
  "M0 6L5.6-4H-5.6Z",
];
const ARROW = "M0 8V22M-4 17L0 22L4 17";
const LAYERS = ["ground", "rigid", "beam", "point"];
const PANELS = [
  { key: "observed", title: "Observed" },
  { key: "error", title: "Error over time" },
  { key: "energy", title: "Energy [J]" },
  { key: "drift", title: "Drift of the joints" },
];

const page = unpackedPage(JSON.parse(byId("data").textContent));
const families = distinct(page.cases.map((one) => one.family));
const columns = tableColumns();
const state = { group: null, slots: [], order: null, names: {} };
const motion = { frames: null, draw: null, time: 0, playing: false, last: 0 };

// Stored curves.

// Where they are is known by their place: names of users may be any.
function unpackedPage(data) {
  for (const { frames } of data.groups.filter((group) => group.frames)) {
    unpackIn(frames, ["t"]);
    for (const body of frames.bodies) unpackIn(body, ["x", "y"]);
  }
  for (const { curves } of data.cases.filter((one) => one.curves)) {
    unpackIn(curves, ["t"]);
    for (const { key } of PANELS) unpackIn(curves[key], Object.keys(curves[key]));
  }
  return data;
}

function unpackIn(object, names) {
  for (const name of names) object[name] = unpacked(object[name]);
}

function unpacked(value) {
  const bytes = Uint8Array.from(atob(value.u16), (letter) => letter.charCodeAt(0));
  const codes = new DataView(bytes.buffer);
  const values = Array.from({ length: bytes.length / 2 }, (_, i) =>
    decoded(codes.getUint16(2 * i, true), value),
  );
  return Object.assign(values, { log: value.log });
}

// What an object has itself: a name may be that of something all objects have.
function own(object, name) {
  return object && Object.hasOwn(object, name) ? object[name] : undefined;
}

function decoded(code, { low, step, log }) {
  if (code === MISSING) return null;
  return log ? 10 ** (low + step * code) : low + step * code;
}

// Elements.

function byId(id) {
  return document.getElementById(id);
}

function built(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value !== false) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

function html(tag, attributes = {}, ...children) {
  return built(document.createElement(tag), attributes, children);
}

function svg(tag, attributes = {}, ...children) {
  return built(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

function empty(sentence) {
  return html("p", { class: "empty" }, sentence);
}

function sign(width, ...children) {
  return svg(
    "svg",
    { class: "sign", width, height: 16, viewBox: `0 -8 ${width} 16`, "aria-hidden": "true" },
    ...children,
  );
}

function familySign(family, more = "") {
  return sign(
    14,
    svg("g", { class: `${familyColor(family)} ${more}`, transform: "translate(7)" }, mark(family)),
  );
}

function lineSign(style, width) {
  return sign(width, svg("path", { class: `curve ${style}`, d: `M0 0H${width}` }));
}

function mark(family) {
  return svg("path", { class: "mark", d: MARKS[families.indexOf(family) % MARKS.length] });
}

function familyColor(family) {
  return `color-${families.indexOf(family) % COLORS}`;
}

// Numbers.

function distinct(values) {
  return [...new Set(values)];
}

function known(values) {
  return values.filter((value) => value !== null && value !== undefined);
}

function extent(lists) {
  let [low, high] = [Infinity, -Infinity];
  for (const list of lists) {
    for (const value of known(list)) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  return [low, high];
}

function shown(value, digits = 4) {
  if (value === null || value === undefined || value === "") return "–";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value !== "number") return String(value);
  const size = Math.abs(value);
  if (value === 0 || (Number.isInteger(value) && size < 1e9)) return String(value);
  if (size >= 1e-3 && size < 1e5) return String(Number(value.toPrecision(digits)));
  return value.toExponential(digits - 2);
}

function powerText(value) {
  const exponent = Math.floor(Math.log10(value) + 1e-9);
  const factor = Math.round(value / 10 ** exponent);
  const raised = [...String(exponent)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("");
  return `${factor === 1 ? "" : `${factor}·`}10${raised}`;
}

// Scales and axes.

function scale([low, high], [from, to], logarithmic) {
  const forth = logarithmic ? Math.log10 : (value) => value;
  const [begin, end] = [forth(low), forth(high)];
  const at = (value) => from + ((to - from) * (forth(value) - begin)) / (end - begin);
  const back = (place) => begin + ((end - begin) * (place - from)) / (to - from);
  return { at, back, ticks: logarithmic ? powerTicks(low, high) : evenTicks(low, high) };
}

function powerTicks(low, high) {
  const span = Math.log10(high / low);
  const factors = span < 1.5 ? [1, 2, 3, 5] : span < 2.5 ? [1, 2, 5] : [1];
  const every = Math.max(Math.ceil(span / 8), 1);
  const values = [];
  for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k += 1) {
    if (k % every === 0) values.push(...factors.map((factor) => factor * 10 ** k));
  }
  const ticks = values.filter((value) => value >= low && value <= high);
  const plain = ticks.every((value) => value > 0.9e-2 && value < 1e4);
  return ticks.map((value) => ({
    value,
    text: plain ? String(Number(value.toPrecision(1))) : powerText(value),
  }));
}

function niceBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [5, 2, 1].find((factor) => factor * power <= value * (1 + 1e-9));
}

function evenTicks(low, high) {
  const step = niceBelow((high - low) / 3.5);
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  const digits = Math.max(Math.ceil(Math.log10(Math.max(Math.abs(low), Math.abs(high)) / step)) + 1, 1);
  return Array.from({ length: last - first + 1 }, (_, i) => {
    const value = (first + i) * step;
    return { value, text: shown(Number(value.toPrecision(Math.min(digits, 15))), Math.max(digits + 1, 2)) };
  });
}

function padded([low, high], logarithmic) {
  if (logarithmic) {
    const more = Math.max(10 ** (0.08 * (1 + Math.log10(high / low))), Math.sqrt((10 * low) / high));
    return [low / more, high * more];
  }
  const more = 0.05 * (high - low) || 0.1 * Math.abs(high) || 1;
  return [low - more, high + more];
}

function plotBox(width, height) {
  return { width, height, left: 62, right: width - 14, top: 24, bottom: height - 34 };
}

function canvas(box, label, ...children) {
  return svg(
    "svg",
    { viewBox: `0 0 ${box.width} ${box.height}`, role: "group", "aria-label": label },
    ...children,
  );
}

function axes(box, x, y, titles) {
  const vertical = x.ticks.flatMap(({ value, text }) => [
    svg("line", { class: "grid", x1: x.at(value), x2: x.at(value), y1: box.top, y2: box.bottom }),
    svg("text", { x: x.at(value), y: box.bottom + 15, "text-anchor": "middle" }, text),
  ]);
  const horizontal = y.ticks.flatMap(({ value, text }) => [
    svg("line", { class: "grid", x1: box.left, x2: box.right, y1: y.at(value), y2: y.at(value) }),
    svg("text", { x: box.left - 7, y: y.at(value) + 4, "text-anchor": "end" }, text),
  ]);
  const frame = {
    class: "axis",
    x: box.left,
    y: box.top,
    width: box.right - box.left,
    height: box.bottom - box.top,
  };
  return [
    ...vertical,
    ...horizontal,
    svg("rect", frame),
    svg(
      "text",
      { class: "title", x: (box.left + box.right) / 2, y: box.height - 3, "text-anchor": "middle" },
      titles.x,
    ),
    svg("text", { class: "title", x: box.left, y: 14 }, titles.y),
  ];
}

// What is said at the pointer.

function showTip(x, y, ...children) {
  const tip = byId("tip");
  tip.replaceChildren(...children);
  tip.hidden = false;
  const { width, height } = tip.getBoundingClientRect();
  tip.style.left = `${Math.max(Math.min(x + 14, window.innerWidth - width - 8), 4)}px`;
  tip.style.top = `${y + 14 + height > window.innerHeight ? y - height - 14 : y + 14}px`;
}

function hideTip() {
  byId("tip").hidden = true;
}

// Cases.

function casesHere() {
  return page.cases.filter((one) => one.group === state.group.id);
}

function failed(one) {
  return one.status !== "ok";
}

function resolution() {
  return state.group.reference?.uncertainty || null;
}

function height(one) {
  return one.below && resolution() ? resolution() : one.error;
}

function plottable(one) {
  return !failed(one) && height(one) > 0 && one.cost > 0;
}

function errorText(one) {
  if (!one.below) return shown(one.error);
  return resolution()
    ? `at most ${shown(resolution(), 3)}, the reference resolves no less`
    : "less than the reference resolves";
}

function facts(one) {
  const rows = [
    ["error", errorText(one)],
    ["wall time", one.cost === null ? "–" : `${shown(one.cost)} s`],
  ];
  const steps = own(one.values, "steps");
  if (steps !== undefined) rows.push(["steps", shown(steps)]);
  return rows;
}

// Error over wall time.

function drawPrecision() {
  const cases = casesHere()
    .filter(plottable)
    .sort((one, other) => height(other) - height(one) || one.cost - other.cost);
  const plot = cases.length
    ? precisionPlot(cases)
    : empty("No case of this model has both an error and a wall time.");
  byId("precision-plot").replaceChildren(plot);
  byId("families").replaceChildren(...(cases.length ? precisionLegend(cases) : []));
}

function precisionPlot(cases) {
  const box = plotBox(640, 400);
  const x = scale(padded(extent([cases.map((one) => one.cost)]), true), [box.left, box.right], true);
  const y = scale(padded(errorExtent(cases), true), [box.bottom, box.top], true);
  const place = (one) => [x.at(one.cost), y.at(height(one))];
  const points = cases.map((one) => point(one, place(one)));
  const plot = canvas(
    box,
    "error over wall time, one point a case",
    ...resolutionBand(box, y),
    ...axes(box, x, y, { x: "wall time [s]", y: "error" }),
    ...resolutionLine(box, y),
    ...seriesLines(cases, place),
    ...points,
  );
  plot.addEventListener("keydown", walk);
  points[0].setAttribute("tabindex", "0");
  return plot;
}

function errorExtent(cases) {
  const [low, high] = extent([cases.map(height)]);
  const near = resolution() && resolution() > low / 100;
  return near ? [Math.min(low, resolution()), Math.max(high, resolution())] : [low, high];
}

function within(value, axis, box) {
  const place = axis.at(value);
  return place >= box.top && place <= box.bottom;
}

function resolutionBand(box, y) {
  if (!resolution() || !within(resolution(), y, box)) return [];
  const top = y.at(resolution());
  return [
    svg("rect", {
      class: "unresolved",
      x: box.left,
      y: top,
      width: box.right - box.left,
      height: box.bottom - top,
    }),
  ];
}

function resolutionLine(box, y) {
  if (!resolution() || !within(resolution(), y, box)) return [];
  const place = y.at(resolution());
  const text = { class: "halo", x: box.left + 6, y: place < box.top + 20 ? place + 15 : place - 6 };
  return [
    svg("line", { class: "resolution", x1: box.left, x2: box.right, y1: place, y2: place }),
    svg("text", text, `the reference resolves ${shown(resolution(), 3)}`),
  ];
}

function seriesLines(cases, place) {
  return distinct(known(cases.map((one) => one.series))).flatMap((series) => {
    const members = cases.filter((one) => one.series === series);
    return members.slice(1).map((one, k) => joined(members[k], one, place));
  });
}

function joined(one, other, place) {
  const [[x1, y1], [x2, y2]] = [place(one), place(other)];
  const open = one.below || other.below ? "dashed" : "";
  return svg("line", { class: `series ${familyColor(one.family)} ${open}`, x1, y1, x2, y2 });
}

function point(one, [x, y]) {
  const attributes = {
    class: `run ${familyColor(one.family)} ${one.below ? "hollow" : ""}`,
    transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})`,
    "data-case": one.id,
    tabindex: "-1",
    role: "button",
    "aria-label": [one.label, ...facts(one).map((row) => row.join(" "))].join(", "),
    click: () => toggle(one.id),
    pointerenter: (event) => showTip(event.clientX, event.clientY, ...caseTip(one)),
    pointerleave: hideTip,
    focus: (event) => showBeside(event.currentTarget, caseTip(one)),
    blur: hideTip,
  };
  const arrow = one.below ? [svg("path", { class: "arrow", d: ARROW })] : [];
  const ring = svg("circle", { class: "ring", r: 10 });
  return svg(
    "g",
    attributes,
    ring,
    ...arrow,
    mark(one.family),
    svg("text", { class: "number halo", x: 10, y: -8 }),
  );
}

function showBeside(element, children) {
  const { right, bottom } = element.getBoundingClientRect();
  showTip(right, bottom, ...children);
}

function caseTip(one) {
  return [
    html("strong", {}, one.label),
    html("table", {}, ...facts(one).map((row) => html("tr", {}, ...row.map((text) => html("td", {}, text))))),
  ];
}

function walk(event) {
  const points = [...event.currentTarget.querySelectorAll(".run")];
  const here = points.indexOf(document.activeElement);
  const way = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
  if (event.key === "Enter" || event.key === " ") toggle(points[here].dataset.case);
  else if (way) moveFocus(points, here, (here + way + points.length) % points.length);
  else return;
  event.preventDefault();
}

function moveFocus(points, from, to) {
  points[from].setAttribute("tabindex", "-1");
  points[to].setAttribute("tabindex", "0");
  points[to].focus();
}

function precisionLegend(cases) {
  const entry = (image, text) => html("span", {}, image, text);
  const present = families.filter((family) => cases.some((one) => one.family === family));
  const entries = present.map((family) => entry(familySign(family), family));
  const below = cases.find((one) => one.below);
  if (below)
    entries.push(entry(familySign(below.family, "hollow"), "at most this: less than the reference resolves"));
  return entries;
}

function drawUnplotted() {
  const broken = casesHere().filter(failed);
  const unmeasured = casesHere().filter((one) => !failed(one) && !plottable(one)).length;
  const parts = [];
  if (broken.length)
    parts.push(
      html("strong", {}, `Failed, not drawn: ${broken.length}`),
      html("ul", {}, ...broken.map(failure)),
    );
  if (unmeasured)
    parts.push(html("p", { class: "quiet" }, `Without an error or a wall time, not drawn: ${unmeasured}`));
  byId("unplotted").replaceChildren(...parts);
}

function failure(one) {
  const button = html(
    "button",
    { type: "button", click: () => toggle(one.id) },
    familySign(one.family),
    " ",
    one.label,
  );
  const tag = one.limited ? [html("span", { class: "tag" }, "limited"), " "] : [];
  return html("li", {}, button, " ", ...tag, one.status);
}

// The table of cases.

function tableColumns() {
  const given = page.columns.find((column) => column.key === "label") ?? { label: "case", unit: "" };
  const sentence = page.columns.find((column) => column.kind === "status") ?? { label: "status", unit: "" };
  const others = page.columns.filter((column) => column.key !== "label" && column.kind !== "status");
  return [
    { ...given, kind: "label", value: (one) => one.label },
    { ...sentence, kind: "status", value: (one) => one.status },
    ...others.map((column) => ({ ...column, value: (one) => own(one.values, column.key) })),
  ];
}

function drawTable() {
  const [head, body] = byId("table").children;
  head.replaceChildren(html("tr", {}, html("th", { "aria-label": "selected" }), ...columns.map(header)));
  body.replaceChildren(...casesHere().map(row));
  sortTable();
  filterTable();
}

function header(column) {
  const unit = column.unit ? [html("span", { class: "unit" }, `[${column.unit}]`)] : [];
  const button = html(
    "button",
    { type: "button", click: () => sortBy(column) },
    html("span", { class: "name" }, column.label),
    ...unit,
  );
  return html("th", { class: column.kind, scope: "col" }, button);
}

function row(one) {
  const box = html("input", {
    type: "checkbox",
    "aria-label": `select ${one.label}`,
    change: () => toggle(one.id),
  });
  const select = (event) => event.target !== box && toggle(one.id);
  const cells = columns.map((column) => cell(one, column));
  return html(
    "tr",
    { "data-case": one.id, click: select },
    html("td", {}, box, " ", html("span", { class: "number badge" })),
    ...cells,
  );
}

function cell(one, column) {
  const alarm = column.kind === "status" && failed(one) ? "alarm" : "";
  const image = column.kind === "label" ? [familySign(one.family)] : [];
  return html("td", { class: `${column.kind} ${alarm}` }, ...image, shown(column.value(one)));
}

function sortBy(column) {
  const again = state.order?.column === column;
  state.order = { column, descending: again && !state.order.descending };
  sortTable();
}

function sortTable() {
  const [head, body] = byId("table").children;
  const rows = new Map([...body.children].map((element) => [element.dataset.case, element]));
  body.append(
    ...casesHere()
      .sort(compare)
      .map((one) => rows.get(one.id)),
  );
  columns.forEach((column, k) => {
    const direction =
      state.order?.column === column ? (state.order.descending ? "descending" : "ascending") : "none";
    head.rows[0].cells[k + 1].setAttribute("aria-sort", direction);
  });
}

function compare(one, other) {
  const ends = failed(one) - failed(other);
  if (ends || !state.order) return ends;
  const [a, b] = [one, other].map(state.order.column.value);
  const missing = (a ?? null) === null || (b ?? null) === null;
  if (missing) return ((a ?? null) === null) - ((b ?? null) === null);
  const way = state.order.descending ? -1 : 1;
  const numbers = typeof a === "number" && typeof b === "number";
  return way * (numbers ? a - b : String(a).localeCompare(String(b), "en", { numeric: true }));
}

function filterTable() {
  const words = byId("filter").value.toLowerCase().split(/\s+/);
  const rows = [...byId("table").tBodies[0].rows];
  for (const element of rows) {
    const text = element.textContent.toLowerCase();
    element.hidden = !words.every((word) => text.includes(word));
  }
  byId("count").value = `${rows.filter((element) => !element.hidden).length} of ${rows.length} cases`;
}

// The selection.

function toggle(id) {
  const slot = state.slots.findIndex((taken) => taken?.one.id === id);
  if (slot >= 0) state.slots[slot] = null;
  else select(page.cases.find((one) => one.id === id));
  showSelection();
}

function select(one) {
  const free = state.slots.indexOf(null);
  const slot = free >= 0 ? free : state.slots.length;
  state.slots[slot] = { one, number: slot + 1, style: freeStyle(one) };
}

// The color of the family, then those no family has; then both again in dashes.
function freeStyle(one) {
  const colors = [familyColor(one.family)];
  for (let k = families.length; k < COLORS; k += 1) colors.push(`color-${k}`);
  const styles = DASHES.flatMap((dash) => colors.map((color) => `${color} ${dash}`));
  const used = selected().map(({ style }) => style);
  return styles.find((style) => !used.includes(style)) ?? styles[0];
}

function selected() {
  return state.slots.filter((taken) => taken);
}

function clearSelection() {
  state.slots = [];
  showSelection();
}

function showSelection() {
  const numbers = new Map(selected().map(({ one, number }) => [one.id, number]));
  for (const element of document.querySelectorAll("[data-case]")) {
    const number = numbers.get(element.dataset.case);
    element.classList.toggle("selected", number !== undefined);
    element.querySelector(".number").textContent = number ?? "";
    if (element.matches(".run")) element.setAttribute("aria-pressed", number !== undefined);
    else element.querySelector("input").checked = number !== undefined;
  }
  byId("clear").disabled = !selected().length;
  drawChosen();
  drawPanels();
}

function selectFirst() {
  const drawn = casesHere().filter((one) => one.curves);
  const best = drawn
    .filter(plottable)
    .sort((one, other) => height(one) - height(other) || one.cost - other.cost);
  state.slots = [];
  [...best, ...drawn].slice(0, 1).forEach(select);
}

function drawChosen() {
  const entries = selected().map(({ one, number, style }) => {
    const attributes = {
      type: "button",
      "aria-label": `${number} ${one.label}, remove`,
      click: () => toggle(one.id),
    };
    return html(
      "button",
      attributes,
      html("span", { class: "badge" }, number),
      lineSign(style, 26),
      one.label,
      failed(one) ? " (failed)" : "",
      " ×",
    );
  });
  byId("chosen").replaceChildren(...entries);
}

// Curves over time.

function drawPanels() {
  const panels = PANELS.map((panel) => ({ ...panel, names: curveNames(panel.key) })).filter(
    (panel) => panel.names.length,
  );
  const hint =
    "Select cases in the plot or in the table: their trajectories, errors, energies and drifts appear here.";
  const none = casesHere().some((one) => one.curves) ? hint : "No case of this model has curves.";
  byId("panels").replaceChildren(
    ...(panels.length && selected().length ? panels.map(panelElement) : [empty(none)]),
  );
}

function curveNames(key) {
  return distinct(casesHere().flatMap((one) => Object.keys(one.curves?.[key] ?? {})));
}

function panelElement({ key, title, names }) {
  if (!names.includes(state.names[key])) state.names[key] = names[0];
  const holder = html("div");
  const draw = () => holder.replaceChildren(curvePlot(key, state.names[key], title));
  const options = names.map((name) => html("option", { selected: name === state.names[key] && "" }, name));
  const change = (event) => {
    state.names[key] = names[event.target.selectedIndex];
    draw();
  };
  const choice =
    names.length > 1 ? [html("select", { "aria-label": `${title}: which`, change }, ...options)] : [];
  draw();
  return html("div", { class: "panel", "data-panel": key }, html("h3", {}, title, ...choice), holder);
}

function curvePlot(key, name, title) {
  const lines = selected()
    .map(({ one, style }) => ({ one, style, t: one.curves?.t, values: own(one.curves?.[key], name) }))
    .filter(({ values }) => values && known(values).length);
  if (!lines.length) return empty("None of the selected cases has this curve.");
  const box = plotBox(640, 270);
  const logarithmic = lines[0].values.log;
  const [begin, end] = extent(lines.map(({ t }) => t));
  const x = scale([begin, end > begin ? end : begin + 1], [box.left, box.right], false);
  const y = scale(padded(curveExtent(lines, logarithmic), logarithmic), [box.bottom, box.top], logarithmic);
  const clip = `clip-${key}`;
  const plot = canvas(
    box,
    `${title}, ${name}: use the arrow keys to read values`,
    svg(
      "clipPath",
      { id: clip },
      svg("rect", { x: box.left, y: box.top, width: box.right - box.left, height: box.bottom - box.top }),
    ),
    ...axes(box, x, y, { x: "t [s]", y: axisTitle(name, logarithmic) }),
    svg("g", { "clip-path": `url(#${clip})` }, ...lines.map((line) => curve(line, x, y))),
    ...(key === "error" ? resolutionLine(box, y) : []),
  );
  return readable(plot, box, lines, x, y);
}

function axisTitle(name, logarithmic) {
  return logarithmic && name === "imbalance" ? "size of the imbalance" : name;
}

function curveExtent(lines, logarithmic) {
  const [low, high] = extent(lines.map(({ values }) => values));
  return logarithmic ? [Math.max(low, high / 10 ** DECADES), high] : [low, high];
}

function curve({ one, style, t, values }, x, y) {
  let path = "";
  let last = null;
  values.forEach((value, k) => {
    if (value === null) return;
    const begins = k === 0 || values[k - 1] === null;
    last = [x.at(t[k]), y.at(value)];
    path += `${begins ? "M" : "L"}${last[0].toFixed(1)} ${last[1].toFixed(1)}`;
  });
  const cross = failed(one)
    ? [svg("path", { class: "curve", transform: `translate(${last})`, d: "M-4-4L4 4M-4 4L4-4" })]
    : [];
  return svg("g", { class: style }, svg("path", { class: `curve ${style}`, d: path }), ...cross);
}

function readable(plot, box, lines, x, y) {
  const reader = svg("g");
  const read = (t, at) => {
    const readings = lines.map((line) => reading(line, t));
    reader.replaceChildren(
      svg("line", { class: "cursor", x1: x.at(t), x2: x.at(t), y1: box.top, y2: box.bottom }),
      ...readings.map((one) => dot(one, x, y, box)),
    );
    showTip(
      at.x,
      at.y,
      html("strong", {}, `t = ${shown(t)} s`),
      html("table", {}, ...readings.map(readingRow)),
    );
  };
  const away = () => {
    reader.replaceChildren();
    hideTip();
  };
  let time = null;
  const clamped = (t) => Math.min(Math.max(t, x.back(box.left)), x.back(box.right));
  plot.append(reader);
  plot.setAttribute("tabindex", "0");
  plot.addEventListener("pointerleave", away);
  plot.addEventListener("blur", away);
  plot.addEventListener("pointermove", (event) => {
    const { left, width } = plot.getBoundingClientRect();
    time = clamped(x.back(((event.clientX - left) * box.width) / width));
    read(time, { x: event.clientX, y: event.clientY });
  });
  plot.addEventListener("keydown", (event) => {
    const way = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!way) return;
    event.preventDefault();
    const [first, last] = [x.back(box.left), x.back(box.right)];
    time = clamped((time ?? first) + (way * (last - first)) / 100);
    const { left, top, width } = plot.getBoundingClientRect();
    read(time, { x: left + (x.at(time) * width) / box.width, y: top + 30 });
  });
  return plot;
}

function reading({ one, style, t, values }, time) {
  let k = t.findIndex((x) => x >= time);
  if (k > 0 && time - t[k - 1] < t[k] - time) k -= 1;
  return { one, style, value: values[k] ?? null, t: t[k] };
}

function dot({ style, value, t }, x, y, box) {
  const outside = value === null || y.at(value) > box.bottom;
  return outside ? "" : svg("circle", { class: `dot ${style}`, cx: x.at(t), cy: y.at(value), r: 3.5 });
}

function readingRow({ one, style, value }) {
  return html(
    "tr",
    {},
    html("td", {}, lineSign(style, 18)),
    html("td", {}, one.label),
    html("td", {}, shown(value)),
  );
}

// The mechanism in motion.

function drawMotion() {
  pause();
  motion.frames = state.group.frames;
  const single = !motion.frames || motion.frames.t.length < 2;
  byId("player").hidden = single;
  if (!motion.frames) return byId("stage").replaceChildren(empty("No animation of this model."));
  byId("stage").replaceChildren(
    stage(motion.frames.bodies),
    html("div", { class: "legend" }, ...bodyLegend(motion.frames.bodies)),
  );
  byId("frame").max = motion.frames.t.length - 1;
  const duration = motion.frames.t.at(-1) - motion.frames.t[0];
  const away = (speed) => Math.abs(Math.log(duration / speed / 6));
  if (!single) byId("speed").selectedIndex = SPEEDS.indexOf([...SPEEDS].sort((a, b) => away(a) - away(b))[0]);
  return showTime(motion.frames.t[0]);
}

function stage(bodies) {
  const [width, margin] = [420, 26];
  const [left, right] = extent(bodies.map((body) => body.x));
  const [bottom, top] = extent(bodies.map((body) => body.y));
  const tall = Math.min(Math.max((width * (top - bottom)) / (right - left || 1), 180), 400);
  const zoom = Math.min(
    (width - 2 * margin) / (right - left || 1e-9),
    (tall - 2 * margin) / (top - bottom || 1e-9),
  );
  const place = (x, y) => [
    width / 2 + zoom * (x - (left + right) / 2),
    tall / 2 - zoom * (y - (bottom + top) / 2),
  ];
  const layered = [...bodies].sort((a, b) => LAYERS.indexOf(a.kind) - LAYERS.indexOf(b.kind));
  const beams = bodies.filter((body) => body.kind === "beam");
  const drawn = (body, more) =>
    svg(
      "path",
      {
        class: `body ${body.kind} ${beams.indexOf(body) % 2 > 0 ? "other" : ""} ${more}`,
        d: outline(body, 0, place),
      },
      svg("title", {}, body.name),
    );
  const moving = layered.map((body) => drawn(body, ""));
  const starts = layered.filter((body) => body.kind !== "ground").map((body) => drawn(body, "start"));
  motion.draw = (frame) =>
    moving.forEach((path, k) => path.setAttribute("d", outline(layered[k], frame, place)));
  const box = { width, height: tall + 16 };
  return canvas(
    box,
    "the mechanism",
    svg("rect", { class: "stage", ...box, rx: 6 }),
    ...starts,
    ...moving,
    ...scaleBar(zoom, box),
  );
}

function outline(body, frame, place) {
  const points = [];
  for (let k = frame * body.points; k < (frame + 1) * body.points; k += 1) {
    if (body.x[k] !== null && body.y[k] !== null)
      points.push(
        place(body.x[k], body.y[k])
          .map((c) => c.toFixed(1))
          .join(" "),
      );
  }
  if (body.kind === "ground") return points.map((p) => `M${p}l-8 13h16Z`).join("");
  if (points.length < 2) return points.map((p) => `M${p}L${p}`).join("");
  return `M${points.join("L")}${body.kind === "rigid" && points.length > 2 ? "Z" : ""}`;
}

function scaleBar(zoom, box) {
  const length = niceBelow(box.width / 4 / zoom);
  const [x, y] = [12, box.height - 10];
  return [
    svg("path", { class: "cursor", d: `M${x} ${y - 4}V${y}H${x + length * zoom}V${y - 4}`, fill: "none" }),
    svg("text", { x: x + 4, y: y - 6 }, `${shown(length)} m`),
  ];
}

function bodyLegend(bodies) {
  return LAYERS.map((kind) => bodies.filter((body) => body.kind === kind))
    .filter((same) => same.length)
    .map(bodyEntry);
}

function bodyEntry(same) {
  const { kind } = same[0];
  const shape = { ground: "M9-6l-7 11h14Z", point: "M9 0L9 0" }[kind] ?? "M3 0H15";
  const names =
    same
      .slice(0, 3)
      .map((body) => body.name)
      .join(", ") + (same.length > 3 ? `, … (${same.length})` : "");
  return html(
    "span",
    {},
    sign(18, svg("path", { class: `body ${kind}`, d: shape })),
    kind === "ground" ? kind : `${kind}: ${names}`,
  );
}

function showTime(time) {
  const { t } = motion.frames;
  const after = t.findIndex((x) => x > time);
  const frame = after < 0 ? t.length - 1 : Math.max(after - 1, 0);
  motion.time = time;
  motion.draw(frame);
  byId("frame").value = frame;
  byId("frame").setAttribute("aria-valuetext", `${shown(t[frame])} s`);
  byId("time").value = `t = ${shown(t[frame], 3)} s`;
}

function advance(now) {
  if (!motion.playing) return;
  const { t } = motion.frames;
  const elapsed = Math.min(now - motion.last, 100) / 1000;
  motion.last = now;
  const time = motion.time + elapsed * SPEEDS[byId("speed").selectedIndex];
  showTime(time > t.at(-1) ? t[0] : time);
  requestAnimationFrame(advance);
}

function play() {
  motion.playing = true;
  motion.last = performance.now();
  byId("play").textContent = "Pause";
  requestAnimationFrame(advance);
}

function pause() {
  motion.playing = false;
  byId("play").textContent = "Play";
}

// The page.

function drawHeader() {
  byId("title").textContent = page.title;
  byId("subtitle").textContent = page.subtitle;
  byId("notes").replaceChildren(...page.notes.map((note) => html("li", {}, note)));
  byId("made").textContent = Object.entries(page.made)
    .map((entry) => entry.join(" "))
    .join(", ");
  byId("group").replaceChildren(...page.groups.map((group) => html("option", {}, group.label || group.id)));
  byId("speed").replaceChildren(...SPEEDS.map((speed) => html("option", {}, `× ${speed}`)));
}

function drawReference() {
  const { reference } = state.group;
  if (!reference)
    return byId("reference").replaceChildren(
      html("span", { class: "alarm" }, "No reference: errors are not known."),
    );
  const verdict = reference.accepted ? [] : [html("span", { class: "alarm" }, "Reference not accepted. ")];
  const said = reference.sentence || (reference.methods ?? []).join(" and ");
  return byId("reference").replaceChildren(...verdict, said);
}

function showGroup(group) {
  state.group = group;
  drawReference();
  drawPrecision();
  drawUnplotted();
  drawTable();
  drawMotion();
  selectFirst();
  showSelection();
}

function listen() {
  byId("group").addEventListener("change", (event) => showGroup(page.groups[event.target.selectedIndex]));
  byId("filter").addEventListener("input", filterTable);
  byId("clear").addEventListener("click", clearSelection);
  byId("play").addEventListener("click", () => (motion.playing ? pause() : play()));
  byId("frame").addEventListener("input", (event) => showTime(motion.frames.t[event.target.value]));
}

function start() {
  drawHeader();
  listen();
  if (page.groups.length) showGroup(page.groups[0]);
  else document.querySelector("main").replaceChildren(empty("This study has no cases."));
}

start();
