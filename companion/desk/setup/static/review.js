// Page 9: what is changed, the file, and what to do next.

import { job } from "./api.js";
import { changed, element, showText } from "./elements.js";
import { button, problem, waiting } from "./parts.js";
import { differences } from "./settings_list.js";

export class ReviewPage {
  constructor(store) {
    this.store = store;
    this.text = element("p", { role: "status" });
    this.diff = element("pre", { tabIndex: 0, "aria-label": "Changes of the file" });
    this.guarded = element("p", { className: "faint" });
    this.problem = problem();
    this.write = button("Write the file", () => this.post("/write"), { className: "primary" });
    this.undo = button("Take all changes back", () => this.post("/forget"));
    this.commands = element("ol", { className: "todo-list" });
    this.trial = button("Raise a test call", () => this.call());
    this.status = element("p", { className: "faint", role: "status" });
    this.part = element("div", { className: "columns" },
      element("section", {}, element("h2", {}, "Review"), this.text, this.guarded, this.diff, element("div", { className: "row" }, this.write, this.undo), this.problem),
      element("section", {}, element("h2", {}, "Next"), this.commands,
        element("p", {}, "While the companion runs, a test call shows whether your ground station is told, and whether its answer comes back. It holds nothing and teaches nothing."),
        this.trial, this.status));
  }

  enter() {
    this.store.load(); // whether the companion runs by now
  }

  show({ next, diff, changed: keys, guarded, written }) {
    const count = keys.length;
    showText(this.text, count ? `${count} ${count === 1 ? "setting is" : "settings are"} changed and not written.` : written || "Nothing is changed yet.");
    showText(this.guarded, count && guarded.length ? `Only on this computer may these be set: ${guarded.join(", ")}.` : "");
    changed(this.diff, diff, (part) => {
      part.hidden = !diff;
      part.replaceChildren(...differences(diff));
    });
    this.write.disabled = this.undo.disabled = !diff;
    changed(this.commands, next, (home) => home.replaceChildren(...next.map(([what, command]) => element("li", {}, `${what}: `, element("code", {}, command)))));
  }

  async post(path) {
    if (path === "/forget") this.store.refused.clear();
    const wrong = await this.store.post(path);
    if (wrong) await this.store.load(); // what it would change in the file as it is by now
    showText(this.problem, wrong);
  }

  async call() {
    this.trial.disabled = true;
    const { answer, problem: wrong } = await job("trial", {}, waiting(this.status, "Look at your ground station: a test call is raised, answer it"));
    this.trial.disabled = false;
    showText(this.status, wrong ?? answer.said.join(" "));
  }

  done(state) {
    return Boolean(state.written) && !state.changed.length;
  }
}
