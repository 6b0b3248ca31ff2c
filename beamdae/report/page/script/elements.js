// Creation of HTML and SVG elements.

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
