// The mechanism, drawn at one time.

const LAYERS = ["ground", "rigid", "beam", "point"];

function stage(bodies) {
  const [width, margin] = [420, 26];
  const [left, right] = extent(bodies.map((body) => body.x));
  const [bottom, top] = extent(bodies.map((body) => body.y));
  const tall = Math.min(Math.max((width * (top - bottom)) / (right - left || 1), 180), 400);
  const zoom = Math.min(
    (width - 2 * margin) / (right - left || 1e-9),
    (tall - 2 * margin) / (top - bottom || 1e-9),
  );
  const place = (x, y) => [
    width / 2 + zoom * (x - (left + right) / 2),
    tall / 2 - zoom * (y - (bottom + top) / 2),
  ];
  const layered = [...bodies].sort((a, b) => LAYERS.indexOf(a.kind) - LAYERS.indexOf(b.kind));
  const beams = bodies.filter((body) => body.kind === "beam");
  const drawn = (body, more) =>
    svg(
      "path",
      {
        class: `body ${body.kind} ${beams.indexOf(body) % 2 > 0 ? "other" : ""} ${more}`,
        d: outline(body, 0, place),
      },
      svg("title", {}, body.name),
    );
  const moving = layered.map((body) => drawn(body, ""));
  const starts = layered.filter((body) => body.kind !== "ground").map((body) => drawn(body, "start"));
  motion.draw = (frame) =>
    moving.forEach((path, k) => path.setAttribute("d", outline(layered[k], frame, place)));
  const box = { width, height: tall + 16 };
  return canvas(
    box,
    "the mechanism",
    svg("rect", { class: "stage", ...box, rx: 6 }),
    ...starts,
    ...moving,
    ...scaleBar(zoom, box),
  );
}

function outline(body, frame, place) {
  const points = [];
  for (let k = frame * body.points; k < (frame + 1) * body.points; k += 1) {
    if (body.x[k] !== null && body.y[k] !== null)
      points.push(
        place(body.x[k], body.y[k])
          .map((c) => c.toFixed(1))
          .join(" "),
      );
  }
  if (body.kind === "ground") return points.map((p) => `M${p}l-8 13h16Z`).join("");
  if (points.length < 2) return points.map((p) => `M${p}L${p}`).join("");
  return `M${points.join("L")}${body.kind === "rigid" && points.length > 2 ? "Z" : ""}`;
}

function scaleBar(zoom, box) {
  const length = niceBelow(box.width / 4 / zoom);
  const [x, y] = [12, box.height - 10];
  return [
    svg("path", { class: "cursor", d: `M${x} ${y - 4}V${y}H${x + length * zoom}V${y - 4}`, fill: "none" }),
    svg("text", { x: x + 4, y: y - 6 }, `${shown(length)} m`),
  ];
}

function bodyLegend(bodies) {
  return LAYERS.map((kind) => bodies.filter((body) => body.kind === kind))
    .filter((same) => same.length)
    .map(bodyEntry);
}

function bodyEntry(same) {
  const { kind } = same[0];
  const shape = { ground: "M9-6l-7 11h14Z", point: "M9 0L9 0" }[kind] ?? "M3 0H15";
  const names =
    same
      .slice(0, 3)
      .map((body) => body.name)
      .join(", ") + (same.length > 3 ? `, … (${same.length})` : "");
  return html(
    "span",
    {},
    sign(18, svg("path", { class: `body ${kind}`, d: shape })),
    kind === "ground" ? kind : `${kind}: ${names}`,
  );
}
