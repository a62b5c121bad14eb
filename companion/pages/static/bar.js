// A bar that stays in view on a small screen: why the first open call was made, go and stay.

import { element, showText } from "./elements.js";

export class AnswerBar {
  // first: returns the card of the first open call, or nothing. whose: which rover's it is, for a person; "" where there is one.
  constructor(first, whose = () => "") {
    Object.assign(this, { first, whose });
    this.why = element("button", { type: "button", className: "why", title: "Show the call", onclick: () => this.first()?.look() });
    this.told = element("p", { className: "told" });
    this.go = element("button", { type: "button", className: "go", onclick: () => this.send("go") });
    this.stay = element("button", { type: "button", onclick: () => this.send("stay") });
    this.part = element("section", { className: "bar", "aria-label": "Open call", hidden: true },
      this.why, this.told, element("div", { className: "motions" }, this.go, this.stay));
    document.body.append(this.part);
    document.addEventListener("input", () => this.show());
    document.addEventListener("click", () => this.show());
  }

  show() {
    const card = this.first();
    this.part.hidden = !card;
    document.body.classList.toggle("asked", Boolean(card));
    if (!card) return;
    const { name, reason, answers } = card.data;
    showText(this.why, `${this.whose(card)}${name}: ${reason}`);
    showText(this.told, card.problem.textContent || answers.at(-1)?.text || "");
    for (const motion of ["go", "stay"]) showText(this[motion], card.buttons[motion].textContent);
  }

  async send(motion) {
    const card = this.first();
    await card?.send(motion);
    this.show();
  }
}
