// Export of charts: pictures with legend in light colors as SVG and PNG, and values as CSV.

const EXPORTED_PROPERTIES = [
  "fill",
  "stroke",
  "stroke-width",
  "stroke-dasharray",
  "stroke-linejoin",
  "opacity",
  "paint-order",
  "font-family",
  "font-size",
  "font-weight",
];
const INVALID_XML_CHARACTERS = /[\u0000-\u0008\u000b\u000c\u000e-\u001f\ufffe\uffff]/g;
const PNG_SCALE = 2; // pixels per SVG unit
const LEGEND_LINE_HEIGHT = 20;
const CSV_DIGITS = 6; // stored values have 16 bits
const MAX_FILE_NAME_PART = 60; // characters of the page title and of the chart name
const BLOB_LIFETIME = 60000; // [ms]

function saveSvg(chart) {
  saveFile(new Blob([exportPicture(chart).text], { type: "image/svg+xml" }), chart, "svg");
}

async function savePng(chart) {
  const { text, width, height } = exportPicture(chart);
  const url = URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));
  const image = Object.assign(new Image(), { src: url });
  await image.decode();
  const canvas = Object.assign(document.createElement("canvas"), {
    width: PNG_SCALE * width,
    height: PNG_SCALE * height,
  });
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  URL.revokeObjectURL(url);
  canvas.toBlob((blob) => saveFile(blob, chart, "png"));
}

function saveCsv(chart) {
  const lines = chart.spec.rows().map((cells) => `${cells.map(formatCsvCell).join(",")}\r\n`);
  saveFile(new Blob(lines, { type: "text/csv" }), chart, "csv");
}

function formatCsvCell(value) {
  if (value === null || value === undefined) return "";
  const text = typeof value === "number" ? String(Number(value.toPrecision(CSV_DIGITS))) : String(value);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

function saveFile(blob, { spec }, suffix) {
  const url = URL.createObjectURL(blob);
  const parts = [page.title, spec.name].map((text) => text.slice(0, MAX_FILE_NAME_PART));
  const name = parts.join("_").replace(/[^\p{L}\p{N}.=-]+/gu, "_");
  html("a", { href: url, download: `${name}.${suffix}` }).click();
  setTimeout(() => URL.revokeObjectURL(url), BLOB_LIFETIME);
}

// SVG text of the chart in its current view, with the legend below it.
function exportPicture(chart) {
  const { plot, spec, box } = chart;
  document.documentElement.classList.add("light");
  const picture = copyWithStyles(plot);
  const legend = spec.legend();
  const height = box.height + LEGEND_LINE_HEIGHT * legend.length + (legend.length ? 10 : 0);
  const fill = getComputedStyle(plot.querySelector("text")).fill;
  const family = getComputedStyle(plot).fontFamily;
  // Icons have computed styles only while they are part of the document.
  const holder = svg("svg", { width: 0, height: 0 });
  document.body.append(holder);
  const entries = legend.map(({ icon, text }, k) => {
    holder.replaceChildren(icon);
    const label = svg("text", { x: 34, y: 4, fill, "font-family": family, "font-size": 12 }, text);
    const transform = `translate(${box.left} ${box.height + 12 + LEGEND_LINE_HEIGHT * k})`;
    const copy = copyWithStyles(icon);
    copy.setAttribute("y", -icon.viewBox.baseVal.height / 2); // centers the icon on its line
    return svg("g", { transform }, copy, label);
  });
  holder.remove();
  document.documentElement.classList.remove("light");
  picture.prepend(svg("rect", { width: box.width, height, fill: "#ffffff" }));
  picture.append(...entries);
  const size = { width: box.width, height, viewBox: `0 0 ${box.width} ${height}` };
  for (const [name, value] of Object.entries(size)) picture.setAttribute(name, value);
  const text = new XMLSerializer().serializeToString(picture);
  return { text: text.replace(INVALID_XML_CHARACTERS, "\ufffd"), width: box.width, height };
}

// The file has no style sheet, so computed styles become attributes of each element.
function copyWithStyles(element) {
  const copy = element.cloneNode(false);
  const styles = getComputedStyle(element);
  for (const name of EXPORTED_PROPERTIES) copy.style.setProperty(name, styles.getPropertyValue(name));
  for (const name of ["class", "tabindex", "data-case"]) copy.removeAttribute(name);
  const copyChild = (child) => (child.nodeType === Node.ELEMENT_NODE ? copyWithStyles(child) : child.cloneNode());
  copy.append(...[...element.childNodes].map(copyChild));
  return copy;
}
