// Selected cases. Each case occupies a slot, which determines its number, and has a color for its curves.

const INITIAL_SELECTION = 4; // number of cases selected initially if no errors are known

function toggleCase(id) {
  const slot = state.slots.findIndex((entry) => entry?.run.id === id);
  if (slot >= 0) state.slots[slot] = null;
  else selectCase(page.cases.find((run) => run.id === id));
  state.hidden.cases.delete(id);
  showSelection();
}

function selectCase(run) {
  const freeSlot = state.slots.indexOf(null);
  const slot = freeSlot >= 0 ? freeSlot : state.slots.length;
  state.slots[slot] = { run, number: slot + 1, color: leastUsedColor(run) };
}

// Candidates are the color of the family, followed by the colors not used by any family.
function leastUsedColor(run) {
  const colors = [familyColor(run.family)];
  for (let k = families.length; k < COLOR_COUNT; k += 1) colors.push(`color-${k}`);
  const countUses = (color) => selectedCases().filter((entry) => entry.color === color).length;
  return colors.sort((a, b) => countUses(a) - countUses(b))[0];
}

function selectedCases() {
  return state.slots.filter((entry) => entry);
}

function clearSelection() {
  state.slots = [];
  state.hidden.cases.clear();
  showSelection();
}

// Select the most accurate case with curves, or the first cases if no errors are known.
function selectInitialCases() {
  const candidates = groupCases().filter((run) => run.curves);
  const byAccuracy = candidates
    .filter((run) => !hasFailed(run) && displayedError(run) > 0 && run.cost > 0)
    .sort((a, b) => displayedError(a) - displayedError(b) || a.cost - b.cost);
  state.slots = [];
  state.hidden.cases.clear();
  const initial = byAccuracy.length ? byAccuracy.slice(0, 1) : candidates.slice(0, INITIAL_SELECTION);
  initial.forEach(selectCase);
}

function showSelection() {
  markSelection(document);
  byId("clear").disabled = !selectedCases().length;
  drawSelectionLegend();
  drawPanels();
}

// Mark the points and rows of the selected cases with their numbers.
function markSelection(root) {
  const numbers = new Map(selectedCases().map(({ run, number }) => [run.id, number]));
  for (const element of root.querySelectorAll("[data-case]")) {
    const number = numbers.get(element.dataset.case);
    const isSelected = number !== undefined;
    element.classList.toggle("selected", isSelected);
    element.querySelector(".number").textContent = number ?? "";
    if (element.matches(".run")) element.setAttribute("aria-pressed", isSelected);
    else element.querySelector("input").checked = isSelected;
  }
}

function drawSelectionLegend() {
  const entries = page.cases.length > 1 ? selectedCases().map(createSelectionEntry) : [];
  byId("selection").replaceChildren(...entries);
}

// Two buttons: the first hides or shows the curves of the case, the second deselects the case.
function createSelectionEntry({ run, number, color }) {
  const hidden = state.hidden.cases;
  const change = () => {
    toggleMember(hidden, run.id);
    drawSelectionLegend();
    drawPanels();
  };
  const content = [
    html("span", { class: "badge" }, number),
    createLineIcon(lineStyle(color, number - 1)),
    run.label,
    hasFailed(run) ? " (failed)" : "",
  ];
  const label = `${number} ${run.label}, remove`;
  return html(
    "span",
    { class: "selection-entry" },
    createLegendSwitch(`case ${run.id}`, !hidden.has(run.id), change, ...content),
    html("button", { type: "button", "aria-label": label, click: () => toggleCase(run.id) }, "×"),
  );
}
