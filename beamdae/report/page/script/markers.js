// Colors, dashes and markers that distinguish families, cases and lines.

const COLOR_COUNT = 7; // colors --color-0 to --color-6 of page.css
const SEQUENCE = ["scale-0", "scale-1", "scale-2"]; // colors of page.css, from small to large values
const PATH = "path://"; // prefix of paths as symbols of ECharts
const DASHES = ["solid", [6, 3], [1.5, 2.5], [7, 2.5, 1.5, 2.5]];
const MARKERS = [
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
  const position = clamp(share, 0, 1) * (scale.length - 1);
  const k = Math.min(Math.floor(position), scale.length - 2);
  const channel = (color, i) => parseInt(color.slice(1 + 2 * i, 3 + 2 * i), 16);
  const mix = (i) => channel(scale[k], i) + (position - k) * (channel(scale[k + 1], i) - channel(scale[k], i));
  return `#${[0, 1, 2].map((i) => Math.round(mix(i)).toString(16).padStart(2, "0")).join("")}`;
}

function familyMarker(family) {
  return MARKERS[families.indexOf(family) % MARKERS.length];
}

// Families that follow a parameter have the colors of a sequence, others distinct colors.
function familyColor(family) {
  const k = families.indexOf(family);
  if (!page.sequential) return themeColor(`color-${k % COLOR_COUNT}`);
  return interpolateColor(SEQUENCE.map(themeColor), k / Math.max(families.length - 1, 1));
}

function createFamilyIcon(family) {
  return createIcon(14, svg("path", { d: familyMarker(family), fill: familyColor(family), transform: "translate(7)" }));
}

function createLineIcon(color, dash, isData) {
  const pattern = isData ? "0 11" : dash === "solid" ? "" : dash.join(" ");
  const looks = { stroke: color, "stroke-dasharray": pattern, "stroke-width": isData ? 5 : 1.8, "stroke-linecap": isData ? "round" : "butt" };
  return createIcon(30, svg("path", { d: "M2 0H28", ...looks }));
}
