// Has an incident file packed, one zip to send to somebody, and shows what became of that.

import { changed, element, showText } from "./elements.js";
import { capital, duration, size } from "./wording.js";

let numbered = 0;

export class Incident {
  // post: posts (kind, content), and returns a promise of "" or of what is wrong.
  constructor(post, say) {
    Object.assign(this, { post, say, busy: false, asked: false, here: 0 });
    this.text = element("p", { id: `incident${++numbered}`, className: "faint" });
    this.ask = element("button", { type: "button", className: "plain", "aria-describedby": this.text.id, onclick: () => this.send("incident", {}) });
    this.problem = element("p", { className: "problem" });
    this.files = element("ul");
    this.part = element("div", { className: "incident", hidden: true }, this.ask, this.text, this.problem, this.files);
  }

  // what: what it is about, for a person. whose: rover and call, as they are posted. data: null where nobody may ask for one.
  show(what, whose, data) {
    this.whose = whose;
    this.part.hidden = !data;
    if (!data) return;
    this.ask.disabled = data.busy;
    showText(this.ask, `Pack an incident file of ${what}`);
    changed(this.files, data.files, (list) => list.replaceChildren(...data.files.map((file) => element("li", {}, ...(file.url ? saved(file) : this.fetched(file))))));
    changed(this.text, data.text, (part) => part.replaceChildren(data.text));
    const here = data.files.filter(({ url }) => url).length;
    if (this.asked && this.busy && !data.busy) this.say(`Incident file of ${what}: ${data.text || "it is packed."}`);
    else if (this.asked && here > this.here) this.say(`An incident file of ${what} is here.`);
    Object.assign(this, { busy: data.busy, here });
  }

  // A file that is still on the rover.
  fetched({ name, what, bytes, waits, received, seconds, problem, fetchable }) {
    const button = (kind, text) => element("button", { type: "button", className: "plain", onclick: () => this.send(kind, { name }) }, text);
    const time = (share) => (seconds === null ? "" : `, about ${duration(seconds * share)}`);
    if (waits) {
      return [element("progress", { max: bytes, value: received, "aria-label": `Fetching ${what}` }),
        ` ${size(received)} of ${size(bytes)}${time(1 - received / bytes)}. `, button("stop", `Stop fetching ${what}`)];
    }
    if (!fetchable) return [`${capital(what)} (${size(bytes)}): ${problem}.`];
    const begun = received ? `, ${size(received)} are here` : "";
    return [button("fetch", `${received ? "Go on fetching" : "Fetch"} ${what} (${size(bytes)}${begun}${time(1 - received / bytes)})`),
      problem ? element("p", { className: "problem" }, `It did not come: ${problem}.`) : ""];
  }

  async send(kind, more) {
    this.asked = true;
    showText(this.problem, await this.post(kind, { ...this.whose, ...more }));
  }
}

// A file that is here.
const saved = ({ what, bytes, url }) => [element("a", { className: "save", href: url, download: "" }, `Save ${what} (${size(bytes)})`)];
