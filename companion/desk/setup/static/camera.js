// Page 1: which camera, and what it delivers.

import { job } from "./api.js";
import { changed, element, showText } from "./elements.js";
import { Field, fieldset } from "./fields.js";
import { findings, problem, waiting } from "./parts.js";

export class CameraPage {
  constructor(store, live) {
    Object.assign(this, { store, live });
    this.choices = element("div", { className: "choices", role: "radiogroup", "aria-label": "Camera" });
    this.status = element("p", { className: "faint", role: "status" });
    this.source = new Field(store, "camera.source", { name: "Another source", help: "rtsp://… and http://… for network cameras, pipe:COMMAND for a program that writes raw pictures, video:FILE, folder:FOLDER, field:HOST:PORT for the simulated field." });
    this.problem = problem();
    this.measured = element("div", { className: "measured" });
    this.view = element("div");
    this.source.input.addEventListener("change", () => (this.more.open ||= this.source.input.value.startsWith("pipe:"))); // a program cannot say them
    this.fields = fieldset(store, "What the picture is", {
      "camera.view": { name: "Horizontal view, degrees", help: "From the camera's data sheet. The ground in metres needs it." },
      "camera.rate": { name: "Frames a second to judge", help: "More sees things sooner and needs a faster computer." },
    });
    this.format = fieldset(store, "Of a program's pictures (pipe:) and USB cameras", {
      "camera.width": { name: "Width, pixels" },
      "camera.height": { name: "Height, pixels" },
      "camera.pixel_format": { name: "Pixel format" },
    });
    this.more = element("details", {}, element("summary", {}, "Size and format"), this.format.part);
    this.part = element("div", { className: "columns" },
      element("section", {}, element("h2", {}, "Camera"),
        element("p", {}, "Choose what the rover sees with. It is opened at once."),
        this.status, this.choices,
        this.problem, element("form", { onsubmit: (event) => { event.preventDefault(); this.source.send(); } }, this.source.part, element("button", { type: "submit" }, "Use it")),
        this.fields.part, this.more),
      element("section", {}, element("h2", {}, "What it delivers"), this.view, this.measured));
  }

  enter() {
    this.live.show(this.view, { changed: (told) => this.tell(told) });
    if (!this.listed) this.list();
  }

  async list() {
    this.listed = true;
    const { answer = [], problem: wrong } = await job("cameras", {}, waiting(this.status, "Looking for cameras"));
    showText(this.status, wrong ?? (answer.length ? "" : "No camera is plugged in here, as far as the kernel knows."));
    this.found = answer;
    this.show();
  }

  show() {
    this.source.show();
    this.fields.show();
    this.format.show();
    const own = this.store.value("camera.source");
    changed(this.choices, [this.found, own, this.chosen], (home) => home.replaceChildren(...(this.found ?? []).map((one) => this.choice(one, own))));
  }

  choice(one, own) {
    const input = element("input", { type: "radio", name: "camera", checked: one.source === own && own !== "", disabled: Boolean(one.why), onchange: () => this.choose(one) });
    return element("label", { className: "choice" }, input, element("span", {}, one.name, one.why ? element("span", { className: "problem" }, ` ${one.why}`) : ""));
  }

  async choose({ source, width, height, pixel_format }) {
    showText(this.problem, await this.store.change({ "camera.source": source, "camera.width": width, "camera.height": height, "camera.pixel_format": pixel_format }));
    this.chosen = (this.chosen ?? 0) + 1; // one that was refused is not chosen
    this.show();
  }

  // The picture's shape is measured: nobody need type it.
  async tell(told) {
    findings(this.measured, told.rows);
    if (!told.has_picture || told.trouble || !told.width || told.has_shape || this.shaping) return;
    this.shaping = true;
    await this.store.change({ "mount.aspect": Math.round((1000 * told.width) / told.height) / 1000 });
    this.shaping = false;
  }

  done(state) {
    return Boolean(this.live.told?.has_picture && !this.live.told.trouble);
  }
}
