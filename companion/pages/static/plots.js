// Draws small plots: a figure over time with its threshold, and the sectors ahead as a fan.

import { changed, drawn, element, showText } from "./elements.js";
import { percent } from "./wording.js";

const WIDTH = 300, HEIGHT = 64, SECONDS = 120, MOST_POINTS = 300;

export const joined = (known, fresh) => [...(known ?? []), ...fresh].slice(-MOST_POINTS);

// A figure of 0 to 1 over the last two minutes. above: whether it is bad above its threshold.
export class TimePlot {
  constructor(name, { above, at }) {
    Object.assign(this, { name, above, at });
    this.value = element("b");
    this.limit = element("span", { className: "faint" });
    this.line = drawn("polyline", { class: "line" });
    this.dashed = drawn("line", { class: "limit", x1: 0, x2: WIDTH });
    this.bad = drawn("rect", { class: "bad", x: 0, width: WIDTH });
    this.dot = drawn("circle", { class: "dot", r: 3 });
    const frame = drawn("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", "aria-hidden": "true" }, this.bad, this.dashed, this.line);
    this.part = element("figure", { className: "plot" }, element("figcaption", {}, element("span", {}, name), this.value, this.limit), frame);
  }

  show(points, limit, time) {
    const known = points.filter((point) => time - point[0] < SECONDS);
    const last = known.at(-1)?.[this.at] ?? null;
    const over = last !== null && limit !== undefined && limit >= 0 && (this.above ? last > limit : last < limit);
    showText(this.value, last === null ? "not known" : percent(last));
    this.value.className = over ? "over" : "";
    showText(this.limit, limit === undefined || limit < 0 ? "no limit" : `${this.above ? "calls above" : "blocked below"} ${percent(limit)}${over ? ": it is" : ""}`);
    const y = (share) => (HEIGHT - 2 - share * (HEIGHT - 4)).toFixed(1);
    changed(this.dashed, limit ?? null, (line) => {
      const there = limit !== undefined && limit >= 0;
      for (const part of [line, this.bad]) part.setAttribute("visibility", there ? "visible" : "hidden");
      if (!there) return;
      for (const side of ["y1", "y2"]) line.setAttribute(side, y(limit));
      this.bad.setAttribute("y", this.above ? 0 : y(limit));
      this.bad.setAttribute("height", Math.max(0, this.above ? y(limit) : HEIGHT - y(limit)));
    });
    const drawnPoints = known.filter((point) => point[this.at] !== null)
      .map((point) => `${(WIDTH * (1 - (time - point[0]) / SECONDS)).toFixed(1)},${y(point[this.at])}`).join(" ");
    this.line.setAttribute("points", drawnPoints);
  }
}

// The drivable share of each sector ahead: the longer a wedge, the more of it is drivable.
export class Fan {
  constructor() {
    this.frame = drawn("svg", { viewBox: "-110 -112 220 124", role: "img", "aria-label": "Drivable share of the sectors ahead" });
    this.text = element("span", { className: "faint" });
    this.part = element("figure", { className: "fan" }, element("figcaption", {}, "Drivable ahead, by direction ", this.text), this.frame);
  }

  show(ahead) {
    changed(this.frame, ahead && [ahead.sectors, ahead.field_of_view], (frame) => {
      const sectors = ahead?.sectors ?? [];
      const view = ((ahead?.field_of_view || 60) * Math.PI) / 180;
      const wedge = (from, to, radius, kind) => {
        const point = (angle) => `${(radius * Math.sin(angle)).toFixed(1)},${(-radius * Math.cos(angle)).toFixed(1)}`;
        return drawn("path", { class: kind, d: `M0,0 L${point(from)} A${radius},${radius} 0 0 1 ${point(to)} Z` });
      };
      const step = view / Math.max(1, sectors.length);
      const parts = sectors.flatMap((share, at) => {
        const from = -view / 2 + at * step, to = from + step;
        return share === null
          ? [wedge(from, to, 104, "unknown")]
          : [wedge(from, to, 104, "ground"), wedge(from, to, 14 + 90 * share, share >= 0.5 ? "drivable" : "blocked")];
      });
      frame.replaceChildren(...parts, drawn("path", { class: "own", d: "M-9,9 L0,-9 L9,9 L0,4 Z" }));
      const known = sectors.filter((share) => share !== null);
      const free = known.filter((share) => share >= 0.5).length;
      showText(this.text, known.length ? `${free} of ${known.length} known sectors mostly drivable` : "not known");
      frame.setAttribute("aria-label", `From the left: ${sectors.map((share) => (share === null ? "not known" : percent(share))).join(", ")}`);
    });
  }
}
