// Selected cases. Each case occupies a slot, which determines its number, and has a color for its curves.

const INITIAL_SELECTION = 7; // largest number of cases selected initially, one of each color

function toggleCase(id) {
  state.sliderSlot = null;
  const slot = state.slots.findIndex((entry) => entry?.run.id === id);
  if (slot >= 0) state.slots[slot] = null;
  else {
    selectCase(page.cases.find((run) => run.id === id));
    showCase(page.cases.find((run) => run.id === id));
  }
  keepInPlace(document.querySelector("[data-case]:hover") ?? document.activeElement, showSelection);
}

// Scroll the page so that an element stays where it is in the window, whatever changes above it.
function keepInPlace(element, change) {
  // Charts are created again, their sections stay.
  const fixed = element.closest("tr, section") ?? element;
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
  const isOwn = !page.sequential;
  const colors = isOwn ? [`color-${families.indexOf(run.family) % COLOR_COUNT}`] : ["color-0"];
  for (let k = isOwn ? families.length : 1; k < COLOR_COUNT; k += 1) colors.push(`color-${k}`);
  const countUses = (color) => selectedCases().filter((entry) => entry.color === color).length;
  return colors.sort((a, b) => countUses(a) - countUses(b))[0];
}

function selectedCases() {
  return state.slots.filter((entry) => entry);
}

function clearSelection() {
  state.slots = [];
  state.sliderSlot = null;
  showSelection();
}

// Select cases that are spread over all cases with curves; with measured data, all. Without any curves, the first case
// that moves; with profiles, the first ones.
function selectInitialCases() {
  const cases = groupCases();
  const drawn = cases.filter((run) => run.curves);
  const candidates = drawn.length ? drawn : cases.filter(mayHaveCurves);
  const moving = cases.filter((run) => run.frames);
  state.slots = [];
  state.sliderSlot = null;
  let initial = spreadCases(candidates);
  if (candidates.some((run) => run.points)) initial = candidates;
  if (!candidates.length) initial = moving.slice(0, page.profiles.length ? INITIAL_SELECTION : 1);
  initial.forEach(selectCase);
}

function spreadCases(candidates) {
  const count = Math.min(INITIAL_SELECTION, candidates.length);
  const last = candidates.length - 1;
  return Array.from({ length: count }, (_, k) => candidates[Math.round((k * last) / Math.max(count - 1, 1))]);
}

function showSelection() {
  markSelection();
  byId("clear").disabled = !selectedCases().length;
  drawSelectionLegend();
  explainMissingCurves();
  drawScatter();
  drawMap();
  drawPortrait();
  drawProfile();
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
  if (curveFiles.get(run.block) === "loading" || !others.length) return html("p", {}, fileState ?? `${run.label} has no curves.`);
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

// Mark the rows of the selected cases with their numbers.
function markSelection() {
  const numbers = new Map(selectedCases().map(({ run, number }) => [run.id, number]));
  for (const row of document.querySelectorAll("#table [data-case]")) {
    const number = numbers.get(row.dataset.case);
    row.classList.toggle("selected", number !== undefined);
    row.querySelector(".number").textContent = number ?? "";
    row.querySelector("input").checked = number !== undefined;
  }
}

function drawSelectionLegend() {
  const entries = page.cases.length > 1 ? selectedCases().map(createSelectionEntry) : [];
  byId("selection").replaceChildren(...entries);
}

// Button that removes a case from the selection.
function createSelectionEntry({ run, number, color }) {
  const icon = createLineIcon({ ...lineStyle(themeColor(color), number - 1), isData: run.points });
  const badge = html("span", { class: "badge" }, number);
  const attributes = { type: "button", class: "selection-entry", title: "remove", click: () => toggleCase(run.id) };
  return html("button", attributes, badge, icon, run.label, hasFailed(run) ? " (failed)" : "", " ×");
}
