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
