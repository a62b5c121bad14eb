// Lays the lines over the live picture that show where [mount] puts the ground, while somebody wants them.

import { changed, drawn, element } from "./elements.js";
import { BAR, FOOT } from "./picture.js";

export class Metres {
  // image: the live picture, over which the lines lie. home: where the switch stands.
  constructor(image, home) {
    this.image = image;
    this.lines = [];
    this.marks = drawn("svg", { class: "metres", "aria-hidden": "true" });
    this.wanted = element("input", { type: "checkbox", onchange: () => this.draw() });
    this.part = element("label", { className: "fade", hidden: true, title: "Where [mount] puts the ground, ahead of the front" }, this.wanted, "Metres");
    image.after(this.marks);
    home.append(this.part);
    image.addEventListener("load", () => this.draw());
  }

  // lines: {kind, label, start, end, labelled} each, places in fractions of the frame; none without a mount.
  show(lines) {
    this.lines = lines;
    this.part.hidden = !lines.length;
    this.draw();
  }

  // The live picture has bars that are no part of the frame.
  draw() {
    const { naturalWidth: width, naturalHeight: height } = this.image;
    const lines = this.wanted.checked && height > BAR + FOOT ? this.lines : [];
    changed(this.marks, [lines, width, height], (marks) => {
      const at = ([x, y]) => [x * width, BAR + y * (height - BAR - FOOT)];
      const line = (kind, { start: [x1, y1], end: [x2, y2] }) => drawn("line", { class: kind, x1, y1, x2, y2 });
      const text = ({ kind, label, labelled: [x, y] }) => drawn("text", { class: kind, x: x + (kind === "stop" ? 4 : -4), y: Math.max(y - 4, BAR + 12) }, label);
      const placed = lines.map((one) => ({ ...one, start: at(one.start), end: at(one.end), labelled: at(one.labelled) }));
      marks.setAttribute("viewBox", `0 0 ${width} ${height}`);
      marks.replaceChildren(...placed.flatMap((one) => [line(`halo ${one.kind}`, one), line(one.kind, one)]), ...placed.map(text));
    });
  }
}
