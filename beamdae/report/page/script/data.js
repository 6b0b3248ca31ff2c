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
