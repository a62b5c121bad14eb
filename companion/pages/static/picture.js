// A call's picture with what is marked in it. An operator who may answer points at the thing in it.

import { changed, drawn, element, showText } from "./elements.js";
import { dragBox, movedBox, tapBox } from "./boxes.js";

export const BAR = 34; // px of 480 wide pictures above the frame
export const FOOT = 30; // and below it
const STEP = 0.01;

export class Picture {
  // picked: called with the operator's box, in fractions of the frame; null where nobody may point.
  constructor(kind, title, picked) {
    Object.assign(this, { kind, picked });
    this.under = element("img", { draggable: false, alt: "", hidden: true });
    this.image = element("img", { draggable: false, alt: "" });
    this.marks = drawn("svg", { viewBox: "0 0 100 100", preserveAspectRatio: "none", "aria-hidden": "true" });
    this.note = element("p", { className: "note" });
    const aims = { type: "button", "aria-label": `${title}. Click or drag to point at the thing; arrow keys move your frame, with shift they change its size.` };
    this.frame = element(picked ? "button" : "div", { className: "aim", ...(picked ? aims : {}) }, this.under, this.image, this.marks);
    this.share = element("input", { type: "range", min: 0, max: 100, step: 5, value: 100, oninput: () => this.blend() });
    this.fade = element("label", { className: "fade", hidden: true }, "Fade", this.share);
    this.part = element("figure", { className: `shot ${kind}` }, element("div", { className: "pane" }, this.frame, this.note), element("figcaption", {}, title, kind === "large" ? this.fade : ""));
    this.image.addEventListener("load", () => this.fit());
    this.image.addEventListener("error", () => showText(this.note, "The picture did not come whole."));
    if (picked) this.listen();
  }

  listen() {
    let from = null;
    const at = (event) => {
      const box = this.frame.getBoundingClientRect();
      return { x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height };
    };
    this.frame.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || !this.open) return;
      from = at(event);
      this.frame.setPointerCapture(event.pointerId);
    });
    this.frame.addEventListener("pointermove", (event) => from && this.far(from, at(event)) && this.picked(dragBox(from, at(event))));
    this.frame.addEventListener("pointerup", (event) => {
      if (from && !this.far(from, at(event))) this.picked(tapBox(from.x, from.y, this.like));
      from = null;
    });
    this.frame.addEventListener("pointercancel", () => (from = null));
    this.frame.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] }[event.key];
      if (!way || !this.open) return;
      event.preventDefault();
      this.picked(movedBox(this.own ?? this.like ?? tapBox(0.5, 0.6), ...way, event.shiftKey));
    });
  }

  far(from, to) {
    return Math.hypot(to.x - from.x, to.y - from.y) > 0.03;
  }

  // The large picture has bars that are no part of the frame: they are cut off.
  fit() {
    const { naturalWidth: width, naturalHeight: height } = this.image;
    const inside = this.kind === "large" ? height - BAR - FOOT : height;
    if (inside <= 0) return showText(this.note, "The picture is not one of this companion's.");
    this.frame.style.aspectRatio = `${width} / ${inside}`;
    this.image.style.top = this.kind === "large" ? `${(-100 * BAR) / inside}%` : "0";
    this.image.style.height = `${(100 * height) / inside}%`;
  }

  // The judgement fades out, and the frame under it comes out.
  blend() {
    this.image.style.opacity = this.share.value / 100;
    this.share.setAttribute("aria-valuetext", `${this.share.value} percent of the judgement`);
  }

  // own: the operator's box, null without one. under: the picture without marks, over which this one lies.
  // plain: whether the picture is without marks.
  show(what) {
    const { url, alt, note, roi, box, own, open, size, under, plain } = what;
    this.last = what;
    this.like = box;
    this.own = own;
    this.open = open;
    if (this.picked) this.frame.disabled = !open;
    changed(this.image, url, (image) => {
      image.hidden = !url;
      if (url) image.src = url;
    });
    changed(this.under, under ?? "", (image) => {
      this.fade.hidden = image.hidden = !under;
      if (under) image.src = under;
      this.blend();
    });
    if (!url && size) this.frame.style.aspectRatio = `${size[0]} / ${size[1]}`;
    this.image.alt = alt;
    showText(this.note, url ? "" : note);
    const bare = !url || plain || under;
    changed(this.marks, [bare, roi, box, own], (marks) => {
      const outline = (sides, kind) => sides ? [drawn("rect", { class: kind, x: 100 * sides[0], y: 100 * sides[1], width: 100 * (sides[2] - sides[0]), height: 100 * (sides[3] - sides[1]) })] : [];
      marks.replaceChildren(...outline(bare ? roi : null, "halo"), ...outline(bare ? roi : null, "roi"), ...outline(own ? null : box, "halo"), ...outline(own ? null : box, "tile"), ...outline(own, "halo"), ...outline(own, "own"));
    });
  }
}
