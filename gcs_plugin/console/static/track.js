// Draws where a rover was and where its calls were, north up, on an own picture if there is one.

import { changed, drawn, element, showText } from "./elements.js";
import { nice, surroundings } from "./model.js";

const WIDTH = 400, HEIGHT = 260;
const OPEN = "open", SHUT = "shut";

export class Track {
  // choose: called with the key of a call.
  constructor(choose) {
    this.choose = choose;
    this.frame = drawn("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": "The way of the rover, north up" });
    this.dots = element("div", { className: "dots" });
    this.text = element("p", { className: "faint" });
    this.part = element("div", { className: "track" }, element("div", { className: "map" }, this.frame, this.dots), this.text);
    this.buttons = new Map();
  }

  // corners: north, west, south, east of the background, null without one.
  show(points, here, calls, corners) {
    const placed = calls.filter((call) => call.place);
    const content = [points.length, points.at(-1), here, placed.map(({ key, open, name, place }) => [key, open, name, place]), corners];
    changed(this.frame, content, () => this.draw(points, here, placed, corners));
    return points.length > 0 || here !== null || placed.length > 0;
  }

  draw(points, here, placed, corners) {
    const own = here ? [[here.latitude, here.longitude]] : [];
    const all = [...points, ...own, ...placed.map(({ place }) => place)];
    if (!all.length) return;
    const { at, metres } = surroundings(all, WIDTH, HEIGHT);
    const place = (point) => at(point).map((one) => one.toFixed(1)).join(",");
    const parts = [];
    if (corners) {
      const [left, top] = at([corners[0], corners[1]]), [right, bottom] = at([corners[2], corners[3]]);
      parts.push(drawn("image", { href: "/background", x: left, y: top, width: right - left, height: bottom - top, preserveAspectRatio: "none" }));
    }
    const line = [...points, ...own].map(place).join(" ");
    parts.push(drawn("polyline", { class: "under", points: line }), drawn("polyline", { class: "way", points: line }));
    if (here) {
      const [x, y] = at(own[0]);
      parts.push(drawn("path", { class: "own", d: here.heading === null ? "M-6,0 L0,-6 L6,0 L0,6 Z" : "M-7,7 L0,-9 L7,7 L0,3 Z", transform: `translate(${x.toFixed(1)} ${y.toFixed(1)}) rotate(${here.heading ?? 0})` }));
    }
    const long = nice(WIDTH / 4 / metres);
    const end = WIDTH - 12, from = end - long * metres;
    parts.push(drawn("path", { class: "scale", d: `M${from},${HEIGHT - 16} v6 H${end} v-6` }));
    this.frame.replaceChildren(...parts);
    showText(this.text, `North is up; the bar is ${long} m. ${placed.length ? "Click a call to see it." : "No call has a place yet."}`);
    this.mark(placed, at);
  }

  // Buttons, so that keyboard and screen reader reach them; the newest lies on top.
  mark(placed, at) {
    const kept = new Set(placed.map((call) => call.key));
    for (const [key, button] of this.buttons) if (!kept.has(key)) button.remove(), this.buttons.delete(key);
    for (const call of [...placed].reverse()) {
      if (!this.buttons.has(call.key)) {
        this.buttons.set(call.key, element("button", { type: "button", onclick: () => this.choose(call.key) }));
        this.dots.append(this.buttons.get(call.key));
      }
      const button = this.buttons.get(call.key), [x, y] = at(call.place);
      button.style.left = `${(100 * x) / WIDTH}%`;
      button.style.top = `${(100 * y) / HEIGHT}%`;
      button.className = call.open ? OPEN : SHUT;
      showText(button, call.name);
      button.setAttribute("aria-label", `${call.name}, ${call.open ? "open" : "closed"}: show it`);
    }
  }
}
