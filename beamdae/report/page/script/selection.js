// Selected cases. Each case occupies a slot, which determines its number, and has a color for its curves.

const INITIAL_SELECTION = 4; // number of cases selected initially if no errors are known

function toggleCase(id) {
  state.sliderSlot = null;
  const slot = state.slots.findIndex((entry) => entry?.run.id === id);
  if (slot >= 0) state.slots[slot] = null;
  else {
    selectCase(page.cases.find((run) => run.id === id));
    showCase(page.cases.find((run) => run.id === id));
  }
  state.hidden.cases.delete(id);
  keepInPlace(document.querySelector("[data-case]:hover") ?? document.activeElement, showSelection);
}

// Scroll the page so that an element stays where it is in the window, whatever changes above it.
function keepInPlace(element, change) {
  // The number of a selected point changes the size of the point, but not that of its ring.
  const fixed = element.querySelector(".ring") ?? element;
  const before = fixed.getBoundingClientRect().top;
  change();
  if (fixed.isConnected) window.scrollBy(0, fixed.getBoundingClientRect().top - before);
}

function selectCase(run) {
  const freeSlot = state.slots.indexOf(null);
  const slot = freeSlot >= 0 ? freeSlot : state.slots.length;
  state.slots[slot] = { run, number: slot + 1, color: leastUsedColor(run) };
  loadCurves(run);
}

// Candidates are the color of the family, followed by the colors not used by any family.
function leastUsedColor(run) {
  const colors = page.sequential ? ["color-0"] : [familyColor(run.family)];
  for (let k = page.sequential ? 1 : families.length; k < COLOR_COUNT; k += 1) colors.push(`color-${k}`);
  const countUses = (color) => selectedCases().filter((entry) => entry.color === color).length;
  return colors.sort((a, b) => countUses(a) - countUses(b))[0];
}

function selectedCases() {
  return state.slots.filter((entry) => entry);
}

function clearSelection() {
  state.slots = [];
  state.sliderSlot = null;
  state.hidden.cases.clear();
  showSelection();
}

// Select the most accurate case with curves, or the first cases if no errors are known; with measured data, all.
function selectInitialCases() {
  const inPage = groupCases().filter((run) => run.curves);
  const candidates = inPage.length ? inPage : groupCases().filter(mayHaveCurves);
  const byAccuracy = candidates
    .filter((run) => !hasFailed(run) && run.error > 0 && run.cost > 0)
    .sort((a, b) => a.error - b.error || a.cost - b.cost);
  state.slots = [];
  state.sliderSlot = null;
  state.hidden.cases.clear();
  // Without any curves, the first case that moves; with profiles, the first ones.
  const moving = groupCases().filter((run) => run.frames);
  const hasData = candidates.some((run) => run.points);
  const withoutCurves = moving.slice(0, page.profiles.length ? INITIAL_SELECTION : 1);
  let initial = candidates.length ? spreadCases(candidates) : withoutCurves;
  if (byAccuracy.length) initial = byAccuracy.slice(0, 1);
  if (hasData) initial = candidates;
  initial.forEach(selectCase);
}

// The first cases, or cases spread over the parameters of a sweep.
function spreadCases(candidates) {
  const count = Math.min(INITIAL_SELECTION, candidates.length);
  if (!page.sliders.length) return candidates.slice(0, count);
  const last = candidates.length - 1;
  return Array.from({ length: count }, (_, k) => candidates[Math.round((k * last) / Math.max(count - 1, 1))]);
}

function showSelection() {
  markSelection(document);
  byId("clear").disabled = !selectedCases().length;
  drawSelectionLegend();
  explainMissingCurves();
  drawPortrait();
  if (page.profiles.length) drawProfile();
  drawPanels();
}

// Below the selection: why curves of a selected case are missing, and the most similar case with curves.
function explainMissingCurves() {
  const hasCurves = groupCases().some(mayHaveCurves);
  const missing = hasCurves ? selectedCases().filter(({ run }) => !run.curves) : [];
  byId("selection-notes").replaceChildren(...missing.map(({ run }) => createCurveNote(run)));
}

function createCurveNote(run) {
  const fileState = describeCurveFile(run);
  if (hasFailed(run) && !fileState) return html("p", {}, `${run.label} has no curves: ${run.status}.`);
  const others = groupCases().filter((other) => other.curves);
  if (isLoading(run) || !others.length) return html("p", {}, fileState ?? `${run.label} has no curves.`);
  const count = `${others.length} of ${groupCases().length} cases`;
  const nearest = nearestCase(run, others);
  const button = html("button", { type: "button", click: () => toggleCase(nearest.id) }, nearest.label);
  const file = run.file ? ` The rows of this case are in ${run.file}.` : "";
  const reason = fileState ?? `${run.label} has no curves on this page, which stores those of ${count}.`;
  return html("p", {}, `${reason}${file} Nearest: `, button);
}

// Case with the most similar parameters, of those listed; `axes` are the indices of the compared parameters.
function nearestCase(run, others, axes = Object.keys(run.at ?? [])) {
  const gap = (other) =>
    axes.reduce((sum, axis) => {
      const count = Math.max(page.sliders[axis].values.length - 1, 1);
      return sum + ((run.at[axis] - other.at[axis]) / count) ** 2;
    }, 0);
  return others.reduce((best, other) => (gap(other) < gap(best) ? other : best));
}

// Mark the points and rows of the selected cases with their numbers.
function markSelection(root) {
  const numbers = new Map(selectedCases().map(({ run, number }) => [run.id, number]));
  for (const element of root.querySelectorAll("[data-case]")) {
    const number = numbers.get(element.dataset.case);
    const isSelected = number !== undefined;
    element.classList.toggle("selected", isSelected);
    const label = element.querySelector(".number");
    if (label) label.textContent = number ?? "";
    // The name of a point contains its visible number.
    const { label: name } = element.dataset;
    if (name) element.setAttribute("aria-label", isSelected ? `${number}: ${name}` : name);
    if (isSelected && element.matches(".cell")) raiseCell(element);
    if (element.matches(".run, .cell")) element.setAttribute("aria-pressed", isSelected);
    else element.querySelector("input").checked = isSelected;
  }
}

// The frame of a selected cell lies above its neighbors. Moving an element takes its focus away.
function raiseCell(cell) {
  const isFocused = cell === document.activeElement;
  cell.parentNode.append(cell);
  if (isFocused) cell.focus({ preventScroll: true });
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
    if (page.profiles.length) drawProfile();
    drawPanels();
  };
  const content = [
    html("span", { class: "badge" }, number),
    createLineIcon({ ...lineStyle(color, number - 1), isData: run.points }),
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
