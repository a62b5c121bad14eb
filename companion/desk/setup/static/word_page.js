// Page 5: words and weights, with the newest picture as they judge it.

import { ask } from "./api.js";
import { element, showFacts, showText } from "./elements.js";
import { problem } from "./parts.js";
import { Words } from "./words.js";

const EVERY = 1500; // ms between two pictures while nothing changes
const REASONS = { unknown_scene: "the scene is new", unknown_object: "something in the region is explained by no word", blocked: "the way is not drivable", fault: "it cannot judge" };

export class WordPage {
  constructor(store, live) {
    Object.assign(this, { store, live, seen: new Set() });
    this.words = new Words("", async (_kind, { changes }) => this.store.change({ words: this.after(changes) }));
    this.picture = element("img", { alt: "The picture with the judgement: green is drivable, orange is not, violet stripes are unknown", hidden: true });
    this.note = element("p", { className: "note" }, "The perceiver is being loaded.");
    this.verdict = element("p", { className: "verdict-box", role: "status" });
    this.facts = element("dl", { className: "facts" });
    this.problem = problem();
    const swatch = (kind, text) => element("li", {}, element("span", { className: `swatch ${kind}` }), text);
    this.part = element("div", { className: "columns picture-first" },
      element("section", {}, element("h2", {}, "What the words make of the picture"),
        element("div", { className: "frame pane" }, this.picture, this.note),
        element("ul", { className: "legend" }, swatch("drivable", "drivable"), swatch("blocked", "not drivable"), swatch("unknown", "unknown"), swatch("roi", "region of interest")),
        this.verdict, this.facts),
      element("section", {}, element("h2", {}, "Words"),
        element("p", {}, "From −1 (never drive) to +1 (drive). What no word explains is unknown, and calls you."),
        this.words.part, this.problem));
    this.feed = element("div", { hidden: true });
  }

  after(changes) {
    const words = { ...this.store.state.words };
    for (const { word, forget, weight } of changes) {
      if (forget) delete words[forget];
      else words[word] = weight;
    }
    return words;
  }

  enter() {
    this.part.append(this.feed);
    this.live.show(this.feed); // it keeps the camera open; the judged picture is shown in its place
    this.timer = setInterval(() => this.judge(), EVERY);
    this.judge();
  }

  leave() {
    clearInterval(this.timer);
  }

  show({ words, vocabulary }) {
    const used = Object.entries(words).map(([word, weight]) => ({ word, weight, fixed: vocabulary.includes(word) }));
    for (const word of [...vocabulary, ...Object.keys(words)]) this.seen.add(word); // so that one that is switched off stays
    const offered = [...this.seen].filter((word) => !(word in words)).map((word) => ({ word, weight: null, fixed: true }));
    this.words.show({ words: [...used, ...offered], words_known: true, calls: [], given: words, names: [] });
    if (this.part.isConnected) this.judge();
  }

  async judge() {
    if (document.hidden) return;
    if (this.judging) return void (this.again = true);
    this.judging = true;
    const { answer, problem: wrong } = await ask("/judge", {});
    this.judging = false;
    showText(this.note, this.picture.hidden ? wrong ?? "" : "");
    showText(this.problem, this.picture.hidden ? "" : wrong ?? "");
    if (answer) this.tell(answer);
    if (this.again) {
      this.again = false;
      this.judge();
    }
  }

  tell({ ok, reasons, shares, figures, misfit, model, seconds }) {
    this.count = (this.count ?? 0) + 1;
    this.picture.src = `/judged.jpg?n=${this.count}`;
    this.picture.hidden = false;
    this.verdict.dataset.tone = ok ? "good" : "warn";
    showText(this.verdict, ok ? "It would drive on here." : `It would call here: ${reasons.map((one) => REASONS[one] ?? one).join(", ")}.${misfit ? ` ${misfit}.` : ""}`);
    showFacts(this.facts, [
      ["Picture", Object.entries(shares).map(([name, share]) => `${Math.round(100 * share)} % ${name}`).join(", ")],
      ["Region", figures], ["Perceiver", `${model}, ${Math.round(1000 * seconds)} ms`],
    ]);
  }

  done(state) {
    return Boolean(this.count) && Object.values(state.words).some((weight) => weight > 0);
  }
}
