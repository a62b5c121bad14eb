// The words in force as sliders. While a call is open, what is changed waits for its answer; else it is sent at once.
// Where nobody may answer they only show.

import { changed, element, showText } from "./elements.js";
import { say } from "./sending.js";
import { Turning } from "./turning.js";
import { ownWeights, plain, propose, turned } from "./weights.js";
import { signed, weightText } from "./wording.js";

class Staged {
  constructor() {
    this.changes = new Map(); // word -> weight, null: out of use
  }

  list() {
    return [...this.changes].map(([word, weight]) => (weight === null ? { forget: word } : { word, weight }));
  }

  text() {
    const parts = [...this.changes].map(([word, weight]) => (weight === null ? `${word} out of use` : `${word} ${signed(weight)}`));
    return parts.length ? `With the answer go: ${parts.join(", ")}.` : "";
  }

  clear() {
    this.changes.clear();
  }
}

export class Words {
  // send: posts what is changed; null where words are only shown. refresh: called when a change waits.
  constructor(system, send = null, refresh = null) {
    Object.assign(this, { system, post: send, refresh, busy: 0 });
    this.staged = new Staged();
    this.rows = new Map();
    this.list = element("ul", { className: send ? "sliders" : "sliders shown" });
    this.note = element("p", { className: "faint" });
    this.problem = element("p", { className: "problem" });
    this.word = element("input", { type: "text", id: `new${system}`, maxLength: 48, autocomplete: "off" });
    this.turning = new Turning(say);
    this.part = element("div", { onkeydown: (event) => { if (event.key === "Escape" && this.turning.asks) this.reset(); } }, this.note, this.list, send && this.turning.part, this.problem, send &&
      element("form", { className: "field", onsubmit: (event) => { event.preventDefault(); this.add(); } },
        element("label", { htmlFor: this.word.id }, "New word"), this.word, element("button", { type: "submit", className: "plain" }, "Add")));
  }

  show(rover) {
    this.rover = rover;
    this.weights = ownWeights(rover);
    this.open = rover.calls.some((call) => call.open);
    this.turning.withdraw(this.question());
    if (!this.open && this.staged.changes.size && !this.busy && !this.turning.asks) this.staged.clear();
    const told = new Map(rover.words.map((one) => [one.word, one]));
    for (const [word, row] of this.rows) if (!told.has(word)) row.part.remove(), this.rows.delete(word);
    for (const one of told.values()) {
      if (!this.rows.has(one.word)) this.rows.set(one.word, this.row(one.word));
      const row = this.rows.get(one.word);
      row.show(one, this.staged.changes);
      if (row.part.parentNode !== this.list) this.list.append(row.part);
    }
    showText(this.note, !told.size ? "Its words are not known yet." : !rover.words_known ? "These are not all, or changed just now: they are asked for."
      : !this.post ? "" : this.open ? "What you change here goes with your answer." : "What you change here is sent at once.");
  }

  row(word) {
    const id = `w${this.system}-${word.replace(/[^a-z0-9]/g, "_")}`;
    const used = element("input", { type: "checkbox", id: this.post ? id : "", onchange: () => this.set(word, used.checked ? propose(word, null, this.weights, false).weight : null) });
    const slider = element("input", { type: "range", id: this.post ? "" : id, min: -1, max: 1, step: 0.1, "aria-label": `Weight of ${word}`, oninput: () => showText(text, signed(Number(slider.value))),
      onchange: () => this.set(word, Number(slider.value)) });
    const text = element("output");
    const part = element("li", {}, this.post && used, element("label", { htmlFor: id }, word), slider, text);
    return {
      part,
      show: ({ weight, fixed }, staged) => {
        const wanted = staged.has(word) ? staged.get(word) : weight;
        part.classList.toggle("staged", staged.has(word));
        changed(part, [wanted, fixed, staged.has(word)], () => {
          used.checked = wanted !== null;
          used.title = fixed ? "in use" : "in use; switched off it is forgotten";
          if (wanted !== null) slider.value = wanted;
          slider.disabled = wanted === null || !this.post;
          slider.setAttribute("aria-valuetext", weightText(wanted ?? 0));
          showText(text, wanted === null ? "off" : signed(wanted));
        });
      },
    };
  }

  add() {
    const word = plain(this.word.value);
    if (word) this.set(word, propose(word, null, this.weights, false).weight);
    this.word.value = "";
  }

  set(word, weight) {
    this.staged.changes.set(word, weight);
    if (this.open) return this.refresh();
    this.decide();
    this.show(this.rover); // the slider is drawn as changed, so that it is drawn anew when that is taken back
  }

  // While one change is on its way, it is not known from what the next one turns.
  decide() {
    const turns = turned(this.staged.list(), this.weights);
    if (!turns.length) this.submit();
    else if (!this.busy) this.turning.ask(turns, { what: this.question(), agreed: () => this.submit(), refused: () => this.reset() });
  }

  // Equal while the same words are turned in the same way. What goes with an answer is asked there.
  question() {
    return this.open ? null : JSON.stringify(turned(this.staged.list(), this.weights));
  }

  reset() {
    this.turning.withdraw();
    this.staged.clear();
    this.show(this.rover);
  }

  async submit() {
    this.turning.withdraw();
    const sent = new Map(this.staged.changes);
    this.busy += 1;
    const problem = await this.post("answer", { rover: this.system, call: null, motion: "none", changes: this.staged.list() });
    showText(this.problem, problem);
    this.busy -= 1;
    for (const [word, weight] of sent) if (this.staged.changes.get(word) === weight) this.staged.changes.delete(word); // not what was changed meanwhile
    if (problem) this.reset();
    else if (!this.busy && this.staged.changes.size) this.decide();
  }
}
