// A chart: a plot with two axes that can be zoomed, and its toolbar.

// Limits of the visible range relative to the full range. Stored values have 65534 steps.
const MIN_VIEW_SHARE = 1e-4;
const MAX_VIEW_SHARE = 4;
const ZOOM_STEP = 1.5; // zoom factor per use of a button or key
const MIN_CHART_WIDTH = 240; // [px]
const MIN_LEFT_MARGIN = 40; // [px]
const DIGIT_WIDTH = 6.8; // of tick labels [px]

/*
 * Create a chart; `drawChart` fills it once it is part of the document.
 *
 * `spec` has
 *   id, label, name      id of the element, label for screen readers, name of exported files
 *   x, y                 axes: title, full range, log (true for a logarithmic axis), optional ticks and, for y,
 *                        stepBase (larger steps between ticks are this one times a power of two); isCount (true
 *                        for whole numbers)
 *   view                 visible ranges x and y; null shows the full range
 *   height               function of the width
 *   drawBackground, drawClipped, drawForeground
 *                        functions of (box, x, y) that return SVG elements: behind the axes, clipped to
 *                        the plot area, and in front of the axes; x and y are scales
 *   legend               function that returns the entries {icon, text} of exported pictures
 *   rows                 function that returns the lines of the CSV file, header first
 *   afterDraw, afterViewChange    optional callbacks
 *   showTime             optional function of (chart, time) that returns the marks of the time of the motion
 */
function createChart(spec) {
  const plot = svg("svg", { class: "plot", role: "group", tabindex: "0", "aria-label": spec.label });
  // Cursor and zoom box: the browser composites this layer without drawing the curves again.
  const overlay = svg("svg", { class: "overlay", "aria-hidden": "true" });
  const timeLayer = svg("svg", { class: "overlay", "aria-hidden": "true" });
  const element = html("div", { class: "chart", "data-chart": spec.id });
  const chart = { spec, plot, overlay, timeLayer, element };
  chart.resetButton = createToolButton("Reset", "Reset: show all (0)", () => resetView(chart));
  chart.element.append(createToolbar(chart), html("div", { class: "plot-layers" }, plot, timeLayer, overlay));
  listenToGestures(chart);
  const redrawIfResized = () => chart.element.clientWidth !== chart.width && drawChart(chart);
  new ResizeObserver(redrawIfResized).observe(chart.element);
  return chart;
}

function createToolButton(text, label, click) {
  return html("button", { type: "button", title: label, "aria-label": label, click }, text);
}

function createToolbar(chart) {
  const { name, label } = chart.spec;
  const zoom = (factor) => () => zoomBy(chart, factor, plotCenter(chart));
  return html(
    "div",
    { class: "tools", role: "group", "aria-label": `${label}: view and files` },
    createToolButton("+", "zoom in (+)", zoom(1 / ZOOM_STEP)),
    createToolButton("−", "zoom out (−)", zoom(ZOOM_STEP)),
    chart.resetButton,
    createToolButton("SVG", `save ${name} as SVG`, () => saveSvg(chart)),
    createToolButton("PNG", `save ${name} as PNG`, () => savePng(chart)),
    createToolButton("CSV", `save ${name} as CSV`, () => saveCsv(chart)),
  );
}

// `width` [px] defaults to that of the element; paper has its own, see print.js.
function drawChart(chart, width = chart.element.clientWidth) {
  const { spec, plot, overlay, timeLayer } = chart;
  // Drawing replaces all elements, so the focus is restored to the corresponding point.
  const focusedCase = plot.contains(document.activeElement) && document.activeElement.dataset.case;
  chart.width = width;
  const box = { width: Math.max(chart.width || 640, MIN_CHART_WIDTH), top: 24 };
  Object.assign(box, { right: box.width - 14, height: spec.height(box.width) });
  box.bottom = box.height - 34;
  const create = (axis, positions) => {
    const { range, log, ticks, stepBase, isCount } = spec[axis];
    return createScale(visibleRange(chart, axis), positions, log, ticks, stepBase, engineeringOrder(range), isCount);
  };
  const y = create("y", [box.bottom, box.top]);
  const labelLength = Math.max(...y.ticks.map(({ text }) => text.length), 0);
  box.left = Math.max(14 + DIGIT_WIDTH * labelLength, MIN_LEFT_MARGIN);
  const x = create("x", [box.left, box.right]);
  Object.assign(chart, { box, x, y });
  const clipId = `clip-${spec.id}`;
  for (const layer of [plot, overlay, timeLayer]) layer.setAttribute("viewBox", `0 0 ${box.width} ${box.height}`);
  overlay.replaceChildren();
  plot.replaceChildren(
    svg("clipPath", { id: clipId }, createPlotArea(box)),
    ...spec.drawBackground(box, x, y),
    ...createAxes(box, x, y, { x: spec.x.title, y: spec.y.title }),
    svg("g", { "clip-path": `url(#${clipId})` }, ...spec.drawClipped(box, x, y)),
    ...spec.drawForeground(box, x, y),
  );
  chart.resetButton.disabled = !isZoomed(chart);
  spec.afterDraw?.(chart);
  markTime(chart, motion.time);
  if (focusedCase) {
    [...plot.querySelectorAll("[data-case]")].find((point) => point.dataset.case === focusedCase)?.focus();
  }
}

function markTime(chart, time) {
  chart.timeLayer.replaceChildren(...(motion.frames ? (chart.spec.showTime?.(chart, time) ?? []) : []));
}

function visibleRange({ spec }, axis) {
  return spec.view[axis] ?? spec[axis].range;
}

function isZoomed({ spec }) {
  return Boolean(spec.view.x || spec.view.y);
}

function plotCenter({ box }) {
  return [(box.left + box.right) / 2, (box.top + box.bottom) / 2];
}

// Zoom about a position in the plot, by default along both axes.
function zoomBy(chart, factor, center, axes = "xy") {
  for (const axis of axes) {
    const { start, end } = chart[axis];
    const fixed = center["xy".indexOf(axis)];
    setVisibleRange(
      chart,
      axis,
      [start, end].map((position) => fixed + factor * (position - fixed)),
    );
  }
  updateView(chart);
}

function panBy(chart, [dx, dy]) {
  const { x, y } = chart;
  setVisibleRange(chart, "x", [x.start - dx, x.end - dx]);
  setVisibleRange(chart, "y", [y.start - dy, y.end - dy]);
  updateView(chart);
}

// Zoom to the box between two opposite corners.
function zoomToBox(chart, corner, opposite) {
  [..."xy"].forEach((axis, k) => {
    const direction = Math.sign(chart[axis].end - chart[axis].start);
    const positions = [corner[k], opposite[k]].sort((a, b) => (a - b) * direction);
    setVisibleRange(chart, axis, positions);
  });
  updateView(chart);
}

function resetView(chart) {
  Object.assign(chart.spec.view, { x: null, y: null });
  updateView(chart);
}

function updateView(chart) {
  hideTooltip();
  drawChart(chart);
  chart.spec.afterViewChange?.();
}

// Ranges beyond the zoom limits and ranges outside the full range are ignored.
function setVisibleRange(chart, axis, positions) {
  const { range, log } = chart.spec[axis];
  const view = positions.map(chart[axis].toValue);
  const forward = log ? Math.log10 : (value) => value;
  const [low, high, first, last] = [...view, ...range].map(forward);
  const share = (high - low) / (last - first);
  const overlaps = low < last && high > first;
  if (share >= MIN_VIEW_SHARE && share <= MAX_VIEW_SHARE && overlaps) chart.spec.view[axis] = view;
}
