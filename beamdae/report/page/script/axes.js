// Scales, ticks and axes.

const TICK_SPACING = 90; // of linear axes [px]
const MIN_TICK_INTERVALS = 1.6;
const MAX_TICK_INTERVALS = 3.5;
const MIN_POWER_TICK_DECADES = 0.7; // logarithmic axes that span less have evenly spaced ticks
const MAX_POWER_TICKS = 8;
const MIN_RELATIVE_RANGE = 1e-7; // of values; smaller ranges are rounding errors

// Map from values in `range` to positions from `start` to `end` in the picture, and its inverse.
// `stepBase` is that of `createLinearTicks`. Evenly spaced ticks show values divided by ten to the power `order`; other ticks have the order 0.
function createScale([low, high], [start, end], isLog, givenTicks, stepBase, order = 0, isCount = false) {
  const forward = isLog ? Math.log10 : (value) => value;
  const [first, last] = [forward(low), forward(high)];
  const toPosition = (value) => start + ((end - start) * (forward(value) - first)) / (last - first);
  const toValue = (position) => {
    const value = first + ((last - first) * (position - start)) / (end - start);
    return isLog ? 10 ** value : value;
  };
  const intervals = clamp(Math.abs(end - start) / TICK_SPACING, MIN_TICK_INTERVALS, MAX_TICK_INTERVALS);
  const hasPowers = isLog && Math.log10(high / low) > MIN_POWER_TICK_DECADES;
  const scale = { toPosition, toValue, start, end, order: 0 };
  if (givenTicks) return { ...scale, ticks: spaceTicks(givenTicks, intervals) };
  if (hasPowers) return { ...scale, ticks: createPowerTicks(low, high) };
  const factor = 10 ** order;
  const ticks = createLinearTicks(low / factor, high / factor, intervals, stepBase, isCount && !order);
  return { ...scale, order, ticks: ticks.map(({ value, text }) => ({ value: value * factor, text })) };
}

// Evenly spaced selection of named ticks that leaves room for their texts.
function spaceTicks(ticks, intervals) {
  const stride = Math.ceil(ticks.length / (3 * intervals));
  return ticks.filter((_, k) => k % stride === 0);
}

function createPowerTicks(low, high) {
  const decades = Math.log10(high / low);
  const factors = decades < 1.5 ? [1, 2, 3, 5] : decades < 2.5 ? [1, 2, 5] : [1];
  const exponentStep = Math.max(Math.ceil(decades / MAX_POWER_TICKS), 1);
  const values = [];
  for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k += 1) {
    if (k % exponentStep === 0) values.push(...factors.map((factor) => factor * 10 ** k));
  }
  const ticks = values.filter((value) => value >= low && value <= high);
  const isPlain = ticks.every((value) => value > 0.9e-2 && value < 1e4);
  return ticks.map((value) => ({
    value,
    text: isPlain ? String(Number(value.toPrecision(1))) : formatPower(value),
  }));
}

// Steps larger than `stepBase` are this one times a power of two. Steps of counts are whole numbers.
function createLinearTicks(low, high, intervals, stepBase = Infinity, isCount = false) {
  const wanted = Math.max((high - low) / intervals, isCount ? 1 : 0);
  const step = wanted < stepBase ? roundDownToNice(wanted) : stepBase * 2 ** Math.floor(Math.log2(wanted / stepBase));
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  // One tick states no scale.
  if (last === first && intervals <= MAX_TICK_INTERVALS && !isCount) return createLinearTicks(low, high, 2 * intervals, stepBase);
  const digits = Math.max(Math.ceil(Math.log10(Math.max(Math.abs(low), Math.abs(high)) / step)) + 1, 1);
  return Array.from({ length: last - first + 1 }, (_, i) => {
    const value = (first + i) * step;
    const text = formatValue(Number(value.toPrecision(Math.min(digits, 15))), Math.max(digits + 1, 2));
    return { value, text };
  });
}

// Largest of 1, 2 and 5 times a power of ten that does not exceed the value.
function roundDownToNice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [5, 2, 1].find((factor) => factor * power <= value * (1 + 1e-9));
}

// Range with a margin, so that no point lies on the border of the plot.
function padRange([low, high], isLog) {
  if (isLog) {
    const factor = Math.max(10 ** (0.08 * (1 + Math.log10(high / low))), Math.sqrt((10 * low) / high));
    return [low / factor, high * factor];
  }
  const size = Math.max(Math.abs(low), Math.abs(high));
  // Constants but for rounding errors are drawn as constants.
  const isConstant = high - low <= MIN_RELATIVE_RANGE * size;
  const margin = isConstant ? 0.1 * size || 1 : 0.05 * (high - low);
  return [low - margin, high + margin];
}

// Rectangle between the axes.
function createPlotArea(box, attributes = {}) {
  const size = { width: box.right - box.left, height: box.bottom - box.top };
  return svg("rect", { x: box.left, y: box.top, ...size, ...attributes });
}

function createAxes(box, x, y, titles) {
  const vertical = x.ticks.flatMap(({ value, text }) => {
    const position = x.toPosition(value);
    return [
      svg("line", { class: "grid", x1: position, x2: position, y1: box.top, y2: box.bottom }),
      svg("text", { x: position, y: box.bottom + 15, "text-anchor": "middle" }, text),
    ];
  });
  const horizontal = y.ticks.flatMap(({ value, text }) => {
    const position = y.toPosition(value);
    return [
      svg("line", { class: "grid", x1: box.left, x2: box.right, y1: position, y2: position }),
      svg("text", { x: box.left - 7, y: position + 4, "text-anchor": "end" }, text),
    ];
  });
  const middle = (box.left + box.right) / 2;
  return [
    ...vertical,
    ...horizontal,
    createPlotArea(box, { class: "axis" }),
    svg("text", { class: "title", x: middle, y: box.height - 5, "text-anchor": "middle" }, scaleTitle(titles.x, x.order)),
    svg("text", { class: "title", x: 2, y: 14 }, scaleTitle(titles.y, y.order)),
  ];
}
