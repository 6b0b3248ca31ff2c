// Charts, drawn by Apache ECharts as SVG, and their toolbar.

const ZOOM_STEP = 1.5; // zoom factor per use of a button or key
const PAN_SHARE = 10; // of the full range, per key [%]
const KEY_STEPS = 100; // steps of the cursor across a chart
const PRINTED_PAGE_WIDTH = 1020; // A4 landscape [px]
const PRINTED_TABLE_SCALE = 0.8; // ratio of the font sizes in media.css and tables.css
const PRINTED_CHART_WIDTH = 500; // on A4 landscape, two charts side by side [px]
const PRINTED_CURVE_WIDTH = 600; // one chart beside the motion [px]
const MIN_RELATIVE_RANGE = 1e-7; // of values; smaller ranges are rounding errors
const CSV_DIGITS = 6; // stored values have 16 bits
const MAX_FILE_NAME_PART = 60; // characters of the page title and of the chart name
const LIGHT_BACKGROUND = "#ffffff"; // as in page.css
const INVALID_XML_CHARACTERS = /[\u0000-\u0008\u000b\u000c\u000e-\u001f\ufffe\uffff]/g;
const PNG_SCALE = 2; // pixels per unit of a chart
const BLOB_LIFETIME = 60000; // [ms]
const MAX_STEPS = 6; // between ticks that are multiples of a given step
const MARGINS = { left: 4, right: 18, top: 30, bottom: 4 }; // around the axes and their labels [px]
const LEGEND_HEIGHT = 24; // [px]

/*
 * Create a chart; `drawChart` fills it once it is part of the document.
 *
 * `spec` has
 *   id, label, name  id of the element, label for screen readers, name of exported files
 *   x, y             axes: title, log, isCount (whole numbers), step (ticks are its multiples), names (of categories), isTime (ends at the data)
 *   hasCursor        true if the tooltip reads all series at a value of x, otherwise it describes points
 *   series           series of ECharts, with data in the units of the axes: x, y, and of points their case and time
 *   visualMap        optional color scale of ECharts
 *   legend           optional, names of the series in the legend
 *   height           function of the width
 *   read             function of a value of x, or of the entry of a point, that returns the content of the tooltip
 *   select           optional function of the case of a point that is clicked
 *   marks            optional function of the time of the motion that returns points [x, y]; y is null for a line
 *   rows             function that returns the lines of the CSV file, header first
 */
function createChart(spec, holder, ...before) {
  const old = state.charts.get(spec.id);
  const hasFocus = old?.plot.contains(document.activeElement);
  removeChart(spec.id);
  const plot = html("div", { class: "plot", role: "group", tabindex: "0", "aria-label": spec.label });
  const marks = html("div", { class: "time-marks", "aria-hidden": "true" });
  const element = html("div", { class: "chart", "data-chart": spec.id });
  const chart = { spec, plot, marks, element, current: -1, cursor: 0 };
  element.append(createToolbar(chart), html("div", { class: "layers" }, plot, marks));
  holder.replaceChildren(...before, element);
  plot.addEventListener("keydown", (event) => handleKey(chart, event));
  // ECharts keeps the page from scrolling, also if the wheel does not zoom.
  for (const wheel of ["wheel", "mousewheel"]) {
    plot.addEventListener(wheel, (event) => event.ctrlKey || event.stopPropagation(), { capture: true, passive: true });
  }
  state.charts.set(spec.id, chart);
  drawChart(chart);
  chart.observer = new ResizeObserver(() => element.clientWidth !== chart.width && drawChart(chart));
  chart.observer.observe(element);
  if (hasFocus) plot.focus({ preventScroll: true });
}

function removeChart(id) {
  state.charts.get(id)?.observer.disconnect();
  state.charts.get(id)?.instance.dispose();
  state.charts.delete(id);
}

function createToolbar(chart) {
  const { name, label, x } = chart.spec;
  const button = (text, title, click) => html("button", { type: "button", title, "aria-label": title, click }, text);
  const view = [
    button("+", "zoom in (+)", () => zoomBy(chart, 1 / ZOOM_STEP)),
    button("−", "zoom out (−)", () => zoomBy(chart, ZOOM_STEP)),
    button("Reset", "Reset: show all (0)", () => zoomTo(chart, () => [0, 100])),
  ];
  return html(
    "div",
    { class: "tools", role: "group", "aria-label": `${label}: view and files` },
    ...(x.names ? [] : view),
    button("SVG", `save ${name} as SVG`, () => saveSvg(chart)),
    button("PNG", `save ${name} as PNG`, () => savePng(chart)),
    button("CSV", `save ${name} as CSV`, () => saveCsv(chart)),
  );
}

function drawChart(chart, width = chart.element.clientWidth) {
  const { spec, plot } = chart;
  chart.width = width;
  const size = { width: width || 640, height: spec.height(width || 640) };
  plot.style.height = `${size.height}px`;
  chart.instance ??= createInstance(chart, size);
  chart.instance.resize(size);
  chart.instance.setOption(describeChart(chart), true);
  markTime(chart, motion.time);
}

function createInstance(chart, size) {
  const { spec, plot } = chart;
  const instance = echarts.init(plot, null, { renderer: "svg", ...size });
  instance.on("click", ({ value }) => spec.select?.(value[2]));
  instance.on("datazoom", () => keepView(chart));
  instance.on("mouseover", ({ value }) => value && moveMotion(value[3]));
  instance.on("updateAxisPointer", ({ axesInfo: [info] }) => {
    if (info && spec.x.isTime) moveMotion(toValue(spec.x, info.value));
  });
  instance.on("legendselectchanged", ({ selected }) => {
    state.legends[spec.id] = selected;
  });
  return instance;
}

// Logarithms are drawn on linear axes, which are zoomed evenly.
function fromValue({ log }, value) {
  return log && value !== null ? Math.log10(value) : value;
}

function toValue({ log }, position) {
  return log ? 10 ** position : position;
}

function listValues({ spec }, k) {
  const finite = (values) => values.filter(Number.isFinite);
  return finite(spec.series.flatMap(({ data }) => data.map((entry) => entry[k])));
}

function describeChart(chart, isExported = false) {
  const { spec } = chart;
  const [ink, muted, line, grid, background] = ["ink", "muted", "line", "grid", "background"].map(themeColor);
  // Texts of saved pictures are attributes between double quotation marks.
  const fontFamily = getComputedStyle(document.body).fontFamily.replaceAll('"', "'");
  const textStyle = { color: ink, fontFamily, fontSize: 12 };
  const describeAxis = (axis, k) => {
    const extent = findExtent([listValues(chart, k)]);
    const order = axis.log ? 0 : engineeringOrder(extent);
    const format = (value) =>
      axis.log ? formatPower(10 ** value) : formatValue(Number((value / 10 ** order).toPrecision(12)));
    const middle = { nameLocation: "middle", nameGap: 26 };
    const corner = { nameLocation: "end", nameGap: 12, nameTextStyle: { ...textStyle, align: "left", padding: [0, 0, 0, -34] } };
    return {
      type: axis.names ? "category" : "value",
      data: axis.names,
      name: scaleTitle(axis.title, order),
      nameTextStyle: textStyle,
      ...(k ? corner : middle),
      ...(axis.names ? {} : limitAxis(axis, extent)),
      splitNumber: k ? 4 : 6,
      axisLine: { show: true, onZero: false, lineStyle: { color: line } },
      axisTick: { show: false },
      axisLabel: { color: ink, hideOverlap: true, ...(axis.names ? {} : { formatter: format }) },
      axisPointer: { label: { show: false }, lineStyle: { color: muted } },
      splitLine: { show: !axis.names, lineStyle: { color: grid } },
    };
  };
  const hasLegend = isExported ? spec.series.length > 1 : Boolean(spec.legend);
  const margins = { ...MARGINS, bottom: MARGINS.bottom + (hasLegend ? LEGEND_HEIGHT : 0) };
  const convert = (entry) => [fromValue(spec.x, entry[0]), fromValue(spec.y, entry[1]), ...entry.slice(2)];
  return {
    animation: false,
    backgroundColor: isExported ? background : "transparent",
    textStyle,
    grid: { ...margins, outerBoundsMode: "same", outerBoundsContain: "all" },
    legend: {
      show: hasLegend,
      bottom: 0,
      textStyle,
      itemHeight: 10,
      data: isExported ? spec.series.map(({ name }) => name) : spec.legend,
      selected: state.legends[spec.id],
    },
    tooltip: {
      trigger: spec.hasCursor ? "axis" : "item",
      confine: true,
      backgroundColor: background,
      borderColor: line,
      textStyle: { ...textStyle, fontSize: 13 },
      formatter: (items) => readChart(spec, items),
    },
    xAxis: describeAxis(spec.x, 0),
    yAxis: describeAxis(spec.y, 1),
    dataZoom: spec.x.names ? [] : [..."xy"].map((axis) => ({
      type: "inside",
      [`${axis}AxisIndex`]: 0,
      filterMode: "none",
      zoomOnMouseWheel: "ctrl",
      preventDefaultMouseMove: false,
      ...describeView(spec, axis),
    })),
    visualMap: spec.visualMap?.map((scale) => ({ type: "continuous", ...scale, textStyle })),
    series: spec.series.map((series) => ({ ...series, data: series.data.map(convert) })),
  };
}

// Constants but for rounding errors are drawn as constants; other axes have round limits.
function limitAxis(axis, [low, high]) {
  const [first, last] = [low, high].map((value) => fromValue(axis, value));
  const size = Math.max(Math.abs(first), Math.abs(last));
  const margin = axis.log ? 1 : 0.1 * size || 1;
  if (!(last - first > MIN_RELATIVE_RANGE * size)) return { min: first - margin, max: last + margin };
  if (axis.isTime) return { min: first, max: last };
  if (axis.step) {
    const interval = axis.step * 2 ** Math.max(Math.ceil(Math.log2((last - first) / axis.step / MAX_STEPS)), 0);
    return { interval, min: interval * Math.floor(first / interval), max: interval * Math.ceil(last / interval) };
  }
  return { scale: true, minInterval: axis.isCount || (axis.log && last - first > 2) ? 1 : 0 };
}

// Content of the tooltip, which screen readers announce, too.
function readChart(spec, items) {
  const content = spec.read(spec.hasCursor ? toValue(spec.x, items[0].axisValue) : items.value);
  const element = html("div", { class: "reading" }, ...content);
  byId("reading").textContent = element.textContent;
  return element;
}

// Visible range of an axis: as the user left it, or the values that the page defines.
function describeView(spec, axis) {
  const view = state.views[spec.id]?.[axis];
  if (!Array.isArray(view)) return view;
  const [startValue, endValue] = view.map((value) => fromValue(spec[axis], value));
  return { startValue, endValue };
}

function visibleShares({ instance }) {
  return instance.getOption().dataZoom.map(({ start, end }) => [start, end]);
}

function zoomTo(chart, change) {
  const batch = visibleShares(chart).map((share, dataZoomIndex) => {
    const [start, end] = change(share, dataZoomIndex);
    return { dataZoomIndex, start, end };
  });
  if (batch.length) chart.instance.dispatchAction({ type: "dataZoom", batch });
}

function zoomBy(chart, factor) {
  zoomTo(chart, ([start, end]) => [start, end].map((x) => (start + end + factor * (2 * x - start - end)) / 2));
}

// All charts over time show the same times.
function keepView(chart) {
  const { id, x } = chart.spec;
  const [time, values] = visibleShares(chart).map(([start, end]) => ({ start, end }));
  state.views[id] = { x: time, y: values };
  markTime(chart, motion.time);
  if (!x.isTime) return;
  for (const other of state.charts.values()) {
    if (other === chart || !other.spec.x.isTime) continue;
    state.views[other.spec.id] = { ...state.views[other.spec.id], x: time };
    other.instance.dispatchAction({ type: "dataZoom", dataZoomIndex: 0, ...time }, { silent: true });
    markTime(other, motion.time);
  }
}

// Marks at the time of the motion lie above the chart, which is not drawn again.
function markTime({ instance, spec, marks }, time) {
  const points = (motion.frames && spec.marks?.(time)) || [];
  const elements = points.flatMap(([x, y]) => {
    const finder = y === null ? { xAxisIndex: 0 } : { xAxisIndex: 0, yAxisIndex: 0 };
    const value = y === null ? fromValue(spec.x, x) : [fromValue(spec.x, x), fromValue(spec.y, y)];
    const [left, top] = [instance.convertToPixel(finder, value)].flat();
    const inside = [left, top ?? (MARGINS.top + instance.getHeight()) / 2];
    if (!instance.containPixel("grid", inside)) return [];
    const place = y === null ? `left: ${left}px` : `left: ${left}px; top: ${top}px`;
    return [html("span", { class: y === null ? "time-line" : "time-dot", style: place })];
  });
  marks.replaceChildren(...elements);
}

// Show the mechanism at the time of the cursor, unless it is playing.
function moveMotion(time) {
  if (!motion.frames || motion.isPlaying || time === undefined) return;
  showTime(clamp(time, motion.frames.t[0], motion.frames.t.at(-1)));
}

// Keys zoom and pan; arrow keys move the cursor, or visit the points of the cases, which Enter selects.
function handleKey(chart, event) {
  if (event.altKey || event.ctrlKey || event.metaKey) return;
  const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
  const isAcross = event.key === "ArrowUp" || event.key === "ArrowDown";
  const { select, hasCursor } = chart.spec;
  if (event.key === "+" || event.key === "=") zoomBy(chart, 1 / ZOOM_STEP);
  else if (event.key === "-") zoomBy(chart, ZOOM_STEP);
  else if (event.key === "0") zoomTo(chart, () => [0, 100]);
  else if (step && event.shiftKey) panBy(chart, step * PAN_SHARE, Number(isAcross));
  else if (step && hasCursor) moveCursor(chart, step);
  else if (step) visitPoint(chart, step);
  else if (event.key === "Enter" || event.key === " ") chart.current >= 0 && select?.(listPoints(chart)[chart.current].id);
  else return;
  event.preventDefault();
}

function panBy(chart, amount, axis) {
  zoomTo(chart, ([start, end], k) => {
    const shift = k === axis ? clamp(amount, -start, 100 - end) : 0;
    return [start + shift, end + shift];
  });
}

// Points in the order of their times, or from left to right.
function listPoints({ spec }) {
  const points = spec.series.flatMap(({ data, silent }, seriesIndex) =>
    silent ? [] : data.map(([x, , id, time], dataIndex) => ({ order: time ?? x, id, time, seriesIndex, dataIndex })),
  );
  return points.sort((a, b) => a.order - b.order);
}

function visitPoint(chart, step) {
  const points = listPoints(chart);
  chart.current = (chart.current + step + points.length + (chart.current < 0 && step < 0)) % points.length;
  const { time, seriesIndex, dataIndex } = points[chart.current];
  moveMotion(time);
  chart.instance.dispatchAction({ type: "showTip", seriesIndex, dataIndex });
}

function moveCursor(chart, step) {
  const { instance, width } = chart;
  const y = instance.getHeight() / 2;
  const isInside = (x) => instance.containPixel("grid", [x, y]);
  const positions = Array.from({ length: KEY_STEPS + 1 }, (_, k) => (k * width) / KEY_STEPS).filter(isInside);
  chart.cursor = clamp(chart.cursor + step, 0, positions.length - 1);
  instance.dispatchAction({ type: "showTip", x: positions[chart.cursor], y });
}

// Charts have the width of the paper and light colors while they are printed, and wide tables are reduced to it.
function preparePrint() {
  document.documentElement.classList.add("light");
  showSelection();
  byId("remarks").open = true;
  showRows(Infinity);
  for (const table of document.querySelectorAll("table")) {
    const width = table.closest("#cases, .wide") ? PRINTED_PAGE_WIDTH : PRINTED_CHART_WIDTH;
    const scale = window.matchMedia("print").matches ? 1 : PRINTED_TABLE_SCALE;
    table.style.zoom = Math.min(width / (scale * table.offsetWidth), 1);
  }
  state.charts.forEach((chart) => {
    const isBesideMotion = !byId("motion").hidden && Boolean(chart.element.closest("#top, .without-curves #charts"));
    drawChart(chart, isBesideMotion ? PRINTED_CURVE_WIDTH : PRINTED_CHART_WIDTH);
  });
}

function restoreScreen() {
  document.documentElement.classList.remove("light");
  document.querySelectorAll("table").forEach((table) => table.style.removeProperty("zoom"));
  showSelection();
}

// SVG text in light colors with a legend.
function exportPicture({ spec: { id } }) {
  const isDark = themeColor("background") !== LIGHT_BACKGROUND;
  document.documentElement.classList.add("light");
  if (isDark) showSelection();
  const chart = state.charts.get(id);
  const size = { width: chart.instance.getWidth(), height: chart.instance.getHeight() };
  const picture = echarts.init(null, null, { renderer: "svg", ssr: true, ...size });
  picture.setOption(describeChart(chart, true));
  document.documentElement.classList.remove("light");
  if (isDark) showSelection();
  const text = picture.renderToSVGString().replace(INVALID_XML_CHARACTERS, "\ufffd");
  picture.dispose();
  return { ...size, blob: new Blob([text], { type: "image/svg+xml" }) };
}

function saveSvg(chart) {
  saveFile(exportPicture(chart).blob, chart, "svg");
}

async function savePng(chart) {
  const { blob, width, height } = exportPicture(chart);
  const url = URL.createObjectURL(blob);
  const image = Object.assign(new Image(), { src: url });
  await image.decode();
  const size = { width: PNG_SCALE * width, height: PNG_SCALE * height };
  const canvas = Object.assign(document.createElement("canvas"), size);
  canvas.getContext("2d").drawImage(image, 0, 0, size.width, size.height);
  URL.revokeObjectURL(url);
  canvas.toBlob((png) => saveFile(png, chart, "png"));
}

function saveCsv(chart) {
  const lines = chart.spec.rows().map((cells) => `${cells.map(formatCsvCell).join(",")}\r\n`);
  saveFile(new Blob(lines, { type: "text/csv" }), chart, "csv");
}

function formatCsvCell(value) {
  if (value === null || value === undefined) return "";
  const text = typeof value === "number" ? String(Number(value.toPrecision(CSV_DIGITS))) : String(value);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

function saveFile(blob, { spec }, suffix) {
  const url = URL.createObjectURL(blob);
  const parts = [page.title, spec.name].map((text) => text.slice(0, MAX_FILE_NAME_PART));
  const name = parts.join("_").replace(/[^\p{L}\p{N}.=-]+/gu, "_");
  html("a", { href: url, download: `${name}.${suffix}` }).click();
  setTimeout(() => URL.revokeObjectURL(url), BLOB_LIFETIME);
}
