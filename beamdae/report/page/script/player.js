// The mechanism in motion.

const SPEEDS = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10];
const motion = { frames: null, draw: null, time: 0, playing: false, last: 0 };

function drawMotion(frames, color = null) {
  pause();
  motion.frames = frames;
  const single = !motion.frames || motion.frames.t.length < 2;
  byId("player").hidden = single;
  if (!motion.frames) return byId("stage").replaceChildren(empty("No animation of this model."));
  drawStage(color);
  byId("frame").max = motion.frames.t.length - 1;
  const duration = motion.frames.t.at(-1) - motion.frames.t[0];
  const away = (speed) => Math.abs(Math.log(duration / speed / 6));
  if (!single) byId("speed").selectedIndex = SPEEDS.indexOf([...SPEEDS].sort((a, b) => away(a) - away(b))[0]);
  return showTime(motion.frames.t[0]);
}

function drawStage(color) {
  const { frames } = motion;
  const choose = (other) => {
    drawStage(other);
    showTime(motion.time);
  };
  byId("stage").replaceChildren(
    stage(frames, color),
    html("div", { class: "controls" }, ...colorChoice(frames.colors, color, choose)),
    html("div", { class: "legend" }, ...bodyLegend(frames)),
  );
}

function showTime(time) {
  const { t } = motion.frames;
  const after = t.findIndex((x) => x > time);
  const frame = after < 0 ? t.length - 1 : Math.max(after - 1, 0);
  motion.time = time;
  motion.draw(frame);
  byId("frame").value = frame;
  byId("frame").setAttribute("aria-valuetext", `${shown(t[frame])} s`);
  byId("time").value = `t = ${shown(t[frame], 3)} s`;
}

function advance(now) {
  if (!motion.playing) return;
  const { t } = motion.frames;
  const elapsed = Math.min(now - motion.last, 100) / 1000;
  motion.last = now;
  const time = motion.time + elapsed * SPEEDS[byId("speed").selectedIndex];
  showTime(time > t.at(-1) ? t[0] : time);
  requestAnimationFrame(advance);
}

function play() {
  motion.playing = true;
  motion.last = performance.now();
  byId("play").textContent = "Pause";
  requestAnimationFrame(advance);
}

function pause() {
  motion.playing = false;
  byId("play").textContent = "Play";
}

function listenToPlayer() {
  byId("speed").replaceChildren(...SPEEDS.map((speed) => html("option", {}, `× ${shown(speed, 3)}`)));
  byId("play").addEventListener("click", () => (motion.playing ? pause() : play()));
  byId("frame").addEventListener("input", (event) => showTime(motion.frames.t[event.target.value]));
}
