// Page 7: the autopilot's parameters that `companion check` judges. One is set only by a click that says so.

import { job } from "./api.js";
import { element, showText } from "./elements.js";
import { button, findings, problem, waiting } from "./parts.js";
import { say } from "./sending.js";

const shown = (value) => String(Math.round(value * 1e4) / 1e4);

export class AutopilotPage {
  constructor(store) {
    this.store = store;
    this.status = element("p", { className: "faint", role: "status" });
    this.problem = problem();
    this.reading = button("Read its settings", () => this.read(), { className: "primary" });
    this.others = element("div");
    this.table = element("div");
    this.part = element("section", {}, element("h2", {}, "Autopilot"),
      element("p", {}, "What makes a hold unsafe or useless stands on top. Reading changes nothing. Set a value here by its button, or at your ground station."),
      this.reading, this.status, this.problem, this.others, this.table);
  }

  async read() {
    this.reading.disabled = true;
    this.take(await job("autopilot", {}, waiting(this.status, "Asking the autopilot")));
    this.reading.disabled = false;
  }

  take({ answer, problem: wrong }) {
    showText(this.status, "");
    showText(this.problem, wrong ?? "");
    if (answer) this.tell((this.result = answer));
  }

  tell({ autopilot, system, rows, others }) {
    showText(this.status, `${autopilot}, system ${system}: ${rows.length} parameters are judged, ${rows.filter((row) => row.verdict !== "pass").length} are to change.`);
    findings(this.others, others);
    const head = element("thead", {}, element("tr", {}, ...["Parameter", "Now", "Why", "Set"].map((name) => element("th", { scope: "col" }, name))));
    const bad = rows.filter((row) => row.verdict !== "pass");
    const good = rows.filter((row) => row.verdict === "pass");
    const list = bad.filter((row) => row.proposed !== null).map((row) => `${row.name},${shown(row.proposed)}`).join("\n");
    this.table.replaceChildren(
      bad.length ? element("table", { className: "parameters" }, head, element("tbody", {}, ...bad.map((row) => this.row(row)))) : rows.length ? element("p", {}, "Nothing is to change.") : "",
      list ? element("details", {}, element("summary", {}, "The same as a list to type or load"), element("pre", { tabIndex: 0, "aria-label": "Parameters and values" }, list)) : "",
      element("details", {}, element("summary", {}, `${good.length} that are well`), element("p", {}, good.map((row) => `${row.name} ${shown(row.value)}`).join(", "))));
  }

  row({ name, value, verdict, text, proposed }) {
    const set = proposed === null ? "by hand" : button(`Set ${name} from ${shown(value)} to ${shown(proposed)}`, (event) => this.set(event.target, { name, before: value, after: proposed }));
    return element("tr", {}, element("th", { scope: "row" }, name), element("td", {}, shown(value)),
      element("td", {}, element("span", { className: "verdict", tone: verdict }, verdict), ` ${text}`), element("td", {}, set));
  }

  async set(pressed, told) {
    pressed.disabled = true;
    const found = await job("parameter", told, waiting(this.status, `Setting ${told.name}`));
    pressed.disabled = false;
    this.take(found);
    if (found.answer) say(`${told.name} is ${shown(told.after)}, read back.`);
  }

  show() {
    if (!this.result || this.result.url === this.store.value("link.url")) return;
    this.result = null;
    this.others.replaceChildren();
    this.table.replaceChildren();
    showText(this.status, "The link is another one now: read the settings of its autopilot.");
  }

  done() {
    return Boolean(this.result);
  }
}
