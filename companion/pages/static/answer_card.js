// One call as somebody sees it who may answer it.

import { changed, element, showText } from "./elements.js";
import { CallView } from "./call_view.js";
import { Incident } from "./incident.js";
import { Turning } from "./turning.js";
import { ownWeights, plain, propose, turned } from "./weights.js";
import { capital, signed, weightText } from "./wording.js";

const READ = 2; // seconds for which a call that took another's place, or has other reasons, takes no answer: it may be meant for the one before
const AND = { go: ", and go", stay: ", and stay", look: ", and look again", none: "", undo: ", and undo" };

export class AnswerCard extends CallView {
  // send: posts, and returns a promise of "" or of what is wrong. staged: words set by sliders for this answer.
  // heading: its tag, as deep as the card is in the page.
  constructor(system, send, say, staged, heading) {
    super((box) => this.point(box), heading);
    Object.assign(this, { system, post: send, say, staged });
    this.todo = element("p", { className: "todo" });
    this.first = element("p", { className: "first" });
    this.undo = element("button", { type: "button", className: "plain", onclick: () => this.takeBack() }, "Undo: forget what this taught");
    this.problem = element("p", { className: "problem" });
    this.turning = new Turning(say);
    this.typed = null; // the weight that somebody chose
    this.sentAt = -Infinity; // when an answer went from this card
    this.hindered = null; // the motion that was not sent
    this.again = element("button", { type: "button", className: "again", onclick: () => this.sayAgain() });
    this.becoming.before(this.todo, this.first, this.again, this.form(), this.turning.part, this.problem);
    this.incident = new Incident(send, say);
    this.ask.append(this.undo, this.incident.part);
  }

  form() {
    const options = `${this.id}-names`;
    this.word = element("input", { type: "text", id: `${this.id}-word`, maxLength: 48, autocomplete: "off", spellcheck: false, list: options, oninput: () => this.refresh() });
    this.options = element("datalist", { id: options });
    this.weight = element("input", { type: "range", id: `${this.id}-weight`, min: -1, max: 1, step: 0.1, oninput: () => this.weigh(Number(this.weight.value)) });
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
    super.show(data, rover, time);
    this.weights = ownWeights(rover);
    if (data.reasons.length || !before) {
      this.object = data.reasons.includes("unknown_object") || Boolean(data.box);
      changed(this.about, [data.reasons, this.object], () => {
        if (before) this.mustBeRead("has changed");
        this.setDefaults();
      });
    }
    for (const name of ["todo", "first"]) showText(this[name], data[name] ?? "");
    this.entry.hidden = !data.open;
    this.naming.hidden = Boolean(data.test) || data.kind === "hold" && !data.box;
    this.showNames(rover);
    this.known = data.known;
    this.again.hidden = !this.known;
    if (this.known) showText(this.again, this.known.text);
    this.refresh();
    if (this.hindered) this.tell(this.hindrance(this.hindered), this.hindered);
    const last = data.answers.at(-1);
    changed(this.ask, last, () => before && last?.settled && this.say(`${data.name}: ${last.text}`));
    this.undo.hidden = !data.undo;
    this.incident.show(data.name, { rover: this.system, call: data.id }, data.test ? null : data.incident);
  }

  showNames(rover) {
    const seen = new Set();
    const names = [...rover.names.map(([word]) => word), ...rover.words.map(({ word }) => word)].filter((word) => !seen.has(word) && seen.add(word));
    changed(this.options, names, (list) => list.replaceChildren(...names.map((word) => element("option", { value: word }))));
    changed(this.chips, names.slice(0, 10), (part) => part.replaceChildren(...names.slice(0, 10).map((word) =>
      element("button", { type: "button", className: "chip", onclick: () => this.choose(word) }, word))));
  }

  sayTheSame({ nearest, open, test, box }) {
    return nearest.alike && open && !test && !box && fitting(nearest.words)
      && element("button", { type: "button", className: "plain", onclick: () => this.takeOver(nearest.words) }, "Say the same");
  }

  // The answer that was given to this thing before, by one click.
  sayAgain() {
    this.choose(this.known.word, this.known.weight);
    this.about.value = "tap";
    this.refresh();
    this.send(this.known.motion);
  }

  // The first word is the thing's name; the others go with the answer.
  takeOver([[word, weight], ...others]) {
    for (const [other, its] of others) this.staged.changes.set(other, its);
    this.choose(word, weight);
  }

  // weight: null for the one that is proposed.
  choose(word, weight = null) {
    this.word.value = word;
    this.weigh(weight);
    this.buttons.go.focus();
  }

  weigh(weight) {
    this.typed = weight;
    this.refresh();
  }

  get thing() {
    return this.object || Boolean(this.own);
  }

  setDefaults() {
    this.typed = null;
    this.about.value = this.thing ? "tap" : "word";
  }

  // An answer may be meant for what was here before.
  mustBeRead(why) {
    this.unread = { why: this.mustWait ? this.unread.why : why, since: performance.now() / 1000 };
  }

  get mustWait() {
    return this.unread && performance.now() / 1000 - this.unread.since < READ;
  }

  // Why this motion is not sent now, "" where it is. A stay waits for no answer: it takes back a go that is on its way.
  hindrance(motion) {
    if (this.mustWait) return `${this.data.name} ${this.unread.why}, so nothing was sent: read it, then answer.`;
    const waits = performance.now() / 1000 - this.sentAt < READ || this.data.answers.some((one) => !one.settled);
    return waits && motion !== "stay" ? `What you answered to ${this.data.name} was sent: wait for its answer, or say stay.` : "";
  }

  // hindered: the motion of which the problem tells for as long as it is so.
  tell(problem, hindered = null) {
    this.hindered = problem && hindered;
    showText(this.problem, problem);
  }

  // What the name is sent with.
  get proposed() {
    return propose(this.word.value, this.typed, this.weights, this.thing).weight;
  }

  changes() {
    const word = plain(this.word.value), weight = this.proposed;
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
    this.weight.value = this.proposed;
    showText(this.weightText, weightText(this.proposed));
    const box = this.own ?? this.data.box;
    this.about.firstChild.disabled = !box;
    if (!box && this.about.value === "tap") this.about.value = "word";
    showText(this.also, this.staged.text());
    this.turning.withdraw(this.question(this.motion, changes));
  }

  // Equal for answers that turn the same words in the same way.
  question(motion, changes) {
    if (motion === "undo") return this.data.undo && JSON.stringify([motion, turned(this.undone(), this.weights)]);
    return this.data.open ? JSON.stringify([motion, changes, turned(changes, this.weights)]) : null;
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
    this.setDefaults();
    this.refresh();
    this.tell("");
  }

  name() {
    this.word.focus();
  }

  aim() {
    this.raw.frame.focus();
  }

  // agreed: the question about turned words that somebody agreed to.
  async send(motion, agreed = null) {
    if (!this.data.open || this.sending) return;
    const hindrance = this.hindrance(motion);
    if (hindrance) {
      this.tell(hindrance, motion);
      return this.say(hindrance);
    }
    const changes = this.data.test ? [] : this.changes();
    const what = this.question(motion, changes), turns = turned(changes, this.weights);
    if (turns.length && what !== agreed) {
      this.motion = motion;
      this.tell("");
      return this.turning.ask(turns, { what, and: AND[motion], agreed: () => this.send(motion, what), refused: () => this.keep(turns) });
    }
    this.sending = true;
    const problem = await this.post("answer", { rover: this.system, call: this.data.id, motion, changes });
    this.sending = false;
    this.tell(problem);
    if (problem) return;
    this.sentAt = performance.now() / 1000;
    this.clear();
    this.leave();
  }

  // A single key that is typed next is an answer, not the first letter of a name.
  leave() {
    if (document.activeElement === this.word) this.title.focus({ preventScroll: true });
  }

  // These words keep the weights that they have.
  keep(turns) {
    for (const { word } of turns) this.staged.changes.delete(word);
    if (turns.some(({ word }) => word === plain(this.word.value))) this.typed = null;
    this.refresh();
  }

  undone() {
    return Object.entries(this.data.undo).map(([word, weight]) => ({ word, weight }));
  }

  async takeBack(agreed = null) {
    if (!this.data.undo) return;
    const what = this.question("undo"), turns = turned(this.undone(), this.weights);
    if (turns.length && what !== agreed) {
      this.motion = "undo";
      return this.turning.ask(turns, { what, and: AND.undo, agreed: () => this.takeBack(what) });
    }
    this.tell(await this.post("undo", { rover: this.system, call: this.data.id }));
  }
}

const named = (words) => words.map(([word, weight]) => `${word} ${signed(weight)}`).join(", ");

// What stands on the button that sends: motion with what was named.
export function labels(changes) {
  const text = capital(named(changes.map(({ word, weight }) => [word, weight])));
  return text ? { go: `${text}, and go`, stay: `${text}, and stay`, none: `${text}, nothing else` } : { go: "Go", stay: "Stay", none: "" };
}

// Whether words said of the ground elsewhere may be said here with one click: only as ground that is driven on.
const fitting = (words) => words.length > 0 && words.every(([, weight]) => weight > 0);
