// A motion alone, as a notebook shows it.

function startAlone() {
  const { frames, caption, speed, colored } = JSON.parse(byId("data").textContent);
  byId("caption").textContent = caption;
  if (!SPEEDS.includes(speed)) SPEEDS.push(speed);
  listenToPlayer();
  drawMotion(unpackFrames(frames), colored ? frames.colors[0] : null);
  byId("speed").selectedIndex = SPEEDS.indexOf(speed);
  if (frames.t.length > 1) play();
  new ResizeObserver(fitFrame).observe(document.body);
}

// As high as what is in it, where what it is in lets it.
function fitFrame() {
  if (window.frameElement) window.frameElement.style.height = `${document.documentElement.offsetHeight}px`;
}

startAlone();
