// Picture of the mechanism at one time: curves of bodies, and symbols that move with poses.

const BODY_KINDS = ["rigid", "beam", "beam solid", "point"]; // their initial positions are drawn as well
const SYMBOL_KINDS = ["ground", "guide", "surface", "gear", "wheel", "spring", "damper", "load"]; // kinds shown in the legend
const MAX_LEGEND_NAMES = 3; // per kind

// SVG units; keep the first four in step with animations.py.
const STAGE_WIDTH = 420;
const MIN_STAGE_HEIGHT = 180;
const MAX_STAGE_HEIGHT = 400;
const SCALE_BAR_HEIGHT = 16;
const STAGE_MARGIN = 26;

// SVG element of the mechanism; `motion.draw` updates it to a frame.
function createStage(frames, color) {
  const { place, box, zoom } = fitStage(frames.extent);
  const draw = (glyph, frame) => formatPath(glyphPoints(glyph, frame, frames), place);
  const moving = frames.glyphs.map((glyph) => createMovingGlyph(glyph, color, draw, place));
  const bodies = frames.glyphs.filter(({ kind }) => BODY_KINDS.includes(kind));
  const initial = bodies.map((glyph) => svg("path", { class: `body ${glyph.kind} initial`, d: draw(glyph, 0) }));
  motion.draw = (frame) => moving.forEach(({ show }) => show(frame));
  return svg(
    "svg",
    { viewBox: `0 0 ${box.width} ${box.height}`, role: "group", "aria-label": "the mechanism" },
    svg("rect", { class: "stage", ...box, rx: 6 }),
    ...initial,
    ...moving.map(({ element }) => element),
    ...createScaleBar(zoom, box, frames.captions),
  );
}

// Size and zoom of the picture, and the map from points [m] to SVG units.
function fitStage([[left, bottom], [right, top]]) {
  const height = clamp((STAGE_WIDTH * (top - bottom)) / (right - left || 1), MIN_STAGE_HEIGHT, MAX_STAGE_HEIGHT);
  const zoom = Math.min((STAGE_WIDTH - 2 * STAGE_MARGIN) / (right - left || 1e-9), (height - 2 * STAGE_MARGIN) / (top - bottom || 1e-9));
  const place = ([x, y]) => {
    const across = STAGE_WIDTH / 2 + zoom * (x - (left + right) / 2);
    const down = height / 2 - zoom * (y - (bottom + top) / 2);
    return `${across.toFixed(1)} ${down.toFixed(1)}`;
  };
  return { place, zoom, box: { width: STAGE_WIDTH, height: height + SCALE_BAR_HEIGHT } };
}

// Points of a glyph in a frame; null interrupts the line.
function glyphPoints(glyph, frame, { poses, t }) {
  if (glyph.x) return curvePoints(glyph, frame, t.length);
  if (glyph.absent?.includes(frame)) return [];
  // A pose that does not move is stored as a single value.
  const [start, end] = [glyph.at, glyph.to].map((k) => ["x", "y", "turn"].map((name) => poses[k][name][poses[k][name].length > 1 ? frame : 0]));
  if (removeMissing([...start, ...end]).length < 6) return [];
  const direction = Math.atan2(end[1] - start[1], end[0] - start[0]);
  return glyph.points.map((point) => {
    if (!point) return null;
    const [share, along, across] = point;
    const [x, y, turn] = start.map((value, k) => value + share * (end[k] - value));
    const [c, s] = [Math.cos, Math.sin].map((f) => f(glyph.along ? direction : turn));
    return [x + c * along - s * across, y + s * along + c * across];
  });
}

// A trail has one list of points for all frames; its visible part grows from frame to frame.
function curvePoints({ kind, x, y, points }, frame, frames) {
  const isTrail = kind === "trail";
  const length = isTrail ? 1 + Math.round((frame / (frames - 1)) * (x.length - 1)) : points;
  return Array.from({ length }, (_, k) => {
    const index = isTrail ? k : frame * points + k;
    return x[index] === null || y[index] === null ? null : [x[index], y[index]];
  });
}

function formatPath(points, place) {
  let path = "";
  points.forEach((point, k) => {
    if (point) path += `${k > 0 && points[k - 1] ? "L" : "M"}${place(point)}`;
  });
  // A line of zero length with round caps is drawn as a dot.
  return removeMissing(points).length === 1 ? path + path.replace("M", "L") : path;
}

function createMovingGlyph(glyph, color, draw, place) {
  const values = color && glyph.x && getOwn(color.values, glyph.name);
  if (values) return createColoredBeam(glyph, color, values, place);
  const element = svg("path", { class: `body ${glyph.kind}` }, svg("title", {}, glyph.name));
  return { element, show: (frame) => element.setAttribute("d", draw(glyph, frame)) };
}

// One path per segment between two sections; of a solid beam, it is the area between both surfaces.
function createColoredBeam(glyph, { scale, limits: [low, high] }, values, place) {
  const isSolid = glyph.kind === "beam solid";
  const count = isSolid ? (glyph.points - 1) / 2 : glyph.points;
  const segments = Array.from({ length: count - 1 }, () => svg("path", { class: `body ${glyph.kind}` }));
  const show = (frame) => {
    const points = curvePoints(glyph, frame);
    segments.forEach((segment, k) => {
      const first = frame * count + k;
      const stroke = interpolateColor(scale, ((values[first] + values[first + 1]) / 2 - low) / (high - low));
      const opposite = isSolid ? points.slice(2 * count - 2 - k, 2 * count - k) : [];
      segment.setAttribute("d", formatPath([points[k], points[k + 1], ...opposite], place));
      segment.setAttribute("style", `stroke: ${stroke}; fill: ${isSolid ? stroke : "none"}`);
    });
  };
  return { element: svg("g", {}, svg("title", {}, glyph.name), ...segments), show };
}

function createScaleBar(zoom, box, caption) {
  const length = roundDownToNice(box.width / 4 / zoom);
  const [x, y] = [12, box.height - 10];
  return [
    svg("path", { class: "cursor", d: `M${x} ${y - 4}V${y}H${x + length * zoom}V${y - 4}`, fill: "none" }),
    svg("text", { x: x + 4, y: y - 6 }, `${formatValue(length)} m`),
    svg("text", { x: box.width - 12, y: y - 6, "text-anchor": "end" }, caption ?? ""),
  ];
}

function createColorSelect(colors, selected, select) {
  if (!colors.length) return [];
  const options = [{ title: "none" }, ...colors];
  const list = createSelect("color of beams", options, selected ?? options[0], (choice) => select(choice.limits ? choice : null), ({ title }) => title);
  return [html("label", {}, "color ", Object.assign(list, { id: "color" })), ...(selected ? [createColorBar(selected)] : [])];
}

function createColorBar({ limits, scale, title }) {
  const [low, high] = limits.map((limit) => formatValue(limit, 3));
  const bar = html("span", { style: `background: linear-gradient(to right, ${scale.join(", ")})` });
  return html("span", { class: "color-bar", role: "img", "aria-label": `${title}, ${low} to ${high}` }, low, bar, high);
}

function createBodyLegend({ glyphs }) {
  const namesOf = (kind) => removeDuplicates(glyphs.filter((glyph) => glyph.kind === kind).map(({ name }) => name));
  return [...BODY_KINDS, ...SYMBOL_KINDS]
    .map((kind) => [kind, namesOf(kind)])
    .filter(([, names]) => names.length)
    .map(([kind, names]) => {
      const ellipsis = names.length > MAX_LEGEND_NAMES ? `, … (${names.length})` : "";
      const text = `${kind.split(" ")[0]}: ${names.slice(0, MAX_LEGEND_NAMES).join(", ")}${ellipsis}`;
      const shape = kind === "point" ? "M12 0A3 3 0 1 1 12-.01Z" : "M3 0H15";
      return html("span", {}, createIcon(18, svg("path", { class: `body ${kind}`, d: shape })), kind === "ground" ? kind : text);
    });
}

// Player of the animation.

const timeAxis = { name: "t", unit: "s" };
const SPEEDS = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10]; // relative to real time
const PATH_DURATION = 3; // of one playback of anything but time [s]
const PREFERRED_DURATION = 6; // desired duration of one playback at the initial speed [s]
const MAX_FRAME_DELAY = 100; // limits the time step after a pause of the browser, for example in a hidden tab [ms]
const motion = { frames: null, draw: null, time: 0, isPlaying: false, lastClock: 0, color: null, follow: null };

// Show frames; those of another motion are shown at the same time and in the same color.
function drawMotion(frames, color = frames?.colors?.find(({ title }) => title === motion.color?.title)) {
  const isFirst = !motion.frames;
  if (isFirst || !frames) pause();
  motion.frames = frames;
  const isStill = !frames || frames.t.length < 2;
  byId("player").hidden = isStill;
  if (!frames) {
    byId("stage").replaceChildren(createPlaceholder("No animation of this model."));
    byId("stage-legend").replaceChildren();
    return;
  }
  drawStage(color ?? null);
  const { t } = frames;
  byId("frame").max = t.length - 1;
  if (isFirst && !isStill) {
    const deviation = (speed) => Math.abs(Math.log((t.at(-1) - t[0]) / speed / PREFERRED_DURATION));
    const [best] = [...SPEEDS].sort((a, b) => deviation(a) - deviation(b));
    byId("speed").selectedIndex = SPEEDS.indexOf(best);
  }
  showTime(isFirst ? t[0] : clamp(motion.time, t[0], t.at(-1)));
}

function drawStage(color) {
  const { frames } = motion;
  motion.color = color;
  const select = (other) => {
    drawStage(other);
    showTime(motion.time);
  };
  byId("stage").replaceChildren(createStage(frames, color));
  byId("stage-legend").replaceChildren(
    html("div", { class: "controls" }, ...createColorSelect(frames.colors ?? [], color, select)),
    html("div", { class: "legend" }, ...createBodyLegend(frames)),
  );
}

function showTime(time) {
  const { t } = motion.frames;
  const frame = Math.max(t.findLastIndex((value) => value <= time), 0);
  motion.time = time;
  motion.draw(frame);
  byId("frame").value = frame;
  byId("frame").setAttribute("aria-valuetext", formatTime(t[frame]));
  byId("time").value = formatTime(t[frame], 3);
  motion.follow?.(time);
}

// Time, or the quantity that takes its place, such as the load factor of an equilibrium path.
function formatTime(value, digits = 4) {
  const { name, unit } = timeAxis;
  return [name, "=", formatValue(value, digits), unit].filter(Boolean).join(" ");
}

function isTime() {
  return timeAxis.name === "t";
}

function advance(clock) {
  if (!motion.isPlaying) return;
  const { t } = motion.frames;
  const elapsed = Math.min(clock - motion.lastClock, MAX_FRAME_DELAY) / 1000;
  // In PATH_DURATION seconds, a path or a period is shown once.
  const rate = isTime() ? SPEEDS[byId("speed").selectedIndex] : (t.at(-1) - t[0]) / PATH_DURATION;
  const time = motion.time + elapsed * rate;
  motion.lastClock = clock;
  showTime(time > t.at(-1) ? t[0] : time);
  requestAnimationFrame(advance);
}

function play() {
  motion.isPlaying = true;
  motion.lastClock = performance.now();
  byId("play").textContent = "Pause";
  requestAnimationFrame(advance);
}

function pause() {
  motion.isPlaying = false;
  byId("play").textContent = "Play";
}

function listenToPlayer() {
  byId("speed").closest("label").hidden = !isTime();
  byId("speed").replaceChildren(...SPEEDS.map((speed) => html("option", {}, `× ${formatValue(speed, 3)}`)));
  byId("play").addEventListener("click", () => (motion.isPlaying ? pause() : play()));
  byId("frame").addEventListener("input", (event) => showTime(motion.frames.t[event.target.value]));
}
