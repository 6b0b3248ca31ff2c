// The cases of the group that is shown, and their numbers.

function casesHere() {
  return page.cases.filter((one) => one.group === state.group.id);
}

function failed(one) {
  return one.status !== "ok";
}

function resolution() {
  return state.group.reference?.uncertainty || null;
}

// Where its error is drawn.
function height(one) {
  return one.below && resolution() ? resolution() : one.error;
}

function errorText(one) {
  if (!one.below) return shown(one.error);
  return resolution()
    ? `at most ${shown(resolution(), 3)}, the reference resolves no less`
    : "less than the reference resolves";
}

// What cases can be drawn by: wall time, error and every column of numbers.
function allQuantities() {
  const valued = {
    error: height,
    cost: (one) => one.cost,
  };
  const known = page.columns.filter(({ kind }) => kind === "number" || valued[kind]);
  const missing = [
    { key: "cost", kind: "cost", label: "wall time", unit: "s" },
    { key: "error", kind: "error", label: "error", unit: "" },
  ].filter(({ kind }) => !known.some((column) => column.kind === kind));
  return [...missing, ...known]
    .map((column) => ({
      ...column,
      title: column.unit && column.unit !== "-" ? `${column.label} [${column.unit}]` : column.label,
      value: valued[column.kind] ?? ((one) => own(one.values, column.key)),
    }))
    .filter(({ value }) => page.cases.some((one) => Number.isFinite(value(one))));
}

// Errors and times span decades; so do others that say so themselves.
function logarithmic({ kind, value }, cases) {
  const [low, high] = extent([cases.map(value)]);
  return low > 0 && (kind !== "number" || high / low > 50);
}

function plottable(one, quantity) {
  const value = quantity.value(one);
  return !failed(one) && Number.isFinite(value) && (quantity.kind === "number" || value > 0);
}

function facts(one) {
  const rows = [["error", one.error === null ? null : errorText(one)]];
  if (one.cost !== null) rows.push(["wall time", `${shown(one.cost)} s`]);
  const steps = own(one.values, "steps");
  if (steps !== undefined) rows.push(["steps", shown(steps)]);
  const [x, y] = chosenAxes();
  for (const { kind, title, value, key } of [x, y].filter(Boolean)) {
    if (kind === "number" && key !== "steps") rows.push([title, shown(value(one))]);
  }
  return rows.filter((row) => row[1] !== null);
}

// The two quantities cases are drawn by; undefined where there are none.
function chosenAxes() {
  const named = (key) => quantities.find((one) => one.key === key);
  const kind = (name) => quantities.find((one) => one.kind === name);
  const { x, y } = { ...page.axes, ...state.axes };
  return [named(x) ?? kind("cost") ?? quantities[0], named(y) ?? kind("error") ?? quantities[1]];
}
