// Charts, drawn by Apache ECharts as SVG.

const KEY_STEPS = 100; // points of a curve that the arrow keys visit
const PRINTED_PAGE_WIDTH = 1020; // A4 landscape [px]
const PRINTED_TABLE_SCALE = 0.8; // ratio of the font sizes in media.css and tables.css
const PRINTED_CHART_WIDTH = 500; // on A4 landscape, two charts side by side [px]
const PRINTED_CURVE_WIDTH = 600; // one chart beside the motion [px]
const MIN_RELATIVE_RANGE = 1e-7; // of values; smaller ranges are rounding errors
const MAX_STEPS = 6; // between ticks that are multiples of a given step
const MARGINS = { left: 4, right: 18, top: 30, bottom: 4 }; // around the axes and their labels [px]
const LEGEND_HEIGHT = 24; // of one line, with margins [px]
const LEGEND_LINE = 20; // without margins [px]

/*
 * Draw a chart, which keeps its visible range if it has been drawn before.
 *
 * `describe` is a function that returns
 *   label            label for screen readers
 *   x, y             axes: title, log, isCount (whole numbers), step (ticks are its multiples), isTime (ends at the data)
 *   hasCursor        true if the tooltip reads all series at a value of x, otherwise it describes points
 *   series           series of ECharts, with data in the units of the axes: x, y, and of points their case and time
 *   legend           optional, names of the series in the legend
 *   height           function of the width
 *   read             function of entries of ECharts under the pointer that returns the content of the tooltip
 *   select           optional function of the case of a point that is clicked
 *   marks            optional function of the time of the motion that returns points [x, y]; y is null for a line
 */
function createChart(id, describe, holder, ...before) {
  const chart = state.charts.get(id) ?? createFrame(id);
  const hasFocus = chart.plot.contains(document.activeElement);
  chart.describe = describe;
  holder.replaceChildren(...before, chart.element);
  drawChart(chart);
  if (hasFocus) chart.plot.focus({ preventScroll: true });
}

function createFrame(id) {
  const plot = html("div", { class: "plot", role: "group", tabindex: "0", keydown: (event) => handleKey(chart, event) });
  const marks = html("div", { class: "time-marks", "aria-hidden": "true" });
  const click = () => resetView(chart, 0, 1);
  const tools = html("div", { class: "tools" }, html("button", { type: "button", title: "show all", click }, "Reset"));
  const element = html("div", { class: "chart", "data-chart": id }, tools, html("div", { class: "layers" }, plot, marks));
  const instance = echarts.init(plot, null, { renderer: "svg", width: 640, height: 400 });
  const chart = { id, plot, marks, element, instance, visited: -1 };
  // ECharts keeps the page from scrolling, also if the wheel does not zoom.
  for (const wheel of ["wheel", "mousewheel"]) {
    plot.addEventListener(wheel, (event) => event.ctrlKey || event.stopPropagation(), { capture: true, passive: true });
  }
  instance.on("click", ({ value }) => chart.spec.select?.(value[2]));
  instance.on("datazoom", () => shareTimes(chart));
  instance.on("mouseover", ({ value }) => value && moveMotion(value[3]));
  instance.on("updateAxisPointer", ({ axesInfo: [info] }) => {
    if (info && chart.spec.x.isTime) moveMotion(toValue(chart.spec.x, info.value));
  });
  chart.observer = new ResizeObserver(() => element.clientWidth !== chart.width && drawChart(chart));
  chart.observer.observe(element);
  state.charts.set(id, chart);
  return chart;
}

function removeChart(id) {
  state.charts.get(id)?.observer.disconnect();
  state.charts.get(id)?.instance.dispose();
  state.charts.get(id)?.element.remove();
  state.charts.delete(id);
}

function drawChart(chart, width = chart.element.clientWidth) {
  const { instance, plot, spec: before } = chart;
  const spec = chart.describe();
  const size = { width: width || 640, height: spec.height(width || 640) };
  Object.assign(chart, { spec, width });
  plot.setAttribute("aria-label", spec.label);
  // A tooltip of a point that is no longer drawn would be an error.
  instance.dispatchAction({ type: "hideTip" });
  instance.resize(size);
  const dataZoom = before ? [] : listZooms(chart);
  instance.setOption({ ...describeChart(spec), dataZoom }, { replaceMerge: ["series"] });
  // Further lines of the legend extend the chart.
  const legend = instance.getViewOfComponentModel(instance.getModel().getComponent("legend")).group.getBoundingRect();
  const further = Math.max(legend.height - LEGEND_LINE, 0);
  instance.setOption({ grid: { bottom: MARGINS.bottom + (spec.legend ? LEGEND_HEIGHT + further : 0) } });
  instance.resize({ ...size, height: size.height + further });
  plot.style.height = `${size.height + further}px`;
  markTime(chart, motion.time);
}

// Logarithms are drawn on linear axes, which are zoomed evenly.
function fromValue({ log }, value) {
  return log && value !== null ? Math.log10(value) : value;
}

function toValue({ log }, position) {
  return log ? 10 ** position : position;
}

function describeChart(spec) {
  const [ink, muted, line, grid, background] = ["ink", "muted", "line", "grid", "background"].map(themeColor);
  const textStyle = { color: ink, fontFamily: getComputedStyle(document.body).fontFamily, fontSize: 12 };
  const describeAxis = (axis, k) => {
    const values = spec.series.flatMap(({ data }) => data.map((entry) => entry[k])).filter(Number.isFinite);
    const extent = findExtent([values]);
    axis.order = axis.log ? 0 : engineeringOrder(extent);
    const format = (value) => (axis.log ? formatPower(10 ** value) : formatValue(Number((value / 10 ** axis.order).toPrecision(12))));
    const middle = { nameLocation: "middle", nameGap: 26 };
    const corner = { nameLocation: "end", nameGap: 12, nameTextStyle: { ...textStyle, align: "left", padding: [0, 0, 0, -34] } };
    return {
      type: "value",
      name: scaleTitle(axis.title, axis.order),
      nameTextStyle: textStyle,
      ...(k ? corner : middle),
      ...limitAxis(axis, extent),
      splitNumber: k ? 4 : 6,
      axisLine: { show: true, onZero: false, lineStyle: { color: line } },
      axisTick: { show: false },
      axisLabel: { color: ink, hideOverlap: true, formatter: format },
      axisPointer: { label: { show: false }, lineStyle: { color: muted } },
      splitLine: { lineStyle: { color: grid } },
    };
  };
  const convert = (entry) => [fromValue(spec.x, entry[0]), fromValue(spec.y, entry[1]), ...entry.slice(2)];
  return {
    animation: false,
    backgroundColor: "transparent",
    textStyle,
    grid: { ...MARGINS, outerBoundsMode: "same", outerBoundsContain: "all" },
    legend: { show: Boolean(spec.legend), bottom: 0, textStyle, itemHeight: 10, data: spec.legend || [] },
    tooltip: {
      trigger: spec.hasCursor ? "axis" : "item",
      confine: true,
      backgroundColor: background,
      borderColor: line,
      textStyle: { ...textStyle, fontSize: 13 },
      formatter: (entries) => {
        const element = html("div", { class: "reading" }, ...spec.read(entries));
        // Screen readers announce the content, too.
        byId("reading").textContent = element.textContent;
        return element;
      },
    },
    xAxis: describeAxis(spec.x, 0),
    yAxis: describeAxis(spec.y, 1),
    series: spec.series.map((series) => ({ ...series, data: series.data.map(convert) })),
  };
}

// Constants but for rounding errors are drawn as constants; other axes have round limits.
function limitAxis(axis, [low, high]) {
  const [first, last] = [low, high].map((value) => fromValue(axis, value));
  const size = Math.max(Math.abs(first), Math.abs(last));
  const margin = axis.log ? 1 : 0.1 * size || 1;
  const automatic = { min: null, max: null, interval: null, scale: true, minInterval: 0 };
  if (!(last - first > MIN_RELATIVE_RANGE * size)) return { ...automatic, min: first - margin, max: last + margin };
  if (axis.isTime) return { ...automatic, min: first, max: last };
  if (axis.step) {
    const interval = axis.step * 2 ** Math.max(Math.ceil(Math.log2((last - first) / axis.step / MAX_STEPS)), 0);
    return { ...automatic, interval, min: interval * Math.floor(first / interval), max: interval * Math.ceil(last / interval) };
  }
  return { ...automatic, minInterval: axis.isCount || (axis.log && last - first > 2) ? 1 : 0 };
}

// Zooms of both axes: initially the values that the page defines, or the times of other charts.
function listZooms({ id, spec }) {
  return [..."xy"].map((axis) => {
    const [startValue, endValue] = (page.views[id]?.[axis] ?? []).map((value) => fromValue(spec[axis], value));
    const times = axis === "x" && spec.x.isTime ? [...state.charts.values()].find((other) => other.spec.x.isTime && other.id !== id) : null;
    const range = times ? readZoom(times, 0) : { startValue, endValue };
    const base = { type: "inside", [`${axis}AxisIndex`]: 0, filterMode: "none" };
    return { ...base, zoomOnMouseWheel: "ctrl", preventDefaultMouseMove: false, ...range };
  });
}

function readZoom({ instance }, axis) {
  const { start, end } = instance.getOption().dataZoom[axis];
  return { start, end };
}

function resetView(chart, ...axes) {
  const batch = axes.map((dataZoomIndex) => ({ dataZoomIndex, start: 0, end: 100 }));
  chart?.instance.dispatchAction({ type: "dataZoom", batch });
}

// All charts over time show the same times.
function shareTimes(chart) {
  markTime(chart, motion.time);
  for (const other of chart.spec.x.isTime ? state.charts.values() : []) {
    if (other === chart || !other.spec.x.isTime) continue;
    other.instance.dispatchAction({ type: "dataZoom", dataZoomIndex: 0, ...readZoom(chart, 0) }, { silent: true });
    markTime(other, motion.time);
  }
}

// Marks at the time of the motion lie above the chart, which is not drawn again.
function markTime({ instance, spec, marks }, time) {
  const points = (motion.frames && spec.marks?.(time)) || [];
  const axes = instance.getModel().getComponent("grid").coordinateSystem.getRect();
  const elements = points.flatMap(([x, y]) => {
    const left = instance.convertToPixel({ xAxisIndex: 0 }, fromValue(spec.x, x));
    const top = y === null ? axes.y : instance.convertToPixel({ yAxisIndex: 0 }, fromValue(spec.y, y));
    if (!axes.contain(left, top)) return [];
    const style = `left: ${left}px; top: ${top}px`;
    return [y === null ? html("span", { class: "time-line", style: `${style}; height: ${axes.height}px` }) : html("span", { class: "time-dot", style })];
  });
  marks.replaceChildren(...elements);
}

// Show the mechanism at the time of the cursor, unless it is playing.
function moveMotion(time) {
  if (!motion.frames || motion.isPlaying || time === undefined) return;
  showTime(clamp(time, motion.frames.t[0], motion.frames.t.at(-1)));
}

// Arrow keys visit the points of a curve, or of the cases, which Enter selects.
function handleKey(chart, event) {
  if (event.altKey || event.ctrlKey || event.metaKey || event.shiftKey) return;
  const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
  const points = listPoints(chart.spec);
  const count = points.length;
  if (step && count) {
    chart.visited = (chart.visited + step + count + (chart.visited < 0 && step < 0)) % count;
    const { time, seriesIndex, dataIndex } = points[chart.visited];
    moveMotion(time);
    chart.instance.dispatchAction({ type: "showTip", seriesIndex, dataIndex });
  } else if (points[chart.visited] && (event.key === "Enter" || event.key === " ")) chart.spec.select?.(points[chart.visited].id);
  else return;
  event.preventDefault();
}

// Points in the order of their times, or from left to right; some of the first curve if all are read together.
function listPoints({ series, hasCursor }) {
  const points = (hasCursor ? series.slice(0, 1) : series).flatMap(({ data, silent }, seriesIndex) =>
    silent && !hasCursor ? [] : data.map(([x, , id, time], dataIndex) => ({ order: time ?? x, id, time, seriesIndex, dataIndex })),
  );
  const step = hasCursor ? Math.ceil(points.length / KEY_STEPS) : 1;
  return points.sort((a, b) => a.order - b.order).filter((_, k) => k % step === 0 || k === points.length - 1);
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
