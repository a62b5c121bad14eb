// Lists the recordings while somebody wants to see them, the newest first, and opens one.

import { arrange, element, showText } from "./elements.js";
import { overview, named, rowEvents, rowNote, rowText, rowTitle } from "./recorded.js";
import { Replay, frameUrl } from "./replay.js";
import { PATIENCE } from "./stream.js";
import { capital } from "./wording.js";

const EVERY = 10_000, SOON = 1000; // ms

export class Recordings {
  constructor(home, say) {
    Object.assign(this, { home, say, pages: 1, rows: new Map(), replay: null, reading: false, again: false, timer: 0 });
    this.text = element("p");
    this.toggle = element("button", { type: "button", className: "plain", "aria-expanded": "false", onclick: () => this.turn() }, "Show recordings");
    this.problem = element("p", { className: "problem" });
    this.place = element("div");
    this.list = element("ul", { className: "recordings" });
    this.more = element("button", { type: "button", className: "plain", hidden: true, onclick: () => (this.pages++, this.refresh()) }, "Show older ones");
    this.body = element("div", { hidden: true }, this.problem, this.place, this.list, this.more);
    home.append(this.text, this.toggle, this.body);
    document.addEventListener("visibilitychange", () => this.refresh());
  }

  // send: posts what is asked; null where the page only shows.
  begin(send) {
    this.replay = new Replay(send, this.say, () => this.close());
  }

  // told: what the companion says of recording.
  show(told = {}) {
    showText(this.text, overview(told));
  }

  turn() {
    this.body.hidden = !this.body.hidden;
    this.toggle.setAttribute("aria-expanded", String(!this.body.hidden));
    showText(this.toggle, this.body.hidden ? "Show recordings" : "Hide recordings");
    this.refresh();
  }

  async refresh() {
    clearTimeout(this.timer);
    this.again = this.reading;
    if (this.body.hidden || document.hidden || this.reading) return;
    this.reading = true;
    let wait = EVERY;
    try {
      const rows = [];
      let older = true, why = "";
      for (let page = 0; page < this.pages && older; page++) {
        const told = await read(rows.length ? `?before=${rows.at(-1).number - 1}` : "");
        rows.push(...told.recordings);
        ({ older, why = "" } = told);
      }
      this.more.hidden = !older;
      showText(this.problem, why);
      this.showRows(rows);
      if (rows.some(({ unread }) => unread)) wait = SOON;
    } catch (error) {
      showText(this.problem, `The list did not come: ${error.message}`);
    } finally {
      this.reading = false;
      this.timer = setTimeout(() => this.refresh(), this.again ? 0 : wait);
    }
  }

  showRows(rows) {
    const there = new Set(rows.map(({ number }) => number));
    for (const [number, row] of this.rows) if (!there.has(number)) row.part.remove(), this.rows.delete(number);
    for (const { number } of rows) if (!this.rows.has(number)) this.rows.set(number, new Row(() => this.open(number)));
    arrange(this.list, rows.map(({ number }) => this.rows.get(number).part));
    for (const data of rows) this.rows.get(data.number).show(data, data.number === this.opened);
    if (this.opened === undefined) return;
    const open = this.rows.get(this.opened);
    if (open) this.replay.show(open.data);
    else this.say(`${capital(named({ number: this.opened }))} is gone.`), this.close();
  }

  open(number) {
    if (!this.replay) return;
    this.opened = number;
    this.place.append(this.replay.part);
    this.replay.show(this.rows.get(number).data);
    this.rows.forEach((row) => row.show(row.data, row.data.number === number));
    this.replay.title.focus();
  }

  close() {
    const row = this.rows.get(this.opened);
    this.opened = undefined;
    const held = this.replay.part.contains(document.activeElement);
    this.replay.part.remove();
    row?.show(row.data, false);
    if (held) (row?.button ?? this.toggle).focus();
  }
}

// One recording of the list: a button that opens it.
class Row {
  constructor(open) {
    this.failed = false;
    this.image = element("img", { alt: "", loading: "lazy", hidden: true, onerror: () => (this.image.hidden = this.failed = true) });
    this.title = element("b");
    this.text = element("span");
    this.events = element("span", { className: "what" });
    this.note = element("span", { className: "faint" });
    this.button = element("button", { type: "button", className: "recording", onclick: open },
      element("span", { className: "thumb" }, this.image), element("span", { className: "told" }, this.title, this.text, this.events, this.note));
    this.part = element("li", {}, this.button);
  }

  show(data, opened) {
    this.data = data;
    showText(this.title, rowTitle(data));
    showText(this.text, rowText(data));
    showText(this.events, rowEvents(data).join(", "));
    showText(this.note, rowNote(data));
    this.button.setAttribute("aria-pressed", String(opened));
    const at = data.frames ? data.events?.find(({ id }) => id)?.at ?? Math.round(500 * data.seconds) : null;
    if (at === null || (this.image.src && !this.failed)) return;
    this.failed = false; // a picture that did not come is asked for again
    this.image.hidden = false;
    this.image.src = frameUrl(data, at);
  }
}

async function read(query) {
  const answer = await fetch(`/recordings.json${query}`, { signal: AbortSignal.timeout(PATIENCE) }).catch(() => null);
  if (!answer) throw new Error("the rover does not answer.");
  if (!answer.ok) throw new Error((await answer.text()).trim());
  return answer.json();
}
