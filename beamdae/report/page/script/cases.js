// The cases of the group that is shown.

function casesHere() {
  return page.cases.filter((one) => one.group === state.group.id);
}

function failed(one) {
  return one.status !== "ok";
}

function resolution() {
  return state.group.reference?.uncertainty || null;
}

function height(one) {
  return one.below && resolution() ? resolution() : one.error;
}

function plottable(one) {
  return !failed(one) && height(one) > 0 && one.cost > 0;
}

function errorText(one) {
  if (!one.below) return shown(one.error);
  return resolution()
    ? `at most ${shown(resolution(), 3)}, the reference resolves no less`
    : "less than the reference resolves";
}

function facts(one) {
  const rows = [
    ["error", errorText(one)],
    ["wall time", one.cost === null ? "–" : `${shown(one.cost)} s`],
  ];
  const steps = own(one.values, "steps");
  if (steps !== undefined) rows.push(["steps", shown(steps)]);
  return rows;
}
