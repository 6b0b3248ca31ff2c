// Data of the page, and creation of HTML and SVG elements.

// Arrays are stored as 32-bit numbers, see page_file.py; numbers that are missing become null.
function parseData(text) {
  return JSON.parse(text, (_, value) => (typeof value?.[""] === "string" ? decodeArray(value[""]) : value));
}

function decodeArray(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return Array.from(new Float32Array(bytes.buffer), (x) => (Number.isFinite(x) ? x : null));
}

// Names chosen by users may equal names of inherited properties, such as "constructor".
function getOwn(object, name) {
  return object && Object.hasOwn(object, name) ? object[name] : undefined;
}

function byId(id) {
  return document.getElementById(id);
}

function html(tag, attributes = {}, ...children) {
  return fillElement(document.createElement(tag), attributes, children);
}

function svg(tag, attributes = {}, ...children) {
  return fillElement(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

// Attributes that are functions become event listeners; false attributes are omitted.
function fillElement(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value !== false) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

// List of options, whose redrawn list has the focus after a choice.
function createSelect(label, options, selected, choose, textOf = (option) => option.label) {
  const change = (event) => {
    choose(options[event.target.selectedIndex]);
    [...document.querySelectorAll("select")].find((list) => list.getAttribute("aria-label") === label)?.focus();
  };
  const createOption = (option) => html("option", { selected: option === selected && "" }, textOf(option));
  return html("select", { "aria-label": label, change }, ...options.map(createOption));
}

function createPlaceholder(sentence) {
  return html("p", { class: "empty" }, sentence);
}

function createIcon(width, ...children) {
  return svg(
    "svg",
    { class: "icon", width, height: 16, viewBox: `0 -8 ${width} 16`, "aria-hidden": "true" },
    ...children,
  );
}

// Ranges of values and formatting of numbers.

function removeDuplicates(values) {
  return [...new Set(values)];
}

function removeMissing(values) {
  return values.filter((value) => value !== null && value !== undefined);
}

// Smallest and largest value of all lists.
function findExtent(lists) {
  let [low, high] = [Infinity, -Infinity];
  for (const list of lists) {
    for (const value of removeMissing(list)) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  return [low, high];
}

function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

// Largest of 1, 2 and 5 times a power of ten that does not exceed the value.
function roundDownToNice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [5, 2, 1].find((factor) => factor * power <= value * (1 + 1e-9));
}

function formatValue(value, digits = 4) {
  if (value === null || value === undefined || value === "") return "–";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value !== "number") return String(value);
  const magnitude = Math.abs(value);
  if (value === 0 || (Number.isInteger(value) && magnitude < 1e7)) return String(value);
  if (magnitude >= 1e-3 && magnitude < 1e5) return String(Number(value.toPrecision(digits)));
  return value.toExponential(digits - 2);
}

// Axes of linear scale show values of 1e4 and more, and below 1e-2, in multiples of 1000 of their unit. The same rule
// holds for pictures, see pictures/tick_labels.py.
const PREFIXES = { "-9": "n", "-6": "µ", "-3": "m", 3: "k", 6: "M", 9: "G" };
const PREFIXED_UNIT = /^(Pa|N|J|W|Hz|V|A)(?=$|[ /*·])/;
const REDUCED_UNIT = /^(m|rad|s)(?=$|[ /*·])/; // no usual prefix enlarges these

// Exponent of ten, a multiple of 3, by which an axis with the given range divides its values.
function engineeringOrder(range) {
  const largest = Math.max(...range.map(Math.abs));
  if (!(largest > 0) || !Number.isFinite(largest)) return 0;
  const exponent = Math.floor(Math.log10(largest) + 1e-9);
  return exponent >= 4 || exponent <= -3 ? 3 * Math.floor(exponent / 3) : 0;
}

// The unit of values that are divided by a power of ten.
function scaleUnit(unit, order) {
  if (!order) return unit;
  const hasPrefix = PREFIXED_UNIT.test(unit) || (order < 0 && REDUCED_UNIT.test(unit));
  if (hasPrefix && PREFIXES[order]) return PREFIXES[order] + unit;
  return `${formatPowerOfTen(order)} ${unit === "-" ? "" : unit}`.trim();
}

// A title such as "stress [Pa]" for values that are divided by a power of ten.
function scaleTitle(title, order) {
  if (!order) return title;
  const [, name, unit] = /^(.*)\[([^\]]*)\]$/.exec(title) ?? [null, `${title} `, ""];
  return `${name}[${scaleUnit(unit, order)}]`;
}

// Text of a value on a logarithmic axis, such as 0.2, 32 or 2·10⁻³.
function formatPower(value) {
  if (value > 0.9e-2 && value < 1e4) return String(Number(value.toPrecision(2)));
  const exponent = Math.floor(Math.log10(value) + 1e-9);
  const factor = Number((value / 10 ** exponent).toPrecision(2));
  return `${factor === 1 ? "" : `${factor}·`}${formatPowerOfTen(exponent)}`;
}

function formatPowerOfTen(exponent) {
  return `10${[...String(exponent)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("")}`;
}
