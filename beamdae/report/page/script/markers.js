// Colors, dashes and markers that distinguish families, cases and lines.

const COLOR_COUNT = 7; // colors --color-0 to --color-6 of page.css
const SEQUENCE = ["scale-0", "scale-1", "scale-2"]; // colors of page.css, from small to large values
const DASHES = ["solid", [6, 3], [1.5, 2.5], [7, 2.5, 1.5, 2.5]];
const MARKER_PATHS = [
  "M-5 0A5 5 0 1 0 5 0A5 5 0 1 0-5 0Z", // circle
  "M-4.5-4.5H4.5V4.5H-4.5Z", // square
  "M0-6L5.6 4H-5.6Z", // triangle
  "M0-6.2L6.2 0L0 6.2L-6.2 0Z", // diamond
  "M0 6L5.6-4H-5.6Z", // triangle pointing down
];

// Value of a color of page.css in the present color scheme.
function themeColor(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

// Color of a share of a scale, all as #rrggbb.
function interpolateColor(scale, share) {
  const position = share * (scale.length - 1);
  const k = Math.min(Math.floor(position), scale.length - 2);
  const channel = (color, i) => parseInt(color.slice(1 + 2 * i, 3 + 2 * i), 16);
  const mix = (i) => channel(scale[k], i) + (position - k) * (channel(scale[k + 1], i) - channel(scale[k], i));
  return `#${[0, 1, 2].map((i) => Math.round(mix(i)).toString(16).padStart(2, "0")).join("")}`;
}

function markerPath(number) {
  return MARKER_PATHS[number % MARKER_PATHS.length];
}

function familyMarker(family) {
  return `path://${markerPath(families.indexOf(family))}`;
}

// Families that follow a parameter have the colors of a sequence, others distinct colors.
function familyColor(family) {
  const k = families.indexOf(family);
  if (!page.sequential) return themeColor(`color-${k % COLOR_COUNT}`);
  return interpolateColor(SEQUENCE.map(themeColor), k / Math.max(families.length - 1, 1));
}

function createFamilyIcon(family) {
  const marker = svg("path", { d: markerPath(families.indexOf(family)), fill: familyColor(family) });
  return createIcon(14, svg("g", { transform: "translate(7)" }, marker));
}

// The number of a line determines its dash pattern and its marker.
function lineStyle(color, number) {
  return { color, dash: DASHES[number % DASHES.length], marker: markerPath(number) };
}

function createLineIcon({ color, dash, marker, isData }, width = 30) {
  const dashes = isData ? "0 11" : dash === "solid" ? "" : dash.join(" ");
  const line = { d: `M4 0H${width - 2}`, stroke: color, "stroke-dasharray": dashes, "stroke-width": isData ? 5 : 1.6, "stroke-linecap": isData ? "round" : "butt" };
  const shape = svg("path", { d: marker, fill: color, transform: `translate(${width / 2}) scale(0.6)` });
  return createIcon(width, svg("path", line), ...(isData ? [] : [shape]));
}
