// The remembered place whose words are in force by a match.

import { changed, element, showFacts, showText } from "./elements.js";
import { Turning } from "./turning.js";
import { turned } from "./weights.js";
import { clock } from "./wording.js";

// known: as in /state.json.
export function place(known, { answers = false } = {}) {
  const changes = Object.entries(known.changed ?? {}).map(([word, [was, now]]) =>
    now == null ? `${word} out of use` : was == null ? `${word} ${now}` : `${word} ${now} (was ${was})`);
  return {
    title: known.call ? `Known place: that of call ${known.call}` : "Known place",
    picture: (known.picture ?? "").replace(/^(\/calls\/\d+)\.jpg$/, "$1-large.jpg"),
    rows: [
      ["similarity", known.similarity == null ? "" : `${floored(known.similarity)}${known.needed == null ? "" : `, at least ${raised(known.needed)} is needed`}`],
      ["since", known.since === undefined ? "" : known.since ? clock(known.since) : "not known"],
      ["changed", changes.join(", ") || "no word"],
      ["wrong?", answers ? "" : `Not the same place: type \`other place${known.call ? ` ${known.call}` : ""}\` on the ground.`],
    ].filter(([, text]) => text),
  };
}

export class KnownPlace {
  // refuse: called with the number of its call, 0 for none, when it is another place; returns a promise of "" or of what is
  // wrong. null where nobody may answer. say: reads aloud.
  constructor(heading, refuse = null, say = null) {
    this.refuse = refuse;
    this.answers = refuse !== null;
    this.turning = new Turning(say);
    this.title = element(heading);
    this.note = element("p", { className: "note" });
    this.picture = element("img", { alt: "The remembered place whose words are in force", onload: () => this.showPicture(true), onerror: () => this.showPicture(false) });
    this.facts = element("dl", { className: "facts" });
    this.problem = element("p", { className: "problem" });
    const other = refuse && element("button", { type: "button", className: "plain", onclick: () => this.takeBack() }, "It is another place");
    this.part = element("figure", { className: "place", hidden: true }, element("div", { className: "frame pane" }, this.picture, this.note),
      element("figcaption", {}, this.title, this.facts, other, this.turning.part, this.problem));
  }

  // Words that the match set are as before it again.
  async takeBack(agreed = null) {
    const both = Object.entries(this.known.changed ?? {}).filter(([, [was, now]]) => was != null && now != null);
    const own = { of: new Map(both.map(([word, [, now]]) => [word, now])), read: true };
    const turns = turned(both.map(([word, [weight]]) => ({ word, weight })), own), what = JSON.stringify(this.known);
    if (turns.length && what !== agreed) return this.turning.ask(turns, { what, and: ", as before", agreed: () => this.takeBack(what) });
    showText(this.problem, await this.refuse(this.known.call ?? 0));
  }

  // known: null where no place is in force.
  show(known) {
    this.part.hidden = !known;
    changed(this.part, known ?? null, () => {
      this.known = known;
      this.turning.withdraw();
      if (!known) return;
      const { title, picture, rows } = place(known, this);
      showText(this.title, title);
      showFacts(this.facts, rows);
      this.showPicture(false);
      if (picture) this.picture.src = picture;
      else this.picture.removeAttribute("src");
    });
  }

  showPicture(there) {
    this.picture.hidden = !there;
    showText(this.note, there ? "" : "No picture of it is kept.");
  }
}

const raised = (share) => (Math.ceil(100 * share - 1e-4) / 100).toFixed(2);
const floored = (share) => (Math.floor(100 * share + 1e-4) / 100).toFixed(2); // one that is shown as 1 is 1
