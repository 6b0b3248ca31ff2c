// Picture of the mechanism at one time: curves of bodies, and symbols that move with poses.

// From back to front.
const LAYERS = [
  ["ground", "guide", "surface", "gear", "wheel", "trail"],
  ["rigid"],
  ["beam", "link", "spring", "damper", "sleeve"],
  ["point"],
  ["joint", "weld", "skate", "contact", "driver"],
  ["load"],
];
const DEFAULT_LAYER = 1;
const BODY_KINDS = ["rigid", "beam", "point"]; // their initial positions are drawn as well
const SYMBOL_KINDS = ["ground", "guide", "surface", "gear", "wheel", "spring", "damper", "load"]; // kinds shown in the legend
const MAX_LEGEND_NAMES = 3; // per kind
const COLOR_LEVELS = 24; // number of discrete colors of beams

// SVG units; keep the first four in step with motion_player.py.
const STAGE_WIDTH = 420;
const MIN_STAGE_HEIGHT = 180;
const MAX_STAGE_HEIGHT = 400;
const SCALE_BAR_HEIGHT = 16;
const STAGE_MARGIN = 26;

// SVG element of the mechanism; `motion.draw` updates it to a frame.
function createStage(frames, color) {
  const glyphs = [...frames.bodies, ...frames.symbols];
  const layered = glyphs.map((glyph) => [layerOf(glyph.kind), glyph]).sort(([a], [b]) => a - b);
  const { place, box, zoom } = fitStage(frames, glyphs);
  const moving = layered.map(([, glyph]) => createMovingGlyph(glyph, frames, place, color));
  const initial = glyphs
    .filter(({ kind }) => BODY_KINDS.includes(kind))
    .map((glyph) =>
      svg("path", {
        class: `body ${glyph.kind} initial`,
        d: formatPath(glyphPoints(glyph, 0, frames), place),
      }),
    );
  motion.draw = (frame) => moving.forEach(({ show }) => show(frame));
  return svg(
    "svg",
    { viewBox: `0 0 ${box.width} ${box.height}`, role: "group", "aria-label": "the mechanism" },
    svg("rect", { class: "stage", ...box, rx: 6 }),
    ...initial,
    ...moving.map(({ element }) => element),
    ...createScaleBar(zoom, box, frames.scale),
  );
}

function layerOf(kind) {
  const layer = LAYERS.findIndex((kinds) => kinds.includes(kind.split(" ")[0]));
  return layer < 0 ? DEFAULT_LAYER : layer;
}

// Size and zoom of the picture, which fits all frames, and the map from points [m] to SVG units.
function fitStage(frames, glyphs) {
  const points =
    frames.extent ?? frames.t.flatMap((_, k) => glyphs.flatMap((glyph) => glyphPoints(glyph, k, frames)));
  const [left, right] = findExtent([removeMissing(points).map(([x]) => x)]);
  const [bottom, top] = findExtent([removeMissing(points).map(([, y]) => y)]);
  const proportionalHeight = (STAGE_WIDTH * (top - bottom)) / (right - left || 1);
  const height = clamp(proportionalHeight, MIN_STAGE_HEIGHT, MAX_STAGE_HEIGHT);
  const zoom = Math.min(
    (STAGE_WIDTH - 2 * STAGE_MARGIN) / (right - left || 1e-9),
    (height - 2 * STAGE_MARGIN) / (top - bottom || 1e-9),
  );
  const place = ([x, y]) => {
    const across = STAGE_WIDTH / 2 + zoom * (x - (left + right) / 2);
    const down = height / 2 - zoom * (y - (bottom + top) / 2);
    return `${across.toFixed(1)} ${down.toFixed(1)}`;
  };
  return { place, zoom, box: { width: STAGE_WIDTH, height: height + SCALE_BAR_HEIGHT } };
}

// Points of a glyph in a frame; null interrupts the line.
function glyphPoints(glyph, frame, { poses }) {
  if (glyph.x) return curvePoints(glyph, frame);
  if (glyph.absent?.includes(frame)) return [];
  const [start, end] = [glyph.at, glyph.to].map((k) => poseAt(poses[k], frame));
  if (removeMissing([...start, ...end]).length < 6) return [];
  const direction = Math.atan2(end[1] - start[1], end[0] - start[0]);
  return glyph.points.map((point) => {
    if (!point) return null;
    const [share, along, across] = point;
    const [x, y, turn] = start.map((value, k) => value + share * (end[k] - value));
    const angle = glyph.along ? direction : turn;
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    return [x + c * along - s * across, y + s * along + c * across];
  });
}

// A trail has one list of points for all frames; its visible part grows from frame to frame.
function curvePoints({ kind, x, y, points, frames }, frame) {
  const isTrail = kind === "trail";
  const length = isTrail ? 1 + Math.round((frame / (frames - 1)) * (points - 1)) : points;
  return Array.from({ length }, (_, k) => {
    const index = isTrail ? k : frame * points + k;
    return x[index] === null || y[index] === null ? null : [x[index], y[index]];
  });
}

// A pose that does not move is stored as a single value.
function poseAt(pose, frame) {
  return [pose.x, pose.y, pose.turn].map((values) => values[values.length > 1 ? frame : 0]);
}

function formatPath(points, place) {
  let path = "";
  points.forEach((point, k) => {
    if (point) path += `${k > 0 && points[k - 1] ? "L" : "M"}${place(point)}`;
  });
  // A line of zero length with round caps is drawn as a dot.
  return removeMissing(points).length === 1 ? path + path.replace("M", "L") : path;
}

function createMovingGlyph(glyph, frames, place, color) {
  const values = color && glyph.x && color.values.find(({ name }) => name === glyph.name)?.values;
  if (values) return createColoredBeam(glyph, place, color, values);
  const element = svg("path", { class: `body ${glyph.kind}` }, svg("title", {}, glyph.name));
  const show = (frame) => element.setAttribute("d", formatPath(glyphPoints(glyph, frame, frames), place));
  return { element, show };
}

// One path per level of the color scale, which contains the beam segments at this level.
function createColoredBeam(glyph, place, { scale, limits }, values) {
  const levels = Array.from({ length: COLOR_LEVELS }, (_, k) => {
    const stroke = interpolateColor(scale, (k + 0.5) / COLOR_LEVELS);
    return svg("path", { class: `body ${glyph.kind}`, style: `stroke: ${stroke}` });
  });
  const [low, high] = limits;
  const show = (frame) => {
    const points = curvePoints(glyph, frame);
    const paths = levels.map(() => "");
    for (let k = 1; k < points.length; k += 1) {
      const index = frame * points.length + k;
      const share = ((values[index - 1] + values[index]) / 2 - low) / (high - low);
      const level = clamp(Math.floor(share * COLOR_LEVELS), 0, COLOR_LEVELS - 1);
      if (points[k - 1] && points[k]) paths[level] += `M${place(points[k - 1])}L${place(points[k])}`;
    }
    levels.forEach((path, k) => path.setAttribute("d", paths[k]));
  };
  return { element: svg("g", {}, svg("title", {}, glyph.name), ...levels), show };
}

function interpolateColor(scale, share) {
  const position = share * (scale.length - 1);
  const k = Math.min(Math.floor(position), scale.length - 2);
  return `color-mix(in srgb, ${scale[k + 1]} ${(100 * (position - k)).toFixed(1)}%, ${scale[k]})`;
}

function createScaleBar(zoom, box, scale) {
  const length = roundDownToNice(box.width / 4 / zoom);
  const [x, y] = [12, box.height - 10];
  return [
    svg("path", { class: "cursor", d: `M${x} ${y - 4}V${y}H${x + length * zoom}V${y - 4}`, fill: "none" }),
    svg("text", { x: x + 4, y: y - 6 }, `${formatValue(length)} m`),
    ...(scale ? [svg("text", { x: box.width - 12, y: y - 6, "text-anchor": "end" }, `displacements × ${scale}`)] : []),
  ];
}

function createColorSelect(colors, selected, select) {
  if (!colors.length) return [];
  const options = ["none", ...colors.map(({ title }) => title)].map((title, k) =>
    html("option", { selected: colors[k - 1] === selected && "" }, title),
  );
  const change = ({ target }) => select(colors[target.selectedIndex - 1] ?? null);
  const list = html("select", { id: "color", change }, ...options);
  return [html("label", {}, "color ", list), ...(selected ? [createColorBar(selected)] : [])];
}

function createColorBar({ limits, scale, title }) {
  const [low, high] = limits;
  return html(
    "span",
    { class: "color-bar", role: "img", "aria-label": `${title}, ${formatValue(low)} to ${formatValue(high)}` },
    formatValue(low, 3),
    html("span", { style: `background: linear-gradient(to right, ${scale.join(", ")})` }),
    formatValue(high, 3),
  );
}

function createBodyLegend(frames) {
  const glyphs = [...frames.bodies, ...frames.symbols];
  const namesOf = (kind) =>
    removeDuplicates(glyphs.filter((glyph) => glyph.kind === kind).map(({ name }) => name));
  return [...BODY_KINDS, ...SYMBOL_KINDS]
    .map((kind) => [kind, namesOf(kind)])
    .filter(([, names]) => names.length)
    .map(([kind, names]) => createBodyEntry(kind, names));
}

function createBodyEntry(kind, names) {
  const ellipsis = names.length > MAX_LEGEND_NAMES ? `, … (${names.length})` : "";
  const text = names.slice(0, MAX_LEGEND_NAMES).join(", ") + ellipsis;
  const shape = kind === "point" ? "M12 0A3 3 0 1 1 12-.01Z" : "M3 0H15";
  return html(
    "span",
    {},
    createIcon(18, svg("path", { class: `body ${kind}`, d: shape })),
    kind === "ground" ? kind : `${kind}: ${text}`,
  );
}
