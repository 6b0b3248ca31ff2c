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

function formatError(run) {
  if (!run.below) return formatValue(run.error);
  return `at most ${formatValue(run.error, 3)}, the resolution of the reference`;
}

// Quantities that users can select for the axes of the scatter plot: wall time, error, numeric columns.
function listQuantities() {
  const getters = {
    error: (run) => run.error,
    cost: (run) => run.cost,
  };
  const numeric = page.columns.filter(({ kind }) => kind === "number" || getters[kind]);
  const missing = [
    { key: "cost", kind: "cost", label: "wall time", unit: "s" },
    { key: "error", kind: "error", label: "error", unit: "" },
  ].filter(({ kind }) => !numeric.some((column) => column.kind === kind));
  return [...missing, ...numeric]
    .map((column) => ({
      ...column,
      title: column.unit && column.unit !== "-" ? `${column.label} [${column.unit}]` : column.label,
      value: getters[column.kind] ?? ((run) => getOwn(run.values, column.key)),
    }))
    .filter(({ value }) => page.cases.some((run) => Number.isFinite(value(run))));
}

// Axes of error and wall time are logarithmic; other axes only if their values span a large range.
function needsLogAxis({ kind, value }, cases) {
  const values = removeMissing(cases.map(value)).sort((a, b) => a - b);
  const [low, high] = [values[0], values.at(-1)];
  if (kind !== "number") return low > 0;
  const hasNoise = values.some((x, k) => k > 0 && values[k - 1] < NOISE_RATIO * x);
  return low > 0 && high / low > MIN_LOG_RATIO && !hasNoise;
}

function isPlottable(run, quantity) {
  const value = quantity.value(run);
  return !hasFailed(run) && Number.isFinite(value) && (quantity.kind === "number" || value > 0);
}

// Pairs of name and value for the tooltip of a case.
function listCaseFacts(run) {
  const rows = [];
  if (run.error !== null) rows.push(["error", formatError(run)]);
  if (run.cost !== null) rows.push(["wall time", `${formatValue(run.cost)} s`]);
  const steps = getOwn(run.values, "steps");
  if (steps !== undefined) rows.push(["steps", formatValue(steps)]);
  for (const { kind, title, value, key } of axisQuantities().filter(Boolean)) {
    if (kind === "number" && key !== "steps") rows.push([title, formatValue(value(run))]);
  }
  return rows;
}

// Quantities of the x and y axes of the scatter plot, undefined if the page has too few quantities.
function axisQuantities() {
  const byKey = (key) => quantities.find((quantity) => quantity.key === key);
  const byKind = (kind) => quantities.find((quantity) => quantity.kind === kind);
  const { x, y } = { ...page.axes, ...state.axes };
  return [byKey(x) ?? byKind("cost") ?? quantities[0], byKey(y) ?? byKind("error") ?? quantities[1]];
}
