// Filter of the gallery: cards without a chosen tag are hidden; choosing a tag again shows all.
document.addEventListener("DOMContentLoaded", () => {
  const buttons = [...document.querySelectorAll(".gallery-tags button")];
  const cards = [...document.querySelectorAll(".gallery-card")];
  const count = document.querySelector(".gallery-count");
  if (!count) return;
  const show = (tag) => {
    for (const button of buttons) {
      button.setAttribute("aria-pressed", String(button.dataset.tag === tag));
    }
    for (const card of cards) {
      card.hidden = Boolean(tag) && !card.dataset.tags.split(" ").includes(tag);
    }
    count.textContent = `${cards.filter((card) => !card.hidden).length} of ${cards.length} entries`;
  };
  for (const button of buttons) {
    const isChosen = () => button.getAttribute("aria-pressed") === "true";
    button.addEventListener("click", () => show(isChosen() ? "" : button.dataset.tag));
  }
  show("");
});
