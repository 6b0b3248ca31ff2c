// Selected cases. Each case occupies a slot, which determines its number, and has a color for its curves.

const INITIAL_SELECTION = 7; // largest number of cases selected initially, one of each color

function toggleCase(id) {
  state.sliderSlot = null;
  const slot = state.slots.findIndex((entry) => entry?.run.id === id);
  if (slot >= 0) state.slots[slot] = null;
  else {
    const run = page.cases.find((other) => other.id === id);
    selectCase(run);
    showCase(run);
  }
  // Scroll the page so that the element under the pointer stays where it is, whatever changes above it.
  const element = document.querySelector("[data-case]:hover") ?? document.activeElement;
  const fixed = element.closest("tr, section") ?? element;
  const before = fixed.getBoundingClientRect().top;
  showSelection();
  if (fixed.isConnected) window.scrollBy(0, fixed.getBoundingClientRect().top - before);
}

function selectCase(run) {
  const freeSlot = state.slots.indexOf(null);
  const slot = freeSlot >= 0 ? freeSlot : state.slots.length;
  state.slots[slot] = { run, number: slot + 1, color: `color-${slot % COLOR_COUNT}` };
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
// that moves.
function selectInitialCases() {
  const candidates = groupCases().filter((run) => run.curves);
  const count = candidates.some((run) => run.points) ? candidates.length : Math.min(INITIAL_SELECTION, candidates.length);
  const share = (candidates.length - 1) / Math.max(count - 1, 1);
  state.slots = [];
  state.sliderSlot = null;
  const spread = Array.from({ length: count }, (_, k) => candidates[Math.round(k * share)]);
  (count ? spread : groupCases().filter((run) => run.frames).slice(0, 1)).forEach(selectCase);
}

function showSelection() {
  markSelection();
  byId("clear").disabled = !selectedCases().length;
  byId("selection").replaceChildren(...(page.cases.length > 1 ? selectedCases().map(createSelectionEntry) : []));
  explainMissingCurves();
  drawScatter();
  drawPanels();
}

// Below the selection: why curves of a selected case are missing.
function explainMissingCurves() {
  const count = groupCases().filter((run) => run.curves).length;
  const missing = count ? selectedCases().filter(({ run }) => !run.curves) : [];
  const notes = missing.map(({ run }) => {
    const file = run.file ? ` Its rows are in ${run.file}.` : "";
    const why = hasFailed(run) ? `: ${run.status}.` : ` on this page, which stores those of ${count} of ${groupCases().length} cases.${file}`;
    return html("p", {}, `${run.label} has no curves${why}`);
  });
  byId("selection-notes").replaceChildren(...notes);
}

// Case with the most similar parameters, of those listed.
function nearestCase(run, others) {
  const axes = Object.keys(run.at ?? []);
  const distance = (other) => axes.reduce((sum, axis) => sum + ((run.at[axis] - other.at[axis]) / page.sliders[axis].values.length) ** 2, 0);
  return others.reduce((best, other) => (distance(other) < distance(best) ? other : best));
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

// Button that removes a case from the selection.
function createSelectionEntry({ run, number, color }) {
  const icon = createLineIcon(themeColor(color), DASHES[(number - 1) % DASHES.length], run.points);
  const badge = html("span", { class: "badge" }, number);
  const attributes = { type: "button", class: "selection-entry", title: "remove", click: () => toggleCase(run.id) };
  return html("button", attributes, badge, icon, run.label, hasFailed(run) ? " (failed)" : "", " ×");
}
