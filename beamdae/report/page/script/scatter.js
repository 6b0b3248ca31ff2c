// Cases as points: error over wall time, or any two of their numbers.

const ARROW = "M0 8V22M-4 17L0 22L4 17";

function drawScatter() {
  const [x, y] = chosenAxes();
  const cases = x && y ? casesHere().filter((one) => plottable(one, x) && plottable(one, y)) : [];
  byId("precision").hidden = !scatters();
  byId("scatter-title").replaceChildren(...scatterTitle(x, y));
  byId("families").replaceChildren(...(cases.length ? familyLegend(cases, y) : []));
  if (!cases.length) {
    const both = x && y ? `${y.label} and ${x.label}` : "an error and a wall time";
    byId("precision-plot").replaceChildren(empty(`No case of this model has both ${both}.`));
    return;
  }
  const made = chart(scatterSpec(cases, x, y));
  made.plot.addEventListener("keydown", walk);
  state.charts.set("scatter", made);
  byId("precision-plot").replaceChildren(made.element);
  drawChart(made);
}

// A page of one run has nothing to compare.
function scatters() {
  return page.cases.length > 1 || page.columns.length > 0;
}

function scatterTitle(x, y) {
  const name = (one) => (one.kind === "number" ? one.label : capital(one.label));
  const title = html("h2", {}, x && y ? `${name(y)} over ${x.label}` : "Cases");
  if (quantities.length < 3) return [title];
  return [title, axisChoice("y", y), axisChoice("x", x)];
}

function axisChoice(way, chosen) {
  const options = quantities.map((one) => html("option", { selected: one === chosen && "" }, one.title));
  const change = (event) => {
    state.axes[way] = quantities[event.target.selectedIndex].key;
    state.views.scatter = { x: null, y: null };
    drawScatter();
    drawUnplotted();
  };
  return html("label", {}, `${way} `, html("select", { "aria-label": `${way} axis`, change }, ...options));
}

function capital(text) {
  return text.slice(0, 1).toUpperCase() + text.slice(1);
}

function scatterSpec(cases, x, y) {
  const shown = cases.filter((one) => !state.hidden.families.has(one.family));
  const measured = y.kind === "error";
  const log = { x: logarithmic(x, cases), y: logarithmic(y, cases) };
  const heights = measured ? errorExtent(cases) : extent([cases.map(y.value)]);
  const place = (one, ax, ay) => [ax.at(x.value(one)), ay.at(y.value(one))];
  const inside = (one, ax, ay, box) => {
    const [a, b] = place(one, ax, ay);
    return within(a, [box.left, box.right]) && within(b, [box.top, box.bottom]);
  };
  return {
    id: "scatter",
    name: `${y.label} over ${x.label}`,
    label: `${y.label} over ${x.label}, one point a case`,
    x: { title: x.title, range: padded(extent([cases.map(x.value)]), log.x), log: log.x },
    y: { title: y.title, range: padded(heights, log.y), log: log.y },
    view: state.views.scatter,
    height: (width) => Math.min(Math.max(0.625 * width, 260), 460),
    under: (box, _, ay) => (measured ? resolutionBand(box, ay) : []),
    inside: (_, ax, ay) => seriesLines(shown, (one) => place(one, ax, ay), measured),
    over: (box, ax, ay) => [
      ...(measured ? resolutionLine(box, ay) : []),
      ...[...shown]
        .filter((one) => inside(one, ax, ay, box))
        .sort((one, other) => place(one, ax, ay)[0] - place(other, ax, ay)[0])
        .map((one) => point(one, place(one, ax, ay), measured)),
    ],
    drawn: ({ plot }) => {
      plot.querySelector(".run")?.setAttribute("tabindex", "0");
      markSelection(plot);
    },
    legend: () =>
      families
        .filter((family) => shown.some((one) => one.family === family))
        .map((family) => ({ sign: familySign(family), text: family })),
    rows: () => [
      ["case", x.title, y.title, ...(measured ? ["below what the reference resolves"] : [])],
      ...shown.map((one) => [
        one.label,
        x.value(one),
        y.value(one),
        ...(measured ? [one.below ? "yes" : "no"] : []),
      ]),
    ],
  };
}

function errorExtent(cases) {
  const [low, high] = extent([cases.map(height)]);
  const near = resolution() && resolution() > low / 100;
  return near ? [Math.min(low, resolution()), Math.max(high, resolution())] : [low, high];
}

function resolvedAt(box, y) {
  const place = resolution() ? y.at(resolution()) : null;
  return place !== null && within(place, [box.top, box.bottom]) ? place : null;
}

function resolutionBand(box, y) {
  const top = resolvedAt(box, y);
  return top === null ? [] : [frame({ ...box, top }, { class: "unresolved" })];
}

function resolutionLine(box, y) {
  const place = resolvedAt(box, y);
  if (place === null) return [];
  const text = { class: "halo", x: box.left + 6, y: place < box.top + 20 ? place + 15 : place - 6 };
  return [
    svg("line", { class: "resolution", x1: box.left, x2: box.right, y1: place, y2: place }),
    svg("text", text, `the reference resolves ${shown(resolution(), 3)}`),
  ];
}

// Cases of a series are joined in the order of their ranks.
function seriesLines(cases, place, measured) {
  return distinct(known(cases.map((one) => one.series))).flatMap((series) => {
    const members = cases.filter((one) => one.series === series).sort((one, other) => one.rank - other.rank);
    return members.slice(1).map((one, k) => joined(members[k], one, place, measured));
  });
}

function joined(one, other, place, measured) {
  const [[x1, y1], [x2, y2]] = [place(one), place(other)];
  const open = measured && (one.below || other.below) ? "dashed" : "";
  return svg("line", { class: `series ${familyColor(one.family)} ${open}`, x1, y1, x2, y2 });
}

function point(one, [x, y], measured) {
  const hollow = measured && one.below;
  const attributes = {
    class: `run ${familyColor(one.family)} ${hollow ? "hollow" : ""}`,
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
  const arrow = hollow ? [svg("path", { class: "arrow", d: ARROW })] : [];
  const ring = svg("circle", { class: "ring", r: 11 });
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
  if (here < 0 && way) moveFocus(points, 0, 0);
  else if (event.key === "Enter" || event.key === " ") points[here] && toggle(points[here].dataset.case);
  else if (way) moveFocus(points, here, (here + way + points.length) % points.length);
  else return;
  event.preventDefault();
}

function moveFocus(points, from, to) {
  points[from]?.setAttribute("tabindex", "-1");
  points[to]?.setAttribute("tabindex", "0");
  points[to]?.focus();
}

// Families are hidden and shown by it.
function familyLegend(cases, y) {
  const present = families.filter((family) => cases.some((one) => one.family === family));
  const entries = present.map((family) => {
    const away = state.hidden.families;
    const click = () => {
      flip(away, family);
      drawScatter();
    };
    return switchOf(`family ${family}`, !away.has(family), click, familySign(family), family || "runs");
  });
  const below = y.kind === "error" && cases.find((one) => one.below);
  if (below) {
    const words = "at most this: less than the reference resolves";
    entries.push(html("span", {}, familySign(below.family, "hollow"), words));
  }
  return entries;
}
