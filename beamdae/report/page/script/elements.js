// Elements of the page, and what is said at the pointer.

function byId(id) {
  return document.getElementById(id);
}

function built(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value !== false) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

function html(tag, attributes = {}, ...children) {
  return built(document.createElement(tag), attributes, children);
}

function svg(tag, attributes = {}, ...children) {
  return built(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

// A button of a legend: what it stands for is shown or hidden. It keeps the focus when it is drawn again.
function switchOf(key, on, change, ...children) {
  const click = () => {
    change();
    [...document.querySelectorAll("[data-key]")].find((one) => one.dataset.key === key)?.focus();
  };
  const attributes = { type: "button", class: "switch", "data-key": key, "aria-pressed": String(on), click };
  return html("button", attributes, ...children);
}

function flip(set, value) {
  if (!set.delete(value)) set.add(value);
}

function empty(sentence) {
  return html("p", { class: "empty" }, sentence);
}

function sign(width, ...children) {
  return svg(
    "svg",
    { class: "sign", width, height: 16, viewBox: `0 -8 ${width} 16`, "aria-hidden": "true" },
    ...children,
  );
}

function showTip(x, y, ...children) {
  const tip = byId("tip");
  tip.replaceChildren(...children);
  tip.hidden = false;
  const { width, height } = tip.getBoundingClientRect();
  tip.style.left = `${Math.max(Math.min(x + 14, window.innerWidth - width - 8), 4)}px`;
  tip.style.top = `${y + 14 + height > window.innerHeight ? y - height - 14 : y + 14}px`;
}

function hideTip() {
  byId("tip").hidden = true;
}

function showBeside(element, children) {
  const { right, bottom } = element.getBoundingClientRect();
  showTip(right, bottom, ...children);
}
