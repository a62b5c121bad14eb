// Page 2: where the camera is mounted, by lines that are dragged onto the ground in the picture.

import { ask, job } from "./api.js";
import { drawn, element, showText } from "./elements.js";
import { fieldset } from "./fields.js";
import { groundMarks } from "./live.js";
import { button, problem, waiting } from "./parts.js";

const STEP = 0.004;

export class MountPage {
  constructor(store, live) {
    Object.assign(this, { store, live, rows: {}, handles: new Map() });
    this.problem = problem();
    this.view = element("div");
    this.metres = element("select", { id: "mark-at", onchange: () => this.live.fit() }, ...[1, 2, 3, 4, 5].map((at) => element("option", { value: at, selected: at === 2 }, `${at} m`)));
    this.fields = fieldset(store, "The mount in numbers", {
      "mount.height": { name: "Height of the lens, m", help: "Above the ground." },
      "mount.tilt": { name: "Tilt, degrees", help: "Of the lens axis below the horizon." },
      "mount.front": { name: "Lens to the vehicle's front, m", help: "Metres count from the front." },
      "mount.roll": { name: "Roll, degrees", help: "Above 0 the right side is down." },
      "mount.heading": { name: "Heading, degrees", help: "Clockwise from the nose." },
    });
    this.text = element("p", { className: "faint" });
    this.status = element("p", { role: "status" });
    this.use = button("Use them", () => this.take(), { hidden: true });
    this.estimate = element("div", {}, button("Estimate it by the recorded drives", (event) => this.ask(event.target)), this.status, this.use);
    this.part = element("div", { className: "columns picture-first" },
      element("section", {}, element("h2", {}, "Where the ground is"), this.view, this.text, this.problem),
      element("section", {}, element("h2", {}, "Mount"),
        element("ol", { className: "todo-list" },
          element("li", {}, "Stand the rover on level ground, and type how far the lens is behind the vehicle's front."),
          element("li", {}, "Drag the horizon line to the horizon. It sets the tilt."),
          element("li", {}, element("label", { for: "mark-at" }, "Lay a mark on the ground ahead of the vehicle's front, at "), this.metres, ", and drag that line onto it. It sets the height."),
          element("li", {}, "Or measure, and type the numbers. Of a recorded drive, ", element("code", {}, "companion look-ground DRIVE --estimate"), " proposes them.")),
        element("p", { className: "faint" }, "With the keyboard: Tab to a line, then arrow up and down."),
        this.estimate, this.fields.part));
  }

  enter() {
    this.live.show(this.view, { draw: (width, height) => this.draw(width, height) });
  }

  show(state) {
    this.fields.show();
    this.estimate.hidden = !state.recorded;
    showText(this.text, state.known ? `Height ${this.store.value("mount.height")} m, tilt ${this.store.value("mount.tilt")} degrees.` : "Not set yet: the lines show a camera 1 m high and tilted by 10 degrees.");
    if (this.live.part.isConnected) this.live.fit();
  }

  draw(width, height) {
    const { lines } = this.store.state;
    const wanted = { horizon: lines.find((one) => one.kind === "horizon"), [this.metres.value]: lines.find((one) => one.kind === "metre" && one.label === `${this.metres.value} m`) };
    this.live.hold(Object.entries(wanted).map(([name, line]) => this.handle(name, line, width, height)));
    return groundMarks({ lines }, width, height);
  }

  handle(name, line, width, height) {
    const row = line ? (line.start[1] + line.end[1]) / 2 : name === "horizon" ? 0.02 : 0.98;
    this.rows[name] = row;
    if (!this.handles.has(name)) this.handles.set(name, this.made(name));
    const part = this.handles.get(name);
    const at = Math.min(0.98, Math.max(0.02, row)) * height;
    part.setAttribute("aria-valuenow", Math.round(100 * row));
    part.setAttribute("aria-valuetext", `${Math.round(100 * row)} percent from the top${line ? "" : ", out of the picture"}`);
    const [hit, circle, arrows] = part.children;
    for (const [attribute, value] of Object.entries({ x1: 0, x2: width, y1: at, y2: at })) hit.setAttribute(attribute, value);
    circle.setAttribute("cx", width / 2);
    circle.setAttribute("cy", at);
    circle.setAttribute("r", Math.max(9, width / 50));
    arrows.setAttribute("x", width / 2);
    arrows.setAttribute("y", at);
    arrows.setAttribute("font-size", Math.max(13, width / 32));
    return part;
  }

  made(name) {
    const label = name === "horizon" ? "Horizon line" : `Line ${name} m ahead`;
    const part = drawn("g", { class: "handle", role: "slider", tabindex: 0, "aria-label": label, "aria-orientation": "vertical", "aria-valuemin": 0, "aria-valuemax": 100 },
      drawn("line", { class: "hit" }), drawn("circle", {}), drawn("text", {}, "↕"));
    const row = (event) => {
      const box = this.live.image.getBoundingClientRect();
      return (event.clientY - box.top) / box.height;
    };
    let dragged = null; // the row under the pointer
    part.addEventListener("pointerdown", (event) => {
      if (event.button === 0) part.setPointerCapture(event.pointerId);
    });
    part.addEventListener("pointermove", (event) => {
      if (part.hasPointerCapture(event.pointerId)) this.move(name, (dragged = row(event)), false);
    });
    part.addEventListener("lostpointercapture", () => {
      if (dragged !== null) this.move(name, dragged, true);
      dragged = null;
    });
    part.addEventListener("keydown", (event) => {
      const way = { ArrowUp: -1, ArrowDown: 1, PageUp: -10, PageDown: 10 }[event.key];
      if (!way) return;
      event.preventDefault();
      this.move(name, this.rows[name] + way * STEP, true);
    });
    return part;
  }

  // One request at a time; only the newest place waits. final: whether the line stays there.
  async move(name, row, final) {
    this.rows[name] = row;
    const { refused } = this.store; // one of the two that is typed stays as it is
    this.next = { line: name, row, final, height: refused.get("mount.height")?.value, tilt: refused.get("mount.tilt")?.value };
    if (this.moving) return;
    this.moving = true;
    while (this.next) {
      const told = this.next;
      this.next = null;
      showText(this.problem, told.final ? await this.store.post("/drag", told) : await this.follow(told));
    }
    this.moving = false;
  }

  async follow(told) {
    const { answer, problem: wrong } = await ask("/drag", told);
    if (answer) {
      this.store.state.lines = answer.lines;
      this.live.fit();
    }
    return wrong ?? "";
  }

  async ask(pressed) {
    pressed.disabled = true;
    const { answer, problem: wrong } = await job("estimate", {}, waiting(this.status, "Comparing frames"));
    pressed.disabled = false;
    this.found = answer;
    this.use.hidden = !answer;
    showText(this.status, wrong ?? answer.text);
  }

  async take() {
    this.use.hidden = true;
    showText(this.problem, await this.store.change({ "mount.height": this.found.height, "mount.tilt": this.found.tilt }));
  }

  done(state) {
    return state.known;
  }
}
