// Printed tables. Paper does not scroll, so columns that do not fit its width are left out and named below the
// table. The style sheet decides this in the browser's layout of the paper, whose size is not known before.

// Widths on A4 landscape: two charts side by side, and one beside the motion [px].
const PRINTED_CHART_WIDTH = 500;
const PRINTED_CURVE_WIDTH = 600;
const PRINT_FONT_SIZE = 10; // [px], 7.5 points as in media.css
const PRINT_PADDING = 12; // of a cell, both sides [px]
const MAX_PRINTED_TEXT = 150; // longer texts are wrapped [px]
const FONT_TOLERANCE = 1.15; // widths in print may exceed those on the screen

function preparePrint() {
  showRows(Infinity);
  byId("remarks").open = true;
  document.querySelectorAll(".printed").forEach(fitPrintedColumns);
  state.charts.forEach((chart) => {
    const isBesideMotion = !byId("motion").hidden && Boolean(chart.element.closest("#top, .without-curves #charts"));
    drawChart(chart, isBesideMotion ? PRINTED_CURVE_WIDTH : PRINTED_CHART_WIDTH);
  });
}

function fitPrintedColumns(box, number) {
  box.querySelectorAll(".omitted, style").forEach((element) => element.remove());
  const table = box.querySelector("table");
  const rows = [...table.rows];
  const count = Math.max(...rows.map((row) => row.cells.length), 0);
  if (count < 3) return; // name and value wrap
  const widths = measureColumns(rows, count);
  box.dataset.printed = number;
  const scope = `[data-printed="${number}"]`;
  const rules = [];
  const names = [];
  let total = widths[0] + widths[1];
  for (let k = 2; k < count; k += 1) {
    total += widths[k];
    const cells = `${scope} tr > :nth-child(${k + 1})`;
    const name = `${scope} .omitted > :nth-child(${names.length + 1})`;
    rules.push(`@container printed (width < ${Math.ceil(total)}px) { ${cells} { display: none } }`);
    rules.push(`@container printed (width >= ${Math.ceil(total)}px) { ${name} { display: none } }`);
    names.push(rows[0].cells[k].innerText.replace(/\s+/g, " ").trim());
  }
  rules.push(`@container printed (width >= ${Math.ceil(total)}px) { ${scope} .omitted { display: none } }`);
  const list = names.map((name) => html("span", {}, name));
  box.append(
    html("p", { class: "omitted" }, ...list),
    html("style", {}, `@media print { ${rules.join("\n")} }`),
  );
}

// Widths of the columns in print [px], from the texts of their cells.
function measureColumns(rows, count) {
  const canvas = document.createElement("canvas").getContext("2d");
  const { fontFamily } = getComputedStyle(document.body);
  const widths = Array.from({ length: count }, () => 0);
  rows.forEach((row, k) => {
    canvas.font = `${k ? "" : "600 "}${PRINT_FONT_SIZE}px ${fontFamily}`;
    [...row.cells].forEach((cell, column) => {
      const isNumber = ["number", "error", "cost"].some((name) => cell.classList.contains(name));
      // The name and the unit of a column are on separate lines.
      const lines = k ? [cell.textContent] : cell.innerText.split("\n");
      const width = Math.max(...lines.map((line) => canvas.measureText(line.trim()).width), 0);
      const limited = isNumber ? width : Math.min(width, MAX_PRINTED_TEXT);
      widths[column] = Math.max(widths[column], FONT_TOLERANCE * limited + PRINT_PADDING);
    });
  });
  return widths;
}

function listenToPrinting() {
  const restore = () => state.charts.forEach((chart) => drawChart(chart));
  window.addEventListener("beforeprint", preparePrint);
  window.addEventListener("afterprint", restore);
  window.matchMedia("print").addEventListener("change", ({ matches }) => (matches ? preparePrint() : restore()));
}
