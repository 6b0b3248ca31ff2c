// Zooming and panning of charts by wheel, drag, pinch, double-click and keys.

const CLICK_TOLERANCE = 4; // a pointer that moves less than this is a click [px]
const KEY_PAN_SHARE = 0.1; // relative to the width or height of the plot
const WHEEL_LINE_HEIGHT = 30; // pixels per line for wheels that report lines
const MAX_WHEEL_STEP = 200; // per wheel event [px]
const WHEEL_ZOOM_LENGTH = 400; // wheel distance for a zoom factor of e [px]

function listenToGestures(chart) {
  const gesture = { pointers: new Map(), start: null, isBox: false, hasMoved: false };
  const { plot } = chart;
  plot.addEventListener("pointerdown", (event) => startGesture(chart, gesture, event));
  plot.addEventListener("pointermove", (event) => continueGesture(chart, gesture, event));
  for (const end of ["pointerup", "pointercancel"]) {
    plot.addEventListener(end, (event) => endGesture(chart, gesture, event));
  }
  // A drag that ends on a point must not select the point.
  plot.addEventListener("click", (event) => gesture.hasMoved && event.stopPropagation(), true);
  plot.addEventListener("dblclick", () => resetView(chart));
  plot.addEventListener("wheel", (event) => handleWheel(chart, event), { passive: false });
  plot.addEventListener("keydown", (event) => handleChartKey(chart, event));
  // Two fingers zoom the chart; one finger that moves up or down scrolls the page.
  for (const touch of ["touchstart", "touchmove"]) {
    plot.addEventListener(touch, (event) => event.touches.length > 1 && event.preventDefault(), {
      passive: false,
    });
  }
}

// Position of a pointer in SVG units.
function pointerPosition({ plot, box }, event) {
  const { left, top, width } = plot.getBoundingClientRect();
  const unitsPerPixel = box.width / width;
  return [(event.clientX - left) * unitsPerPixel, (event.clientY - top) * unitsPerPixel];
}

function startGesture(chart, gesture, event) {
  if (event.button !== 0) return;
  if (!gesture.pointers.size) gesture.hasMoved = false;
  gesture.start = pointerPosition(chart, event);
  gesture.pointers.set(event.pointerId, gesture.start);
  gesture.isBox = event.shiftKey && event.pointerType === "mouse";
}

function continueGesture(chart, gesture, event) {
  const before = gesture.pointers.get(event.pointerId);
  if (!before) return;
  const now = pointerPosition(chart, event);
  const isSingle = gesture.pointers.size < 2;
  if (!gesture.hasMoved && isSingle && distance(gesture.start, now) < CLICK_TOLERANCE) return;
  // If the view shows the full range, one finger reads values.
  if (event.pointerType === "touch" && isSingle && !isZoomed(chart)) return;
  if (!gesture.hasMoved) chart.plot.setPointerCapture(event.pointerId);
  gesture.hasMoved = true;
  if (!isSingle) pinch(chart, gesture, event.pointerId, now);
  else if (gesture.isBox) drawZoomBox(chart, gesture.start, now);
  else panBy(chart, [now[0] - before[0], now[1] - before[1]]);
  gesture.pointers.set(event.pointerId, now);
}

// The finger that does not move is the center of the zoom.
function pinch(chart, gesture, movingId, now) {
  const center = [...gesture.pointers].find(([id]) => id !== movingId)[1];
  const before = gesture.pointers.get(movingId);
  zoomBy(chart, distance(before, center) / Math.max(distance(now, center), 1), center);
}

function endGesture(chart, gesture, event) {
  const now = pointerPosition(chart, event);
  const endsBox = gesture.pointers.delete(event.pointerId) && gesture.isBox && gesture.hasMoved;
  if (!endsBox) return;
  gesture.isBox = false;
  const isLarge = distance(gesture.start, now) > CLICK_TOLERANCE;
  if (event.type === "pointerup" && isLarge) zoomToBox(chart, gesture.start, now);
  else drawChart(chart);
}

function distance([x, y], [u, v]) {
  return Math.hypot(u - x, v - y);
}

function drawZoomBox({ overlay }, [x, y], [u, v]) {
  hideTooltip();
  const size = { width: Math.abs(u - x), height: Math.abs(v - y) };
  overlay.replaceChildren(svg("rect", { class: "zoom-box", x: Math.min(x, u), y: Math.min(y, v), ...size }));
}

// The wheel scrolls the page unless the chart has the focus or Ctrl is pressed. Over an axis, it zooms only
// this axis.
function handleWheel(chart, event) {
  if (!event.ctrlKey && !chart.element.contains(document.activeElement)) return;
  event.preventDefault();
  const [x, y] = pointerPosition(chart, event);
  const axes = y > chart.box.bottom ? "x" : x < chart.box.left ? "y" : "xy";
  const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? WHEEL_LINE_HEIGHT : 1);
  const step = clamp(pixels, -MAX_WHEEL_STEP, MAX_WHEEL_STEP);
  zoomBy(chart, Math.exp(step / WHEEL_ZOOM_LENGTH), [x, y], axes);
}

function handleChartKey(chart, event) {
  if (event.altKey || event.ctrlKey || event.metaKey) return;
  const { left, right, top, bottom } = chart.box;
  const [dx, dy] = [KEY_PAN_SHARE * (right - left), KEY_PAN_SHARE * (bottom - top)];
  const pans = { ArrowLeft: [dx, 0], ArrowRight: [-dx, 0], ArrowUp: [0, dy], ArrowDown: [0, -dy] };
  if (event.key === "+" || event.key === "=") zoomBy(chart, 1 / ZOOM_STEP, plotCenter(chart));
  else if (event.key === "-") zoomBy(chart, ZOOM_STEP, plotCenter(chart));
  else if (event.key === "0") resetView(chart);
  else if (event.shiftKey && pans[event.key]) panBy(chart, pans[event.key]);
  else return;
  event.preventDefault();
  event.stopImmediatePropagation();
}
