// Page 6: the port on which the autopilot is, and who is heard there.

import { job } from "./api.js";
import { changed, element, showText } from "./elements.js";
import { button, problem, waiting } from "./parts.js";

const BAUDS = [57600, 115200, 230400, 460800, 500000, 921600];

// Whether an address is on this port, with any baud rate.
const isOf = (own, url) => own === url || own.startsWith(`${url}:`);

export class LinkPage {
  constructor(store) {
    this.store = store;
    this.own = element("p");
    this.choices = element("div", { className: "choices", role: "radiogroup", "aria-label": "Where to listen" });
    this.baud = element("select", { id: "baud", onchange: () => (this.heard = null) }, ...BAUDS.map((baud) => element("option", { value: baud }, String(baud))));
    this.typed = element("input", { type: "text", id: "typed-url", autocomplete: "off", placeholder: "udpin:0.0.0.0:14550", "aria-label": "Another address", oninput: () => (this.other.checked = true) });
    this.other = element("input", { type: "radio", name: "port", id: "other-port" });
    this.status = element("p", { className: "faint", role: "status" });
    this.problem = problem();
    this.table = element("div");
    this.listening = button("Listen", () => this.listen());
    this.part = element("div", { className: "columns" },
      element("section", {}, element("h2", {}, "Link"),
        element("p", {}, "Choose where the autopilot is wired to, and listen. Nothing is sent while it listens, but a heartbeat to a udpout address, where nobody knows us before."),
        this.own, this.choices,
        element("div", { className: "row" }, this.other, element("label", { for: "other-port" }, "Another address"), this.typed),
        element("div", { className: "row" }, element("label", { for: "baud" }, "Baud of a serial port"), this.baud),
        this.listening, this.status, this.problem),
      element("section", {}, element("h2", {}, "Who is there"), this.table));
  }

  enter() {
    if (!this.listed) this.list();
  }

  async list() {
    this.listed = true;
    const { answer = [], problem: wrong } = await job("ports", {}, waiting(this.status, "Looking for ports"));
    showText(this.status, wrong ?? "");
    this.ports = answer;
    const own = this.store.value("link.url");
    if (!this.typed.value && !answer.some(({ url }) => isOf(own, url))) Object.assign(this.typed, { value: own }), (this.other.checked = true);
    this.show();
  }

  show() {
    const own = this.store.value("link.url");
    showText(this.own, `In the file: ${own}`);
    changed(this.choices, this.ports, (home) => home.replaceChildren(...(this.ports ?? []).map(({ url, what }) =>
      element("label", { className: "choice" }, element("input", { type: "radio", name: "port", value: url, checked: !this.other.checked && isOf(own, url) }), element("span", {}, element("b", {}, url), ` ${what}`)))));
    if (this.result) this.tell(this.result);
  }

  get url() {
    const chosen = this.other.checked ? this.typed.value.trim().replace(/^\/dev\//, "serial:$&") : this.choices.querySelector("input:checked")?.value ?? "";
    return /^serial:.*(?<!:\d+)$/.test(chosen) ? `${chosen}:${this.baud.value}` : chosen;
  }

  async listen() {
    if (!this.url) return showText(this.problem, "Choose a port, or type an address.");
    this.listening.disabled = true;
    const { answer, problem: wrong } = await job("listen", { url: this.url }, waiting(this.status, `Listening on ${this.url}`));
    this.listening.disabled = false;
    showText(this.status, "");
    showText(this.problem, wrong ?? "");
    this.result = answer;
    if (answer) this.tell(answer);
    else changed(this.table, wrong, (home) => home.replaceChildren());
  }

  tell(told) {
    const own = this.store.value("link.url");
    changed(this.table, [told, own], (home) => {
      const cell = (text) => element("td", {}, text);
      const rows = told.heard.map((one) => element("tr", {}, element("th", { scope: "row" }, `${one.system}/${one.component}`), cell(one.type), cell(one.autopilot || "no autopilot")));
      const head = element("thead", {}, element("tr", {}, ...["System/component", "Type", "Autopilot"].map((name) => element("th", { scope: "col" }, name))));
      const found = told.heard.some((one) => one.is_autopilot);
      const use = own === told.url ? element("p", {}, "This port is chosen.") : button(`Use ${told.url}`, () => this.use(told.url), { className: found ? "primary" : "" });
      home.replaceChildren(
        element("p", {}, `${told.url}: ${told.bytes} bytes in ${told.seconds} s.`),
        rows.length ? element("table", {}, head, element("tbody", {}, ...rows)) : "",
        told.problem ? element("p", { className: "problem" }, told.problem) : "", use);
    });
  }

  async use(url) {
    showText(this.problem, await this.store.change({ "link.url": url }));
  }

  done() {
    return Boolean(this.result?.heard.some((one) => one.is_autopilot) && this.result.url === this.store.value("link.url"));
  }
}
