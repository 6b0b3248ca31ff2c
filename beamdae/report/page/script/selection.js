// The selection.

function toggle(id) {
  const slot = state.slots.findIndex((taken) => taken?.one.id === id);
  if (slot >= 0) state.slots[slot] = null;
  else select(page.cases.find((one) => one.id === id));
  showSelection();
}

function select(one) {
  const free = state.slots.indexOf(null);
  const slot = free >= 0 ? free : state.slots.length;
  state.slots[slot] = { one, number: slot + 1, style: freeStyle(one) };
}

// The color of the family, then those no family has; then both again in dashes.
function freeStyle(one) {
  const colors = [familyColor(one.family)];
  for (let k = families.length; k < COLORS; k += 1) colors.push(`color-${k}`);
  const styles = DASHES.flatMap((dash) => colors.map((color) => `${color} ${dash}`));
  const used = selected().map(({ style }) => style);
  return styles.find((style) => !used.includes(style)) ?? styles[0];
}

function selected() {
  return state.slots.filter((taken) => taken);
}

function clearSelection() {
  state.slots = [];
  showSelection();
}

function showSelection() {
  const numbers = new Map(selected().map(({ one, number }) => [one.id, number]));
  for (const element of document.querySelectorAll("[data-case]")) {
    const number = numbers.get(element.dataset.case);
    element.classList.toggle("selected", number !== undefined);
    element.querySelector(".number").textContent = number ?? "";
    if (element.matches(".run")) element.setAttribute("aria-pressed", number !== undefined);
    else element.querySelector("input").checked = number !== undefined;
  }
  byId("clear").disabled = !selected().length;
  drawChosen();
  drawPanels();
}

function selectFirst() {
  const drawn = casesHere().filter((one) => one.curves);
  const best = drawn
    .filter(plottable)
    .sort((one, other) => height(one) - height(other) || one.cost - other.cost);
  state.slots = [];
  [...best, ...drawn].slice(0, 1).forEach(select);
}

function drawChosen() {
  const entries = selected().map(({ one, number, style }) => {
    const attributes = {
      type: "button",
      "aria-label": `${number} ${one.label}, remove`,
      click: () => toggle(one.id),
    };
    return html(
      "button",
      attributes,
      html("span", { class: "badge" }, number),
      lineSign(style, 26),
      one.label,
      failed(one) ? " (failed)" : "",
      " ×",
    );
  });
  byId("chosen").replaceChildren(...entries);
}
