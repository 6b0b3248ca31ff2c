// The cases that are selected: each has a number and a color.

function toggle(id) {
  const slot = state.slots.findIndex((taken) => taken?.one.id === id);
  if (slot >= 0) state.slots[slot] = null;
  else select(page.cases.find((one) => one.id === id));
  state.hidden.cases.delete(id);
  showSelection();
}

function select(one) {
  const free = state.slots.indexOf(null);
  const slot = free >= 0 ? free : state.slots.length;
  state.slots[slot] = { one, number: slot + 1, color: freeColor(one) };
}

// The color of the family, then those no family has, as few times each as can be.
function freeColor(one) {
  const colors = [familyColor(one.family)];
  for (let k = families.length; k < COLORS; k += 1) colors.push(`color-${k}`);
  const uses = (color) => selected().filter((taken) => taken.color === color).length;
  return colors.sort((a, b) => uses(a) - uses(b))[0];
}

function selected() {
  return state.slots.filter((taken) => taken);
}

function clearSelection() {
  state.slots = [];
  state.hidden.cases.clear();
  showSelection();
}

function showSelection() {
  markSelection(document);
  byId("clear").disabled = !selected().length;
  drawChosen();
  drawPanels();
}

function markSelection(root) {
  const numbers = new Map(selected().map(({ one, number }) => [one.id, number]));
  for (const element of root.querySelectorAll("[data-case]")) {
    const number = numbers.get(element.dataset.case);
    element.classList.toggle("selected", number !== undefined);
    element.querySelector(".number").textContent = number ?? "";
    if (element.matches(".run")) element.setAttribute("aria-pressed", number !== undefined);
    else element.querySelector("input").checked = number !== undefined;
  }
}

const FIRST = 4;

// The best of what has curves; without errors, the first ones.
function selectFirst() {
  const drawn = casesHere().filter((one) => one.curves);
  const measured = (one) => !failed(one) && height(one) > 0 && one.cost > 0;
  const best = drawn
    .filter(measured)
    .sort((one, other) => height(one) - height(other) || one.cost - other.cost);
  state.slots = [];
  state.hidden.cases.clear();
  (best.length ? best.slice(0, 1) : drawn.slice(0, FIRST)).forEach(select);
}

function drawChosen() {
  const entries = page.cases.length > 1 ? selected().map(chip) : [];
  byId("chosen").replaceChildren(...entries);
}

// Hides and shows the curves of a case; the cross takes it out of the selection.
function chip({ one, number, color }) {
  const away = state.hidden.cases;
  const click = () => {
    flip(away, one.id);
    drawChosen();
    drawPanels();
  };
  const words = [one.label, failed(one) ? " (failed)" : ""];
  const badge = html("span", { class: "badge" }, number);
  const image = lineSign(lineStyle(color, number - 1));
  return html(
    "span",
    { class: "chip" },
    switchOf(`case ${one.id}`, !away.has(one.id), click, badge, image, ...words),
    html("button", { type: "button", "aria-label": `${number} ${one.label}, remove`, click: () => toggle(one.id) }, "×"),
  );
}
