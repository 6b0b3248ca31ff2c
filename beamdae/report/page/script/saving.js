// Charts as files: SVG and PNG with their legend, in the colors of paper, and their numbers as CSV.

const KEPT = [
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
const NOT_IN_XML = /[\u0000-\u0008\u000b\u000c\u000e-\u001f\ufffe\uffff]/g;
const PIXELS = 2;
const LINE = 20;
const LONGEST = 60;

function saveSvg(made) {
  save(new Blob([picture(made).text], { type: "image/svg+xml" }), made, "svg");
}

async function savePng(made) {
  const { text, width, height } = picture(made);
  const url = URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));
  const image = Object.assign(new Image(), { src: url });
  await image.decode();
  const sheet = Object.assign(document.createElement("canvas"), {
    width: PIXELS * width,
    height: PIXELS * height,
  });
  sheet.getContext("2d").drawImage(image, 0, 0, sheet.width, sheet.height);
  URL.revokeObjectURL(url);
  sheet.toBlob((blob) => save(blob, made, "png"));
}

function saveCsv(made) {
  const text = made.spec.rows().map((cells) => `${cells.map(csvCell).join(",")}\r\n`);
  save(new Blob(text, { type: "text/csv" }), made, "csv");
}

function csvCell(value) {
  if (value === null || value === undefined) return "";
  const text = typeof value === "number" ? String(Number(value.toPrecision(6))) : String(value);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

function save(blob, { spec }, suffix) {
  const url = URL.createObjectURL(blob);
  const words = [page.title, spec.name].map((text) => text.slice(0, LONGEST));
  const name = words.join("_").replace(/[^\p{L}\p{N}.=-]+/gu, "_");
  html("a", { href: url, download: `${name}.${suffix}` }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
}

// The chart as it is seen, its legend below it.
function picture(made) {
  const { plot, spec, box } = made;
  document.documentElement.classList.add("paper");
  const sheet = styledCopy(plot);
  const legend = spec.legend();
  const height = box.height + LINE * legend.length + (legend.length ? 10 : 0);
  const ink = getComputedStyle(plot.querySelector("text")).fill;
  const family = getComputedStyle(plot).fontFamily;
  const holder = svg("svg", { width: 0, height: 0 });
  document.body.append(holder);
  const entries = legend.map(({ sign: image, text }, k) => {
    holder.replaceChildren(image);
    const words = svg("text", { x: 34, y: 4, fill: ink, "font-family": family, "font-size": 12 }, text);
    const place = `translate(${box.left} ${box.height + 12 + LINE * k})`;
    return svg("g", { transform: place }, styledCopy(image), words);
  });
  holder.remove();
  document.documentElement.classList.remove("paper");
  sheet.prepend(svg("rect", { width: box.width, height, fill: "#ffffff" }));
  sheet.append(...entries);
  const size = { width: box.width, height, viewBox: `0 0 ${box.width} ${height}` };
  for (const [name, value] of Object.entries(size)) sheet.setAttribute(name, value);
  const text = new XMLSerializer().serializeToString(sheet);
  return { text: text.replace(NOT_IN_XML, "\ufffd"), width: box.width, height };
}

// No style sheet goes with a file: what it makes of each element is written to it.
function styledCopy(element) {
  const copy = element.cloneNode(false);
  const looks = getComputedStyle(element);
  for (const name of KEPT) copy.style.setProperty(name, looks.getPropertyValue(name));
  for (const name of ["class", "tabindex", "data-case"]) copy.removeAttribute(name);
  const shown = [...element.childNodes].filter((child) => !child.classList?.contains("reader"));
  copy.append(...shown.map((child) => (child.nodeType === 1 ? styledCopy(child) : child.cloneNode())));
  return copy;
}
