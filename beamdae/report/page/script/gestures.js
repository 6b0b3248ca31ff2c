// How charts are zoomed and panned: by wheel, drag, two fingers, double click and keys.

// A pointer that moves less is a click.
const STILL = 4;
const KEY_PAN = 0.1;

function listenTo(made) {
  const held = { pointers: new Map(), start: null, box: null, moved: false };
  const { plot } = made;
  plot.addEventListener("pointerdown", (event) => hold(made, held, event));
  plot.addEventListener("pointermove", (event) => drag(made, held, event));
  for (const end of ["pointerup", "pointercancel"]) {
    plot.addEventListener(end, (event) => release(made, held, event));
  }
  // A drag that ends on a point does not choose it.
  plot.addEventListener("click", (event) => held.moved && event.stopPropagation(), true);
  plot.addEventListener("dblclick", () => resetView(made));
  plot.addEventListener("wheel", (event) => turn(made, event), { passive: false });
  plot.addEventListener("keydown", (event) => press(made, event));
  // Two fingers are the chart's, one that goes up or down is the page's.
  for (const touch of ["touchstart", "touchmove"]) {
    plot.addEventListener(touch, (event) => event.touches.length > 1 && event.preventDefault(), {
      passive: false,
    });
  }
}

// Where a pointer is in the drawing.
function placeIn({ plot, box }, event) {
  const { left, top, width } = plot.getBoundingClientRect();
  const zoom = box.width / width;
  return [(event.clientX - left) * zoom, (event.clientY - top) * zoom];
}

function hold(made, held, event) {
  if (event.button !== 0) return;
  if (!held.pointers.size) held.moved = false;
  held.pointers.set(event.pointerId, placeIn(made, event));
  held.start = placeIn(made, event);
  held.box = event.shiftKey && event.pointerType === "mouse";
}

function drag(made, held, event) {
  const before = held.pointers.get(event.pointerId);
  if (!before) return;
  const now = placeIn(made, event);
  const fingers = event.pointerType === "touch";
  if (!held.moved && distance(held.start, now) < STILL && held.pointers.size < 2) return;
  // One finger reads values until there is something to move.
  if (fingers && held.pointers.size < 2 && !zoomed(made)) return;
  if (!held.moved) made.plot.setPointerCapture(event.pointerId);
  held.moved = true;
  if (held.pointers.size > 1) pinch(made, held, event.pointerId, now);
  else if (held.box) showBox(made, held.start, now);
  else panBy(made, [now[0] - before[0], now[1] - before[1]]);
  held.pointers.set(event.pointerId, now);
}

function pinch(made, held, moving, now) {
  const other = [...held.pointers].find(([id]) => id !== moving)[1];
  const before = held.pointers.get(moving);
  const factor = distance(before, other) / Math.max(distance(now, other), 1);
  zoomBy(made, factor, other);
}

function release(made, held, event) {
  const now = placeIn(made, event);
  const boxed = held.pointers.delete(event.pointerId) && held.box && held.moved;
  if (!boxed) return;
  held.box = false;
  if (event.type === "pointerup" && distance(held.start, now) > STILL) zoomTo(made, held.start, now);
  else drawChart(made);
}

function distance([x, y], [u, v]) {
  return Math.hypot(u - x, v - y);
}

function showBox({ plot }, [x, y], [u, v]) {
  hideTip();
  const size = { width: Math.abs(u - x), height: Math.abs(v - y) };
  plot.querySelector(".zoom-box")?.remove();
  plot.append(svg("rect", { class: "zoom-box", x: Math.min(x, u), y: Math.min(y, v), ...size }));
}

// The wheel is the page's, until a chart has the focus: then it zooms, one axis where it is beside it.
function turn(made, event) {
  if (!event.ctrlKey && !made.element.contains(document.activeElement)) return;
  event.preventDefault();
  const [x, y] = placeIn(made, event);
  const ways = y > made.box.bottom ? "x" : x < made.box.left ? "y" : "xy";
  const lines = event.deltaY * (event.deltaMode === 1 ? 30 : 1);
  zoomBy(made, Math.exp(Math.min(Math.max(lines, -200), 200) / 400), [x, y], ways);
}

function press(made, event) {
  if (event.altKey || event.ctrlKey || event.metaKey) return;
  const { box } = made;
  const [wide, tall] = [KEY_PAN * (box.right - box.left), KEY_PAN * (box.bottom - box.top)];
  const pans = { ArrowLeft: [wide, 0], ArrowRight: [-wide, 0], ArrowUp: [0, tall], ArrowDown: [0, -tall] };
  if (event.key === "+" || event.key === "=") zoomBy(made, 1 / STEP, middleOf(made));
  else if (event.key === "-") zoomBy(made, STEP, middleOf(made));
  else if (event.key === "0") resetView(made);
  else if (event.shiftKey && pans[event.key]) panBy(made, pans[event.key]);
  else return;
  event.preventDefault();
  event.stopImmediatePropagation();
}
