// Decoding of curves and frames, which page_data.py encodes as 16-bit numbers in equal steps.

const MISSING_CODE = 65535;
const STORED_STEPS = 65534;

// Frames of groups are decoded immediately, curves and frames of cases when they are drawn for the first time.
function decodePage(data) {
  for (const { frames } of data.groups) {
    if (frames) decodeFrames(frames);
  }
  return data;
}

// Frames of a case, or null.
function caseFrames(run) {
  if (run.frames?.t.u16 !== undefined) decodeFrames(run.frames);
  return run.frames ?? null;
}

function decodeFrames(frames) {
  decodeEntries(frames, ["t"]);
  for (const body of frames.bodies) decodeEntries(body, ["x", "y"]);
  for (const pose of frames.poses) decodeEntries(pose, ["x", "y", "turn"]);
  for (const color of frames.colors) for (const beam of color.values) decodeEntries(beam, ["values"]);
  return frames;
}

function decodeEntries(object, keys) {
  for (const key of keys) object[key] = decodeValues(object[key]);
}

function decodeValues({ u16, low, step, log = false }) {
  const bytes = Uint8Array.from(atob(u16), (letter) => letter.charCodeAt(0));
  const codes = new DataView(bytes.buffer);
  const values = Array.from({ length: bytes.length / 2 }, (_, i) => {
    const code = codes.getUint16(2 * i, true);
    if (code === MISSING_CODE) return null;
    return log ? 10 ** (low + step * code) : low + step * code;
  });
  return Object.assign(values, { log });
}

// Smallest and largest stored value. Steps of 1 are also those of constant values, see page_data.py.
function storedLimits(stored) {
  const { low, step, log } = stored;
  return step === 1 || log ? findExtent([getValues(stored)]) : [low, low + STORED_STEPS * step];
}

const decodedValues = new WeakMap();

function getValues(stored) {
  if (stored && !decodedValues.has(stored)) decodedValues.set(stored, decodeValues(stored));
  return stored && decodedValues.get(stored);
}

// Names chosen by users may equal names of inherited properties, such as "constructor".
function getOwn(object, name) {
  return object && Object.hasOwn(object, name) ? object[name] : undefined;
}
