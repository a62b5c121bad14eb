// Asks once more, in red, before an answer turns the sign of a word.

import { element, showText } from "./elements.js";
import { turnText } from "./weights.js";
import { signed } from "./wording.js";

export class Turning {
  // say: reads aloud.
  constructor(say) {
    this.say = say;
    this.texts = element("div");
    this.keep = element("button", { type: "button", onclick: () => this.over(this.refused) });
    this.turn = element("button", { type: "button", className: "turn", onclick: () => this.over(this.agreed) });
    this.part = element("div", { className: "turning", role: "group", "aria-label": "Turn a sign?", hidden: true,
      onkeydown: (event) => { if (event.key === "Escape") this.over(this.refused); } },
      this.texts, element("div", { className: "motions" }, this.keep, this.turn));
  }

  // turned: of `weights.js`. what: the same only for the same question. and: what is sent besides, for a person. agreed, refused: called once.
  ask(turned, { what, and = "", agreed, refused = () => {} }) {
    Object.assign(this, { what, agreed, refused });
    this.before ??= document.activeElement;
    this.texts.replaceChildren(...turned.map((one) => element("p", {}, turnText(one))));
    showText(this.keep, `Keep ${turned.map(({ word, was }) => `${word} ${was === null ? "as it is" : signed(was)}`).join(", ")}`);
    showText(this.turn, `Turn ${turned.map(({ word, weight }) => `${word} to ${signed(weight)}`).join(", ")}${and}`);
    this.part.hidden = false;
    this.keep.focus(); // who presses a key twice turns nothing
    this.say(`${this.texts.textContent} Turn it?`);
  }

  get asks() {
    return !this.part.hidden;
  }

  // Takes the question back, unless it is still the same.
  withdraw(what = null) {
    if (this.asks && this.what !== what) this.over();
  }

  over(then) {
    const { before } = this, held = this.part.contains(document.activeElement);
    this.part.hidden = true;
    this.before = null;
    if (held && before?.isConnected) before.focus();
    then?.();
  }
}
