// How families and runs are told apart.

const COLORS = 7;
const DASHES = ["", "dash-1", "dash-2", "dash-3"];
const MARKS = [
  "M-5 0A5 5 0 1 0 5 0A5 5 0 1 0-5 0Z",
  "M-4.5-4.5H4.5V4.5H-4.5Z",
  "M0-6L5.6 4H-5.6Z",
  "M0-6.2L6.2 0L0 6.2L-6.2 0Z",
  "M0 6L5.6-4H-5.6Z",
];

function familySign(family, more = "") {
  return sign(
    14,
    svg("g", { class: `${familyColor(family)} ${more}`, transform: "translate(7)" }, mark(family)),
  );
}

function lineSign(style, width) {
  return sign(width, svg("path", { class: `curve ${style}`, d: `M0 0H${width}` }));
}

function mark(family) {
  return svg("path", { class: "mark", d: MARKS[families.indexOf(family) % MARKS.length] });
}

function familyColor(family) {
  return `color-${families.indexOf(family) % COLORS}`;
}
