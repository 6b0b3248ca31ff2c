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
