// How families, runs and lines are told apart: by color, by dashes and by marks.

const COLORS = 7;
const DASHES = ["", "dash-1", "dash-2", "dash-3"];
const MARKS = [
  "M-5 0A5 5 0 1 0 5 0A5 5 0 1 0-5 0Z",
  "M-4.5-4.5H4.5V4.5H-4.5Z",
  "M0-6L5.6 4H-5.6Z",
  "M0-6.2L6.2 0L0 6.2L-6.2 0Z",
  "M0 6L5.6-4H-5.6Z",
];
const LINE_MARK = "scale(0.62)";

function familySign(family, more = "") {
  return sign(
    14,
    svg("g", { class: `${familyColor(family)} ${more}`, transform: "translate(7)" }, mark(family)),
  );
}

function mark(family) {
  return svg("path", { class: "mark", d: MARKS[families.indexOf(family) % MARKS.length] });
}

function familyColor(family) {
  return `color-${families.indexOf(family) % COLORS}`;
}

// Of a line: its color, and by its number its dashes and its mark.
function lineStyle(color, number) {
  return { color, dash: DASHES[number % DASHES.length], shape: MARKS[number % MARKS.length] };
}

function lineSign({ color, dash, shape }, width = 30) {
  return sign(
    width,
    svg("path", { class: `curve ${color} ${dash}`, d: `M0 0H${width}` }),
    lineMark({ color, shape }, [width / 2, 0]),
  );
}

function lineMark({ color, shape }, [x, y]) {
  const place = `translate(${x.toFixed(1)} ${y.toFixed(1)}) ${LINE_MARK}`;
  return svg("path", { class: `line-mark ${color}`, d: shape, transform: place });
}
