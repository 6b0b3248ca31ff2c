// Creation of HTML and SVG elements, and the tooltip.

const TOOLTIP_OFFSET = 14; // from the pointer [px]

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

// Legend entry that shows or hides an item. `change` redraws the legend; afterwards, the new entry with the
// same key receives the focus.
function createLegendSwitch(key, isOn, change, ...children) {
  const click = () => {
    change();
    [...document.querySelectorAll("[data-key]")].find((element) => element.dataset.key === key)?.focus();
  };
  const attributes = { type: "button", class: "switch", "data-key": key, "aria-pressed": String(isOn), click };
  return html("button", attributes, ...children);
}

// Position of the select with the focus among those of an element. Redrawn selects get it back by `focusSelect`.
function findFocusedSelect(element) {
  return [...element.querySelectorAll("select")].indexOf(document.activeElement);
}

function focusSelect(element, position) {
  element.querySelectorAll("select")[position]?.focus();
}

function toggleMember(set, value) {
  if (!set.delete(value)) set.add(value);
}

// Box that scrolls sideways; the keyboard reaches it, and screen readers announce it by its label.
function createScrollBox(label, ...children) {
  return html("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": label }, ...children);
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

function showTooltip(x, y, ...children) {
  const tooltip = byId("tooltip");
  tooltip.replaceChildren(...children);
  tooltip.hidden = false;
  const { width, height } = tooltip.getBoundingClientRect();
  const left = Math.max(Math.min(x + TOOLTIP_OFFSET, window.innerWidth - width - 8), 4);
  const fitsBelow = y + TOOLTIP_OFFSET + height <= window.innerHeight;
  tooltip.style.left = `${left}px`;
  tooltip.style.top = `${fitsBelow ? y + TOOLTIP_OFFSET : y - height - TOOLTIP_OFFSET}px`;
}

function hideTooltip() {
  byId("tooltip").hidden = true;
}

function showTooltipBeside(element, children) {
  const { right, bottom } = element.getBoundingClientRect();
  showTooltip(right, bottom, ...children);
}
