// Error over wall time.

const ARROW = "M0 8V22M-4 17L0 22L4 17";

function drawPrecision() {
  const cases = casesHere()
    .filter(plottable)
    .sort((one, other) => height(other) - height(one) || one.cost - other.cost);
  const plot = cases.length
    ? precisionPlot(cases)
    : empty("No case of this model has both an error and a wall time.");
  byId("precision-plot").replaceChildren(plot);
  byId("families").replaceChildren(...(cases.length ? precisionLegend(cases) : []));
}

function precisionPlot(cases) {
  const box = plotBox(640, 400);
  const x = scale(padded(extent([cases.map((one) => one.cost)]), true), [box.left, box.right], true);
  const y = scale(padded(errorExtent(cases), true), [box.bottom, box.top], true);
  const place = (one) => [x.at(one.cost), y.at(height(one))];
  const points = cases.map((one) => point(one, place(one)));
  const plot = canvas(
    box,
    "error over wall time, one point a case",
    ...resolutionBand(box, y),
    ...axes(box, x, y, { x: "wall time [s]", y: "error" }),
    ...resolutionLine(box, y),
    ...seriesLines(cases, place),
    ...points,
  );
  plot.addEventListener("keydown", walk);
  points[0].setAttribute("tabindex", "0");
  return plot;
}

function errorExtent(cases) {
  const [low, high] = extent([cases.map(height)]);
  const near = resolution() && resolution() > low / 100;
  return near ? [Math.min(low, resolution()), Math.max(high, resolution())] : [low, high];
}

function within(value, axis, box) {
  const place = axis.at(value);
  return place >= box.top && place <= box.bottom;
}

function resolutionBand(box, y) {
  if (!resolution() || !within(resolution(), y, box)) return [];
  const top = y.at(resolution());
  return [
    svg("rect", {
      class: "unresolved",
      x: box.left,
      y: top,
      width: box.right - box.left,
      height: box.bottom - top,
    }),
  ];
}

function resolutionLine(box, y) {
  if (!resolution() || !within(resolution(), y, box)) return [];
  const place = y.at(resolution());
  const text = { class: "halo", x: box.left + 6, y: place < box.top + 20 ? place + 15 : place - 6 };
  return [
    svg("line", { class: "resolution", x1: box.left, x2: box.right, y1: place, y2: place }),
    svg("text", text, `the reference resolves ${shown(resolution(), 3)}`),
  ];
}

function seriesLines(cases, place) {
  return distinct(known(cases.map((one) => one.series))).flatMap((series) => {
    const members = cases.filter((one) => one.series === series).sort((one, other) => one.rank - other.rank);
    return members.slice(1).map((one, k) => joined(members[k], one, place));
  });
}

function joined(one, other, place) {
  const [[x1, y1], [x2, y2]] = [place(one), place(other)];
  const open = one.below || other.below ? "dashed" : "";
  return svg("line", { class: `series ${familyColor(one.family)} ${open}`, x1, y1, x2, y2 });
}

function point(one, [x, y]) {
  const attributes = {
    class: `run ${familyColor(one.family)} ${one.below ? "hollow" : ""}`,
    transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})`,
    "data-case": one.id,
    tabindex: "-1",
    role: "button",
    "aria-label": [one.label, ...facts(one).map((row) => row.join(" "))].join(", "),
    click: () => toggle(one.id),
    pointerenter: (event) => showTip(event.clientX, event.clientY, ...caseTip(one)),
    pointerleave: hideTip,
    focus: (event) => showBeside(event.currentTarget, caseTip(one)),
    blur: hideTip,
  };
  const arrow = one.below ? [svg("path", { class: "arrow", d: ARROW })] : [];
  const ring = svg("circle", { class: "ring", r: 10 });
  return svg(
    "g",
    attributes,
    ring,
    ...arrow,
    mark(one.family),
    svg("text", { class: "number halo", x: 10, y: -8 }),
  );
}

function caseTip(one) {
  return [
    html("strong", {}, one.label),
    html("table", {}, ...facts(one).map((row) => html("tr", {}, ...row.map((text) => html("td", {}, text))))),
  ];
}

function walk(event) {
  const points = [...event.currentTarget.querySelectorAll(".run")];
  const here = points.indexOf(document.activeElement);
  const way = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
  if (event.key === "Enter" || event.key === " ") toggle(points[here].dataset.case);
  else if (way) moveFocus(points, here, (here + way + points.length) % points.length);
  else return;
  event.preventDefault();
}

function moveFocus(points, from, to) {
  points[from].setAttribute("tabindex", "-1");
  points[to].setAttribute("tabindex", "0");
  points[to].focus();
}

function precisionLegend(cases) {
  const entry = (image, text) => html("span", {}, image, text);
  const present = families.filter((family) => cases.some((one) => one.family === family));
  const entries = present.map((family) => entry(familySign(family), family));
  const below = cases.find((one) => one.below);
  if (below)
    entries.push(entry(familySign(below.family, "hollow"), "at most this: less than the reference resolves"));
  return entries;
}

function drawUnplotted() {
  const broken = casesHere().filter(failed);
  const unmeasured = casesHere().filter((one) => !failed(one) && !plottable(one)).length;
  const parts = [];
  if (broken.length)
    parts.push(
      html("strong", {}, `Failed, not drawn: ${broken.length}`),
      html("ul", {}, ...broken.map(failure)),
    );
  if (unmeasured)
    parts.push(html("p", { class: "quiet" }, `Without an error or a wall time, not drawn: ${unmeasured}`));
  byId("unplotted").replaceChildren(...parts);
}

function failure(one) {
  const button = html(
    "button",
    { type: "button", click: () => toggle(one.id) },
    familySign(one.family),
    " ",
    one.label,
  );
  const tag = one.limited ? [html("span", { class: "tag" }, "limited"), " "] : [];
  return html("li", {}, button, " ", ...tag, one.status);
}
