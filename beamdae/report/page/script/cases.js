// Cases of the selected group and their quantities. Variables for a case are named `run` because `case` is
// a reserved word.

const MIN_LOG_RATIO = 50; // ratio of largest to smallest value that requires a logarithmic axis
const NOISE_RATIO = 1e-9; // to the next larger value; smaller values are zero but for rounding

function groupCases() {
  return page.cases.filter((run) => run.group === state.group.id);
}

function hasFailed(run) {
  return run.status !== "ok";
}

// Smallest error that the reference of the group resolves, or null.
function referenceResolution() {
  return state.group.reference?.uncertainty || null;
}

function titleOf({ label, unit }) {
  return unit && unit !== "-" ? `${label} [${unit}]` : label;
}

// Columns of the table with functions that return their values.
function addGetters(column) {
  const value = (run) => (column.kind === "error" || column.kind === "cost" ? run[column.kind] : getOwn(run.values, column.key));
  return { ...column, title: titleOf(column), value };
}

// Quantities that users can select for the axes of the scatter plot: wall time, error, numeric columns.
function listQuantities() {
  const numeric = page.columns.filter(({ kind }) => ["number", "error", "cost"].includes(kind));
  const missing = [
    { key: "cost", kind: "cost", label: "wall time", unit: "s" },
    { key: "error", kind: "error", label: "error", unit: "" },
  ].filter(({ kind }) => !numeric.some((column) => column.kind === kind));
  return [...missing, ...numeric].map(addGetters).filter(({ value }) => page.cases.some((run) => Number.isFinite(value(run))));
}

// Axes of error and wall time are logarithmic; other axes only if their values span a large range.
function needsLogAxis({ kind, value }, cases) {
  const values = removeMissing(cases.map(value)).sort((a, b) => a - b);
  const [low, high] = [values[0], values.at(-1)];
  if (kind !== "number") return low > 0;
  const hasNoise = values.some((x, k) => k > 0 && values[k - 1] < NOISE_RATIO * x);
  return low > 0 && high / low > MIN_LOG_RATIO && !hasNoise;
}

// Cases of the group with values of both axes.
function plottableCases() {
  const isDrawn = (run, { kind, value }) => Number.isFinite(value(run)) && (kind === "number" || value(run) > 0);
  const axes = axisQuantities();
  return groupCases().filter((run) => !hasFailed(run) && axes.every((axis) => axis && isDrawn(run, axis)));
}

// Pairs of name and value for the tooltip of a case.
function listCaseFacts(run) {
  const error = run.below ? `at most ${formatValue(run.error, 3)}, the resolution of the reference` : formatValue(run.error);
  const facts = [["error", run.error, error], ["wall time", run.cost, `${formatValue(run.cost)} s`]];
  const numeric = [...quantities.filter(({ key }) => key === "steps"), ...axisQuantities()].filter((one) => one?.kind === "number");
  const rows = facts.filter(([, value]) => value !== null).map(([name, , text]) => [name, text]);
  return [...rows, ...new Map(numeric.map(({ title, value }) => [title, formatValue(value(run))]))];
}

// Quantities of the x and y axes of the scatter plot, undefined if the page has too few quantities.
function axisQuantities() {
  const { x, y } = { ...page.axes, ...state.axes };
  const find = (key, kind, k) => quantities.find((one) => one.key === key) ?? quantities.find((one) => one.kind === kind) ?? quantities[k];
  return [find(x, "cost", 0), find(y, "error", 1)];
}

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

// Sliders for the parameters of a sweep: they show the motion of the nearest case whose motion is stored.

function drawSliders() {
  const isMoving = groupCases().some((run) => run.frames);
  byId("sliders").replaceChildren(...(isMoving ? page.sliders : []).map(createSlider));
}

function createSlider(parameter, axis) {
  const id = `slider-${axis}`;
  const slide = (event) => {
    state.position[axis] = Number(event.target.value);
    showPosition();
  };
  const attributes = { id, type: "range", min: 0, max: parameter.values.length - 1, step: 1 };
  const input = html("input", { ...attributes, value: state.position[axis], input: slide, change: selectPosition });
  return html("div", { class: "controls" }, html("label", { for: id }, titleOf(parameter)), input, html("output", { for: id }));
}

// Move the sliders to the position, and show the motion of the stored case next to it.
function showPosition() {
  page.sliders.forEach(({ values }, axis) => {
    const text = formatValue(values[state.position[axis]]);
    const input = byId(`slider-${axis}`);
    if (!input) return;
    input.value = state.position[axis];
    input.setAttribute("aria-valuetext", text);
    input.parentElement.querySelector("output").value = text;
  });
  const stored = groupCases().filter((run) => run.frames);
  if (stored.length) showFrames(nearestCase({ at: state.position }, stored));
}

// Select the case next to the sliders, in place of the case that they selected before.
function selectPosition() {
  const run = nearestCase({ at: state.position }, groupCases());
  if (state.sliderSlot !== null) state.slots[state.sliderSlot] = null;
  state.sliderSlot = null;
  if (!selectedCases().some((entry) => entry.run.id === run.id)) {
    selectCase(run);
    state.sliderSlot = state.slots.findIndex((entry) => entry?.run.id === run.id);
  }
  showSelection();
}

// Show the motion of a case, and move the sliders to it.
function showCase(run) {
  if (run.at) {
    state.position = [...run.at];
    showPosition();
  } else if (run.frames) showFrames(run);
}

function showFrames(run) {
  byId("shown").textContent = run.label;
  drawMotion({ ...run.frames, extent: commonExtent() ?? run.frames.extent });
}

// Corners of all motions of the group: all are shown at the same scale.
function commonExtent() {
  const extents = removeMissing(groupCases().map((run) => run.frames?.extent));
  if (!extents.length) return null;
  return [Math.min, Math.max].map((f, k) => [0, 1].map((i) => f(...extents.map((extent) => extent[k][i]))));
}
