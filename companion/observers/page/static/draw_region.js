// Draws the region of interest of the file over the newest picture. What was drawn waits among the changed settings.

import { dragged, regionOf } from "./boxes.js";
import { element, showText } from "./elements.js";
import { BAR, FOOT } from "./picture.js";

export class DrawRegion {
  // picture: the live picture. settings: {row(key), change(changes)}, as of `Settings`.
  constructor(picture, settings) {
    Object.assign(this, { picture, settings, drag: null });
    this.toggle = element("button", { type: "button", className: "plain", "aria-pressed": "false", onclick: () => this.turn(!this.drag) }, "Draw the region");
    this.note = element("p", { className: "faint", role: "status" });
    this.part = element("div", { className: "row", hidden: true }, this.toggle, this.note);
  }

  value(key) {
    return this.settings.row(key)?.value ?? null;
  }

  // As `region_of` of the configuration: with these it is computed.
  get inMetres() {
    return this.value("mount.width") !== null && (this.value("roi.far") !== null || this.value("stopping.speed") !== null);
  }

  // may: whether settings can be changed on this page.
  show(may) {
    this.part.hidden = !may;
    this.toggle.disabled = this.inMetres;
    if (this.inMetres) showText(this.note, "The region is computed from mount, width and speed: change [roi] near, far or width.");
    if (!may || this.inMetres) this.turn(false);
    const drawn = Object.keys(regionOf([])).map((key) => this.settings.row(key));
    this.drag?.show(drawn.some((row) => row?.changed) ? drawn.map((row) => row.value) : null);
  }

  turn(on) {
    const pane = this.picture.parentElement;
    this.toggle.setAttribute("aria-pressed", String(on));
    pane.classList.toggle("drawing", on);
    if (on && !this.drag) {
      // The live picture has bars that are no part of the frame.
      const place = () => {
        const high = this.picture.naturalHeight || BAR + FOOT + 1, whole = this.picture.clientHeight / pane.clientHeight;
        return { left: 0, top: (whole * BAR) / high, width: 1, height: (whole * (high - BAR - FOOT)) / high };
      };
      this.drag = dragged(pane, place, (box) => this.take(box));
      showText(this.note, "Drag a box over the picture.");
      pane.scrollIntoView({ block: "center" });
    } else if (!on && this.drag) {
      this.drag.end();
      this.drag = null;
      if (!this.inMetres) showText(this.note, "");
    }
  }

  async take(box) {
    showText(this.note, (await this.settings.change(regionOf(box))) || "It is drawn, and not written yet: see below the settings.");
  }
}
