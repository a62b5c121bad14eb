// The live picture of the draft's camera, with marks over it. It is asked for while a page shows it.

import { ask } from "./api.js";
import { drawn, element, showText } from "./elements.js";

const EVERY = 350; // ms

export class Live {
  constructor() {
    this.image = element("img", { alt: "The camera's picture", draggable: false, hidden: true });
    this.lines = drawn("g");
    this.handles = drawn("g");
    this.marks = drawn("svg", { class: "marks" }, this.lines, this.handles);
    this.note = element("p", { className: "note" }, "The camera is being opened.");
    this.pane = element("div", { className: "frame pane" }, this.image, this.marks, this.note);
    this.part = element("figure", { className: "live" }, this.pane);
    this.told = null;
    this.draw = () => {};
    this.changed = () => {};
    this.shown = 0;
    this.image.addEventListener("load", () => this.fit());
    setInterval(() => this.look(), EVERY);
  }

  // draw: makes the marks, given the picture's width and height. changed: called with what the camera says.
  show(home, { draw = () => [], changed = () => {} } = {}) {
    Object.assign(this, { draw, changed });
    this.handles.replaceChildren();
    home.append(this.part);
    this.fit();
    if (this.told) changed(this.told);
  }

  fit() {
    const { naturalWidth: width, naturalHeight: height } = this.image;
    if (!width) return;
    this.marks.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.lines.replaceChildren(...this.draw(width, height));
  }

  // One that stays is not moved: it may be dragged, or have the focus.
  hold(handles) {
    for (const one of [...this.handles.children]) if (!handles.includes(one)) one.remove();
    for (const one of handles) if (one.parentNode !== this.handles) this.handles.append(one);
  }

  async look() {
    if (this.busy || document.hidden || !this.part.isConnected) return;
    this.busy = true;
    const { answer, problem } = await ask("/camera.json");
    this.busy = false;
    showText(this.note, problem ?? (answer.has_picture && !answer.trouble ? "" : answer.trouble));
    if (!answer) return;
    this.told = answer;
    this.image.hidden = !answer.has_picture;
    this.pane.classList.toggle("empty", !answer.has_picture);
    if (answer.has_picture && answer.number !== this.shown) {
      this.shown = answer.number;
      this.image.src = `/frame.jpg?n=${answer.number}`;
    }
    this.changed(answer);
  }
}

// Lines of the ground, as `ground` of mount.py tells them, without a handle.
export function groundMarks({ lines, region }, width, height) {
  const at = ([x, y]) => [x * width, y * height];
  const line = (kind, { start, end }) => {
    const [[x1, y1], [x2, y2]] = [at(start), at(end)];
    return drawn("line", { class: kind, x1, y1, x2, y2 });
  };
  const size = Math.max(9, width / 40);
  const text = ({ kind, label, labelled }) => {
    const [x, y] = at(labelled);
    return drawn("text", { class: kind, x: x + (kind === "stop" ? 4 : -4), y: Math.max(y - size / 4, size), "font-size": size }, label);
  };
  const area = region?.length ? [drawn("polygon", { class: "region", points: region.map((one) => at(one).join(",")).join(" ") })] : [];
  return [...area, ...lines.flatMap((one) => [line(`halo ${one.kind}`, one), line(one.kind, one)]), ...readable(lines, size / height).map(text)];
}

// Leaves out the labels of metres that would lie over each other: the farther, the closer they are.
function readable(lines, apart) {
  let last = Infinity;
  return lines.filter(({ kind, labelled: [, y] }) => {
    if (kind !== "metre") return true;
    if (last - y < apart) return false;
    last = y;
    return true;
  });
}
