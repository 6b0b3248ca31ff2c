// Ranges of values and formatting of numbers.

function removeDuplicates(values) {
  return [...new Set(values)];
}

function removeMissing(values) {
  return values.filter((value) => value !== null && value !== undefined);
}

// Smallest and largest value of all lists.
function findExtent(lists) {
  let [low, high] = [Infinity, -Infinity];
  for (const list of lists) {
    for (const value of removeMissing(list)) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  return [low, high];
}

function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

function isWithin(value, [low, high]) {
  return value >= low && value <= high;
}

function formatValue(value, digits = 4) {
  if (value === null || value === undefined || value === "") return "–";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value !== "number") return String(value);
  const magnitude = Math.abs(value);
  if (value === 0 || (Number.isInteger(value) && magnitude < 1e9)) return String(value);
  if (magnitude >= 1e-3 && magnitude < 1e5) return String(Number(value.toPrecision(digits)));
  return value.toExponential(digits - 2);
}

// Format as one digit and a power of ten, such as 2·10⁻³.
function formatPower(value) {
  const exponent = Math.floor(Math.log10(value) + 1e-9);
  const factor = Math.round(value / 10 ** exponent);
  const superscript = [...String(exponent)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("");
  return `${factor === 1 ? "" : `${factor}·`}10${superscript}`;
}
