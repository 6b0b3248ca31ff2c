// A chart: what is drawn between two axes that can be zoomed, and the buttons beside it.

// Of what there is to see: stored numbers have 65534 steps, and far away is nothing.
const CLOSEST = 1e-4;
const FARTHEST = 4;
const STEP = 1.5;

/*
 * `spec` has "id", "name" (of its files), "label"; axes "x" and "y" with "title", "range" and "log";
 * "view", ranges x and y that are seen instead where they are not null; "height" by width; "under",
 * "inside" (cut off by the axes) and "over", functions of (box, x, y) that give what is drawn;
 * "legend", signs and words for files; "rows", the lines of its CSV file.
 * Optional: "drawn", "changed" (the view), "hidden" (the buttons).
 */
function chart(spec) {
  const plot = svg("svg", { class: "plot", role: "group", tabindex: "0", "aria-label": spec.label });
  const made = { spec, plot, element: html("div", { class: "chart", "data-chart": spec.id }) };
  made.reset = tool("Reset", "show all (0)", () => resetView(made));
  made.element.append(tools(made), plot);
  listenTo(made);
  new ResizeObserver(() => made.element.clientWidth !== made.width && drawChart(made)).observe(made.element);
  return made;
}

function tool(text, label, click) {
  return html("button", { type: "button", title: label, "aria-label": label, click }, text);
}

function tools(made) {
  const { name } = made.spec;
  const zoom = (factor) => () => zoomBy(made, factor, middleOf(made));
  return html(
    "div",
    { class: "tools", role: "group", "aria-label": `${made.spec.label}: view and files` },
    tool("+", "zoom in (+)", zoom(1 / STEP)),
    tool("−", "zoom out (-)", zoom(STEP)),
    made.reset,
    tool("SVG", `save ${name} as SVG`, () => saveSvg(made)),
    tool("PNG", `save ${name} as PNG`, () => savePng(made)),
    tool("CSV", `save ${name} as CSV`, () => saveCsv(made)),
  );
}

// Elements are replaced by it: the one that has the focus gets it again.
function drawChart(made) {
  const { spec, plot, element } = made;
  const focused = plot.contains(document.activeElement) && document.activeElement.dataset.case;
  made.width = element.clientWidth;
  const box = { width: Math.max(made.width || 640, 240), top: 24 };
  Object.assign(box, { right: box.width - 14, height: spec.height(box.width) });
  box.bottom = box.height - 34;
  const y = scale(seen(made, "y"), [box.bottom, box.top], spec.y.log);
  box.left = Math.max(14 + 6.8 * Math.max(...y.ticks.map(({ text }) => text.length), 0), 40);
  const x = scale(seen(made, "x"), [box.left, box.right], spec.x.log);
  Object.assign(made, { box, x, y });
  const clip = `clip-${spec.id}`;
  plot.setAttribute("viewBox", `0 0 ${box.width} ${box.height}`);
  plot.replaceChildren(
    svg("clipPath", { id: clip }, frame(box)),
    ...spec.under(box, x, y),
    ...axes(box, x, y, { x: spec.x.title, y: spec.y.title }),
    svg("g", { "clip-path": `url(#${clip})` }, ...spec.inside(box, x, y)),
    ...spec.over(box, x, y),
  );
  made.reset.disabled = !zoomed(made);
  spec.drawn?.(made);
  if (focused) [...plot.querySelectorAll("[data-case]")].find((one) => one.dataset.case === focused)?.focus();
}

function seen({ spec }, way) {
  return spec.view[way] ?? spec[way].range;
}

function zoomed({ spec }) {
  return Boolean(spec.view.x || spec.view.y);
}

function middleOf({ box }) {
  return [(box.left + box.right) / 2, (box.top + box.bottom) / 2];
}

// Views. Ranges are those of two places on the axes.

function zoomBy(made, factor, at, ways = "xy") {
  [...ways].forEach((way) => {
    const [axis, place] = [made[way], at["xy".indexOf(way)]];
    look(
      made,
      way,
      [axis.from, axis.to].map((end) => place + factor * (end - place)),
    );
  });
  showView(made);
}

function panBy(made, by) {
  [..."xy"].forEach((way, k) => {
    const axis = made[way];
    look(made, way, [axis.from - by[k], axis.to - by[k]]);
  });
  showView(made);
}

function zoomTo(made, one, other) {
  [..."xy"].forEach((way, k) => {
    const ends = [one[k], other[k]].sort((a, b) => (a - b) * Math.sign(made[way].to - made[way].from));
    look(made, way, ends);
  });
  showView(made);
}

function resetView(made) {
  Object.assign(made.spec.view, { x: null, y: null });
  showView(made);
}

function showView(made) {
  hideTip();
  drawChart(made);
  made.spec.changed?.();
}

// A view that shows nothing, or is too near or too far, is none.
function look(made, way, ends) {
  const { range, log } = made.spec[way];
  const view = ends.map(made[way].back);
  const forth = log ? Math.log10 : (value) => value;
  const [low, high, first, last] = [...view, ...range].map(forth);
  const share = (high - low) / (last - first);
  if (share >= CLOSEST && share <= FARTHEST && low < last && high > first) made.spec.view[way] = view;
}
