"use strict";
// Shows the sheets of the report with Leaflet: the coordinates of the map are metres in the map's frame.
(() => {
  document.querySelectorAll("[data-copy]").forEach((button) => button.addEventListener("click", async () => {
    const said = button.textContent;
    try {
      await navigator.clipboard.writeText(button.dataset.copy);
      button.textContent = "copied";
    } catch {
      button.textContent = button.dataset.copy; // to be copied by hand
      return;
    }
    setTimeout(() => { button.textContent = said; }, 1500);
  }));
  const search = document.getElementById("search");
  if (search) search.addEventListener("input", () => document.querySelectorAll("#config tr").forEach((row) => {
    row.hidden = !row.cells[0].textContent.toLowerCase().includes(search.value.trim().toLowerCase());
  }));

  const { sheets } = JSON.parse(document.getElementById("data").textContent);
  const place = document.getElementById("map");
  if (!place || !sheets.length) return;
  const readout = document.getElementById("readout");
  const hint = [...readout.childNodes];

  const map = L.map(place, {
    crs: L.CRS.Simple, attributionControl: false, preferCanvas: true, zoomSnap: 0.25, zoomDelta: 0.75,
    wheelPxPerZoomLevel: 90, minZoom: -4, maxZoom: 8,
  });
  L.control.scale({ imperial: false, maxWidth: 160 }).addTo(map);
  ["base", "robots", "over"].forEach((name, index) => { map.createPane(name).style.zIndex = 210 + 10 * index; });
  const whole = L.control({ position: "topleft" });
  whole.onAdd = () => {
    const box = make("div", { className: "leaflet-bar" });
    const button = make("button", { type: "button", title: "Show the whole map", textContent: "⤢", id: "whole" });
    button.addEventListener("click", () => fit());
    const ruler = make("button", { type: "button", title: "Measure a distance: click two points", textContent: "↔", id: "ruler" });
    ruler.setAttribute("aria-pressed", "false");
    ruler.addEventListener("click", () => measure(ruler));
    const picture = make("button", { type: "button", title: "Save this view as PNG", textContent: "↓", id: "picture" });
    picture.setAttribute("aria-label", picture.title);
    picture.addEventListener("click", () => savePicture());
    box.append(button, ruler, gridButton(map), picture);
    L.DomEvent.disableClickPropagation(box);
    return box;
  };
  whole.addTo(map);

  let ends = null;      // of the distance that is measured; null while nothing is
  const rule = L.polyline([], { color: "#b3261e", weight: 2, interactive: false }).addTo(map);

  function measure(button) {
    ends = ends ? null : [];
    rule.setLatLngs([]).unbindTooltip();
    button.setAttribute("aria-pressed", String(ends !== null));
    place.classList.toggle("measuring", ends !== null);
  }

  map.on("click", ({ latlng }) => {
    if (!ends) return;
    ends = ends.length === 2 ? [latlng] : [...ends, latlng];
    rule.setLatLngs(ends).unbindTooltip();
    if (ends.length === 2) {
      const [a, b] = ends;
      const metres = Math.hypot(b.lng - a.lng, b.lat - a.lat);
      rule.bindTooltip(make("span", { textContent: `${metres.toFixed(2)} m` }), { permanent: true }).openTooltip();
    }
  });

  let current = null;   // the sheet that is shown
  let shown = [];       // its layers: what the report says of each, Leaflet's layer, and its values once decoded

  function make(tag, properties = {}, children = []) {
    const element = Object.assign(document.createElement(tag), properties);
    element.append(...children);
    return element;
  }

  function drawn(layer, index) {
    if (layer.kind === "raster") {
      const pane = layer.only_one ? "base" : layer.column ? "robots" : "over";
      const image = L.imageOverlay(layer.image, layer.bounds, { pane, opacity: layer.opacity, alt: layer.label });
      image.on("add", () => { image.getElement().dataset.layer = index; });
      return image;
    }
    const style = { color: layer.colour, interactive: false };
    if (layer.kind === "line") return L.polyline(layer.points, { ...style, weight: 2, opacity: 0.9, smoothFactor: 0.5 });
    if (layer.kind === "links") {
      const pairs = [];
      for (let k = 0; k + 1 < layer.points.length; k += 2) pairs.push([layer.points[k], layer.points[k + 1]]);
      return L.polyline(pairs, { ...style, weight: 1.5, opacity: 0.75, dashArray: "4 3" });
    }
    const told = layer.texts.length > 0;
    const dots = layer.points.map((point, index) => {
      const look = { radius: told ? 6 : 2.5, stroke: told, color: "#fff", weight: 1.5, fillColor: layer.colour, fillOpacity: 0.9 };
      const dot = L.circleMarker(point, { ...look, interactive: told });
      // An element's text is never taken for markup.
      return told ? dot.bindTooltip(make("span", { textContent: layer.texts[index] })) : dot;
    });
    return L.featureGroup(dots);
  }

  function input(entry) {
    const { layer } = entry;
    const box = make("input", {
      type: layer.only_one ? "radio" : "checkbox", name: layer.only_one ? layer.group : "", checked: layer.shown,
      title: layer.note,
    });
    box.dataset.layer = entry.index;
    box.addEventListener("change", () => {
      if (layer.only_one) shown.filter((other) => other.layer.group === layer.group).forEach((other) => other.drawing.remove());
      if (box.checked) entry.drawing.addTo(map); else entry.drawing.remove();
      if (layer.column === "drive" && robots.some(({ track }) => track.label === layer.label)) showRobots();
    });
    return box;
  }

  function swatch(layer) {
    if (layer.colours) {
      const bar = make("i", { className: "bar" });
      const some = layer.colours.map((rgb) => `rgb(${rgb.join()})`);
      bar.style.background = `linear-gradient(90deg, ${some.join()})`;
      return bar;
    }
    const square = make("i", { className: "swatch" });
    square.style.background = layer.colour;
    return square;
  }

  function asList(entries) {
    return entries.map((entry) => make("label", { title: entry.layer.note }, [
      input(entry), entry.layer.label, ...(entry.layer.colours || entry.layer.colour ? [swatch(entry.layer)] : [])]));
  }

  function asTable(entries) {
    const columns = [...new Set(entries.map((entry) => entry.layer.column))];
    const rows = [...new Set(entries.map((entry) => entry.layer.label))];
    const heads = columns.map((column) => make("th", { textContent: column, scope: "col" }));
    const lines = rows.map((row) => {
      const own = entries.filter((entry) => entry.layer.label === row);
      const coloured = own.find((entry) => entry.layer.colour);
      const name = make("td", { title: row }, [...(coloured ? [swatch(coloured.layer)] : []), row]);
      const cells = columns.map((column) => {
        const entry = own.find((one) => one.layer.column === column);
        if (!entry) return make("td");
        const box = input(entry);
        box.setAttribute("aria-label", `${row}: ${column}`);
        return make("td", {}, [box]);
      });
      return make("tr", {}, [name, ...cells]);
    });
    return [make("table", {}, [
      make("thead", {}, [make("tr", {}, [make("th"), ...heads])]), make("tbody", {}, lines)])];
  }

  function fit() {
    const bounds = L.latLngBounds(current.layers.filter((layer) => layer.kind === "raster").flatMap((layer) => layer.bounds));
    map.fitBounds(bounds, { padding: [12, 12], animate: false });
  }

  function show(number) {
    shown.forEach((entry) => entry.drawing.remove());
    current = sheets[number];
    beginTime();  // which takes a line of the map's place, or gives it back
    map.invalidateSize({ animate: false });
    shown = current.layers.map((layer, index) => ({ layer, index, drawing: drawn(layer, index) }));
    fit();
    shown.filter((entry) => entry.layer.shown).forEach((entry) => entry.drawing.addTo(map));
    const groups = [...new Set(current.layers.map((layer) => layer.group))];
    document.getElementById("layers").replaceChildren(...groups.map((group) => {
      const entries = shown.filter((entry) => entry.layer.group === group);
      const body = entries.some((entry) => entry.layer.column) ? asTable(entries) : asList(entries);
      return make("fieldset", {}, [make("legend", { textContent: group }), ...body]);
    }));
    document.querySelectorAll("[data-sheet]").forEach((tab) =>
      tab.setAttribute("aria-selected", String(Number(tab.dataset.sheet) === number)));
    document.querySelectorAll("[data-note]").forEach((note) => { note.hidden = Number(note.dataset.note) !== number; });
    tell(null);
  }

  // Robots run along their drives: rows of tenths of a second, centimetres twice, and degrees.
  const slider = document.getElementById("when"), play = document.getElementById("play"), said = document.getElementById("at");
  const ARROW = [[0, -11], [8, 9], [0, 4], [-8, 9]];  // pixels, heading up
  let robots = [];      // of the current sheet: the track and Leaflet's marker
  let playing = null;   // the handle of the next frame; null while paused

  function poseAt({ rows }, time) {
    const tenths = 10 * time;
    let low = 0, high = rows.length - 1;
    while (low < high) {  // the first row that is not before the time
      const middle = (low + high) >> 1;
      if (rows[middle][0] < tenths) low = middle + 1; else high = middle;
    }
    const after = rows[low], before = rows[Math.max(low - 1, 0)];
    const share = after[0] > before[0] ? Math.min(Math.max((tenths - before[0]) / (after[0] - before[0]), 0), 1) : 1;
    const turn = ((after[3] - before[3] + 540) % 360) - 180;
    return {
      point: [(before[2] + share * (after[2] - before[2])) / 100, (before[1] + share * (after[1] - before[1])) / 100],
      degrees: before[3] + share * turn,
    };
  }

  function arrow(colour) {
    const make = (tag, properties) => {
      const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
      Object.entries(properties).forEach(([name, value]) => element.setAttribute(name, value));
      return element;
    };
    const svg = make("svg", { width: 24, height: 24, viewBox: "-12 -12 24 24" });
    svg.append(make("path", { d: `M${ARROW.join("L")}Z`, fill: colour, stroke: "#fff", "stroke-width": 1.5 }));
    return svg;
  }

  const longest = () => Math.max(0, ...current.tracks.map(({ rows }) => rows[rows.length - 1][0] / 10));

  function beginTime() {
    stop();
    robots.forEach(({ marker }) => marker.remove());
    robots = current.tracks.map((track) => ({ track, marker: L.marker([0, 0], {
      icon: L.divIcon({ html: arrow(track.colour), className: "robot", iconSize: [24, 24] }), interactive: false, keyboard: false,
    }) }));
    document.getElementById("time").hidden = !robots.length;
    const step = Math.max(0.1, Math.ceil(longest() / 100) / 10);
    slider.step = step;
    slider.max = Math.ceil(longest() / step) * step;
    slider.value = 0;
    sayTime();
  }

  function sayTime() {
    said.textContent = `${Math.min(Number(slider.value), longest()).toFixed(1)} s of ${longest().toFixed(1)} s`;
    slider.setAttribute("aria-valuetext", said.textContent);
  }

  // A robot is hidden while its drive is switched off.
  function showRobots() {
    sayTime();
    robots.forEach((robot) => {
      const drive = shown.find(({ layer }) => layer.label === robot.track.label && layer.column === "drive");
      if (!drive || !map.hasLayer(drive.drawing)) { robot.marker.remove(); return; }
      const { point, degrees } = poseAt(robot.track, Number(slider.value));
      robot.degrees = degrees;
      robot.marker.setLatLng(point).addTo(map);
      robot.marker.getElement().firstChild.style.transform = `rotate(${90 - degrees}deg)`;
    });
  }

  function stop() {
    if (playing !== null) cancelAnimationFrame(playing);
    playing = null;
    play.textContent = "▶";
    play.title = "Play";
    play.setAttribute("aria-pressed", "false");
  }

  slider.addEventListener("input", () => { stop(); showRobots(); });
  play.addEventListener("click", () => {
    if (playing !== null) { stop(); return; }
    const whole = Number(slider.max);
    const first = Number(slider.value) >= whole ? 0 : Number(slider.value);
    let began = null;
    const next = (now) => {
      began = began === null ? now : began;
      const time = first + (whole * (now - began)) / 20000;  // all of it in 20 s
      slider.value = time;
      showRobots();
      if (time >= whole) stop(); else playing = requestAnimationFrame(next);
    };
    play.textContent = "❚❚";
    play.title = "Pause";
    play.setAttribute("aria-pressed", "true");
    playing = requestAnimationFrame(next);
  });

  // Draw the visible part of the map again: pictures, then marks, then robots.
  function savePicture() {
    const frame = place.getBoundingClientRect(), sharp = window.devicePixelRatio || 1;
    const blank = () => {
      const canvas = make("canvas", { width: Math.round(frame.width * sharp), height: Math.round(frame.height * sharp) });
      const context = canvas.getContext("2d");
      context.scale(sharp, sharp);
      context.imageSmoothingEnabled = false;
      return context;
    };
    const put = (context, element) => {
      const { left, top, width, height } = element.getBoundingClientRect();
      context.globalAlpha = element.style.opacity === "" ? 1 : Number(element.style.opacity);
      context.drawImage(element, left - frame.left, top - frame.top, width, height);
      context.globalAlpha = 1;
    };
    const view = blank();
    view.fillStyle = getComputedStyle(place).backgroundColor;
    view.fillRect(0, 0, frame.width, frame.height);
    ["base", "robots", "over"].forEach((name) => {
      const pane = blank();  // colours of robots mix with each other, and not with the map below
      if (name === "robots") pane.globalCompositeOperation = "multiply";
      map.getPane(name).querySelectorAll("img").forEach((image) => put(pane, image));
      view.drawImage(pane.canvas, 0, 0, frame.width, frame.height);
    });
    map.getPane("overlayPane").querySelectorAll("canvas").forEach((canvas) => put(view, canvas));
    robots.filter(({ marker }) => map.hasLayer(marker)).forEach(({ track, marker, degrees }) => {
      const { x, y } = map.latLngToContainerPoint(marker.getLatLng());
      view.save();
      view.translate(x, y);
      view.rotate(((90 - degrees) * Math.PI) / 180);
      view.beginPath();
      ARROW.forEach(([right, down]) => view.lineTo(right, down));
      view.closePath();
      Object.assign(view, { fillStyle: track.colour, strokeStyle: "#fff", lineWidth: 1.5 });
      view.fill();
      view.stroke();
      view.restore();
    });
    const bar = place.querySelector(".leaflet-control-scale-line"), { left, bottom, width } = bar.getBoundingClientRect();
    view.font = "12px sans-serif";
    view.fillStyle = view.strokeStyle = "#1d2733";
    view.fillText(bar.textContent, left - frame.left + 4, bottom - frame.top - 5);
    view.strokeRect(left - frame.left, bottom - frame.top, width, 0.5);
    view.canvas.toBlob((png) => {
      const link = make("a", { href: URL.createObjectURL(png), download: `${current.title}.png` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    });
  }

  // A colour of a picture tells the value that it stands for.
  async function decode(entry) {
    const { layer } = entry;
    const image = new Image();
    image.src = layer.image;
    await image.decode();
    const canvas = make("canvas", { width: image.width, height: image.height });
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    const pixels = context.getImageData(0, 0, image.width, image.height).data;
    const levels = new Map(layer.colours.map(([red, green, blue], level) => [(red << 16) | (green << 8) | blue, level]));
    const values = new Uint8Array(image.width * image.height);
    for (let k = 0; k < values.length; k += 1) {
      values[k] = pixels[4 * k + 3] ? levels.get((pixels[4 * k] << 16) | (pixels[4 * k + 1] << 8) | pixels[4 * k + 2]) : 0;
    }
    entry.values = { width: image.width, height: image.height, values };
  }

  function valueAt(entry, { lat, lng }) {
    if (!entry.decoding) entry.decoding = decode(entry).then(() => tell(at));  // a finger does not move again
    if (!entry.values) return null;
    const [[bottom, left], [top, right]] = entry.layer.bounds;
    const { width, height, values } = entry.values;
    const col = Math.floor(((lng - left) / (right - left)) * width);
    const row = Math.floor(((top - lat) / (top - bottom)) * height);
    if (col < 0 || row < 0 || col >= width || row >= height) return null;
    return values[row * width + col] * entry.layer.unit;
  }

  let at = null;        // the point that is read; null while none is
  function tell(point) {
    at = point;
    if (!point) { readout.replaceChildren(...hint); return; }
    const parts = [`x ${point.lng.toFixed(2)} m   y ${point.lat.toFixed(2)} m`];
    shown.filter((entry) => entry.layer.colours).forEach((entry) => {
      const value = valueAt(entry, point);
      if (value !== null) parts.push(`${entry.layer.label.toLowerCase()} ${entry.layer.unit < 1 ? value.toFixed(2) : value}`);
    });
    readout.textContent = parts.join("     ");
  }
  map.on("mousemove", ({ latlng }) => tell(latlng));
  place.addEventListener("mouseleave", () => tell(null));  // Leaflet tells of no 'mouseout' from its canvas
  document.querySelectorAll("[data-sheet]").forEach((tab) =>
    tab.addEventListener("click", () => show(Number(tab.dataset.sheet))));
  show(0);

  // A time in a warning leads to where the robot was then.
  function placesAt(names, time) {
    return sheets.flatMap((sheet, number) => sheet.layers.flatMap((layer) => (layer.texts || []).flatMap((text, index) =>
      names.includes(layer.label) && text.startsWith(`${time} s: `) ? [{ number, layer, point: layer.points[index], text }] : [])));
  }
  function jump({ number, layer, point, text }) {
    if (sheets[number] !== current) show(number);
    const entry = shown.find((one) => one.layer === layer);
    if (!map.hasLayer(entry.drawing)) entry.drawing.addTo(map);
    map.setView(point, Math.max(map.getZoom(), 4));
    entry.drawing.eachLayer((dot) => { if (dot.getTooltip() && dot.getTooltip().getContent().textContent === text) dot.openTooltip(); });
    place.scrollIntoView({ block: "center" });
  }
  document.querySelectorAll(".warnings li").forEach((line) => {
    const parts = /^(.*?): at ([\d., ]+) s\b/.exec(line.textContent);
    if (!parts) return;
    const names = parts[1].split(", ");
    const times = parts[2].split(", ").map((time) => {
      const [first] = placesAt(names, time);
      if (!first) return time;
      const button = make("button", { type: "button", className: "jump", title: "Show where", textContent: time });
      button.addEventListener("click", () => jump(first));
      return button;
    });
    const rest = line.textContent.slice(parts[0].length - 2);
    line.replaceChildren(`${parts[1]}: at `, ...times.flatMap((time, index) => (index ? [", ", time] : [time])), rest);
  });
})();
