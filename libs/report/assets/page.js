"use strict";
// Draws the figures and keeps their time axes together: zooming or panning one does so with all.
const figures = JSON.parse(document.getElementById("figures").textContent);
const timed = [];
let passing = false;

function link(source, change) {
  if (passing) return;
  let range = null;
  if ("xaxis.range[0]" in change) range = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
  else if ("xaxis.range" in change) range = change["xaxis.range"];
  const update = range ? { "xaxis.range": range } : change["xaxis.autorange"] ? { "xaxis.autorange": true } : null;
  if (!update) return;
  passing = true;
  const others = timed.filter((place) => place !== source);
  Promise.all(others.map((place) => Plotly.relayout(place, update))).finally(() => { passing = false; });
}

for (const figure of figures) {
  const place = document.getElementById("figure-" + figure.name);
  Plotly.newPlot(place, figure.data, figure.layout, { responsive: true, displaylogo: false }).then(() => {
    if (!figure.timed) return;
    timed.push(place);
    place.on("plotly_relayout", (change) => link(place, change));
  });
}
