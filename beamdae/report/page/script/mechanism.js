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
  const heightScale = commonHeightScale(frames);
  const moving = layered.map(([, glyph]) => createMovingGlyph(glyph, frames, place, color, heightScale));
  const initial = glyphs
    .filter(({ kind }) => BODY_KINDS.includes(kind))
    .map((glyph) =>
      svg("path", {
        class: `body ${glyph.kind}${glyph.heights ? " solid" : ""} initial`,
        d: formatPath(visiblePoints(glyph, 0, frames, heightScale), place),
      }),
    );
  motion.draw = (frame) => moving.forEach(({ show }) => show(frame));
  return svg(
    "svg",
    { viewBox: `0 0 ${box.width} ${box.height}`, role: "group", "aria-label": "the mechanism" },
    svg("rect", { class: "stage", ...box, rx: 6 }),
    ...initial,
    ...moving.map(({ element }) => element),
    ...createScaleBar(zoom, box, frames.scale, heightScale),
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

// Points of the visible line: the outline of a beam that is drawn with the heights of its sections.
function visiblePoints(glyph, frame, frames, heightScale) {
  const points = glyphPoints(glyph, frame, frames);
  if (!glyph.heights) return points;
  const sides = removeMissing(offsetPoints(points, glyph.heights, heightScale));
  return [...sides.map(([upper]) => upper), ...sides.map(([, lower]) => lower).reverse(), ...(sides[0]?.slice(0, 1) ?? [])];
}

// Pairs of points on the upper and the lower surface of a beam; null where its axis has no point.
function offsetPoints(points, heights, heightScale) {
  return points.map((point, k) => {
    if (!point) return null;
    const [before, after] = [points[k - 1] ?? point, points[k + 1] ?? point];
    const [dx, dy] = [after[0] - before[0], after[1] - before[1]];
    const arm = (heightScale * heights[k]) / 2 / (Math.hypot(dx, dy) || 1);
    return [1, -1].map((side) => [point[0] - side * arm * dy, point[1] + side * arm * dx]);
  });
}

// Factor of section heights, the same for all mechanisms of a page, which can be compared then; 1 without heights.
function commonHeightScale(frames) {
  const entries = typeof page === "undefined" ? [] : [...page.groups, ...page.cases];
  const scales = [frames, ...entries.map((entry) => entry.frames)].map((other) => other?.heights);
  return Math.min(...removeMissing(scales), Infinity) === Infinity ? 1 : Math.min(...removeMissing(scales));
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

function createMovingGlyph(glyph, frames, place, color, heightScale) {
  const values = color && glyph.x && color.values.find(({ name }) => name === glyph.name)?.values;
  if (values) return createColoredBeam(glyph, place, color, values, heightScale);
  const kind = glyph.heights ? `${glyph.kind} solid` : glyph.kind;
  const element = svg("path", { class: `body ${kind}` }, svg("title", {}, glyph.name));
  const show = (frame) =>
    element.setAttribute("d", formatPath(visiblePoints(glyph, frame, frames, heightScale), place));
  return { element, show };
}

// One path per level of the color scale, which contains the beam segments at this level.
function createColoredBeam(glyph, place, { scale, limits }, values, heightScale) {
  const levels = Array.from({ length: COLOR_LEVELS }, (_, k) => {
    const stroke = interpolateColor(scale, (k + 0.5) / COLOR_LEVELS);
    return glyph.heights
      ? svg("path", { class: `body ${glyph.kind} solid`, style: `stroke: ${stroke}; fill: ${stroke}` })
      : svg("path", { class: `body ${glyph.kind}`, style: `stroke: ${stroke}` });
  });
  const [low, high] = limits;
  const show = (frame) => {
    const points = curvePoints(glyph, frame);
    const sides = glyph.heights && offsetPoints(points, glyph.heights, heightScale);
    const paths = levels.map(() => "");
    for (let k = 1; k < points.length; k += 1) {
      const index = frame * points.length + k;
      const share = ((values[index - 1] + values[index]) / 2 - low) / (high - low);
      const level = clamp(Math.floor(share * COLOR_LEVELS), 0, COLOR_LEVELS - 1);
      if (!points[k - 1] || !points[k]) continue;
      const corners = sides
        ? [...sides[k - 1], ...[...sides[k]].reverse(), sides[k - 1][0]]
        : [points[k - 1], points[k]];
      paths[level] += formatPath(corners, place);
    }
    levels.forEach((path, k) => path.setAttribute("d", paths[k]));
  };
  return { element: svg("g", {}, svg("title", {}, glyph.name), ...levels), show };
}

function createScaleBar(zoom, box, scale, heightScale) {
  const length = roundDownToNice(box.width / 4 / zoom);
  const [x, y] = [12, box.height - 10];
  const factors = [scale && `displacements × ${scale}`, heightScale > 1 && `section heights × ${heightScale}`];
  const caption = factors.filter(Boolean).join(", ");
  return [
    svg("path", { class: "cursor", d: `M${x} ${y - 4}V${y}H${x + length * zoom}V${y - 4}`, fill: "none" }),
    svg("text", { x: x + 4, y: y - 6 }, `${formatValue(length)} m`),
    ...(caption ? [svg("text", { x: box.width - 12, y: y - 6, "text-anchor": "end" }, caption)] : []),
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
