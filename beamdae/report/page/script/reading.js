// Values of curves at the pointer, and at a cursor that keys move.

function readable(made) {
  const { plot } = made;
  let time = null;
  const away = () => {
    plot.querySelector(".reader")?.remove();
    hideTip();
  };
  const clamped = (t) => Math.min(Math.max(t, made.x.back(made.box.left)), made.x.back(made.box.right));
  const point = (event) => {
    if (event.buttons && event.pointerType === "mouse") return;
    if (event.pointerType === "touch" && event.type === "pointermove" && zoomed(made)) return;
    time = clamped(made.x.back(placeIn(made, event)[0]));
    read(made, time, { x: event.clientX, y: event.clientY });
  };
  plot.addEventListener("pointermove", point);
  plot.addEventListener("pointerdown", point);
  // What a finger has read stays until it touches something else.
  plot.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && away());
  plot.addEventListener("blur", away);
  plot.addEventListener("keydown", (event) => {
    const way = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!way || event.shiftKey) return;
    event.preventDefault();
    const [first, last] = [made.box.left, made.box.right].map(made.x.back);
    time = clamped((time ?? first) + (way * (last - first)) / 100);
    const { left, top, width } = plot.getBoundingClientRect();
    read(made, time, { x: left + (made.x.at(time) * width) / made.box.width, y: top + 30 });
  });
}

function read({ spec, plot, box, x, y }, time, at) {
  const readings = spec.lines.map((line) => reading(line, time));
  plot.querySelector(".reader")?.remove();
  plot.append(
    svg(
      "g",
      { class: "reader" },
      svg("line", { class: "cursor", x1: x.at(time), x2: x.at(time), y1: box.top, y2: box.bottom }),
      ...readings.map((one) => dot(one, x, y, box)),
    ),
  );
  const rows = readings.map(({ line, value }) =>
    html(
      "tr",
      {},
      html("td", {}, lineSign(line.style)),
      html("td", {}, line.label),
      html("td", {}, shown(value)),
    ),
  );
  showTip(at.x, at.y, html("strong", {}, `t = ${shown(time)} s`), html("table", {}, ...rows));
}

function reading(line, time) {
  const k = nearest(line.t, time);
  return { line, value: line.values[k] ?? null, t: line.t[k] };
}

function dot({ line, value, t }, x, y, box) {
  const seen = value !== null && within(y.at(value), [box.top, box.bottom]);
  const there = seen && within(x.at(t), [box.left - 1, box.right + 1]);
  return there ? svg("circle", { class: `dot ${line.style.color}`, cx: x.at(t), cy: y.at(value), r: 3.5 }) : "";
}
