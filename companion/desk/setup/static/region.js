// Page 4: the region of interest, in metres from the mount, or drawn in the picture.

import { dragged, regionOf } from "./boxes.js";
import { element, showText } from "./elements.js";
import { fieldset } from "./fields.js";
import { groundMarks } from "./live.js";
import { button, problem } from "./parts.js";

export class RegionPage {
  constructor(store, live) {
    Object.assign(this, { store, live });
    this.view = element("div");
    this.problem = problem();
    this.how = element("p", { role: "status" });
    this.metres = fieldset(store, "In metres", {
      "roi.near": { name: "Begins, m ahead", help: "Of the vehicle's front." },
      "roi.far": { name: "Ends, m ahead", help: "Not set: 1.2 times what stopping needs, and 0.5 m." },
      "roi.width": { name: "Width, m", help: "Not set: the vehicle's, and 0.6 m." },
    });
    this.drawn = fieldset(store, "In fractions of the picture", {
      "roi.left": { name: "Left" }, "roi.top": { name: "Top" }, "roi.right": { name: "Right" }, "roi.bottom": { name: "Bottom" },
      "corridor.bottom": { name: "Vehicle's width at the bottom", help: "As it appears in the picture, a fraction of its width." },
      "corridor.top": { name: "Vehicle's width at the top", help: "The same at the region's upper side." },
    });
    this.instead = button("Draw it instead", () => this.draw());
    this.part = element("div", { className: "columns picture-first" },
      element("section", {}, element("h2", {}, "Region of interest"), this.view, this.problem),
      element("section", {}, element("h2", {}, "What is judged"),
        element("p", {}, "Only what is in the region can call or stop the rover. A faster or bigger vehicle needs a bigger one."),
        this.how, this.metres.part, this.drawn.part, this.instead));
  }

  get inMetres() {
    return this.store.value("mount.width") !== null && this.store.state.known && (this.store.value("roi.far") !== null || this.store.value("stopping.speed") !== null);
  }

  enter() {
    this.live.show(this.view, { draw: (width, height) => groundMarks({ lines: this.inMetres ? this.store.state.lines : [], region: this.store.state.region }, width, height) });
    const whole = () => ({ left: 0, top: 0, width: 1, height: this.live.image.clientHeight / this.live.pane.clientHeight });
    this.drag = dragged(this.live.pane, whole, (box) => this.set(box), { may: () => !this.inMetres });
  }

  leave() {
    this.drag.end();
    this.live.pane.classList.remove("drawing");
  }

  async set(box) {
    showText(this.problem, await this.store.change(regionOf(box)));
    this.drag.show(null);
  }

  async draw() {
    showText(this.problem, await this.store.change({ "mount.width": null }));
  }

  show(state) {
    this.metres.show();
    this.drawn.show();
    const metres = this.inMetres;
    this.metres.part.hidden = !metres;
    this.drawn.part.hidden = metres;
    this.instead.hidden = !metres;
    this.instead.textContent = "Draw it instead (takes the vehicle's width out)";
    this.live.pane.classList.toggle("drawing", !metres);
    showText(this.how, state.region_problem ?? (metres ? "It is computed from mount, width and speed. Leave what is not set, or type metres."
      : "Drag a box over the picture, or type it. With mount, the vehicle's width and speed it is computed in metres."));
    if (this.live.part.isConnected) this.live.fit();
  }

  done(state) {
    return state.region.length > 0 && (this.inMetres || state.changed.some((key) => key.startsWith("roi.")));
  }
}
