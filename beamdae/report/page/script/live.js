// Live view: controls of the parameters, the drawing that follows them, and runs.

const SLIDER_STEPS = 400;
const SLIDER_DIGITS = 4;
const FIELD_DIGITS = 6;
const MIN_STAGE_SHARE = 0.3; // of the picture; a smaller mechanism gets a new scale
const live = { controls: [], values: {}, isBusy: false, next: null, extent: null };

function startLiveView() {
  const { name, summary, controls, t_end, first } = JSON.parse(byId("data").textContent);
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

function createControl(control) {
  const { name, unit, description, kind, value } = control;
  const id = `parameter-${name}`;
  const label = html("label", { for: id, title: description.replaceAll("`", "") }, name);
  const shownUnit = unit === "-" ? "" : unit;
  const row = html("div", { class: `parameter ${kind}` }, label);
  control.row = row;
  if (kind === "flag") {
    const box = html("input", { id, type: "checkbox", change: () => changeValue(control, box.checked, true) });
    control.show = (shown) => {
      box.checked = shown;
    };
    row.append(box);
  } else if (kind === "choice") {
    const select = html(
      "select",
      { id, change: () => changeValue(control, select.value, true) },
      ...control.choices.map((text) => html("option", { value: text }, text)),
    );
    control.show = (shown) => {
      select.value = shown;
    };
    row.append(select);
  } else {
    const suggestions = control.choices ? `choices-${name}` : false;
    if (suggestions) {
      const options = control.choices.map((text) => html("option", { value: text }));
      row.append(html("datalist", { id: suggestions }, ...options));
    }
    const field = html("input", {
      id,
      list: suggestions,
      type: "text",
      inputmode: kind === "text" ? "text" : "decimal",
      autocomplete: "off",
      spellcheck: "false",
      change: () => changeValue(control, readField(field.value, kind), true),
    });
    row.append(field, ...(kind === "text" ? [] : [html("span", { class: "unit" }, shownUnit)]));
    const slider = control.low === undefined ? null : createSlider(control, field, shownUnit);
    if (slider) row.append(slider);
    control.show = (shown) => {
      field.value = typeof shown === "number" ? formatPlain(shown) : shown;
      if (slider && typeof shown === "number") slider.value = toPosition(control, shown);
    };
  }
  control.show(value);
  return row;
}

function createSlider(control, field, unit) {
  const { name, low, high, kind } = control;
  const steps = kind === "integer" ? high - low : SLIDER_STEPS;
  const slider = html("input", { type: "range", min: 0, max: steps, step: 1, "aria-label": name });
  const move = (isReleased) => {
    const value = toValue(control, Number(slider.value), steps);
    field.value = formatPlain(value);
    slider.setAttribute("aria-valuetext", `${formatPlain(value)} ${unit}`.trim());
    changeValue(control, value, isReleased, true);
  };
  slider.addEventListener("input", () => move(false));
  slider.addEventListener("change", () => move(true));
  control.steps = steps;
  slider.title = `${formatPlain(low)} to ${formatPlain(high)} ${unit}`.trim();
  return slider;
}

function toValue({ low, high, log, kind }, position, steps) {
  if (kind === "integer") return low + position;
  const share = position / steps;
  const value = log ? low * (high / low) ** share : low + (high - low) * share;
  // Rounded relative to the range, so that a slider through zero reaches zero.
  const unit = log ? value : high - low;
  const digit = 10 ** (Math.floor(Math.log10(Math.abs(unit))) - SLIDER_DIGITS + 1);
  return Number((Math.round(value / digit) * digit).toPrecision(12));
}

function toPosition({ low, high, log, steps }, value) {
  const share = log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  return Math.round(clamp(share, 0, 1) * steps);
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
  for (const control of live.controls) {
    control.show(control.value);
    control.row.classList.remove("changed");
  }
  showCommand();
  request("run");
}

function showCommand() {
  const settings = Object.entries(live.values).map(([name, value]) => {
    const setting = `${name}=${value}`;
    return ` --set ${/^[\w=.+-]+$/.test(setting) ? setting : `'${setting}'`}`;
  });
  byId("command").hidden = !settings.length;
  byId("command").querySelector("code").textContent = `beamdae run MODEL${settings.join("")}`;
}

// One request at a time: while one is in progress, only the latest waits. A run is first drawn. A request that
// follows a run ends it in the server.
async function request(action) {
  pause();
  if (live.isBusy && live.action !== "run") {
    live.next = action;
    return;
  }
  const number = (live.number ?? 0) + 1;
  Object.assign(live, { isBusy: true, number, action: "draw", next: null });
  const isCurrent = () => live.number === number;
  const drawing = await send("draw");
  if (!isCurrent()) return;
  showAnswer("draw", drawing);
  if (live.next === null && action === "run" && !drawing.error) {
    live.action = "run";
    showState("running …");
    const result = await send("run");
    if (!isCurrent()) return;
    showAnswer("run", result);
  }
  live.isBusy = false;
  const { next } = live;
  if (next !== null) request(next);
}

async function send(action) {
  const body = JSON.stringify({ values: live.values, t_end: readField(byId("end").value, "number") });
  try {
    const response = await fetch(action, { method: "POST", headers: { "Content-Type": "application/json" }, body });
    return response.ok ? await response.json() : { error: await response.text() };
  } catch {
    return { error: "The server does not answer; start `beamdae view` again." };
  }
}

function showAnswer(action, answer) {
  if (answer.superseded) {
    showState("Stopped by a later request.");
    return;
  }
  if (answer.error) {
    showState(answer.error, true);
    return;
  }
  if (!answer.frames) {
    showState("The run cannot be animated.", true);
    return;
  }
  const frames = withCommonExtent(decodeFrames(answer.frames));
  if (action === "draw") {
    showState("");
    drawMotion(frames);
    return;
  }
  showState(answer.status, !answer.ok);
  const color = frames.colors.find(({ title }) => title === motion.color?.title) ?? null;
  drawMotion(frames, color);
  showResults(answer);
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

function showResults({ warnings, table }) {
  byId("results").hidden = !table.rows.length && !warnings.length;
  byId("notes").hidden = !warnings.length;
  byId("notes").replaceChildren(...warnings.map((text) => html("li", {}, text)));
  const createCell = (tag) => (cell, k) => html(tag, { class: k > 0 && "number" }, cell);
  const createRow = (cells, tag) => html("tr", {}, ...cells.map(createCell(tag)));
  byId("table").replaceChildren(
    html("thead", {}, createRow(table.head, "th")),
    html("tbody", {}, ...table.rows.map((cells) => createRow(cells, "td"))),
  );
}

startLiveView();
