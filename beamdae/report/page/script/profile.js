// Chart of a list of numbers in each selected case, such as the thicknesses along a beam, over their index.

const MAX_PROFILE_MARKERS = 40; // longer lists have no markers

function drawProfile() {
  const holder = byId("profile");
  const profile = page.profiles.find(({ label }) => label === state.choices.profile) ?? page.profiles[0];
  const { cases: hidden } = state.hidden;
  const lines = selectedCases().map(({ run, color, number }) => ({
    run,
    style: lineStyle(color, number - 1),
    values: profile.keys.map((key) => getOwn(run.values, key) ?? null),
  }));
  const visible = lines.filter(({ run }) => !hidden.has(run.id));
  holder.hidden = !lines.length;
  state.charts.delete("profile");
  if (holder.hidden) {
    holder.replaceChildren();
    return;
  }
  const chart = createChart(describeProfile(profile, lines, visible));
  state.charts.set("profile", chart);
  const selects = page.profiles.length > 1 ? [createProfileSelect(profile)] : [];
  const focused = findFocusedSelect(holder);
  holder.replaceChildren(html("div", { class: "heading" }, html("h3", {}, "Parameter"), ...selects), chart.element);
  focusSelect(holder, focused);
  drawChart(chart);
}

function createProfileSelect(profile) {
  const change = (event) => {
    state.choices.profile = page.profiles[event.target.selectedIndex].label;
    state.views.profile = { x: null, y: null };
    drawProfile();
  };
  const options = page.profiles.map(({ label }) =>
    html("option", { selected: label === profile.label && "" }, label),
  );
  return html("select", { "aria-label": "Parameter over its index", change }, ...options);
}

function describeProfile({ label, keys }, lines, visible) {
  const createLine = ({ style, values }, x, y) => {
    const points = values.map((value, k) => (value === null ? null : [x.toPosition(k), y.toPosition(value)]));
    const d = formatPath(points, (point) => point.map((position) => position.toFixed(1)).join(" "));
    const markers = keys.length > MAX_PROFILE_MARKERS ? [] : removeMissing(points);
    return svg(
      "g",
      {},
      svg("path", { class: `curve ${style.color} ${style.dash}`, d }),
      ...markers.map((point) => createLineMarker(style, point)),
    );
  };
  return {
    id: "profile",
    name: `${label} over index`,
    label: `${label} over index, one line per case`,
    x: { title: "index", range: padRange([0, keys.length - 1], false), log: false, isCount: true },
    y: { title: label, range: padRange(findExtent(lines.map(({ values }) => values)), false), log: false },
    view: state.views.profile,
    height: (width) => clamp(0.36 * width, 215, 320),
    drawBackground: () => [],
    drawClipped: (box, x, y) => visible.map((line) => createLine(line, x, y)),
    drawForeground: () => [],
    legend: () => visible.map(({ run, style }) => ({ icon: createLineIcon(style), text: run.label })),
    rows: () => [
      ["case", "index", label],
      ...visible.flatMap(({ run, values }) => values.map((value, k) => [run.label, k, value])),
    ],
  };
}
