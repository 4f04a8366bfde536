"use strict";
// A button that shows a grid over a map with Leaflet. Lines lie at round metres, as close together as the zoom allows.
function gridButton(map) {
  const LEAST = 50; // pixels between two lines
  const lines = L.polyline([], { color: "#4a5b6d", weight: 1, opacity: 0.45, interactive: false });
  const said = L.control({ position: "bottomleft" });
  said.onAdd = () => L.DomUtil.create("div", "grid-step");
  const button = L.DomUtil.create("button");
  Object.assign(button, { type: "button", id: "grid", title: "Show a grid", textContent: "#" });

  function step() {
    const least = LEAST / map.getZoomScale(map.getZoom(), 0); // a metre is a pixel at zoom 0
    const power = 10 ** Math.floor(Math.log10(least));
    return power * [1, 2, 5, 10].find((digit) => digit * power >= least);
  }

  function multiples(from, to, apart) {
    const first = Math.ceil(from / apart);
    return Array.from({ length: Math.max(Math.floor(to / apart) - first + 1, 0) }, (_, k) => (first + k) * apart);
  }

  function draw() {
    const seen = map.getBounds(), apart = step();
    const [left, right, bottom, top] = [seen.getWest(), seen.getEast(), seen.getSouth(), seen.getNorth()];
    lines.setLatLngs([
      ...multiples(left, right, apart).map((x) => [[bottom, x], [top, x]]),
      ...multiples(bottom, top, apart).map((y) => [[y, left], [y, right]]),
    ]);
    said.getContainer().textContent = `grid ${Number(apart.toPrecision(1))} m`;
  }

  button.setAttribute("aria-pressed", "false");
  button.addEventListener("click", () => {
    const shows = !map.hasLayer(lines);
    button.setAttribute("aria-pressed", String(shows));
    if (!shows) {
      map.off("moveend", draw);
      lines.remove();
      said.remove();
      return;
    }
    lines.addTo(map);
    said.addTo(map);
    map.on("moveend", draw);
    draw();
  });
  return button;
}
