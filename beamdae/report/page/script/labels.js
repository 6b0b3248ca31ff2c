// Places of labels in a chart: on their lines, as on contour lines, and beside their marks.

const LABEL_HEIGHT = 14; // [px]
const LABEL_DIGIT_WIDTH = 7.5; // [px]
const LABEL_GAP = 2; // to other labels and to points [px]
const OBSTACLE_RADIUS = 8; // of points and marks [px]
const LABEL_STEP = 4; // between candidates on a line [px]
const MAX_SAMPLES = 1000; // of a segment, which is long if the chart is zoomed
const MARK_DISTANCES = [19, 34, 50]; // between a mark and the center of its label [px]
// Costs of a place.
const LABEL_COST = 1000; // per covered label
const OUTSIDE_COST = 500;
const OBSTACLE_COST = 50; // per covered point or mark
const LINE_COST = 4; // per covered line
const DISTANCE_COST = 0.05; // per distance from the preferred place [1/px]

// Return the centers of the labels: each at the place that covers the least of what is drawn. The points of the series
// are drawn as markers.
function placeLabels(box, lines, marks, series) {
  const labels = [];
  const obstacles = [...series.flat(), ...marks.map(({ at }) => at)];
  const paths = [...lines.map(({ path }) => path), ...series].map((path) => samplePath(path, box));
  lines.forEach(({ label: text }, k) => {
    // From the end, where lines through a common point are farthest apart.
    const candidates = paths[k].filter((at) => isInPlot(at, labelSize(text), box)).reverse();
    const others = paths.filter((path) => path !== paths[k]);
    const [place] = candidates;
    if (place) labels.push({ text, ...chooseBest(candidates, text, place, { box, labels, obstacles, paths: others }) });
  });
  for (const { label: text, at } of marks.filter(({ label }) => label)) {
    const [preferred, ...others] = MARK_DISTANCES.flatMap((gap) => candidatesAround(at, gap, labelSize(text)));
    labels.push({ text, ...chooseBest([preferred, ...others], text, preferred, { box, labels, obstacles, paths }) });
  }
  return labels;
}

function labelSize(text) {
  return [LABEL_DIGIT_WIDTH * text.length + LABEL_GAP, LABEL_HEIGHT];
}

function candidatesAround([x, y], gap, [width]) {
  const across = gap - LABEL_HEIGHT / 2 + width / 2;
  return [
    [x, y - gap],
    [x, y + gap],
    [x + across, y],
    [x - across, y],
    [x + across, y - gap],
    [x - across, y - gap],
  ];
}

function chooseBest(candidates, text, preferred, surroundings) {
  const size = labelSize(text);
  let best = { cost: Infinity };
  for (const at of candidates) {
    const distance = Math.hypot(at[0] - preferred[0], at[1] - preferred[1]);
    const cost = DISTANCE_COST * distance + coverCost(at, size, surroundings);
    if (cost < best.cost) best = { at, size, cost };
  }
  return best;
}

function coverCost(at, size, { box, labels, obstacles, paths }) {
  const covers = (other, [width, height]) =>
    Math.abs(at[0] - other[0]) < (size[0] + width) / 2 + LABEL_GAP &&
    Math.abs(at[1] - other[1]) < (size[1] + height) / 2 + LABEL_GAP;
  const count = (list, test) => list.filter(test).length;
  const obstacle = [2 * OBSTACLE_RADIUS, 2 * OBSTACLE_RADIUS];
  return (
    LABEL_COST * count(labels, (other) => covers(other.at, other.size)) +
    OBSTACLE_COST * count(obstacles, (point) => covers(point, obstacle)) +
    LINE_COST * count(paths, (path) => path.some((point) => covers(point, [0, 0]))) +
    (isInPlot(at, size, box) ? 0 : OUTSIDE_COST)
  );
}

function isInPlot([x, y], [width, height], box) {
  return (
    isWithin(x - width / 2, [box.left, box.right]) &&
    isWithin(x + width / 2, [box.left, box.right]) &&
    isWithin(y - height / 2, [box.top, box.bottom]) &&
    isWithin(y + height / 2, [box.top, box.bottom])
  );
}

// Points at equal distances on the segments of a line that cross the plot.
function samplePath(path, box) {
  const overlaps = (from, to, [low, high]) => Math.min(from, to) <= high && Math.max(from, to) >= low;
  return path.slice(1).flatMap(([x, y], k) => {
    const [x0, y0] = path[k];
    if (!overlaps(x0, x, [box.left, box.right]) || !overlaps(y0, y, [box.top, box.bottom])) return [];
    const count = clamp(Math.ceil(Math.hypot(x - x0, y - y0) / LABEL_STEP), 1, MAX_SAMPLES);
    return Array.from({ length: count }, (_, i) => {
      const share = (i + 1) / count;
      return [x0 + share * (x - x0), y0 + share * (y - y0)];
    });
  });
}
