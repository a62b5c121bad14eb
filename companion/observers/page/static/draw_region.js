// Draws the region of interest of the file over the newest picture. What was drawn waits among the changed settings.

import { dragged, regionOf } from "./boxes.js";
import { element, showText } from "./elements.js";
import { BAR, FOOT } from "./picture.js";

const COMPUTED = "The region is computed from mount, width and speed: change [roi] near, far or width.";

export class DrawRegion {
  // picture: the live picture. settings: {row(key), change(changes), inMetres}, as of `Settings`.
  constructor(picture, settings) {
    Object.assign(this, { picture, settings, drag: null });
    this.toggle = element("button", { type: "button", className: "plain", "aria-pressed": "false", onclick: () => this.turn(!this.drag) }, "Draw the region");
    this.note = element("p", { className: "faint", role: "status" });
    this.row = element("div", { className: "row" }, this.toggle, this.note);
    this.part = element("div", { hidden: true }, this.row);
    document.addEventListener("keydown", ({ key }) => key === "Escape" && this.turn(false));
    new ResizeObserver(() => this.band()).observe(picture);
  }

  // may: whether settings can be changed on this page.
  show(may) {
    const computed = this.settings.inMetres;
    this.part.hidden = !may;
    this.toggle.disabled = computed;
    if (!may || computed) this.turn(false);
    if (computed) showText(this.note, COMPUTED);
    else if (this.note.textContent === COMPUTED) showText(this.note, "");
    this.band();
  }

  // Shows what waits among the settings, and nothing else.
  band() {
    const drawn = Object.keys(regionOf([])).map((key) => this.settings.row(key));
    this.drag?.show(drawn.some((row) => row?.changed) ? drawn.map((row) => row.value ?? row.default) : null);
  }

  turn(on) {
    if (on === Boolean(this.drag)) return;
    const pane = this.picture.parentElement;
    this.toggle.setAttribute("aria-pressed", String(on));
    pane.classList.toggle("drawing", on);
    if (on) {
      // The live picture has bars that are no part of the frame.
      const place = () => {
        const high = this.picture.naturalHeight || BAR + FOOT + 1, whole = this.picture.clientHeight / pane.clientHeight;
        return { left: 0, top: (whole * BAR) / high, width: 1, height: (whole * (high - BAR - FOOT)) / high };
      };
      const may = () => this.picture.naturalHeight > 0 && !this.picture.hidden;
      this.drag = dragged(pane, place, (box) => this.take(box), { may, dropped: () => this.band() });
      this.band();
    } else {
      this.drag.end();
      this.drag = null;
    }
    showText(this.note, on ? "Drag a box over the picture." : "");
    // A phone does not show the settings and the picture at once.
    const hadFocus = document.activeElement === this.toggle;
    (on ? pane.parentElement : this.part).append(this.row);
    if (hadFocus) this.toggle.focus({ preventScroll: true });
    if (on) pane.scrollIntoView({ block: "center" });
  }

  async take(box) {
    showText(this.note, (await this.settings.change(regionOf(box))) || "It is drawn, and not written yet: see below the settings.");
    this.band();
  }
}
