// Chart of one column over another, such as the load factor over a displacement. A dot follows the motion.

const PORTRAIT_REACH = 40; // largest distance from the pointer to a point that it selects [px]

function drawPortrait() {
  const holder = byId("portrait");
  const lines = page.portrait ? selectedCases().filter(({ run }) => run.curves) : [];
  const choices = listChoices(PANELS[0]).filter(({ names }) => names.length === 1);
  holder.hidden = !lines.length || choices.length < 2;
  state.charts.delete("portrait");
  if (holder.hidden) {
    holder.replaceChildren();
    return;
  }
  const chart = createChart(describePortrait(lines));
  chart.plot.addEventListener("pointermove", (event) => pointAtPortrait(chart, event));
  chart.plot.addEventListener("pointerleave", hideTooltip);
  state.charts.set("portrait", chart);
  const selects = ["y", "x"].map((axis) => createPortraitSelect(axis, choices));
  const focused = findFocusedSelect(holder);
  holder.replaceChildren(html("div", { class: "heading" }, html("h3", {}, "Curve"), ...selects), chart.element);
  focusSelect(holder, focused);
  drawChart(chart);
}

function createPortraitSelect(axis, choices) {
  const change = (event) => {
    page.portrait[axis] = choices[event.target.selectedIndex].label;
    state.views.portrait = { x: null, y: null };
    drawPortrait();
  };
  const options = choices.map(({ label }) =>
    html("option", { selected: label === page.portrait[axis] && "" }, label),
  );
  return html("label", {}, `${axis} `, html("select", { "aria-label": `${axis} axis of the curve`, change }, ...options));
}

function describePortrait(selected) {
  const [xName, yName] = [page.portrait.x, page.portrait.y];
  const lines = selected.map(({ run, color, number }) => ({
    run,
    style: lineStyle(color, number - 1),
    t: getValues(run.curves.t),
    x: getValues(getOwn(run.curves.observed, xName)) ?? [],
    y: getValues(getOwn(run.curves.observed, yName)) ?? [],
  }));
  const isKnown = ({ x, y }, k) => Number.isFinite(x[k]) && Number.isFinite(y[k]);
  const createLine = (line, x, y) => {
    const place = ([u, v]) => `${x.toPosition(u).toFixed(1)} ${y.toPosition(v).toFixed(1)}`;
    const points = line.t.map((_, k) => (isKnown(line, k) ? [line.x[k], line.y[k]] : null));
    return svg("path", { class: `curve ${line.style.color} ${line.style.dash}`, d: formatPath(points, place) });
  };
  const createDots = ({ x, y }, time) =>
    lines.flatMap((line) => {
      const k = nearestIndex(line.t, time);
      if (!isKnown(line, k)) return [];
      return [svg("circle", { class: "time-dot", cx: x.toPosition(line.x[k]), cy: y.toPosition(line.y[k]), r: 5 })];
    });
  const createMarks = (box, x, y) =>
    page.portrait.marks.flatMap(({ t, label }) => {
      const [line] = lines;
      const k = nearestIndex(line.t, t);
      if (!isKnown(line, k)) return [];
      const [cx, cy] = [x.toPosition(line.x[k]), y.toPosition(line.y[k])];
      return [
        svg("circle", { class: "mark", cx, cy, r: 5 }),
        createMarkLabel(box, [cx, cy], label),
      ];
    });
  const range = (axis) => padRange(findExtent(lines.map((line) => line[axis])), false);
  return {
    id: "portrait",
    name: `${yName} over ${xName}`,
    label: `${yName} over ${xName}`,
    x: { title: xName, range: range("x"), log: false },
    y: { title: yName, range: range("y"), log: false },
    view: state.views.portrait,
    lines,
    height: (width) => clamp(0.4 * width, 230, 340),
    drawBackground: () => [],
    drawClipped: (box, x, y) => [...lines.map((line) => createLine(line, x, y)), ...createMarks(box, x, y)],
    drawForeground: () => [],
    showTime: (chart, time) => createDots(chart, time),
    legend: () => lines.map(({ run, style }) => ({ icon: createLineIcon(style), text: run.label })),
    rows: () => [
      ["case", timeTitle(), xName, yName],
      ...lines.flatMap(({ run, t, x, y }) => t.map((time, k) => [run.label, time, x[k], y[k]])),
    ],
  };
}

// Label beside a mark, on the side where the plot does not clip it.
function createMarkLabel(box, [cx, cy], label) {
  const isRight = cx > box.right - 8 - DIGIT_WIDTH * label.length;
  const side = isRight ? { x: cx - 8, "text-anchor": "end" } : { x: cx + 8 };
  return svg("text", { class: "halo", ...side, y: cy < box.top + 20 ? cy + 18 : cy - 6 }, label);
}

// Move the motion to the point of a curve next to the pointer.
function pointAtPortrait(chart, event) {
  if (event.buttons) return;
  const [px, py] = pointerPosition(chart, event);
  let best = { gap: PORTRAIT_REACH };
  for (const line of chart.spec.lines) {
    line.t.forEach((time, k) => {
      const gap = Math.hypot(chart.x.toPosition(line.x[k]) - px, chart.y.toPosition(line.y[k]) - py);
      if (gap < best.gap) best = { gap, line, time, k };
    });
  }
  if (!best.line) return;
  moveMotion(best.time);
  const rows = [
    [page.portrait.y, best.line.y[best.k]],
    [page.portrait.x, best.line.x[best.k]],
  ].map(([name, value]) => html("tr", {}, html("td", {}, name), html("td", {}, formatValue(value))));
  showTooltip(event.clientX, event.clientY, html("strong", {}, formatTime(best.time)), html("table", {}, ...rows));
}
