// Settings of the file: what is in force, what would change, and a second click that has it written.

import { DrawRegion } from "./draw_region.js";
import { element, showText } from "./elements.js";
import { SettingsList, differences } from "./settings_list.js";
import { capital } from "./wording.js";

const PATIENCE = 45_000; // ms; the companion needs less, and says why it failed
const SHELL = "Some values only in the shell.";

export class Settings {
  // picture: the live one, over which the region is drawn.
  constructor(home, say, picture) {
    Object.assign(this, { home, say, file: "", cannot: "", staged: new Map(), proposal: "", became: "", restarts: false, started: "", inMetres: false, lost: false, busy: false });
    this.mark = SHELL;
    this.rows = new Map(); // by key
    this.text = element("p", { role: "status" });
    this.why = element("p");
    this.ground = element("p", { className: "faint" });
    this.toggle = button("Show settings", () => this.turn(), { "aria-expanded": "false" });
    this.problem = element("p", { className: "problem" });
    this.problems = element("ul", { className: "problems" });
    this.diff = element("pre", { tabIndex: 0, role: "region", "aria-label": "Changes of the file", hidden: true });
    this.look = button("Show what would change", () => this.propose(), { hidden: true });
    this.write = button("Write and restart", () => this.have(), { hidden: true, className: "primary" });
    this.undo = button("Take all back", () => this.forget(), { hidden: true });
    this.review = element("div", { className: "review" }, this.text, this.problem, this.problems, this.diff, element("div", { className: "row" }, this.look, this.write, this.undo));
    this.place = element("div", { hidden: true });
    this.region = new DrawRegion(picture, this);
    home.append(this.toggle, this.why, this.ground, this.region.part, this.place, this.review);
  }

  // may: whether this page may change anything.
  begin(may) {
    this.home.hidden = !may;
  }

  // set: what the ground has set, of status.
  show(set = {}) {
    const given = Object.entries(set).map(([name, told]) => `${name} ${told.set}`);
    showText(this.ground, given.length && !this.place.hidden ? `Set by the ground meanwhile, and in force instead of the file's: ${given.join(", ")}.` : "");
  }

  // why: why there is no connection, "" while there is one.
  connection(why) {
    const back = this.lost && !why;
    this.lost = Boolean(why);
    if (back && !this.place.hidden) this.load();
  }

  async turn() {
    const shown = this.place.hidden;
    this.place.hidden = this.review.hidden = !shown;
    this.toggle.setAttribute("aria-expanded", String(shown));
    showText(this.toggle, shown ? "Hide settings" : "Show settings");
    if (shown) await this.load();
    else this.region.show(false);
  }

  async load() {
    const typed = this.list?.fields.find(({ field }) => field.edited && field.input === document.activeElement);
    if (typed) return typed.field.input.addEventListener("blur", () => this.load(), { once: true });
    const { answer, problem } = await ask("/settings.json");
    if (!answer?.rows) return showText(this.problem, problem || "The companion has told no settings yet: show them again.");
    const before = this.rows;
    this.rows = new Map(answer.rows.map((row) => [row.key, row]));
    if (this.restarts) {
      this.restarts = answer.started === this.started;
      this.became = this.restarts ? "It is written, and the companion was not started again yet: it takes effect when it is." : "It was written, and the companion was started again.";
    }
    Object.assign(this, { file: answer.file, cannot: answer.problem, inMetres: answer.in_metres, started: answer.started });
    for (const [key, value] of this.staged) {
      const now = this.rows.get(key);
      // A table made of an older one would take away what came meanwhile.
      const older = ["table", "lines"].includes(now?.form.type) && !same(now.value, before.get(key).value);
      if (older) this.became = `${key} was changed meanwhile: change it again.`;
      if (older || same(now?.value, value)) this.staged.delete(key);
    }
    const search = this.list?.search.value ?? "";
    this.list = new SettingsList(this, { shell: (row) => this.command(row), note: this.cannot ? "" : "What you change here waits until you have it written." });
    this.list.search.value = search;
    this.list.filter();
    this.place.replaceChildren(this.list.part);
    showText(this.why, this.cannot ? `${capital(this.cannot)}.` : "");
    this.changed();
  }

  command({ typed, shell }) {
    return shell || this.cannot ? `companion config set ${this.file || "FILE"} ${typed}=VALUE` : "";
  }

  row(key) {
    const row = this.rows.get(key);
    return this.staged.has(key) ? { ...row, value: this.staged.get(key), hidden: false, changed: true } : row;
  }

  async change(changes) {
    if (this.busy) return "Wait: the last change is being looked at.";
    for (const [key, value] of Object.entries(changes)) {
      const { value: now, hidden } = this.rows.get(key);
      if (!hidden && same(now, value)) this.staged.delete(key);
      else this.staged.set(key, value), (this.became = "");
    }
    this.changed();
    return "";
  }

  forget() {
    this.staged.clear();
    this.list.fields.forEach(({ field }) => field.forget?.());
    this.changed();
    this.look.hidden || this.look.focus();
  }

  // The changes are others now: what was shown does not count any more.
  changed() {
    this.proposal = "";
    this.tell(this.summary());
    this.wrong("");
    this.shown();
    this.list.show();
    this.region.show(!this.place.hidden && !this.cannot);
  }

  summary() {
    const count = this.staged.size, keys = [...this.staged.keys()].join(", ");
    return count ? `${count} ${count === 1 ? "setting is" : "settings are"} changed here, and not written: ${keys}.` : this.became;
  }

  shown() {
    const some = this.staged.size > 0;
    this.look.hidden = !some || Boolean(this.proposal);
    this.write.hidden = this.diff.hidden = !this.proposal;
    this.undo.hidden = !some;
    for (const one of [this.look, this.write, this.undo]) one.disabled = this.busy;
  }

  async propose() {
    const answer = await this.post("/settings/look", { changes: Object.fromEntries(this.staged) }, "The file is being checked …");
    if (!answer?.proposal) return;
    this.proposal = answer.proposal;
    this.diff.replaceChildren(...differences(answer.diff));
    this.tell("This would change. The companion then starts again, and sees nothing for some seconds.");
    this.shown();
    this.write.focus();
  }

  async have() {
    const answer = await this.post("/settings/write", { proposal: this.proposal }, "It is being written …");
    this.proposal = "";
    if (answer?.written) {
      this.restarts = answer.restarts;
      this.staged.clear();
      const what = answer.restarts ? "and the companion starts again, unless the vehicle is armed first: this page comes back by itself" : "and takes effect at the next start";
      this.became = `It is written, ${what}. ${capital(answer.text)}.`;
      this.changed();
    }
    this.shown();
  }

  async post(path, content, meanwhile) {
    this.busy = true;
    this.wrong("");
    this.tell(meanwhile);
    this.shown();
    const { answer, problem } = await ask(path, content);
    this.busy = false;
    this.tell(this.summary());
    const why = problem || answer?.problem;
    if (why) this.wrong(`Nothing was written: ${why}.`, answer?.problems);
    this.shown();
    return why ? null : answer;
  }

  tell(text) {
    showText(this.text, text);
  }

  wrong(text, rows = []) {
    showText(this.problem, text);
    this.problems.replaceChildren(...rows.map((row) => element("li", {}, row)));
    if (text) this.say(`${text} ${rows.join(" ")}`);
  }
}

const button = (text, onclick, properties = {}) => element("button", { type: "button", className: "plain", onclick, ...properties }, text);
const same = (a, b) => JSON.stringify(a ?? null) === JSON.stringify(b ?? null);

// content: posted as JSON; without it the path is read. Resolves to {answer}, with its problem, or to {problem}.
async function ask(path, content) {
  const posted = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content) };
  try {
    const answer = await fetch(path, { signal: AbortSignal.timeout(PATIENCE), ...(content === undefined ? {} : posted) });
    const text = await answer.text();
    const json = answer.headers.get("content-type")?.startsWith("application/json");
    return answer.ok && json ? { answer: JSON.parse(text) } : { problem: json ? JSON.parse(text).problem : text.trim() };
  } catch {
    return { problem: "the rover did not answer, so it is not known: look what is set" };
  }
}
