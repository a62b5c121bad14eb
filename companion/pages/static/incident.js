// Has an incident file packed, one zip to send to somebody, and shows what became of that.

import { arrange, changed, element, showText } from "./elements.js";
import { capital, duration, size } from "./wording.js";

let numbered = 0;

export class Incident {
  // post: posts (kind, content), and returns a promise of "" or of what is wrong.
  constructor(post, say) {
    Object.assign(this, { post, say, busy: false, asked: false, here: 0 });
    this.text = element("p", { id: `incident${++numbered}`, className: "faint" });
    this.ask = element("button", { type: "button", className: "plain", "aria-describedby": this.text.id, onclick: () => this.send("incident", {}) });
    this.cancel = element("button", { type: "button", className: "plain", onclick: () => this.sendCancel() });
    this.problem = element("p", { className: "problem" });
    this.files = element("ul");
    this.rows = new Map(); // name of a file -> FileRow
    this.part = element("div", { className: "incident", hidden: true }, this.ask, this.text, this.cancel, this.problem, this.files);
  }

  // what: what it is about, for a person. whose: rover and call, as they are posted. data: null where nobody may ask for one.
  show(what, whose, data) {
    this.whose = whose;
    this.part.hidden = !data;
    if (!data) return;
    this.ask.disabled = data.busy;
    showText(this.ask, `Pack an incident file of ${what}`);
    if (document.activeElement === this.cancel && !data.packing) this.ask.focus();
    this.cancel.hidden = !data.packing;
    showText(this.cancel, `Cancel packing of ${what}`);
    this.showFiles(data.files);
    changed(this.text, data.text, (part) => part.replaceChildren(data.text));
    const here = data.files.filter(({ url }) => url).length;
    if (this.asked && this.busy && !data.busy) this.say(`Incident file of ${what}: ${data.text || "it is packed."}`);
    else if (this.asked && here > this.here) this.say(`An incident file of ${what} is here.`);
    Object.assign(this, { busy: data.busy, here });
  }

  showFiles(files) {
    const names = files.map(({ name }) => name);
    for (const [name, row] of this.rows) if (!names.includes(name)) row.part.remove(), this.rows.delete(name);
    for (const name of names) if (!this.rows.has(name)) this.rows.set(name, new FileRow((kind) => this.send(kind, { name })));
    arrange(this.files, names.map((name) => this.rows.get(name).part));
    files.forEach((file) => this.rows.get(file.name).show(file));
  }

  // It goes the way of an answer, but belongs to no call.
  sendCancel() {
    return this.send("answer", { call: null, motion: "none", changes: [{ cancel_incident: this.whose.call ?? 0 }] });
  }

  async send(kind, more) {
    this.asked = true;
    showText(this.problem, await this.post(kind, { ...this.whose, ...more }));
  }
}

// One file: it is on the rover, on its way, or here. Its elements stay, since one of them may hold the focus.
class FileRow {
  // send: called with "fetch" or "stop".
  constructor(send) {
    const button = (kind) => element("button", { type: "button", className: "plain", onclick: () => send(kind) });
    this.link = element("a", { className: "save", download: "" });
    this.bar = element("progress");
    this.text = element("span");
    [this.fetch, this.stop] = ["fetch", "stop"].map(button);
    this.problem = element("p", { className: "problem" });
    this.part = element("li", {}, this.link, this.bar, this.text, this.fetch, this.stop, this.problem);
  }

  show({ what, bytes, url = "", waits = false, received = 0, seconds = null, problem = "", fetchable = false }) {
    const left = seconds === null ? "" : `, about ${duration(seconds * (1 - received / bytes))}`;
    const begun = received ? `, ${size(received)} are here` : "";
    const held = document.activeElement;
    this.link.hidden = !url;
    if (url) this.link.href = url;
    this.bar.hidden = this.stop.hidden = Boolean(url) || !waits;
    this.fetch.hidden = Boolean(url) || waits || !fetchable;
    this.text.hidden = Boolean(url) || (!waits && fetchable);
    if (held === this.fetch && waits) this.stop.focus();
    if (held === this.stop && !waits) (url ? this.link : this.fetch).focus();
    Object.assign(this.bar, { max: bytes, value: received });
    this.bar.setAttribute("aria-label", `Fetching ${what}`);
    showText(this.link, `Save ${what} (${size(bytes)})`);
    showText(this.text, waits ? ` ${size(received)} of ${size(bytes)}${left}. ` : `${capital(what)} (${size(bytes)}): ${problem}.`);
    showText(this.fetch, `${received ? "Go on fetching" : "Fetch"} ${what} (${size(bytes)}${begun}${left})`);
    showText(this.stop, `Stop fetching ${what}`);
    showText(this.problem, !url && fetchable && problem ? `It did not come: ${problem}.` : "");
  }
}
