// One call as somebody sees it who may answer it.

import { changed, element, showText } from "./elements.js";
import { CallView } from "./call_view.js";
import { Incident } from "./incident.js";
import { capital, signed, weightText } from "./wording.js";

const READ = 2; // seconds for which a call that took another's place takes no answer: it may be meant for that one

export class AnswerCard extends CallView {
  // send: posts, and returns a promise of "" or of what is wrong. staged: words set by sliders for this answer.
  // heading: its tag, as deep as the card is in the page.
  constructor(system, send, say, staged, heading) {
    super((box) => this.point(box), heading);
    Object.assign(this, { system, post: send, say, staged });
    this.shownAt = performance.now() / 1000;
    this.replaces = false;
    this.todo = element("p", { className: "todo" });
    this.first = element("p", { className: "first" });
    this.undo = element("button", { type: "button", className: "plain", onclick: () => this.takeBack() }, "Undo: forget what this taught");
    this.problem = element("p", { className: "problem" });
    this.becoming.before(this.todo, this.first, this.form(), this.problem);
    this.incident = new Incident(send, say);
    this.ask.append(this.undo, this.incident.part);
  }

  form() {
    const options = `${this.id}-names`;
    this.word = element("input", { type: "text", id: `${this.id}-word`, maxLength: 48, autocomplete: "off", spellcheck: false, list: options, oninput: () => this.refresh() });
    this.options = element("datalist", { id: options });
    this.weight = element("input", { type: "range", id: `${this.id}-weight`, min: -1, max: 1, step: 0.1, value: -1, oninput: () => this.refresh() });
    this.weightText = element("output", { htmlFor: `${this.id}-weight` });
    this.chips = element("div", { className: "chips", role: "group", "aria-label": "Names used before" });
    this.about = element("select", { id: `${this.id}-about`, onchange: () => this.refresh() },
      element("option", { value: "tap" }, "the thing in the frame"), element("option", { value: "word" }, "all ground that fits the name"));
    this.also = element("p", { className: "faint" });
    this.buttons = {
      go: element("button", { type: "submit", className: "go" }),
      stay: element("button", { type: "button", onclick: () => this.send("stay") }),
      look: element("button", { type: "button", onclick: () => this.send("look") }, "Look again"),
      none: element("button", { type: "button", onclick: () => this.send("none") }),
    };
    this.naming = element("div", { className: "naming" },
      element("div", { className: "field" }, element("label", { htmlFor: this.word.id }, "Its name"), this.word, this.options),
      this.chips,
      element("div", { className: "field" }, element("label", { htmlFor: this.weight.id }, "Weight"), this.weight, this.weightText),
      element("div", { className: "field" }, element("label", { htmlFor: this.about.id }, "It names"), this.about),
      this.also);
    return this.entry = element("form", { onsubmit: (event) => { event.preventDefault(); this.send("go"); } },
      this.naming, element("div", { className: "motions", role: "group", "aria-label": "Answer" }, ...Object.values(this.buttons)));
  }

  show(data, rover, time) {
    const before = this.data;
    if (!before) {
      const object = data.reasons.includes("unknown_object") || data.box;
      this.weight.value = object ? -1 : 1;
      this.about.value = object ? "tap" : "word";
    }
    super.show(data, time);
    for (const name of ["todo", "first"]) showText(this[name], data[name] ?? "");
    this.entry.hidden = !data.open;
    this.naming.hidden = Boolean(data.test) || data.kind === "hold" && !data.box;
    this.showNames(rover);
    this.refresh();
    const last = data.answers.at(-1);
    changed(this.ask, last, () => before && last?.settled && this.say(`${data.name}: ${last.text}`));
    this.undo.hidden = !data.undo;
    this.incident.show(data.name, { rover: this.system, call: data.id }, data.test ? null : data.incident);
  }

  showNames(rover) {
    const seen = new Set();
    const names = [...rover.names, ...rover.words.map(({ word, weight }) => [word, weight])].filter(([word]) => !seen.has(word) && seen.add(word));
    changed(this.options, names, (list) => list.replaceChildren(...names.map(([word]) => element("option", { value: word }))));
    changed(this.chips, names.slice(0, 10), (part) => part.replaceChildren(...names.slice(0, 10).map(([word, weight]) =>
      element("button", { type: "button", className: "chip", onclick: () => this.choose(word, weight) }, word))));
  }

  sayTheSame({ nearest, open, test, box }) {
    return nearest.alike && open && !test && fitting(nearest.words, box)
      && element("button", { type: "button", className: "plain", onclick: () => this.takeOver(nearest.words) }, "Say the same");
  }

  // The first word is the thing's name; the others go with the answer.
  takeOver([[word, weight], ...others]) {
    for (const [other, its] of others) this.staged.changes.set(other, its);
    this.choose(word, weight);
  }

  choose(word, weight) {
    this.word.value = word;
    if (weight !== null) this.weight.value = weight;
    this.refresh();
    this.buttons.go.focus();
  }

  changes() {
    const word = this.word.value.trim(), weight = Number(this.weight.value);
    const box = this.own ?? this.data.box;
    const taps = this.about.value === "tap" && box;
    const own = word && !this.naming.hidden ? [taps ? { tap: word, weight, box, frame: this.data.frame } : { word, weight }] : [];
    return [...own, ...this.staged.list().filter((one) => (one.word ?? one.forget) !== word)];
  }

  refresh() {
    if (!this.data) return;
    const changes = this.changes();
    const shown = changes.filter((one) => one.weight !== undefined).map((one) => ({ word: one.tap ?? one.word, weight: one.weight }));
    const text = labels(shown);
    for (const name of ["go", "stay", "none"]) showText(this.buttons[name], text[name]);
    this.buttons.none.hidden = !changes.length;
    if (changes.length && !text.none) showText(this.buttons.none, "Only change the words");
    showText(this.weightText, weightText(Number(this.weight.value)));
    const box = this.own ?? this.data.box;
    this.about.firstChild.disabled = !box;
    if (!box && this.about.value === "tap") this.about.value = "word";
    showText(this.also, this.staged.text());
  }

  point(box) {
    this.own = box;
    if (box) this.about.value = "tap";
    for (const picture of [this.raw, this.judged]) picture.show({ ...picture.last, own: box });
    this.refresh();
  }

  clear() {
    this.point(null);
    this.word.value = "";
    this.staged.clear();
    this.refresh();
    showText(this.problem, "");
  }

  name() {
    this.word.focus();
  }

  aim() {
    this.raw.frame.focus();
  }

  async send(motion) {
    if (!this.data.open || this.sending) return;
    if (this.replaces && performance.now() / 1000 - this.shownAt < READ) {
      const problem = `${this.data.name} is new, so nothing was sent: read it, then answer.`;
      showText(this.problem, problem);
      return this.say(problem);
    }
    const changes = this.data.test ? [] : this.changes();
    this.sending = true;
    const problem = await this.post("answer", { rover: this.system, call: this.data.id, motion, changes });
    this.sending = false;
    showText(this.problem, problem);
    if (!problem) this.clear();
  }

  async takeBack() {
    showText(this.problem, await this.post("undo", { rover: this.system, call: this.data.id }));
  }
}

// What stands on the button that sends: motion with what was named.
export function labels(changes) {
  const named = changes.map(({ word, weight }) => `${word} ${signed(weight)}`).join(", ");
  return named
    ? { go: `${capital(named)}, and go`, stay: `${capital(named)}, and stay`, none: `${capital(named)}, nothing else` }
    : { go: "Go", stay: "Stay", none: "" };
}

// Whether words said elsewhere may be said here with one click: a thing is not named as ground that is driven on.
export const fitting = (words, box) => words.length > 0 && words.every(([, weight]) => (box ? weight <= 0 : weight > 0));
