// Curves over time.

const DECADES = 9;
const PANELS = [
  { key: "observed", title: "Observed" },
  { key: "error", title: "Error over time" },
  { key: "energy", title: "Energy [J]" },
  { key: "drift", title: "Drift of the joints" },
];

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
