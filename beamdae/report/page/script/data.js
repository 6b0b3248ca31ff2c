// Stored curves.

const MISSING = 65535;

// Where they are is known by their place: names of users may be any.
function unpackedPage(data) {
  for (const { frames } of data.groups.filter((group) => group.frames)) {
    unpackFrames(frames);
  }
  return data;
}

function unpackFrames(frames) {
  unpackIn(frames, ["t"]);
  for (const body of frames.bodies) unpackIn(body, ["x", "y"]);
  for (const pose of frames.poses) unpackIn(pose, ["x", "y", "turn"]);
  for (const color of frames.colors) for (const along of color.values) unpackIn(along, ["values"]);
  return frames;
}

function unpackIn(object, names) {
  for (const name of names) object[name] = unpacked(object[name]);
}

function unpacked(value) {
  const bytes = Uint8Array.from(atob(value.u16), (letter) => letter.charCodeAt(0));
  const codes = new DataView(bytes.buffer);
  const values = Array.from({ length: bytes.length / 2 }, (_, i) =>
    decoded(codes.getUint16(2 * i, true), value),
  );
  return Object.assign(values, { log: value.log });
}

// What an object has itself: a name may be that of something all objects have.
function own(object, name) {
  return object && Object.hasOwn(object, name) ? object[name] : undefined;
}

// Of curves, once they are drawn.
const unpackedValues = new WeakMap();

function valuesOf(value) {
  if (value && !unpackedValues.has(value)) unpackedValues.set(value, unpacked(value));
  return value && unpackedValues.get(value);
}

function decoded(code, { low, step, log }) {
  if (code === MISSING) return null;
  return log ? 10 ** (low + step * code) : low + step * code;
}
