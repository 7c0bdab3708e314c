"use strict";
// Draws the figures and links their time axes: zooming or panning applies to all.
const figures = JSON.parse(document.getElementById("figures").textContent);
const timed = [];
let updating = false;

function link(source, change) {
  if (updating) return;
  let range = null;
  if ("xaxis.range[0]" in change) range = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
  else if ("xaxis.range" in change) range = change["xaxis.range"];
  const update = range ? { "xaxis.range": range } : change["xaxis.autorange"] ? { "xaxis.autorange": true } : null;
  if (!update) return;
  updating = true;
  const others = timed.filter((element) => element !== source);
  Promise.all(others.map((element) => Plotly.relayout(element, update))).finally(() => { updating = false; });
}

for (const figure of figures) {
  const element = document.getElementById("figure-" + figure.name);
  Plotly.newPlot(element, figure.data, figure.layout, { responsive: true, displaylogo: false }).then(() => {
    if (!figure.timed) return;
    timed.push(element);
    element.on("plotly_relayout", (change) => link(element, change));
  });
}
