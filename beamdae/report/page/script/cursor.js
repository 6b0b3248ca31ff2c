// Cursor of curve charts: shows values at the pointer or at a time selected by the arrow keys.

const KEY_STEPS = 100; // cursor steps across the visible time range

function addCursor(chart) {
  const { plot, overlay } = chart;
  let time = null;
  const visibleTimes = () => [chart.box.left, chart.box.right].map(chart.x.toValue);
  const removeCursor = () => {
    overlay.replaceChildren();
    hideTooltip();
  };
  const followPointer = (event) => {
    if (event.buttons && event.pointerType === "mouse") return;
    if (event.pointerType === "touch" && event.type === "pointermove" && isZoomed(chart)) return;
    time = clamp(chart.x.toValue(pointerPosition(chart, event)[0]), ...visibleTimes());
    drawCursor(chart, time, { x: event.clientX, y: event.clientY });
    moveMotion(time);
  };
  plot.addEventListener("pointermove", followPointer);
  plot.addEventListener("pointerdown", followPointer);
  // On touch screens, the cursor stays until the user touches a different position.
  plot.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && removeCursor());
  plot.addEventListener("blur", removeCursor);
  plot.addEventListener("keydown", (event) => {
    const direction = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!direction || event.shiftKey) return;
    event.preventDefault();
    const { left: first, right: last } = chart.box;
    const start = time === null ? first : chart.x.toPosition(time);
    time = chart.x.toValue(clamp(start + (direction * (last - first)) / KEY_STEPS, first, last));
    const { left, top, width } = plot.getBoundingClientRect();
    moveMotion(time);
    drawCursor(chart, time, { x: left + (chart.x.toPosition(time) * width) / chart.box.width, y: top + 30 });
  });
}

// Show the mechanism at the time of the cursor, unless it is playing.
function moveMotion(time) {
  if (!motion.frames || motion.isPlaying) return;
  showTime(clamp(time, motion.frames.t[0], motion.frames.t.at(-1)));
}

// Line at the time of the motion.
function createTimeLine({ box, x }, time) {
  const position = x.toPosition(time);
  if (!isWithin(position, [box.left - 1, box.right + 1])) return [];
  return [svg("line", { class: "time-line", x1: position, x2: position, y1: box.top, y2: box.bottom })];
}

function drawCursor({ spec, overlay, box, x, y }, time, tooltipPosition) {
  const readings = spec.lines.map((line) => {
    const k = nearestIndex(line.t, time);
    return { line, t: line.t[k], value: line.values[k] ?? null };
  });
  const position = x.toPosition(time);
  overlay.replaceChildren(
    svg("line", { class: "cursor", x1: position, x2: position, y1: box.top, y2: box.bottom }),
    ...readings.flatMap((reading) => createDot(reading, x, y, box)),
  );
  const rows = readings.map(({ line, value }) =>
    html(
      "tr",
      {},
      html("td", {}, createLineIcon(line.style)),
      html("td", {}, line.label),
      html("td", {}, value === null ? formatValue(value) : formatReading(value, spec.y.title, y.order)),
    ),
  );
  showTooltip(
    tooltipPosition.x,
    tooltipPosition.y,
    html("strong", {}, formatTime(time)),
    html("table", {}, ...rows),
  );
}

// Value in the unit of the axis.
function formatReading(value, title, order) {
  const unit = /\[([^\]]*)\]$/.exec(title)?.[1] ?? "";
  return `${formatValue(value / 10 ** order)} ${order ? scaleUnit(unit, order) : ""}`.trim();
}

function createDot({ line, value, t }, x, y, box) {
  if (value === null) return [];
  const [cx, cy] = [x.toPosition(t), y.toPosition(value)];
  const isVisible = isWithin(cx, [box.left - 1, box.right + 1]) && isWithin(cy, [box.top, box.bottom]);
  return isVisible ? [svg("circle", { class: `dot ${line.style.color}`, cx, cy, r: 3.5 })] : [];
}
