// Sliders for the parameters of a sweep: they show the motion of the nearest case whose motion is stored.

function drawSliders() {
  const isMoving = groupCases().some((run) => run.frames);
  const sliders = isMoving ? page.sliders : [];
  byId("sliders").replaceChildren(...sliders.map(createSlider));
}

function createSlider({ label, unit, values }, axis) {
  const name = unit && unit !== "-" ? `${label} [${unit}]` : label;
  const id = `slider-${axis}`;
  const slide = (event) => {
    state.position[axis] = Number(event.target.value);
    showPosition();
  };
  const attributes = { id, type: "range", min: 0, max: values.length - 1, step: 1 };
  const input = html("input", { ...attributes, value: state.position[axis], input: slide, change: selectPosition });
  const output = html("output", { for: id });
  return html("div", { class: "controls" }, html("label", { for: id }, name), input, output);
}

// Show the motion of the stored case next to the position of the sliders.
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
  const here = { at: state.position };
  const run = nearestCase(here, groupCases());
  if (state.sliderSlot !== null) state.slots[state.sliderSlot] = null;
  state.sliderSlot = null;
  if (!selectedCases().some((entry) => entry.run.id === run.id)) {
    selectCase(run);
    state.sliderSlot = state.slots.findIndex((entry) => entry?.run.id === run.id);
  }
  updateMap();
  showSelection();
}

// Show the motion of a case, and move the sliders and the map to it.
function showCase(run) {
  if (run.at) {
    state.position = [...run.at];
    updateMap();
    showPosition();
  } else if (run.frames) showFrames(run);
}

function showFrames(run) {
  byId("shown").textContent = run.label;
  const frames = caseFrames(run);
  replaceFrames({ ...frames, extent: commonExtent() ?? frames.extent });
}

// Corners of the region that contains all motions: the scale does not change from case to case.
function commonExtent() {
  const extents = removeMissing(groupCases().map((run) => run.frames?.extent));
  if (!extents.length) return null;
  const corner = (k, select) => [0, 1].map((axis) => select(...extents.map((extent) => extent[k][axis])));
  return [corner(0, Math.min), corner(1, Math.max)];
}
