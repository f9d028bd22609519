// Draws the panels and keeps count of them: reportState is what a test looks at.
"use strict";
const state = (window.reportState = { expected: 0, drawn: 0, errors: [] });
window.addEventListener("error", (event) => state.errors.push(String(event.message)));
window.addEventListener("unhandledrejection", (event) => state.errors.push(String(event.reason)));

const panels = JSON.parse(document.getElementById("panels").textContent);
state.expected = panels.length;
/** Two buttons: keep the picture, see everything again. */
function configOf(panel) {
  const reset = panel.layout.scene ? "resetCameraDefault3d" : "resetScale2d";
  return { responsive: true, displaylogo: false, modeBarButtons: [["toImage", reset]] };
}

/** The key that a trace belongs to: its own name, or else the longest before a comma. */
function keyOf(panel, trace) {
  const fits = panel.keys.map(([name]) => name).filter((name) => trace === name || trace.startsWith(name + ", "));
  return fits.sort((a, b) => b.length - a.length)[0];
}

/** A key that hides and shows everything of its name. */
function addKeys(panel, plot) {
  const box = plot.previousElementSibling;
  for (const [name, colour] of panel.keys) {
    const key = document.createElement("button");
    key.type = "button";
    key.setAttribute("aria-pressed", "true");
    const patch = document.createElement("i");
    patch.style.background = colour;
    key.append(patch, name);
    key.addEventListener("click", () => {
      const shown = key.getAttribute("aria-pressed") !== "true";
      key.setAttribute("aria-pressed", String(shown));
      const own = panel.data.map((trace, i) => [trace.name, i]).filter(([other]) => keyOf(panel, other) === name).map(([, i]) => i);
      Plotly.restyle(plot, { visible: shown }, own);
    });
    box.append(key);
  }
}

const plots = document.querySelectorAll(".plot");
panels.forEach((panel, i) => {
  const plot = plots[i];
  addKeys(panel, plot);
  Plotly.newPlot(plot, panel.data, panel.layout, configOf(panel)).then(
    () => { state.drawn += 1; plot.dataset.drawn = "yes"; },
    (error) => state.errors.push(String(error)),
  );
});
