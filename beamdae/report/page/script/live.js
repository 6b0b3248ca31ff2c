// Live view: controls of the parameters, the drawing that follows them, and runs.

const SLIDER_STEPS = 400;
const FIELD_DIGITS = 6;
const MIN_STAGE_SHARE = 0.3; // of the picture; a smaller mechanism gets a new scale
const live = { controls: [], values: {}, number: 0, isBusy: false, isRunning: false, next: null, extent: null };

function startLiveView() {
  const { name, summary, controls, t_end, first } = parseData(byId("data").textContent);
  byId("title").textContent = name;
  byId("subtitle").textContent = summary.replaceAll("`", "");
  byId("end").value = t_end;
  live.controls = controls;
  listenToPlayer();
  byId("sliders").replaceChildren(...controls.map(createControl));
  byId("run").addEventListener("click", () => request("run"));
  byId("end").addEventListener("change", () => request("run"));
  byId("reset").addEventListener("click", resetControls);
  showAnswer("draw", first);
  if (!first.error) request("run");
}

// Row with the control of a parameter; `control.show` shows a value.
function createControl(control) {
  const { name, description, kind, value } = control;
  const id = `parameter-${name}`;
  const create = { flag: createBox, choice: createChoice }[kind] ?? createField;
  const label = html("label", { for: id, title: description.replaceAll("`", "") }, name);
  control.row = html("div", { class: `parameter ${kind}` }, label, ...create(control, id));
  control.show(value);
  return control.row;
}

function createBox(control, id) {
  const box = html("input", { id, type: "checkbox", change: () => changeValue(control, box.checked, true) });
  control.show = (shown) => (box.checked = shown);
  return [box];
}

function createChoice(control, id) {
  const options = control.choices.map((text) => html("option", { value: text }, text));
  const select = html("select", { id, change: () => changeValue(control, select.value, true) }, ...options);
  control.show = (shown) => (select.value = shown);
  return [select];
}

function createField(control, id) {
  const { kind, low } = control;
  const unit = control.unit === "-" ? "" : control.unit;
  const field = html("input", {
    id,
    type: "text",
    inputmode: kind === "text" ? "text" : "decimal",
    autocomplete: "off",
    spellcheck: "false",
    change: () => changeValue(control, readField(field.value, kind), true),
  });
  const slider = low === undefined ? null : createSlider(control, field, unit);
  control.show = (shown) => {
    const isNumber = typeof shown === "number";
    field.value = isNumber ? formatPlain(shown) : shown;
    if (slider && isNumber) slider.value = control.toPosition(shown);
  };
  const shownUnit = kind === "text" ? [] : [html("span", { class: "unit" }, unit)];
  return [field, ...shownUnit, ...(slider ? [slider] : [])];
}

function createSlider(control, field, unit) {
  const { name, low, high, kind, log } = control;
  const [toPosition, toValue] = log ? [Math.log, Math.exp] : [Number, Number];
  const [min, max] = [toPosition(low), toPosition(high)];
  control.toPosition = toPosition;
  const title = `${formatPlain(low)} to ${formatPlain(high)} ${unit}`.trim();
  const move = (isReleased) => {
    const value = Number(formatPlain(toValue(slider.value)));
    field.value = formatPlain(value);
    slider.setAttribute("aria-valuetext", `${field.value} ${unit}`.trim());
    changeValue(control, value, isReleased, true);
  };
  const step = kind === "integer" ? 1 : (max - min) / SLIDER_STEPS;
  const attributes = { type: "range", min, max, step, "aria-label": name, title };
  const slider = html("input", { ...attributes, input: () => move(false), change: () => move(true) });
  return slider;
}

function formatPlain(value) {
  return String(Number(value.toPrecision(FIELD_DIGITS)));
}

// Numbers are sent as numbers; other texts, such as "850 mm", are converted by the model.
function readField(text, kind) {
  const isNumber = kind !== "text" && text.trim() !== "" && Number.isFinite(Number(text));
  return isNumber ? Number(text) : text;
}

function changeValue(control, value, isReleased, isFromSlider = false) {
  if (value === control.value) delete live.values[control.name];
  else live.values[control.name] = value;
  control.row.classList.toggle("changed", value !== control.value);
  if (!isFromSlider) control.show(value);
  showCommand();
  request(isReleased && byId("follow").checked ? "run" : "draw");
}

function resetControls() {
  Object.assign(live, { values: {}, extent: null });
  for (const { show, row, value } of live.controls) {
    show(value);
    row.classList.remove("changed");
  }
  showCommand();
  request("run");
}

function showCommand() {
  const settings = Object.entries(live.values).map((pair) => pair.join("="));
  const quoted = settings.map((setting) => ` --set ${/^[\w=.+-]+$/.test(setting) ? setting : `'${setting}'`}`);
  byId("command").hidden = !settings.length;
  byId("command").querySelector("code").textContent = `beamdae run MODEL${quoted.join("")}`;
}

// One request at a time: while one is in progress, only the latest waits. A run is first drawn. A request that
// follows a run ends it in the server.
async function request(action) {
  pause();
  if (live.isBusy && !live.isRunning) {
    live.next = action;
    return;
  }
  live.number += 1;
  Object.assign(live, { isBusy: true, isRunning: false, next: null });
  const { number } = live;
  const drawing = await send("draw");
  if (live.number !== number) return;
  showAnswer("draw", drawing);
  if (live.next === null && action === "run" && !drawing.error) {
    live.isRunning = true;
    showState("running …");
    const result = await send("run");
    if (live.number !== number) return;
    showAnswer("run", result);
  }
  Object.assign(live, { isBusy: false, isRunning: false });
  if (live.next !== null) request(live.next);
}

async function send(action) {
  const body = JSON.stringify({ values: live.values, t_end: readField(byId("end").value, "number") });
  try {
    const response = await fetch(action, { method: "POST", headers: { "Content-Type": "application/json" }, body });
    return response.ok ? parseData(await response.text()) : { error: await response.text() };
  } catch {
    return { error: "The server does not answer; start `beamdae view` again." };
  }
}

function showAnswer(action, { superseded, error, frames, status, ok, warnings, table }) {
  if (superseded) return showState("Stopped by a later request.");
  if (error) return showState(error, true);
  if (!frames) return showState("The run cannot be animated.", true);
  const { color } = motion;
  motion.frames = null;
  drawMotion(withCommonExtent(frames), action === "run" ? (frames.colors.find(({ title }) => title === live.color?.title) ?? null) : null);
  live.color = action === "run" ? motion.color : (color ?? live.color);
  if (action === "draw") return showState("");
  showState(status, !ok);
  showResults(warnings, table);
  if (frames.t.length > 1) play();
}

// Drawings and runs have one scale, which grows with the mechanism, so that changes of size are seen.
function withCommonExtent(frames) {
  const [low, high] = frames.extent;
  const [left, right] = live.extent ?? frames.extent;
  const common = [low.map((x, k) => Math.min(x, left[k])), high.map((x, k) => Math.max(x, right[k]))];
  const sizeOf = ([first, last]) => Math.max(...last.map((x, k) => x - first[k]));
  live.extent = sizeOf(frames.extent) < MIN_STAGE_SHARE * sizeOf(common) ? frames.extent : common;
  return { ...frames, extent: live.extent };
}

function showState(text, isAlarm = false) {
  byId("state").textContent = text;
  byId("state").classList.toggle("alarm", isAlarm);
}

function showResults(warnings, { head, rows }) {
  byId("results").hidden = !rows.length && !warnings.length;
  byId("notes").hidden = !warnings.length;
  byId("notes").replaceChildren(...warnings.map((text) => html("li", {}, text)));
  const createRow = (cells, tag) => html("tr", {}, ...cells.map((cell, k) => html(tag, { class: k > 0 && "number" }, cell)));
  const body = html("tbody", {}, ...rows.map((cells) => createRow(cells, "td")));
  byId("table").replaceChildren(html("thead", {}, createRow(head, "th")), body);
}

startLiveView();
