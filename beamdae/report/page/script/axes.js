// Scales, ticks and axes.

// From values to places in a drawing and back.
function scale([low, high], [from, to], logarithmic) {
  const forth = logarithmic ? Math.log10 : (value) => value;
  const [begin, end] = [forth(low), forth(high)];
  const at = (value) => from + ((to - from) * (forth(value) - begin)) / (end - begin);
  const back = (place) => {
    const found = begin + ((end - begin) * (place - from)) / (to - from);
    return logarithmic ? 10 ** found : found;
  };
  const fewest = Math.min(Math.max(Math.abs(to - from) / 90, 1.6), 3.5);
  const powers = logarithmic && Math.log10(high / low) > 0.7;
  return { at, back, from, to, ticks: powers ? powerTicks(low, high) : evenTicks(low, high, fewest) };
}

function powerTicks(low, high) {
  const span = Math.log10(high / low);
  const factors = span < 1.5 ? [1, 2, 3, 5] : span < 2.5 ? [1, 2, 5] : [1];
  const every = Math.max(Math.ceil(span / 8), 1);
  const values = [];
  for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k += 1) {
    if (k % every === 0) values.push(...factors.map((factor) => factor * 10 ** k));
  }
  const ticks = values.filter((value) => value >= low && value <= high);
  const plain = ticks.every((value) => value > 0.9e-2 && value < 1e4);
  return ticks.map((value) => ({
    value,
    text: plain ? String(Number(value.toPrecision(1))) : powerText(value),
  }));
}

function evenTicks(low, high, fewest) {
  const step = niceBelow((high - low) / fewest);
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  const digits = Math.max(Math.ceil(Math.log10(Math.max(Math.abs(low), Math.abs(high)) / step)) + 1, 1);
  return Array.from({ length: last - first + 1 }, (_, i) => {
    const value = (first + i) * step;
    return { value, text: shown(Number(value.toPrecision(Math.min(digits, 15))), Math.max(digits + 1, 2)) };
  });
}

function niceBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [5, 2, 1].find((factor) => factor * power <= value * (1 + 1e-9));
}

function padded([low, high], logarithmic) {
  if (logarithmic) {
    const more = Math.max(10 ** (0.08 * (1 + Math.log10(high / low))), Math.sqrt((10 * low) / high));
    return [low / more, high * more];
  }
  const more = 0.05 * (high - low) || 0.1 * Math.abs(high) || 1;
  return [low - more, high + more];
}

function within(value, [low, high]) {
  return value >= low && value <= high;
}

function canvas(box, label, ...children) {
  return svg(
    "svg",
    { viewBox: `0 0 ${box.width} ${box.height}`, role: "group", "aria-label": label },
    ...children,
  );
}

// What is between the axes.
function frame(box, more = {}) {
  const size = { width: box.right - box.left, height: box.bottom - box.top };
  return svg("rect", { x: box.left, y: box.top, ...size, ...more });
}

function axes(box, x, y, titles) {
  const vertical = x.ticks.flatMap(({ value, text }) => [
    svg("line", { class: "grid", x1: x.at(value), x2: x.at(value), y1: box.top, y2: box.bottom }),
    svg("text", { x: x.at(value), y: box.bottom + 15, "text-anchor": "middle" }, text),
  ]);
  const horizontal = y.ticks.flatMap(({ value, text }) => [
    svg("line", { class: "grid", x1: box.left, x2: box.right, y1: y.at(value), y2: y.at(value) }),
    svg("text", { x: box.left - 7, y: y.at(value) + 4, "text-anchor": "end" }, text),
  ]);
  const middle = (box.left + box.right) / 2;
  return [
    ...vertical,
    ...horizontal,
    frame(box, { class: "axis" }),
    svg("text", { class: "title", x: middle, y: box.height - 3, "text-anchor": "middle" }, titles.x),
    svg("text", { class: "title", x: 2, y: 14 }, titles.y),
  ];
}
