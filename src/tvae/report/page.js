"use strict";
// The points of the latent space open: hover names an episode, a click or the arrow keys show it.
(() => {
  const { styles, episodes, first } = JSON.parse(document.getElementById("episodes").textContent);
  const [map, tip, panel, hint] = ["map", "tip", "episode", "hint"].map((id) => document.getElementById(id));
  const svg = map.querySelector("svg");
  const reach = 14; // how far from a point, in the picture's units, still means that point
  const order = episodes.map((_, i) => i).sort((a, b) => episodes[a].place[0] - episodes[b].place[0]);

  const ring = (name) => {
    const circle = document.createElementNS(svg.namespaceURI, "circle");
    circle.setAttribute("class", name);
    circle.setAttribute("r", 5.5);
    circle.style.display = "none";
    return svg.appendChild(circle);
  };
  const hovered = ring("ring");
  const pinned = ring("ring pinned");

  const mark = (circle, episode) => {
    circle.style.display = episode ? "" : "none";
    if (!episode) return;
    circle.setAttribute("cx", episode.place[0]);
    circle.setAttribute("cy", episode.place[1]);
  };

  const nearest = (event) => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    let best = -1;
    let least = reach;
    episodes.forEach(({ place: [x, y] }, i) => {
      const distance = Math.hypot(x - at.x, y - at.y);
      if (distance < least) [best, least] = [i, distance];
    });
    return best;
  };

  const element = (name, text, parent) => {
    const made = document.createElement(name);
    made.textContent = text;
    return parent.appendChild(made);
  };

  const hover = (index) => {
    const episode = episodes[index];
    tip.hidden = !episode;
    mark(hovered, episode);
    if (!episode) return;
    const box = svg.viewBox.baseVal;
    tip.textContent = `${episode.id} · ${styles[episode.style]} · ${episode.probability}`;
    tip.style.top = `${(100 * episode.place[1]) / box.height}%`;
    const half = tip.offsetWidth / 2;
    const x = (map.clientWidth * episode.place[0]) / box.width;
    tip.style.left = `${Math.max(half, Math.min(map.clientWidth - half, x))}px`;
  };

  let current = 0;
  const show = (index) => {
    current = index;
    const episode = episodes[index];
    mark(pinned, episode);
    panel.replaceChildren();
    element("h3", `Episode ${episode.id}`, panel);
    // The picture is this page's own markup: text inside it was escaped when it was drawn.
    panel.insertAdjacentHTML("beforeend", episode.picture);
    const list = element("dl", "", panel);
    const facts = [["style", styles[episode.style]], ["probability", episode.probability], ...episode.facts];
    for (const [name, value] of facts) {
      element("dt", name, list);
      element("dd", value, list);
    }
  };

  map.addEventListener("pointermove", (event) => hover(nearest(event)));
  map.addEventListener("pointerleave", () => hover(-1));
  map.addEventListener("click", (event) => {
    const index = nearest(event);
    if (index >= 0) show(index);
  });
  map.addEventListener("keydown", (event) => {
    const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, Home: -Infinity, End: Infinity };
    if (!(event.key in steps)) return;
    event.preventDefault();
    const rank = order.indexOf(current) + steps[event.key];
    show(order[Math.max(0, Math.min(order.length - 1, rank))]);
    hover(current);
  });
  map.addEventListener("blur", () => hover(-1));

  map.classList.add("live");
  map.tabIndex = 0;
  map.setAttribute("role", "group");
  panel.hidden = hint.hidden = false;
  show(first);
})();
