"use strict";
(() => {
  const grids = JSON.parse(document.getElementById("what-if-data").textContent);
  const form = document.getElementById("what-if-form");
  const choices = document.getElementById("what-if-choices");
  const words = document.getElementById("what-if-words");
  // A cubic through the samples (Catmull-Rom), so that an oscillation has no corners.
  const FINER = 6;
  const between = (y, place) => {
    const at = Math.min(Math.floor(place), y.length - 2), t = place - at;
    const [a, b, c, d] = [y[Math.max(at - 1, 0)], y[at], y[at + 1], y[Math.min(at + 2, y.length - 1)]];
    return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)));
  };
  const line = (response) => {
    const n = FINER * (response.length - 1);
    return Array.from({ length: n + 1 }, (_, at) =>
      `${(34 + 278 * at / n).toFixed(1)},${(150 - 0.9 * between(response, at / FINER)).toFixed(1)}`).join(" ");
  };
  const draw = (id, loop) => document.getElementById(id).setAttribute("points", loop ? line(loop[2]) : "");
  // The place of a combination: the last parameter counts fastest.
  const placeOf = (grid, picks) => picks.reduce((sum, pick, at) => sum * grid.values[at].length + pick, 0);
  const flownOf = (grid) => placeOf(grid, grid.values.map((values) => (values.length - 1) / 2));
  const show = () => {
    const grid = grids[form.elements.axis.value];
    const picks = [...choices.querySelectorAll("select")].map((select) => select.selectedIndex);
    const loop = grid.loops[placeOf(grid, picks)];
    words.textContent = loop ? `Margins: ${loop[0]}. The rate ${loop[1]}.` : "This loop would be unstable.";
    draw("what-if-before", grid.loops[flownOf(grid)]);
    draw("what-if-after", loop);
    document.getElementById("what-if-end").textContent = grid.end;
  };
  const fill = () => {
    const grid = grids[form.elements.axis.value];
    choices.replaceChildren(...grid.names.map((name, at) => {
      const label = document.createElement("label"), select = document.createElement("select");
      grid.values[at].forEach((value, place) => {
        const flown = place === (grid.values[at].length - 1) / 2;
        select.add(new Option(flown ? `${value} (flown)` : value, value, flown, flown));
      });
      label.append(name, select);
      return label;
    }));
    show();
  };
  form.addEventListener("change", (event) => (event.target.name === "axis" ? fill() : show()));
  form.addEventListener("submit", (event) => event.preventDefault());
  fill();
})();
