// Sliders for the parameters of a sweep: the mechanism morphs between the cases whose motion is stored.

function drawSliders() {
  const isMoving = groupCases().some((run) => run.frames);
  const sliders = isMoving ? page.sliders : [];
  byId("sliders").replaceChildren(...sliders.map(createSlider));
}

function createSlider({ label, unit, values, isNumeric }, axis) {
  const name = unit && unit !== "-" ? `${label} [${unit}]` : label;
  const id = `slider-${axis}`;
  const slide = (event) => {
    state.position[axis] = Number(event.target.value);
    showPosition();
  };
  const attributes = { id, type: "range", min: 0, max: values.length - 1, step: isNumeric ? "any" : 1 };
  const input = html("input", { ...attributes, value: state.position[axis], input: slide, change: selectPosition });
  const output = html("output", { for: id });
  return html("div", { class: "controls" }, html("label", { for: id }, name), input, output);
}

// Value of a parameter at a position, which may lie between two of its values.
function valueAt({ values, isNumeric }, position) {
  const [k, share] = [Math.floor(position), position % 1];
  if (!share) return values[k];
  return isNumeric ? values[k] + share * (values[k + 1] - values[k]) : values[Math.round(position)];
}

// Show the motion at the position of the sliders.
function showPosition() {
  page.sliders.forEach((slider, axis) => {
    const text = formatValue(valueAt(slider, state.position[axis]));
    const input = byId(`slider-${axis}`);
    if (!input) return;
    input.value = state.position[axis];
    input.setAttribute("aria-valuetext", text);
    input.parentElement.querySelector("output").value = text;
  });
  const corners = findCorners();
  if (!corners.length) return;
  const frames = corners.length > 1 ? mixFrames(corners) : caseFrames(corners[0].run);
  const names = corners.map(({ run }) => run.label);
  const isBetween = corners.length > 1 || corners[0].run.at.some((k, axis) => k !== state.position[axis]);
  byId("shown").textContent = isBetween
    ? `interpolated between ${[...new Set([names[0], names.at(-1)])].join(" and ")}`
    : names[0];
  replaceFrames({ ...frames, extent: commonExtent() ?? frames.extent });
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
  }
  if (!run.at || !groupCases().some((other) => other.frames)) {
    showOwnFrames(run);
    return;
  }
  showPosition();
}

function showOwnFrames(run) {
  if (!run.frames) return;
  byId("shown").textContent = run.label;
  replaceFrames(caseFrames(run));
}

// Cases around the position with their weights, of those whose motion is stored. If the motions differ in their
// bodies or if one is missing, the nearest case alone.
function findCorners() {
  const stored = groupCases().filter((run) => run.frames);
  if (!stored.length) return [];
  let corners = [{ key: [], weight: 1 }];
  page.sliders.forEach((_, axis) => {
    const nodes = removeDuplicates(stored.map((run) => run.at[axis])).sort((a, b) => a - b);
    const position = clamp(state.position[axis], nodes[0], nodes.at(-1));
    const low = nodes.findLast((node) => node <= position);
    const high = nodes.find((node) => node >= position);
    const share = high > low ? (position - low) / (high - low) : 0;
    corners = corners.flatMap(({ key, weight }) => [
      { key: [...key, low], weight: weight * (1 - share) },
      ...(share ? [{ key: [...key, high], weight: weight * share }] : []),
    ]);
  });
  const byPosition = new Map(stored.map((run) => [run.at.join(), run]));
  const found = corners.map(({ key, weight }) => ({ run: byPosition.get(key.join()), weight }));
  const areAlike = found.every(({ run }) => run && haveSameShape(caseFrames(run), caseFrames(found[0].run)));
  if (areAlike) return found;
  return [{ run: nearestCase({ at: state.position }, stored), weight: 1 }];
}

function haveSameShape(frames, other) {
  const describe = ({ t, bodies, symbols, poses }) =>
    JSON.stringify([
      t.length,
      bodies.map(({ name, kind, points, heights }) => [name, kind, points, Boolean(heights)]),
      symbols.map(({ name, kind, at, to, points }) => [name, kind, at, to, points.map((point) => point === null)]),
      poses.length,
    ]);
  return describe(frames) === describe(other);
}

// Weighted mean of motions of the same bodies.
function mixFrames(corners) {
  const all = corners.map(({ run }) => caseFrames(run));
  const weights = corners.map(({ weight }) => weight);
  const mix = (select) => {
    const lists = all.map(select);
    const length = Math.max(...lists.map((list) => list.length));
    return Array.from({ length }, (_, k) => {
      let sum = 0;
      for (let i = 0; i < lists.length; i += 1) {
        const value = lists[i][lists[i].length > 1 ? k : 0];
        if (value === null) return null;
        sum += weights[i] * value;
      }
      return sum;
    });
  };
  const mixAxes = (part, k, axes) =>
    Object.fromEntries(axes.map((axis) => [axis, mix((frames) => frames[part][k][axis])]));
  const first = all[0];
  return {
    ...first,
    t: mix(({ t }) => t),
    bodies: first.bodies.map((body, k) => ({
      ...body,
      ...mixAxes("bodies", k, body.heights ? ["x", "y", "heights"] : ["x", "y"]),
    })),
    poses: first.poses.map((pose, k) => ({ ...pose, ...mixAxes("poses", k, ["x", "y", "turn"]) })),
    symbols: first.symbols.map((symbol, k) => ({
      ...symbol,
      points: symbol.points.map((point, i) => point && mix((frames) => frames.symbols[k].points[i])),
    })),
    colors: [],
  };
}

// Corners of the region that contains all motions: the scale does not change while the mechanism morphs.
function commonExtent() {
  const extents = removeMissing(groupCases().map((run) => run.frames?.extent));
  if (!extents.length) return null;
  const corner = (k, select) => [0, 1].map((axis) => select(...extents.map((extent) => extent[k][axis])));
  return [corner(0, Math.min), corner(1, Math.max)];
}
