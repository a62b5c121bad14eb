// Page 8: what the companion may do to the vehicle, and what `companion check` says of each.

import { job } from "./api.js";
import { element, showText } from "./elements.js";
import { button, findings, problem, waiting } from "./parts.js";

export class PolicyPage {
  constructor(store) {
    this.store = store;
    this.status = element("p", { className: "faint", role: "status" });
    this.problem = problem();
    this.cards = element("div", { className: "policies", role: "radiogroup", "aria-label": "Policy" });
    this.part = element("section", {}, element("h2", {}, "Policy"),
      element("p", {}, "What the companion may do to the vehicle. Begin with report or shadow, watch it for some drives, then let it hold. A hold that cannot be given is a fault, never a quiet report."),
      this.status, this.problem, this.cards, button("Check again", () => this.check(), { className: "plain" }));
  }

  enter() {
    this.check();
  }

  async check() {
    if (this.checking) return;
    this.checking = true;
    const { answer, problem: wrong } = await job("policies", {}, waiting(this.status, "Checking"));
    this.checking = false;
    showText(this.status, "");
    showText(this.problem, wrong ?? "");
    if (answer) this.tell(answer);
  }

  tell(told) {
    this.result = told;
    this.cards.replaceChildren(...told.map((one) => this.card(one)));
  }

  card({ policy, what, rows, fails, warns, skips }) {
    const input = element("input", { type: "radio", name: "policy", id: `policy-${policy}`, value: policy, checked: policy === this.store.value("call.policy"), onchange: () => this.choose(policy) });
    const [wrong, list] = [element("div"), element("div")];
    findings(wrong, rows.filter(({ verdict }) => verdict === "fail"));
    findings(list, rows.filter(({ verdict }) => verdict !== "fail"));
    const counts = [[warns, "to know of"], [skips, "not checked"]].filter(([count]) => count).map(([count, text]) => `${count} ${text}`);
    return element("div", { className: "policy", tone: fails ? "fail" : warns ? "warn" : "pass" },
      element("div", { className: "row" }, input, element("label", { for: input.id }, element("b", {}, policy), ` ${what}`)),
      wrong, element("details", {}, element("summary", {}, counts.join(", ") || (fails ? "The rest is well" : "All is well")), list));
  }

  async choose(policy) {
    showText(this.problem, await this.store.change({ "call.policy": policy }));
    this.show();
  }

  show() {
    const own = this.store.value("call.policy");
    for (const input of this.cards.querySelectorAll("input")) input.checked = input.value === own;
  }

  done() {
    return Boolean(this.result);
  }
}
