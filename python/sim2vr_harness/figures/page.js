// Draws the panels and keeps count of them: reportState is what a test looks at.
"use strict";
const state = (window.reportState = { expected: 0, drawn: 0, errors: [] });
window.addEventListener("error", (event) => state.errors.push(String(event.message)));
window.addEventListener("unhandledrejection", (event) => state.errors.push(String(event.reason)));

/** The page's colours, for a figure; a finger scrolls the page, it does not zoom. */
function template() {
  const css = getComputedStyle(document.documentElement);
  const [ink, faint, line] = ["--ink", "--faint", "--line"].map((name) => css.getPropertyValue(name).trim());
  const axis = { gridcolor: line, zerolinecolor: line, linecolor: line, title: { font: { color: faint } } };
  const dragmode = matchMedia("(pointer: coarse)").matches ? false : "zoom";
  const none = "rgba(0,0,0,0)";
  return { layout: { font: { color: ink }, paper_bgcolor: none, plot_bgcolor: none, dragmode, xaxis: axis, yaxis: axis,
    scene: { dragmode: "turntable", xaxis: axis, yaxis: axis, zaxis: axis } } };
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

// On paper there are stills instead.
const plots = matchMedia("print").matches ? [] : [...document.querySelectorAll(".plot")];
state.expected = plots.length;
for (const plot of plots) {
  const panel = JSON.parse(plot.firstElementChild.textContent);
  addKeys(panel, plot);
  Plotly.newPlot(plot, panel.data, { ...panel.layout, template: template() }, { responsive: true, displayModeBar: false }).then(
    () => { state.drawn += 1; plot.dataset.drawn = "yes"; },
    (error) => state.errors.push(String(error)),
  );
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach((plot) => Plotly.relayout(plot, { template: template() })));
