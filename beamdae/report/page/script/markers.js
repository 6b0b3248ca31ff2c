// Colors, dashes and markers that distinguish families, cases and lines.

const COLOR_COUNT = 7; // classes color-0 to color-6 in charts.css
const SHADE_COUNT = 24;
const SEQUENCE = ["var(--scale-0)", "var(--scale-1)", "var(--scale-2)"]; // from small to large values
const DASH_CLASSES = ["", "dash-1", "dash-2", "dash-3"];
const MARKER_PATHS = [
  "M-5 0A5 5 0 1 0 5 0A5 5 0 1 0-5 0Z", // circle
  "M-4.5-4.5H4.5V4.5H-4.5Z", // square
  "M0-6L5.6 4H-5.6Z", // triangle
  "M0-6.2L6.2 0L0 6.2L-6.2 0Z", // diamond
  "M0 6L5.6-4H-5.6Z", // triangle pointing down
];
const LINE_MARKER_SCALE = 0.62;

function createFamilyIcon(family, classes = "") {
  return createIcon(
    14,
    svg("g", { class: `${familyColor(family)} ${classes}`, transform: "translate(7)" }, createMarker(family)),
  );
}

function createMarker(family) {
  return svg("path", { class: "marker", d: MARKER_PATHS[families.indexOf(family) % MARKER_PATHS.length] });
}

// Families that follow a parameter have the colors of a sequence, others distinct colors.
function familyColor(family) {
  const k = families.indexOf(family);
  if (!page.sequential) return `color-${k % COLOR_COUNT}`;
  return `shade-${Math.round((k / Math.max(families.length - 1, 1)) * (SHADE_COUNT - 1))}`;
}

function createShadeStyles() {
  const rules = Array.from({ length: SHADE_COUNT }, (_, k) => {
    const color = interpolateColor(SEQUENCE, k / (SHADE_COUNT - 1));
    return `.shade-${k} { --line-color: ${color}; }`;
  });
  return html("style", {}, rules.join("\n"));
}

function createSequentialLegend(present) {
  const [first, last] = [present[0], present.at(-1)];
  return html(
    "span",
    { class: "color-bar", role: "img", "aria-label": `colors from ${first} to ${last}` },
    first,
    html("span", { style: `background: linear-gradient(to right, ${SEQUENCE.join(", ")})` }),
    last,
  );
}

// The number of a line determines its dash pattern and its marker.
function lineStyle(color, number) {
  return {
    color,
    dash: DASH_CLASSES[number % DASH_CLASSES.length],
    shape: MARKER_PATHS[number % MARKER_PATHS.length],
  };
}

function createLineIcon({ color, dash, shape, isData }, width = 30) {
  if (isData) return createIcon(width, svg("path", { class: `curve data ${color}`, d: "M4 0h0m11 0h0m11 0h0" }));
  return createIcon(
    width,
    svg("path", { class: `curve ${color} ${dash}`, d: `M0 0H${width}` }),
    createLineMarker({ color, shape }, [width / 2, 0]),
  );
}

function createLineMarker({ color, shape }, [x, y]) {
  const transform = `translate(${x.toFixed(1)} ${y.toFixed(1)}) scale(${LINE_MARKER_SCALE})`;
  return svg("path", { class: `line-marker ${color}`, d: shape, transform });
}
