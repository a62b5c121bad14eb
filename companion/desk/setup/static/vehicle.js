// Page 3: the vehicle, how fast it drives, and in how many metres it stops.

import { element, showText } from "./elements.js";
import { fieldset } from "./fields.js";
import { groundMarks } from "./live.js";

export class VehiclePage {
  constructor(store, live) {
    Object.assign(this, { store, live });
    this.view = element("div");
    this.stops = element("p", { className: "verdict-box", role: "status" });
    this.groups = [
      fieldset(store, "Vehicle", {
        "mount.width": { name: "Width, m", help: "With it the region of interest is one in metres." },
        "mount.front": { name: "Lens to its front, m", help: "Metres count from the front." },
        "guide.radius": { name: "Tightest turn, radius in m", help: "Only policy guide needs it." },
      }),
      fieldset(store, "Speed and brakes", {
        "stopping.speed": { name: "Fastest speed by itself, m/s", help: "As the autopilot is commanded. 12 % more are assumed." },
        "stopping.time_constant": { name: "Time constant, s", help: "Measured by `companion check --measure`. Not set: 2.1 s." },
        "stopping.braking": { name: "Braking in HOLD, m/s²", help: "Measured by the same command." },
        "stopping.delay": { name: "Until a hold is accepted, s", help: "From the command to the autopilot." },
        "stopping.hold_by": { name: "How it stops", help: "hold: HOLD. brake: our script brakes first." },
      }),
    ];
    this.part = element("div", { className: "columns" },
      element("section", {}, element("h2", {}, "Vehicle and speed"), this.stops, ...this.groups.map((group) => group.part)),
      element("section", {}, element("h2", {}, "Where it stands after a stop"), this.view,
        element("p", { className: "faint" }, "Orange: where the vehicle's front stands when it has stopped for a thing that it just begins to see. Yellow: its way.")));
  }

  enter() {
    this.live.show(this.view, { draw: (width, height) => groundMarks({ lines: this.store.state.lines }, width, height) });
  }

  show(state) {
    this.groups.forEach((group) => group.show());
    this.stops.dataset.tone = state.enough ? "good" : "warn";
    const text = state.stops;
    showText(this.stops, text.startsWith("set ") ? `Not known yet whether it stops in time: ${text}.` : `${text[0].toUpperCase()}${text.slice(1)}.`);
    if (this.live.part.isConnected) this.live.fit();
  }

  done() {
    return this.store.value("stopping.speed") !== null;
  }
}
