// The mechanism, drawn at one time: curves, and symbols that move with poses.

const LAYERS = [
  ["ground", "guide", "surface", "gear", "wheel", "trail"],
  ["rigid"],
  ["beam", "link", "spring", "damper", "sleeve"],
  ["point"],
  ["joint", "weld", "skate", "contact", "driver"],
  ["load"],
];
// Of these the legend tells names, of the others what they are.
const BODIES = ["rigid", "beam", "point"];
const EXPLAINED = ["ground", "guide", "surface", "gear", "wheel", "spring", "damper", "load"];
const LEVELS = 24;

function stage(frames, color) {
  const glyphs = [...frames.bodies, ...frames.symbols];
  const layered = glyphs.map((glyph) => [layerOf(glyph.kind), glyph]).sort(([a], [b]) => a - b);
  const { place, box, zoom } = placing(frames, glyphs);
  const moving = layered.map(([, glyph]) => moved(glyph, frames, place, color));
  const starts = glyphs.filter(({ kind }) => BODIES.includes(kind)).map((glyph) => still(glyph, frames, place));
  motion.draw = (frame) => moving.forEach(({ show }) => show(frame));
  return canvas(
    box,
    "the mechanism",
    svg("rect", { class: "stage", ...box, rx: 6 }),
    ...starts,
    ...moving.map(({ element }) => element),
    ...scaleBar(zoom, box),
  );
}

function layerOf(kind) {
  const layer = LAYERS.findIndex((kinds) => kinds.includes(kind.split(" ")[0]));
  return layer < 0 ? 1 : layer;
}

// From places to the drawing, in which all that is ever seen has room.
function placing(frames, glyphs) {
  const corners = frames.extent ?? frames.t.flatMap((_, k) => glyphs.flatMap((glyph) => line(glyph, k, frames)));
  const [left, right] = extent([known(corners).map(([x]) => x)]);
  const [bottom, top] = extent([known(corners).map(([, y]) => y)]);
  const [width, margin] = [420, 26];
  const tall = Math.min(Math.max((width * (top - bottom)) / (right - left || 1), 180), 400);
  const zoom = Math.min(
    (width - 2 * margin) / (right - left || 1e-9),
    (tall - 2 * margin) / (top - bottom || 1e-9),
  );
  const place = ([x, y]) => {
    const across = width / 2 + zoom * (x - (left + right) / 2);
    const down = tall / 2 - zoom * (y - (bottom + top) / 2);
    return `${across.toFixed(1)} ${down.toFixed(1)}`;
  };
  return { place, zoom, box: { width, height: tall + 16 } };
}

// Where the points of a glyph are; null where its line breaks.
function line(glyph, frame, { poses }) {
  if (glyph.x) return curvePoints(glyph, frame);
  if (glyph.absent?.includes(frame)) return [];
  const [a, b] = [glyph.at, glyph.to].map((k) => poseAt(poses[k], frame));
  if (known([...a, ...b]).length < 6) return [];
  const way = Math.atan2(b[1] - a[1], b[0] - a[0]);
  return glyph.points.map((point) => {
    if (!point) return null;
    const [share, along, across] = point;
    const [x, y, turn] = a.map((value, k) => value + share * (b[k] - value));
    const angle = glyph.along ? way : turn;
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    return [x + c * along - s * across, y + s * along + c * across];
  });
}

// Of a trail all points are stored once, and seen as far as it has come.
function curvePoints({ kind, x, y, points, frames }, frame) {
  const trail = kind === "trail";
  const length = trail ? 1 + Math.round((frame / (frames - 1)) * (points - 1)) : points;
  return Array.from({ length }, (_, k) => {
    const at = trail ? k : frame * points + k;
    return x[at] === null || y[at] === null ? null : [x[at], y[at]];
  });
}

// What does not move is stored once.
function poseAt(pose, frame) {
  return [pose.x, pose.y, pose.turn].map((values) => values[values.length > 1 ? frame : 0]);
}

function outline(points, place) {
  let path = "";
  points.forEach((point, k) => {
    if (point) path += `${k > 0 && points[k - 1] ? "L" : "M"}${place(point)}`;
  });
  // A line of no length is a dot.
  return known(points).length === 1 ? path.replace("M", "L").replace("L", "M") + path.replace("M", "L") : path;
}

function still(glyph, frames, place) {
  return svg("path", {
    class: `body ${glyph.kind} start`,
    d: outline(line(glyph, 0, frames), place),
  });
}

function moved(glyph, frames, place, color) {
  const values = color && glyph.x && color.values.find(({ name }) => name === glyph.name)?.values;
  if (values) return painted(glyph, frames, place, color, values);
  const element = svg("path", { class: `body ${glyph.kind}` }, svg("title", {}, glyph.name));
  const show = (frame) => element.setAttribute("d", outline(line(glyph, frame, frames), place));
  return { element, show };
}

// A path for each level of the scale, of the pieces of the beam that have it.
function painted(glyph, frames, place, color, values) {
  const levels = Array.from({ length: LEVELS }, (_, k) =>
    svg("path", { class: `body ${glyph.kind}`, style: `stroke: ${mixed(color.scale, (k + 0.5) / LEVELS)}` }),
  );
  const [low, high] = color.limits;
  const show = (frame) => {
    const points = curvePoints(glyph, frame);
    const paths = levels.map(() => "");
    for (let k = 1; k < points.length; k += 1) {
      const at = frame * points.length + k;
      const share = ((values[at - 1] + values[at]) / 2 - low) / (high - low);
      const level = Math.min(Math.max(Math.floor(share * LEVELS), 0), LEVELS - 1);
      if (points[k - 1] && points[k]) paths[level] += `M${place(points[k - 1])}L${place(points[k])}`;
    }
    levels.forEach((path, k) => path.setAttribute("d", paths[k]));
  };
  return { element: svg("g", {}, svg("title", {}, glyph.name), ...levels), show };
}

function mixed(scale, share) {
  const at = share * (scale.length - 1);
  const k = Math.min(Math.floor(at), scale.length - 2);
  return `color-mix(in srgb, ${scale[k + 1]} ${(100 * (at - k)).toFixed(1)}%, ${scale[k]})`;
}

function scaleBar(zoom, box) {
  const length = niceBelow(box.width / 4 / zoom);
  const [x, y] = [12, box.height - 10];
  return [
    svg("path", { class: "cursor", d: `M${x} ${y - 4}V${y}H${x + length * zoom}V${y - 4}`, fill: "none" }),
    svg("text", { x: x + 4, y: y - 6 }, `${shown(length)} m`),
  ];
}

function colorChoice(colors, chosen, choose) {
  if (!colors.length) return [];
  const options = ["none", ...colors.map(({ title }) => title)].map((title, k) =>
    html("option", { selected: colors[k - 1] === chosen && "" }, title),
  );
  const change = ({ target }) => choose(colors[target.selectedIndex - 1] ?? null);
  const select = html("select", { id: "color", change }, ...options);
  return [html("label", {}, "color ", select), ...(chosen ? [colorBar(chosen)] : [])];
}

function colorBar({ limits, scale, title }) {
  const [low, high] = limits;
  const image = `background: linear-gradient(to right, ${scale.join(", ")})`;
  return html(
    "span",
    { class: "color-bar", role: "img", "aria-label": `${title}, ${shown(low)} to ${shown(high)}` },
    shown(low, 3),
    html("span", { style: image }),
    shown(high, 3),
  );
}

function bodyLegend(frames) {
  const glyphs = [...frames.bodies, ...frames.symbols];
  const of = (kind) => distinct(glyphs.filter((glyph) => glyph.kind === kind).map(({ name }) => name));
  return [...BODIES, ...EXPLAINED]
    .map((kind) => [kind, of(kind)])
    .filter(([, names]) => names.length)
    .map(([kind, names]) => bodyEntry(kind, names));
}

function bodyEntry(kind, names) {
  const listed = names.slice(0, 3).join(", ") + (names.length > 3 ? `, … (${names.length})` : "");
  const shape = kind === "point" ? "M12 0A3 3 0 1 1 12-.01Z" : "M3 0H15";
  return html(
    "span",
    {},
    sign(18, svg("path", { class: `body ${kind}`, d: shape })),
    kind === "ground" ? kind : `${kind}: ${listed}`,
  );
}
